"""The file that lists the folder of a flight in closed loop."""

from uavbench.trajectories.files.listed import Marker

MARKER = Marker("record.json", "flight in closed loop")
