"""A sequence on disk: the contract between render, track and score.

In: images, poses and annotations. Out: folders with a manifest, and readers whose errors name the file. Imports
rendering and effects for the annotations, and the registries of plug-ins for the record of a spec.
"""
