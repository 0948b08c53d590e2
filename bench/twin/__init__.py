"""The path-traced twin of a sequence: the same scene, path, lens and shutter, with images rendered by Blender's Cycles.

In: a rendered sequence's folder. Out: a sequence folder with other images. Imports the config, the camera in flight,
and scenes; Blender is a separate program that is never imported (`blender_script.py` runs inside it).
"""
