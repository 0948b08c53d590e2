"""Gimbals: a camera whose pose on the body changes in flight.

In: parameters of the axes and the encoders, and the motion of the body. Out: angles of the joints, the pose of the
camera on the body at any time, and the encoders' readings. Imports of trajectories: camera mount, pose, sensor tables.
"""
