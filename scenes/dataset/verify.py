"""Manifest of a folder: writing it, and verification against its files and against another rendering."""

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from uavbench.scenes.dataset.table_files import format_of, read_json
from uavbench.scenes.image_files import load_image
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import ANY
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.files.writing import write_text

TOLERANCE_LEVELS = 3
TOLERANCE_SHARE = 0.999
IMAGE = re.compile(r"(cameras/[^/]+/)?frames/")
"""Magic bytes of image files."""
SEALED = ("manifest.json",)
MACHINE = ("versions",)
"""Keys of sequence.json that describe the machine rather than the sequence."""


@dataclass(frozen=True)
class Verdict:
    """Result for one folder: method of comparison, number of files, and a line for each problem."""

    folder: Path
    method: Literal["hash", "tolerance"]
    files: int
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether there are no problems."""
        return not self.problems


def write_manifest(folder: Path) -> None:
    """Write `manifest.json`: the sha256 of every file of the folder, by relative path, sorted."""
    hashes = {name: file_hash(folder / name) for name in sorted(_files(folder)) if name != "manifest.json"}
    write_text(folder / "manifest.json", json.dumps({"sha256": hashes}, indent=1) + "\n")


def file_hash(path: Path) -> str:
    """sha256 of a file, in hexadecimal."""
    with opened(path, ANY, damaged=True) as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _files(folder: Path) -> Iterator[str]:
    return (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def verify(folder: Path) -> Verdict:
    """Compare every file of a sequence folder with its manifest, by hash; UserError without a manifest."""
    named = _manifest(folder)
    there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} - set(SEALED)
    problems = [f"{name}: is not in the manifest" for name in sorted(there - set(named))]
    for name, digest in named.items():
        if name not in there:
            problems.append(f"{name}: is missing")
        elif file_hash(folder / name) != digest:
            problems.append(f"{name}: has changed since it was rendered")
    return Verdict(folder, "hash", len(named), tuple(problems))


def compare(folder: Path, again: Path) -> Verdict:
    """Compare a folder with another rendering of the same config.

    By hash first. Where only images differ (another Mesa or CPU), by tolerance: at most TOLERANCE_LEVELS grey levels on
    at least TOLERANCE_SHARE of the pixels. Ground truth and sensors must be byte-identical. Of two formats nothing more
    is compared.
    """
    first, second = _manifest(folder), _manifest(again)
    if (one := _format(folder)) != (other := _format(again)):
        problem = f"sequence.json: is of format {one}, the other of format {other}, whose bytes differ; render it again"
        return Verdict(folder, "hash", len(first), (problem,))
    problems = [f"{name}: is in only one of the two folders" for name in sorted(set(first) ^ set(second))]
    images: list[str] = []
    for name in sorted(set(first) & set(second)):
        if first[name] == second[name]:
            continue
        if IMAGE.match(name):
            images.append(name)
        elif name == "sequence.json":
            if _without_machine(folder) != _without_machine(again):
                problems.append("sequence.json: differs in more than the machine's description")
        else:
            problems.append(f"{name}: differs; ground truth and sensors must be byte-identical")
    for name in images:
        share = _share_within(folder / name, again / name)
        if not share >= TOLERANCE_SHARE:
            problems.append(
                f"{name}: {100 * (1 - share):.3f} % of its pixels differ by more than {TOLERANCE_LEVELS} levels"
            )
    return Verdict(folder, "tolerance" if images else "hash", len(first), tuple(problems))


def _manifest(folder: Path) -> dict[str, str]:
    named = read_json(folder / "manifest.json").get("sha256")
    if not isinstance(named, dict):
        raise UserError(f"{folder / 'manifest.json'}: has no hashes; render the sequence again")
    return {str(name): str(digest) for name, digest in named.items()}


def _format(folder: Path) -> int:
    return format_of(folder / "sequence.json", read_json(folder / "sequence.json"))


def _without_machine(folder: Path) -> str:
    info = read_json(folder / "sequence.json")
    return json.dumps({key: value for key, value in info.items() if key not in MACHINE}, sort_keys=True)


def _share_within(a: Path, b: Path) -> float:
    first, second = (load_image(path, cv2.IMREAD_UNCHANGED) for path in (a, b))
    if first.shape != second.shape:
        return 0.0
    off = np.abs(first.astype(np.int16) - second.astype(np.int16)).reshape(*first.shape[:2], -1).max(axis=2)
    return float((off <= TOLERANCE_LEVELS).mean())
