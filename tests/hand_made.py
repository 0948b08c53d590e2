"""Folders as somebody makes them by hand."""

import json


def hand_made(folder):
    """The folder, with the seals taken off its lists, so that files in it can be changed."""
    for name in ("manifest.json", "record.json", "report.json"):
        if (folder / name).is_file():
            about = json.loads((folder / name).read_text())
            about.pop("made_by", None)
            (folder / name).write_text(json.dumps(about))
    return folder
