"""Rendered sequences: cameras, structures, their surroundings, rendering, image effects, and sequences on disk.

Rooms: structures, world, site, clutter and model_files make what is seen; rendering and effects make images of it;
dataset writes and reads a sequence; exports writes it in other tools' formats. Imports trajectories.
"""
