"""Image effects in physical order: shutter, lens, sensor, processing, link.

In: a camera simulator of linear images, parameters and random generators. Out: a camera simulator. Imports
rendering.
"""
