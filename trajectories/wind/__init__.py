"""The air: mean wind, gusts and Dryden turbulence.

In: parameters, a random generator and positions. Out: wind velocity in m/s in the world. Imports obstacles and poses.
"""
