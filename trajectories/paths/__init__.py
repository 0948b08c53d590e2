"""Flight paths: the reference that the vehicle flies.

In: obstacles around the structure, the camera's mount and a random generator. Out: reference rows for the controller,
one per control step. Imports geometry, trajectory files and the vehicle; never the simulation.
"""
