"""What the cameras of a spec take along a flight, and where they may be: what a dry run asks before a scene is built.

In: a spec, a flight, the structure as obstacles, the site or the room. Out: exposures, lenses and mounts, or what keeps
them from it. Imports the scene's parts and the camera simulator's lens; draws nothing.
"""
