"""Filming: the frames of one camera along a flight, with its effects, written with their ground truth.

In: a scene, a flight, exposures, a mount and a lens. Out: the files of a camera's folder. Imports the camera simulator,
the effects and the files of a dataset.
"""
