"""Files in the folder of a flight's video."""

from uavbench.trajectories.files.listed import Marker

VIDEO = "flight.webm"
MARKER = Marker("video.json", "video of a flight")
"""File that marks the folder as complete; holds the content hash of the video's inputs."""
