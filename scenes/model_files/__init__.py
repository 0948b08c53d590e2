"""Structures from model files of the user: OBJ, STL, PLY, glTF, ViSP's CAO, IFC.

In: a file relative to the config. Out: a structure, validated before anything is rendered. Imports primitives and
materials; nothing of rendering.
"""
