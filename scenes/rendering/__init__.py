"""Rendering: GL context, shaders, shadow maps, baked light, antialiasing, and the camera simulator.

In: renderable parts and a moving camera. Out: linear radiance, depth and instances at any time. OpenGL's axis
convention is confined to this package. Imports nothing of structures or datasets.
"""
