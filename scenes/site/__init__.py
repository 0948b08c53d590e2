"""The site of a structure outdoors: terrain, water or a road beneath, embankments, markings, plants, shading.

In: a structure with its road and feet, and parameters. Out: parts that are no part of the structure's model. Imports
primitives and materials.
"""
