"""Every structure by its name."""

from scenes.box import Box

STRUCTURES: dict[str, type] = {
    "box": Box,
}
