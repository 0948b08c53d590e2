"""The flight loop: guidance, control, motors and aerodynamics, integrated by MuJoCo.

In: a flight's specification and obstacles. Out: a flight record, or an error that says why it cannot be flown. Imports
geometry, kernels, paths, vehicle and wind; nothing of sensors.
"""
