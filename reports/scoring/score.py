"""The score of one tracker's results on one sequence, with a record of how it was computed."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter, ValidationError

from uavbench.reports.evaluation.doubts.conventions_of_results import doubts_of_results
from uavbench.reports.metrics.align import Alignment, align
from uavbench.reports.metrics.ape import absolute_errors
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.frame_errors import SUCCESS_DEG, SUCCESS_M, FrameErrors, frame_errors
from uavbench.reports.metrics.latency import Latency, deadline_misses, stage_latencies
from uavbench.reports.metrics.model_space import ModelSpace, model_space
from uavbench.reports.metrics.rpe import PairInterval, interval_pairs, motion_error_sizes
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.reports.protocols.restarting import Replay, replay_in_real_time
from uavbench.reports.scoring.coverage import Tracking, tracking
from uavbench.reports.scoring.crlb_ratio import ErrorOverBound
from uavbench.reports.uncertainty.consistency import Consistency
from uavbench.reports.uncertainty.nees import consistency
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.results import MARKER, Results
from uavbench.tracker.sound_results import sound
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text

ALIGNMENTS: tuple[Alignment, ...] = ("none", "se3", "sim3")
OF_RESULTS = ("tracker", "rate_hz", "seed", "start", "content_hash", "versions")
"""Parts of the record of results that are in the record of their score."""
Status = Literal["complete", "lost", "crashed", "missing"]


@dataclass(frozen=True, kw_only=True)
class PoseErrors:
    """Errors of poses or of motions over the frames with a pose; None without any; undefined: the reason, or ""."""

    translation_m: ErrorSummary | None
    rotation_deg: ErrorSummary | None
    undefined: str = ""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Score of one run.

    status: `complete` when every frame has a pose, `lost` when some have none, `crashed` when the tracker raised an
    error or stopped early, `missing` when there is no result at all. ate, by alignment, and rpe, by interval (`1 s`),
    are over the frames with a pose: read them with tracking.coverage. latency: by stage, `total` first;
    deadline_misses: share of frames. replay: real-time replay; model: errors of the structure in space and image;
    consistency: NEES; bound: errors over their Cramer-Rao bound; each None where times, covariances or bounds are
    missing. errors: of the tracker; doubts: on the convention of its poses; record: how the score was computed.
    """

    label: str
    rate_hz: float
    seed: int
    sequence: str
    status: Status
    tracking: Tracking
    ate: dict[str, PoseErrors]
    rpe: dict[str, PoseErrors]
    latency: dict[str, Latency]
    deadline_misses: float | None
    replay: Replay | None = None
    model: ModelSpace | None = None
    consistency: Consistency | None = None
    bound: ErrorOverBound | None = None
    errors: tuple[str, ...]
    record: dict[str, Any]
    doubts: tuple[str, ...] = ()

    @property
    def run(self) -> str:
        """Name of tracker and rate, `lsd@15hz`."""
        return f"{self.label}@{self.rate_hz:g}hz"

    @property
    def flight(self) -> str:
        """Name of the sequence without its seed."""
        return self.sequence.removesuffix(f"-s{self.seed}")

    def to_json(self) -> dict[str, Any]:
        """The score as a JSON object; `doubts` where there are any."""
        value = asdict(self)
        value["errors"] = list(self.errors)
        if doubts := list(value.pop("doubts")):
            value["doubts"] = doubts
        return value

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Score":
        """The score of an object that `to_json` returned; UserError naming the first invalid key."""
        known = {name: value[name] for name in cls.__dataclass_fields__ if name in value}
        try:
            return _ADAPTER.validate_python(known)
        except ValidationError as error:
            first = error.errors()[0]
            raise UserError(f"not a score: {'.'.join(map(str, first['loc']))}: {first['msg']}; score again") from None

    def save(self, path: Path, content_hash: str = "") -> None:
        """Write `score.json`; content_hash: of its inputs."""
        text = json.dumps({"content_hash": content_hash, **self.to_json()}, indent=1, allow_nan=False)
        write_text(path, text + "\n", kind=MARKER.kind)

    @classmethod
    def load(cls, path: Path) -> "Score":
        """Read `score.json`; UserError naming the file when it is missing or not a score."""
        values = read_json(path)
        try:
            return cls.from_json(values)
        except UserError as error:
            raise UserError(f"{path}: {error}") from None


