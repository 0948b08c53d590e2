"""A sequence on disk: the contract between render, track and score.

In: images, poses and annotations. Out: folders that verify, and readers with errors for people. Imports rendering and
effects for the annotations, and the registries of plug-ins for the record of a spec.
"""
