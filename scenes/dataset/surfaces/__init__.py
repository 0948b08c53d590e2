"""Surface annotations of a frame: optical flow to the next frame, occlusion, and normals; depth between pixels.

In: the scene and two poses of the camera. Out: images in the established formats of optical flow. Imports rendering
for the geometry at each pixel.
"""