_ADAPTER = TypeAdapter(Score)
_versions = lru_cache(versions)


def score(sequence: Sequence, results: Results) -> Score:
    """Score of results against the ground truth of their sequence; UserError when they do not belong together."""
    results, unsound = sound(results)
    errors = frame_errors(sequence, results)
    record = results.record
    faults = tuple(str(e) for e in record.get("errors", ()))
    stopped = len(results) < len(errors)
    if not len(results):
        faults += ("no frame has a row: the run is missing",)
    elif stopped:
        faults += (f"{len(errors) - len(results)} of {len(errors)} frames have no row: the run stopped early",)
    status: Status = "crashed" if faults else "complete" if errors.ok.all() else "lost"
    if not len(results):
        status = "missing"
    return Score(
        label=str(record.get("label", record["tracker"]["kind"])),
        rate_hz=float(record["rate_hz"]),
        seed=int(record["seed"]),
        sequence=sequence.name,
        status=status,
        tracking=tracking(errors),
        ate={kind: absolute(errors.tracked, kind) for kind in ALIGNMENTS},
        rpe={
            "1 frame": relative(errors, PairInterval(1, "frames", True)),
            "1 s": relative(errors, PairInterval(1, "s", True)),
        },
        latency=stage_latencies(results),
        deadline_misses=deadline_misses(results),
        replay=replay_in_real_time(sequence, results),
        model=model_space(sequence, results),
        consistency=consistency(sequence, results),
        bound=ErrorOverBound.of(sequence, errors),
        errors=faults + unsound,
        record=how(sequence, results),
        doubts=doubts_of_results(sequence, results, errors),
    )


def absolute(pairs: PosePairs, kind: Alignment) -> PoseErrors:
    """ATE under an alignment; `undefined` holds the reason when there is none."""
    try:
        aligned = align(pairs, kind) if len(pairs) else pairs
    except UserError as error:
        return PoseErrors(translation_m=None, rotation_deg=None, undefined=str(error))
    return PoseErrors(
        translation_m=summary(absolute_errors(aligned, "translation_m")),
        rotation_deg=summary(absolute_errors(aligned, "angle_deg")),
        undefined="" if len(pairs) else "no frame has a pose",
    )


def relative(errors: FrameErrors, over: PairInterval) -> PoseErrors:
    """RPE over all pairs of expected frames an interval apart that both have a pose."""
    i, j = interval_pairs(errors.pairs, over)
    both = errors.ok[i] & errors.ok[j]
    i, j = i[both], j[both]
    metres, radians = motion_error_sizes(errors.pairs, i, j)
    return PoseErrors(
        translation_m=summary(metres),
        rotation_deg=summary(np.degrees(radians)),
        undefined="" if len(i) else "no two frames so far apart have a pose",
    )


def summary(errors: Any) -> ErrorSummary | None:
    """Summary of errors (n,); None without any."""
    return ErrorSummary.of(errors) if len(errors) else None


def how(sequence: Sequence, results: Results) -> dict[str, Any]:
    """Record of how a score is computed; scores with different records are not comparable."""
    return {
        "compared": "world_from_body with groundtruth.csv",
        "association": "by frame; every frame at the tracker's rate is expected",
        "rpe_pairs": "all pairs",
        "success": {"translation_m": SUCCESS_M, "rotation_deg": SUCCESS_DEG},
        "std_ddof": 0,
        "sequence": {
            "name": sequence.name,
            "content_hash": sequence.content_hash,
            "images": sequence.images_hash,
        },
        "results": {k: results.record.get(k) for k in OF_RESULTS},
        "versions": dict(_versions()),
    }
