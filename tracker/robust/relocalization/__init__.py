"""Relocalization: pose search without a usable prediction.

In: an image and an uncertain guess. Out: fitted poses, best first. Imports edges and the fit.
"""
