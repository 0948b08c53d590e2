"""Where an export describes its files: the frame of their poses, which formats cannot tell."""

from pathlib import Path

EXPORT = "export.json"
"""Description of an export; it declares the frame for formats that cannot."""
LEVELS = 4
"""Number of parent folders of a file that are searched for it."""


def description_of(file: Path) -> Path | None:
    """The description of the export that a file may be of, the nearest one; None without one."""
    places = (folder / EXPORT for folder in file.resolve().parents[:LEVELS])
    return next((place for place in places if place.is_file()), None)
