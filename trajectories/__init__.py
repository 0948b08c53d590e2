"""Flights: poses, trajectories, flight paths, the MuJoCo quadrotor, wind, and body sensors.

Packages: paths, vehicle, wind and simulation for flights; sensors for measurements; trajectory_files and bags for
trajectory formats; geometry, kernels, files and processes as common foundations. Imports no other layer.
"""
