"""The published method of Shang & Shen, one stage a file; RAPID, Canny and LSD are its variants.

In: an image and the last pose. Out: the pose, and counts of segments, points and inliers. Imports the tracker protocol,
visible edges and geometry kernels; nothing of `robust`.
"""
