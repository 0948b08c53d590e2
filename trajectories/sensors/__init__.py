"""Body sensors: IMU, GNSS, barometer, optical flow.

In: the flight record and a random generator. Out: tables of measurements with their own stamps. Imports wind models
and geometry; nothing of the simulation.
"""
