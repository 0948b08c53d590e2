"""A reinforcement-learning environment of the closed loop, in the extra `uavbench[gym]`.

In: a suite of flights, and an agent's setpoints. Out: observations and rewards. Imports config, the closed loop and its
measures.
"""
