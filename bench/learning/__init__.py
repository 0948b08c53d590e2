"""An environment for learners over the closed loop, behind the extra `uavbench[gym]`.

In: a suite of flights, and an agent's setpoints. Out: observations and rewards. Imports config, the closed loop and its
measures.
"""
