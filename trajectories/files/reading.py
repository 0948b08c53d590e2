"""Guarded reading of untrusted files: regular files, inside their folder, within a size limit."""

import codecs
import json
import os
import re
import stat
import tomllib
from io import BufferedReader
from pathlib import Path
from typing import Any

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.intact import refuse_damaged
from uavbench.trajectories.files.limits import JSON, MOST_NESTING, SETTINGS, FileLimit

DOTTED = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_NESTING}}}(?=[\w"'-])"""
)
"""A dotted key that is nested deeper than MOST_NESTING."""
HOLDS = {dict: "object", list: "list", str: "string", int: "number", float: "number", bool: "boolean"}


def opened(
    path: Path, limit: FileLimit, *, inside: Path | None = None, hint: str = "", damaged: bool = False
) -> BufferedReader:
    """Handle of a file of at most limit.most_bytes; links are followed, but not out of the folder `inside`.

    damaged: also a file that is not as a sealed list says. UserError naming the file when it is missing (the hint
    follows), is not a regular file, is outside, too large, or changed since uavbench wrote it.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # checked first, because opening some devices has side effects
            raise UserError(f"{path}: is not a regular file (it is a folder, a pipe or a device)")
        if inside is not None and not path.resolve().is_relative_to(inside.resolve()):
            raise _outside(path, inside)
        handle = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    except FileNotFoundError:
        raise UserError(f"{path}: no such file{hint}") from None
    except (OSError, ValueError, RuntimeError) as error:  # no permission, a cycle of links, a null character
        raise UserError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        found = os.fstat(handle.fileno())  # of the open file, since the path may have been replaced meanwhile
        if not stat.S_ISREG(found.st_mode):
            raise UserError(f"{path}: is not a regular file (it is a pipe or a device)")
        if inside is not None and not _place(handle.fileno(), path).is_relative_to(inside.resolve()):
            raise _outside(path, inside)
        if found.st_size > limit.most_bytes:
            raise _too_large(path, limit, found.st_size)
        if not damaged:
            refuse_damaged(path)
    except BaseException:
        handle.close()
        raise
    return handle


def given_path(key: str, value: Any) -> Path:
    """Path that a script gave as an argument; UserError naming the argument when it is none."""
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str):
        raise UserError(f"{key} = {value!r}: must be a path")
    return Path(value)


def read_bytes(path: Path, limit: FileLimit, *, inside: Path | None = None, hint: str = "") -> bytes:
    """Content of a file; UserError as `opened`."""
    with opened(path, limit, inside=inside, hint=hint) as handle:
        try:
            data = handle.read(limit.most_bytes + 1)  # the file may grow while it is read
        except OSError as error:
            raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) > limit.most_bytes:
        raise _too_large(path, limit, len(data))
    return data


def read_text(path: Path, limit: FileLimit = SETTINGS, *, inside: Path | None = None, hint: str = "") -> str:
    """Content of a UTF-8 file, with Unix line ends; UserError as `opened`, or when it is not text."""
    try:
        text = read_bytes(path, limit, inside=inside, hint=hint).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise not_text(path, error) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def not_text(path: Path, error: UnicodeDecodeError, where: str = "") -> UserError:
    """Error about a file that is not UTF-8; where: such as `line 3: `, by default the place is told in bytes."""
    if error.object.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return UserError(f"{path}: is text in UTF-16, as some programs on Windows write it; save it as UTF-8")
    return UserError(
        f"{path}: {where}not readable as text: {error.reason}" + ("" if where else f" at byte {error.start}")
    )


def read_toml(path: Path, *, inside: Path | None = None, hint: str = "") -> dict[str, Any]:
    """Table of a TOML file; UserError as `read_text`, or when it is not TOML or nested too deeply."""
    text = read_text(path, SETTINGS, inside=inside, hint=hint)
    try:
        return toml_table(text)
    except ValueError as error:
        raise UserError(f"{path}: not a readable TOML file: {error}") from None


def read_json(path: Path, *, limit: FileLimit = JSON, inside: Path | None = None, hint: str = "") -> dict[str, Any]:
    """Object of a JSON file; UserError as `read_text`, or when it is not JSON, nested too deeply, or not an object."""
    text = read_text(path, limit, inside=inside, hint=hint)
    try:
        value = json_value(text)
    except ValueError as error:
        raise UserError(f"{path}: not readable as JSON: {error}") from None
    if not isinstance(value, dict):
        raise UserError(f"{path}: expected a JSON object, not a {HOLDS.get(type(value), 'null')}")
    return value


def toml_table(text: str) -> dict[str, Any]:
    """Table of TOML text; ValueError when it is invalid or nested too deeply."""
    if DOTTED.search(text):  # tomllib is quadratic in the depth
        raise ValueError(_TOO_DEEP)
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _shallow(table)
    return table


def json_value(text: str | bytes) -> Any:
    """Value of JSON text; ValueError when it is invalid or nested too deeply."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _shallow(value)
    return value


_TOO_DEEP = f"it is nested deeper than {MOST_NESTING} levels"


def _shallow(value: Any) -> None:
    """ValueError when a value is nested too deeply for recursive processing."""
    level = [value]
    for _ in range(MOST_NESTING):
        level = [
            item
            for each in level
            if isinstance(each, dict | list)
            for item in (each.values() if isinstance(each, dict) else each)
            if isinstance(item, dict | list)
        ]
        if not level:
            return
    raise ValueError(_TOO_DEEP)


def _place(number: int, path: Path) -> Path:
    """Path of an open file by its descriptor, or the given path if the system has no such lookup."""
    try:
        return Path(f"/proc/self/fd/{number}").readlink()
    except OSError:
        return path.resolve()


def _outside(path: Path, inside: Path) -> UserError:
    return UserError(f"{path}: points outside the folder {inside}; do not trust its content")


def _too_large(path: Path, limit: FileLimit, size: int) -> UserError:
    return UserError(f"{path}: has {size:,} bytes; a {limit.kind} has at most {limit.most_bytes:,}: {limit.remedy}")
