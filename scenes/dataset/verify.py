"""Manifest of a folder: writing it, and verification against its files and against another rendering."""

import hashlib
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.sequence import EDGE_COLUMNS
from uavbench.scenes.dataset.table_files import ANEW, format_of, read_json, read_numbers
from uavbench.scenes.image_files import load_image
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import ANY
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.files.writing import write_text

if TYPE_CHECKING:
    import pandas as pd

TOLERANCE_LEVELS = 3
TOLERANCE_SHARE = 0.999
DEPTH_SHARE = 1e-4
"""Share of a depth by which drivers may differ: a GPU moves vertices to the nearest 1/256 px, which on ground seen at a
slant is as much (2 mm at 28 m from 9 m above it, measured on an NVIDIA H200)."""
EDGE_SHARE = 0.99
"""Least share of the visible length of edges that is the same: of few edges one sample is half a per cent."""
RENDERED = re.compile(r"(?:cameras/[^/]+/)?(frames|depth|mask|edges|flow|normals|occlusion)/")
"""Files that are drawn or cut out by OpenGL."""
SHEET = re.compile(r"(cameras/[^/]+/)?contact_sheet\.jpg")
"""Files made of the frames, which are compared themselves."""
SEALED = ("manifest.json",)
MACHINE = ("versions", "content_hash")
"""Keys of sequence.json that describe the machine and its libraries rather than the sequence."""


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
    """Write `manifest.json`: the sha256 of every file of the folder, by relative path, sorted.

    UserError where there is one, which may tell of files that were changed since.
    """
    if (folder / "manifest.json").exists():
        raise UserError(
            f"{folder / 'manifest.json'}: exists; `uavbench verify {folder}` tells what has changed since it was "
            "written, and once it is deleted a new one can be written of the files as they are"
        )
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
            problems.append(f"{name}: has changed since it was written")
    return Verdict(folder, "hash", len(named), tuple(problems))


def compare(folder: Path, again: Path) -> Verdict:
    """Compare a folder with another rendering of the same config.

    Each folder against its own manifest first: of one that has changed, nothing more is compared. Then by hash. Where
    frames differ (another Mesa or CPU), by tolerance: at most TOLERANCE_LEVELS grey levels on at least TOLERANCE_SHARE
    of the pixels. Of two GL drivers, what they render of the ground truth, too: on as many pixels the same mask, normal
    and flow, and a depth within a unit and DEPTH_SHARE; EDGE_SHARE of the edges. All else must be byte-identical. Of
    two formats nothing more is compared.
    """
    first, second = _manifest(folder), _manifest(again)
    if changed := (*verify(folder).problems, *(f"{again}: {problem}" for problem in verify(again).problems)):
        return Verdict(folder, "hash", len(first), changed)
    if (one := _format(folder)) != (other := _format(again)):
        problem = f"sequence.json: is of format {one}, the other of format {other}, whose bytes differ; render it again"
        return Verdict(folder, "hash", len(first), (problem,))
    problems = [f"{name}: is in only one of the two folders" for name in sorted(set(first) ^ set(second))]
    tolerant = {"frames"} if _driver(folder) == _driver(again) else set(COMPARED)
    by_tolerance: list[tuple[str, str]] = []
    for name in sorted(name for name in set(first) & set(second) if first[name] != second[name]):
        if (drawn := RENDERED.match(name)) and drawn[1] in tolerant:
            by_tolerance.append((name, drawn[1]))
        elif name == "sequence.json":
            if _without_machine(folder) != _without_machine(again):
                problems.append("sequence.json: differs in more than the machine's description")
        elif not SHEET.fullmatch(name):
            problems.append(f"{name}: differs; ground truth and sensors must be byte-identical")
    for name, kind in by_tolerance:
        if problem := COMPARED[kind](folder / name, again / name):
            problems.append(f"{name}: {problem}")
    return Verdict(folder, "tolerance" if by_tolerance else "hash", len(first), tuple(problems))


def _manifest(folder: Path) -> dict[str, str]:
    named = read_json(folder / "manifest.json").get("sha256")
    if not isinstance(named, dict):
        raise UserError(f"{folder / 'manifest.json'}: has no hashes; {ANEW}")
    return {str(name): str(digest) for name, digest in named.items()}


def _format(folder: Path) -> int:
    return format_of(folder / "sequence.json", read_json(folder / "sequence.json"))


def _without_machine(folder: Path) -> str:
    info = read_json(folder / "sequence.json")
    return json.dumps({key: value for key, value in info.items() if key not in MACHINE}, sort_keys=True)


def _driver(folder: Path) -> object:
    versions = read_json(folder / "sequence.json").get("versions")
    return versions.get("gl") if isinstance(versions, dict) else None


def _frames_differ(one: Path, other: Path) -> str:
    return _pixels_differ(one, other, TOLERANCE_LEVELS, f"by more than {TOLERANCE_LEVELS} levels")


def _truth_differs(one: Path, other: Path) -> str:
    return _pixels_differ(one, other, 0, "")


def _depth_differs(one: Path, other: Path) -> str:
    allowed = 1 + DEPTH_SHARE * load_image(one, cv2.IMREAD_UNCHANGED)
    return _pixels_differ(one, other, allowed, f"by more than 1 mm and {100 * DEPTH_SHARE:g} %")


def _pixels_differ(one: Path, other: Path, allowed: float | NDArray[np.floating[Any]], how: str) -> str:
    """What is wrong with the differences of two images' values beyond those allowed, per pixel; or nothing."""
    first, second = (load_image(path, cv2.IMREAD_UNCHANGED) for path in (one, other))
    if first.shape != second.shape:
        return "is of another size"
    off = np.abs(first.astype(np.int32) - second).reshape(*first.shape[:2], -1).max(axis=2)
    share = float((off > allowed).mean())
    return f"{100 * share:.3f} % of its pixels differ {how}".rstrip() if share > 1 - TOLERANCE_SHARE else ""


def _edges_differ(one: Path, other: Path) -> str:
    """What is wrong with the lengths of edges that are visible in one or the other alone, or nothing."""
    first, second = (_visible_px(path) for path in (one, other))
    both = first.reindex(first.index.union(second.index), fill_value=0.0)
    off, length = (second.reindex(both.index, fill_value=0.0) - both).abs().sum(), both.sum()
    if off <= (1 - EDGE_SHARE) * length:
        return ""
    return f"{off:.1f} px of its edges are visible in only one of the two, of {length:.0f} px"


def _visible_px(path: Path) -> "pd.Series[float]":
    """Visible length of each edge in px, by the row of the edge."""
    import pandas as pd

    rows = pd.DataFrame(read_numbers(path, list(EDGE_COLUMNS)), columns=list(EDGE_COLUMNS))
    rows["px"] = np.hypot(rows.u1_px - rows.u0_px, rows.v1_px - rows.v0_px)
    return rows.groupby("edge")["px"].sum()


COMPARED: dict[str, Callable[[Path, Path], str]] = {
    "frames": _frames_differ,
    "depth": _depth_differs,
    "mask": _truth_differs,
    "edges": _edges_differ,
    "flow": _truth_differs,
    "normals": _truth_differs,
    "occlusion": _truth_differs,
}
"""For each folder of rendered files: what is wrong with the differences of two of them, or nothing."""
