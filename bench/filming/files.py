"""Files in the folder of a flight's video."""

VIDEO = "flight.webm"
MARKER = "video.json"
"""File that marks the folder as complete; holds the content hash of the video's inputs."""
