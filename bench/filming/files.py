"""Files of a folder with the video of a flight."""

VIDEO = "flight.webm"
MARKER = "video.json"
"""Lists them, and carries the hash of what made them."""
