"""The site of an outdoor structure: terrain, a river or road underneath, embankments, markings, vegetation, shading.

In: a structure with its roadway and footprints, and parameters. Out: parts that do not belong to the structure's
model. Imports primitives and materials.
"""
