"""Closed-loop simulation: the vehicle flies on its tracker's poses, in lockstep with the renderer.

In: a sequence's spec, a tracker and the table `[loop]` of a suite. Out: a flight, written by
`uavbench.reports.closed_loop`. Imports external programs' faults, the tracker's filter, rendering and simulation;
nothing of the runner.
"""
