"""Quadrotors: airframes with their sources, their MuJoCo model, equations of motion and geometric control.

In: an airframe's parameters or a user's file. Out: a simulated vehicle and its controller. Imports poses, files and
geometry; nothing of paths, wind or sensors.
"""
