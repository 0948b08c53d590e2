"""A suite: one TOML file in, checked specs out, all mistakes told at once.

In: TOML. Out: frozen dataclasses. Imports inputs, and the plug-ins of all layers.
"""
