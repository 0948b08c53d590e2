"""Cameras, structures, clutter, rendering, image effects and sequences on disk."""
