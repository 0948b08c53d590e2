"""Sequences as ROS 2 bags: topics, messages, and where on Earth a world lies.

In: a sequence as an export shows it. Out: MCAP or SQLite. Imports the other exports' notes and EuRoC's view of an IMU.
"""
