"""Rendered sequences: cameras, structures and environments, rendering, image effects, and sequences on disk.

Packages: structures, world, site, clutter and model_files build the scene; rendering and effects make images of it;
dataset writes and reads sequences; exports converts them to the formats of other tools. Imports trajectories.
"""
