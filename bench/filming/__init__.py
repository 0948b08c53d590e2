"""Videos of flights in closed loop.

In: a flight's folder and the spec of its sequence. Out: a video. Imports the closed loop's camera, rendering and
drawing.
"""
