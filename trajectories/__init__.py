"""Flights: poses, trajectories, flight paths, the MuJoCo quadrotor, wind, and body sensors.

Rooms: paths, vehicle, wind and simulation fly; sensors measure; trajectory_files and bags read and write trajectories;
geometry, kernels and files are what all layers stand on. Imports no other layer.
"""
