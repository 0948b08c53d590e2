"""The benchmark: suites, the job graph (render -> track -> score -> report), and the command line.

Packages: config reads a suite; runner runs its jobs; external and third_party run other programs as trackers;
closed_loop flies on a tracker's poses; gate and history judge changes; cli is the command. Imports every other layer.
"""
