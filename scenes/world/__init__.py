"""Environments around a structure: indoor, outdoor, studio.

In: parameters and a random generator. Out: parts and lights. Imports primitives and materials.
"""
