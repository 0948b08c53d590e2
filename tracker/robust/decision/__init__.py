"""The decision on each frame: accepted, ambiguous or lost; and where a run begins again after a loss.

In: a frame and its fit. Out: the best fit and its status. Imports the fit, places, relocalization, frames, and the
state of the track.
"""
