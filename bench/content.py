"""Content hashes: a result is fresh when the hash of all that entered it is the one it carries."""

import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.config_paths import names_a_file
from scenes.sequence import file_hash
from trajectories.errors import UserError
from trajectories.reading import read_json

PACKAGES = {"trajectories", "scenes", "tracker", "reports", "bench"}
PLAIN = {float, int, str, bool, type(None)}
ROOT = Path(__file__).parent.parent
LIBRARIES = ["numpy", "scipy", "opencv-python-headless", "numba", "mujoco", "trimesh", "pyrender", "PyOpenGL"]
"""Libraries whose version may change a frame or an estimate."""


def content_hash(*parts: Any) -> str:
    """sha256 of values in canonical form: plug-ins by class and fields, files by their content."""
    text = json.dumps([canonical(part) for part in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def canonical(value: Any) -> Any:
    """JSON form of a value; a dataclass carries its class, and, where it is a user's own, the hash of its source."""
    if type(value) in PLAIN:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        cls = type(value)
        form = {f.name: canonical(getattr(value, f.name)) for f in fields(cls)}
        form["class"] = f"{cls.__module__}:{cls.__qualname__}"
        if cls.__module__.split(".")[0] not in PACKAGES:
            form["source"] = _file_digest(Path(inspect.getfile(cls)))
        if hasattr(value, "entering_files"):
            form["entering_files"] = [_file_digest(path) for path in value.entering_files]
        for name in form:
            path = getattr(value, name, None)
            if names_a_file(name) and isinstance(path, str) and Path(path).is_file():
                form[name] = _file_digest(Path(path))
        return form
    if isinstance(value, Mapping):
        return {str(k): canonical(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [canonical(v) for v in value]
    return value


@cache
def code_hash(*packages: str) -> str:
    """Hash of the sources of these packages and of the versions of the libraries under them."""
    digest = hashlib.sha256(json.dumps({name: version(name) for name in LIBRARIES}).encode())
    for package in packages:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in {".py", ".xml", ".html", ".css", ".js", ".toml"}:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def carried_hash(path: Path) -> str | None:
    """Content hash that a JSON file carries, None when there is no such file or it is not whole."""
    try:
        return str(read_json(path)["content_hash"])
    except (UserError, KeyError):
        return None


def _file_digest(path: Path) -> str:
    return file_hash(path)
