"""A simulated human pilot: decisions with delay and imprecision, and a gamepad.

In: obstacles and the true state. Out: stick input turned into references by the assist mode. Imports references; no
other path.
"""
