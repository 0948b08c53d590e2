"""Body sensors: IMU, GNSS, barometer, optical flow, laser range finder, lidar.

In: the flight record and a random generator. Out: tables of measurements with their own stamps. Imports wind models,
the vehicle's constants and obstacles; nothing of the simulation.
"""
