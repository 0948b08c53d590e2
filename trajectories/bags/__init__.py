"""ROS 2 bags, MCAP and rosbag2, through the library rosbags (the optional extra `uavbench[bags]`).

In: a bag and one of its topics. Out: messages with their stamps, and trajectories with their declared frames. Imports
the file guards.
"""
