"""The flight loop: guidance, control, motors and air, integrated by MuJoCo.

In: a flight's description and obstacles. Out: a flight record, or a named reason why it cannot be flown. Imports
geometry, kernels, paths, vehicle and wind; nothing of sensors.
"""
