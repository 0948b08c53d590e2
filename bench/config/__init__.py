"""Suites: TOML files that are validated as a whole, with all errors reported at once.

In: TOML. Out: frozen dataclasses. Imports inputs, external and third-party trackers, and the plug-ins of all layers.
"""
