"""Users' own models: OBJ, STL, PLY, glTF, ViSP's CAO, IFC.

In: a file in the config's folder. Out: a structure that is checked before anything is rendered. Imports primitives
and materials; nothing of rendering.
"""
