"""A human pilot: what he wants to see, and the gamepad in his hands.

In: obstacles and the true state. Out: stick input turned into references by the assist mode. Imports references; no
other path.
"""
