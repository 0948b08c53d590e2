"""Files that a config names, restricted to the config's own folder.

Suites are untrusted: they may read only files in their folder, links resolved, or in a folder listed in the
environment variable UAVBENCH_DATA (separated by colons; inherited by workers and Slurm jobs). The `command` of an
external tracker may be anywhere, since it runs with all the user's rights anyway.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

FREE = "UAVBENCH_DATA"
MOST_TOLD = 3
"""Links of one folder that are named."""


def names_a_file(key: str) -> bool:
    """Whether a config key holds the path of a file, by its name."""
    return key in {"file", "path"} or key.endswith(("_file", "_path"))


class Located(NamedTuple):
    """A config whose relative file names start at its folder, and a line for each that leads out of it."""

    config: Any
    outside: list[str]


def located(config: Any, folder: Path, at: str = "") -> Located:
    """The config with relative file names taken from its folder; `at` is the path of its key, for the lines."""
    if isinstance(config, list):
        pairs = [located(item, folder, f"{at}[{i}]") for i, item in enumerate(config)]
        return Located([item for item, _ in pairs], [line for _, lines in pairs for line in lines])
    if not isinstance(config, dict):
        return Located(config, [])
    found: dict[str, Any] = {}
    outside: list[str] = []
    for key, value in config.items():
        path = f"{at}.{key}" if at else key
        if names_a_file(key) and isinstance(value, str):
            found[key], lines = str(folder / value), _leading_out(value, folder, path)
        elif key == "input_files" and isinstance(value, list):
            found[key] = [_beside(word, folder) for word in value]
            lines = [line for word in value if isinstance(word, str) for line in _leading_out(word, folder, path)]
        elif key == "command" and isinstance(value, list):
            found[key], lines = [_beside(word, folder) for word in value], []
        else:
            found[key], lines = located(value, folder, path)
        outside += lines
    return Located(found, outside)


def _beside(word: Any, folder: Path) -> Any:
    """A word of a command, or a file: the file beside the config where there is one.

    Links are not resolved: the location of a virtual environment's interpreter determines the environment.
    """
    return str(folder.resolve() / word) if isinstance(word, str) and is_file(folder / word) else word


def _leading_out(name: str, folder: Path, at: str) -> list[str]:
    """A line where a file, or anything in a folder, lies neither in the config's folder nor in an allowed one."""
    free = [Path(word).resolve() for word in os.environ.get(FREE, "").split(os.pathsep) if word]
    roots = (folder.resolve(), *free)
    try:
        real = (folder / name).resolve()
        links = (path for path in (folder / name).rglob("*") if path.is_symlink())
        astray = [path for path in (real, *(path.resolve() for path in links)) if not _is_in(path, roots)]
    except (OSError, ValueError, RuntimeError) as error:
        return [f"{at}: {name!r} is no file name: {error}"]
    return [
        f"{at}: {name if path == real else path} lies outside of {folder.resolve()}, the folder of this file; copy it "
        f"there, or allow its own: {FREE}={path.parent}"
        for path in astray[:MOST_TOLD]
    ]


def _is_in(path: Path, roots: tuple[Path, ...]) -> bool:
    return any(path.is_relative_to(root) for root in roots)


def is_file(path: Path) -> bool:
    """Whether there is a file, False also where no file can have such a name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long, not allowed to look, or a null character
        return False
