"""Sequences as ROS 2 bags: topics, messages, and the geodetic datum of the world.

In: the images and readings of a sequence. Out: MCAP or SQLite. Imports the other exports' notes and EuRoC's
view of an IMU.
"""
