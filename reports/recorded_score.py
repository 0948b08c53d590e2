"""Scores of runs on recordings of real images, whose errors are unknown without ground truth.

A score holds the frames with a pose, their times, and the share of the model's visible edges that coincide with an
image edge. The last tells a lost tracker from one that follows the structure; it does not measure accuracy.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from uavbench.reports.figures.tracker_pictures import View
from uavbench.reports.metrics.latency import Latency, deadline_misses, stage_latencies
from uavbench.reports.scoring.score import Status
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.results import MARKER, Results
from uavbench.tracker.run import stride
from uavbench.tracker.shang_shen.control_points import control_points
from uavbench.tracker.shang_shen.segments import detect_edge_pixels, grey
from uavbench.tracker.sound_results import sound
from uavbench.tracker.versions import versions
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, Pose

MEETS_PX = 2.0
"""Distance in px within which a model edge coincides with an image edge."""


@dataclass(frozen=True, kw_only=True)
class RecordedScore:
    """Score of one run on a recording.

    frames: number of expected frames; coverage: share of them with a pose; longest_gap_s: longest time without a pose;
    edges_met: mean share of the visible edges that coincide with an image edge, None without a pose.
    """

    label: str
    rate_hz: float
    seed: int
    sequence: str
    status: Status
    frames: int
    coverage: float
    longest_gap_s: float
    edges_met: float | None
    latency: dict[str, Latency]
    deadline_misses: float | None
    errors: tuple[str, ...]
    record: dict[str, Any]

    @property
    def run(self) -> str:
        """Name of tracker and rate, `lsd@30hz`."""
        return f"{self.label}@{self.rate_hz:g}hz"

    def save(self, path: Path, content_hash: str = "") -> None:
        """Write `score.json`; content_hash: of its inputs."""
        text = json.dumps({"content_hash": content_hash, **asdict(self)}, indent=1, allow_nan=False)
        write_text(path, text + "\n", kind=MARKER.kind)

    @classmethod
    def load(cls, path: Path) -> "RecordedScore":
        """Read what `save` wrote; UserError naming the file."""
        known: Mapping[str, Any] = {k: v for k, v in read_json(path).items() if k in cls.__dataclass_fields__}
        try:
            return _ADAPTER.validate_python(known)
        except ValidationError as error:
            first = error.errors()[0]
            raise UserError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}; score again") from None


_ADAPTER = TypeAdapter(RecordedScore)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """One tracker's results on one recording; expected (n,) are the frames that it had to locate."""

    sequence: Sequence
    results: Results

    @cached_property
    def expected(self) -> NDArray[np.int64]:
        """Expected frames (n,) of a run at this rate."""
        every = stride(self.sequence, float(self.results.record["rate_hz"]))
        return np.arange(0, len(self.sequence), every, dtype=np.int64)

    @cached_property
    def ok(self) -> NDArray[np.bool_]:
        """Whether each expected frame (n,) has a pose."""
        return np.asarray(np.isin(self.expected, self.results.frames[self.results.ok]))

    @cached_property
    def seconds(self) -> Array:
        """Time (n,) of the expected frames since the first."""
        return np.asarray((self.sequence.stamps_ns[self.expected] - self.sequence.stamps_ns[0]) / 1e9)

    @cached_property
    def edges_met(self) -> Array:
        """Share of the visible edges that meet an edge of the image, by expected frame (n,); NaN without a pose."""
        out = np.full(len(self.expected), np.nan)
        rows = {int(frame): row for frame, row in zip(self.results.frames, self.results.rows, strict=True)}
        for k, frame in enumerate(self.expected.tolist()):
            pose = rows[frame].cam_from_world if frame in rows else None
            if pose is not None:
                out[k] = edges_met(self.sequence, frame, pose)
        return out


def edges_met(sequence: Sequence, frame: int, cam_from_world: Pose) -> float:
    """Share of control points of the visible edges that have a Canny edge within MEETS_PX; 0 without any in view."""
    pixels = control_points(visible_edges(sequence.structure, sequence.camera, cam_from_world)).pixels
    if not len(pixels):
        return 0.0
    view = View.of(sequence.image(frame), sequence.camera, sequence.structure)
    away = cv2.distanceTransform(255 - detect_edge_pixels(grey(view.image)), cv2.DIST_L2, 5)
    h, w = away.shape
    column, row = np.rint(pixels).astype(int).T
    return float((away[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)] <= MEETS_PX).mean())


def score_recorded(sequence: Sequence, results: Results) -> RecordedScore:
    """Score of results on a recording."""
    results, unsound = sound(results)
    run, record = RecordedRun(sequence, results), results.record
    faults = tuple(str(e) for e in record.get("errors", ()))
    if len(results) < len(run.expected):
        faults += (f"{len(run.expected) - len(results)} of {len(run.expected)} frames have no row",)
    status: Status = "crashed" if faults else "complete" if run.ok.all() else "lost"
    met = run.edges_met[run.ok]
    return RecordedScore(
        label=str(record.get("label", record["tracker"]["kind"])),
        rate_hz=float(record["rate_hz"]),
        seed=int(record["seed"]),
        sequence=sequence.name,
        status=status if len(results) else "missing",
        frames=len(run.expected),
        coverage=float(run.ok.mean()),
        longest_gap_s=longest_gap_s(run.seconds, run.ok),
        edges_met=float(met.mean()) if len(met) else None,
        latency=stage_latencies(results),
        deadline_misses=deadline_misses(results),
        errors=faults + unsound,
        record={
            "compared": "with no ground truth: there is none",
            "edges_met": f"share of control points within {MEETS_PX:g} px of a Canny edge",
            "sequence": {"name": sequence.name, "content_hash": sequence.content_hash},
            "results": {k: record.get(k) for k in ("tracker", "rate_hz", "seed", "content_hash", "versions")},
            "versions": versions(),
        },
    )


def longest_gap_s(seconds: Array, ok: NDArray[np.bool_]) -> float:
    """Longest time from a frame without a pose to the next with one, or to the last frame."""
    longest = 0.0
    begin: float | None = None
    for t, good in zip(seconds.tolist(), ok.tolist(), strict=True):
        if begin is not None:
            longest = max(longest, t - begin)
        begin = None if good else t if begin is None else begin
    return longest
