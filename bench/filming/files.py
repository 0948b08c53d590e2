"""Files in the folder of a flight's video."""

VIDEO = "flight.webm"
MARKER = "video.json"
"""Marks the folder as complete; holds the content hash of the video's inputs."""
