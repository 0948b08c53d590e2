"""Paths of files in a config, restricted to the config's own folder.

Suites are untrusted: after resolving links, they may read only files in their own folder or in folders listed in the
environment variable UAVBENCH_DATA (separated by colons; inherited by workers and Slurm jobs). The `command` of an
external tracker is not restricted, since the program has all rights of the user anyway.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

FREE = "UAVBENCH_DATA"
MOST_TOLD = 3
"""Most links of a folder that are listed in errors."""


def names_a_file(key: str) -> bool:
    """Whether a config key holds the path of a file, judged by its name."""
    return key in {"file", "path"} or key.endswith(("_file", "_path"))


class Located(NamedTuple):
    """A config with file names resolved against its folder, and an error line for each that is outside of it."""

    config: Any
    outside: list[str]


def located(config: Any, folder: Path, at: str = "") -> Located:
    """The config with relative file names resolved against its folder; at: path of its key, for error lines."""
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
    """The file of this name beside the config if there is one, else the word unchanged.

    Links are not resolved: the location of a virtual environment's interpreter determines the environment.
    """
    return str(folder.resolve() / word) if isinstance(word, str) and is_file(folder / word) else word


def _leading_out(name: str, folder: Path, at: str) -> list[str]:
    """Error line when a file, or a link in a folder, is neither in the config's folder nor in an allowed one."""
    free = [Path(word).resolve() for word in os.environ.get(FREE, "").split(os.pathsep) if word]
    roots = (folder.resolve(), *free)
    try:
        real = (folder / name).resolve()
        links = (path for path in (folder / name).rglob("*") if path.is_symlink())
        astray = [path for path in (real, *(path.resolve() for path in links)) if not _is_in(path, roots)]
    except (OSError, ValueError, RuntimeError) as error:
        return [f"{at}: {name!r} is not a file name: {error}"]
    return [
        f"{at}: {name if path == real else path} lies outside of {folder.resolve()}, the folder of this file; copy it "
        f"there, or allow its own: {FREE}={path.parent}"
        for path in astray[:MOST_TOLD]
    ]


def _is_in(path: Path, roots: tuple[Path, ...]) -> bool:
    return any(path.is_relative_to(root) for root in roots)


def is_file(path: Path) -> bool:
    """Whether a path is a file; False also for invalid names."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # name too long, permission denied, or a null character
        return False
