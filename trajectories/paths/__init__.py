"""Flight paths: what the vehicle is told to fly.

In: obstacles around the structure, the camera's mount and a random generator. Out: reference rows for the controller,
one for each control step. Imports geometry and the vehicle; never the simulation.
"""
