"""ROS 2 bags, MCAP and rosbag2, through the library rosbags (the optional extra `uavbench[bags]`).

In: a bag and a topic of it. Out: messages with their stamps, and trajectories with the frames that they say. Imports
the guards of files.
"""
