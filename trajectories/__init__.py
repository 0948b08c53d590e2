"""Poses, trajectories, flight paths and the MuJoCo quadrotor."""
