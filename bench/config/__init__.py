"""A suite: a TOML file checked as a whole, with every mistake reported at once.

In: TOML. Out: frozen dataclasses. Imports inputs, external and third-party trackers, and the plug-ins of all layers.
"""
