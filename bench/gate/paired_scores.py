"""Scores of two folders of a suite, paired by run: same tracker, rate and frames."""

import math
import os
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from uavbench.reports.closed_loop import repeated_flights
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.run_folder import refuse_disowned
from uavbench.reports.scoring.score import PoseErrors, Score
from uavbench.reports.scoring.seen import seen
from uavbench.reports.statistics.repeats import Repeats
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import DamagedFileError, UserError
from uavbench.trajectories.pose import Array

Key = tuple[str, str, int]
"""Tracker and rate (`lsd@15hz`), sequence without its seed, seed."""
COVERAGE, SUCCESS = "coverage", "success"
"""Metrics compared as shares: of frames with a pose, of successful flights."""
OTHER_SIDE = "base"
"""Folder of the older version, beside that of the newer one, of `uavbench compare`."""
HOW = ("compared", "association", "rpe_pairs", "success", "std_ddof")
"""Parts of a score's record that must agree before two numbers are compared."""


def _size(error: float) -> float:
    """An error; NaN for a negative number in a file."""
    return error if error >= 0 else math.nan


def _rmse(errors: PoseErrors | None, kind: Literal["translation_m", "rotation_deg"]) -> float:
    summary = getattr(errors, kind) if errors is not None else None
    return math.nan if summary is None else float(summary.rmse)


def known(errors: Mapping[str, float]) -> dict[str, float]:
    """The errors that are numbers."""
    return {metric: value for metric, value in errors.items() if math.isfinite(value)}


ERRORS: dict[str, tuple[str, Callable[[Score], float]]] = {
    "ATE": ("m", lambda score: _rmse(score.ate.get("none"), "translation_m")),
    "ATE rotation": ("deg", lambda score: _rmse(score.ate.get("none"), "rotation_deg")),
    "RPE 1 s": ("m", lambda score: _rmse(score.rpe.get("1 s"), "translation_m")),
}
"""Metrics that are compared as ratios: unit and value of a score."""
FLIGHT_ERRORS: dict[str, tuple[str, Callable[[FlightScore], float]]] = {
    "path error": ("m", lambda score: score.path_rms_m),
    "estimate error": ("m", lambda score: math.nan if score.estimate_rms_m is None else score.estimate_rms_m),
}
"""The same for flights in closed loop; one flown on its true state has no estimate."""
FLOWN = "flown"
"""Key in `how` of a flight, which prevents comparison with a run on recorded frames."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Values of one run that the gate compares: its coverage, and its errors by metric, NaN where one is undefined.

    For a flight in closed loop the coverage is 1 for a success, else 0. crash: error message of a crash, else "";
    frames: hash of the frames' inputs; images: hash of the image files, "" where they need not agree; how: the parts of
    the score's record that must agree; start: where the initial pose came from, None where unknown; seen: frames and
    all numbers, by which equal seeds are found, "" where unknown.
    """

    coverage: float
    errors: Mapping[str, float]
    crash: str = ""
    frames: str = ""
    images: str = ""
    how: Mapping[str, Any] = field(default_factory=dict)
    start: Any = None
    seen: str = ""

    @classmethod
    def of(cls, score: Score) -> "Measured":
        """The numbers of a score."""
        return cls(
            coverage=score.tracking.coverage,
            errors={metric: _size(value(score)) for metric, (_, value) in ERRORS.items()},
            crash=(score.errors or ("no reason given",))[0] if score.status == "crashed" else "",
            frames=str(score.record.get("sequence", {}).get("content_hash", "")),
            images=str(score.record.get("sequence", {}).get("images", "")),
            how={part: score.record.get(part) for part in HOW},
            start=score.record.get("results", {}).get("start"),
            seen=seen(score) or "",
        )

    @classmethod
    def of_flight(cls, score: FlightScore) -> "Measured":
        """The numbers of a flight in closed loop."""
        return cls(
            coverage=float(score.success),
            errors={metric: _size(value(score)) for metric, (_, value) in FLIGHT_ERRORS.items()},
            crash=score.why if score.status == "crashed" else "",
            how={FLOWN: True},
            seen=repeated_flights.seen(score),
        )


@dataclass(frozen=True)
class Side:
    """Measured values of one folder, and why the other runs have no score.

    flights: hash of the specs of the suite's sequences; not_compared: why runs are only on this side, by tracker and
    rate.
    """

    runs: Mapping[Key, Measured]
    faults: Mapping[Key, str] = field(default_factory=dict)
    flights: str = ""
    not_compared: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_flown(self) -> bool:
        """Whether its runs are flights in closed loop."""
        return any(run.how.get(FLOWN) for run in self.runs.values())

    @property
    def units(self) -> dict[str, str]:
        """Unit of each metric that is compared as a ratio."""
        if not self.is_flown:
            return {metric: unit for metric, (unit, _) in ERRORS.items()}
        found = {metric for run in self.runs.values() for metric in known(run.errors)}
        return {metric: unit for metric, (unit, _) in FLIGHT_ERRORS.items() if metric in found}

    @property
    def share(self) -> str:
        """Name of what is compared as a share."""
        return SUCCESS if self.is_flown else COVERAGE


def read_side(folder: Path) -> Side:
    """Measured values of a suite's folder; UserError when it is not one, or when a score was changed."""
    if not os.path.lexists(folder / "suite.json"):
        raise UserError(f"{folder}: has no suite.json, as folders of `uavbench run`, `score` and `fly` have; name one")
    about = read_json(folder / "suite.json")
    found: dict[Key, Measured] = {}
    faults: dict[Key, str] = {}
    try:
        names = [str(name) for name in about["sequences"]]
        flown = "loops" in about and (folder / "flights").is_dir()
        loops = [f"+{name}" if name else "" for name in map(str, about["loops"])] if flown else [""]
        pairs = [(label, rate) for label in about["trackers"] for rate in about["rates_hz"]]
        runs = [f"{label}@{float(rate):g}hz{loop}" for label, rate in pairs for loop in loops]
        if leads := [name for name in (*names, *runs) if "/" in name or "\0" in name]:
            raise ValueError(f"{leads[0]!r} is not the name of a folder")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{folder / 'suite.json'}: not uavbench's: {error}") from None
    for name in names:
        sequence, _, seed = name.rpartition("-s")
        for run in runs:
            key = (run, sequence or name, int(seed) if sequence and seed.isdecimal() else 0)
            try:
                found[key] = _measured(folder, name, run, flown=flown)
            except DamagedFileError:
                raise
            except UserError as error:
                faults[key] = str(error)
    not_compared = {str(run): str(why) for run, why in (about.get("not_compared") or {}).items()}
    return Side(found, faults, str(about.get("flights", "")), not_compared)


def _measured(folder: Path, sequence: str, run: str, *, flown: bool) -> Measured:
    """Measured values of one run of a folder; UserError when it has no score."""
    path = folder / ("flights" if flown else "results") / sequence / run / "score.json"
    refuse_disowned(folder, path)
    return Measured.of_flight(FlightScore.load(path)) if flown else Measured.of(Score.load(path))


def _start_apart(base: Any, head: Any) -> bool:
    """Whether two starts are known and of different kinds or numbers; a version may have numbers that another lacks."""
    if not (isinstance(base, dict) and isinstance(head, dict)):
        return False
    of_base, of_head = (start.get("parameters") or {} for start in (base, head))
    both = [name for name in of_base if name in of_head and not isinstance(of_base[name], str)]
    return base.get("kind") != head.get("kind") or any(of_base[name] != of_head[name] for name in both)


def expect_comparable(base: Measured, head: Measured, key: Key) -> None:
    """UserError unless both are of the same frames and were computed the same way."""
    what = f"{key[0]} on {key[1]}, seed {key[2]}"
    if base.frames and base.frames != head.frames:
        raise UserError(
            f"{what}: baseline and results are of different frames; use `uavbench compare`, or update the baseline"
        )
    if base.images and head.images and base.images != head.images:
        raise UserError(
            f"{what}: baseline and results are of the same flight, but its images differ: another GL driver, CPU or "
            "library rendered them; use `uavbench compare`, or copy the folders `sequences` and `made` of one to the "
            "other, and score it again"
        )
    if _start_apart(base.start, head.start):
        raise UserError(
            f"{what}: the tracker starts otherwise in the baseline (`start`: {base.start!r}) than in the results "
            f"({head.start!r}); score both with the same `start`"
        )
    for part in (*HOW, FLOWN):
        if base.how.get(part) != head.how.get(part):
            raise UserError(
                f"{what}: `{part}` of the scores differs ({base.how.get(part)!r}, {head.how.get(part)!r}); "
                "score both again with the same uavbench"
            )


@dataclass(frozen=True, eq=False)
class PairedValues:
    """One metric of one tracker on both sides: (sequence, seed) -> value, NaN where there is none.

    undefined: runs in which both sides have a score but neither has the number, as of flights too short for it.
    repeats: the seeds that were left out, since they repeat another one, and what to do.
    """

    base: Mapping[tuple[str, int], float]
    head: Mapping[tuple[str, int], float]
    undefined: Set[tuple[str, int]] = frozenset()
    repeats: str = ""

    def missing(self) -> str:
        """Message on the first other run without a finite number on one of the sides; "" if there is none."""
        for sequence, seed in sorted({*self.base, *self.head} - self.undefined):
            for side, values in (("results", self.head), ("baseline", self.base)):
                if not np.isfinite(values.get((sequence, seed), np.nan)):
                    return f"no number in the {side} for {sequence}, seed {seed}"
        return ""

    def without(self, repeats: Repeats) -> "PairedValues":
        """The values without those of seeds that repeat another one."""
        base, head = ({k: v for k, v in side.items() if repeats.counts(*k)} for side in (self.base, self.head))
        undefined = {key for key in self.undefined if repeats.counts(*key)}
        return PairedValues(base, head, undefined, str(repeats))

    @property
    def seeds(self) -> int:
        """The smallest number of seeds of any sequence."""
        sequences = [sequence for sequence, _ in self.head]
        return min((sequences.count(name) for name in set(sequences)), default=0)

    @property
    def sequences(self) -> list[str]:
        """Names of the sequences."""
        return sorted({sequence for sequence, _ in self.head})

    def sides(self, function: Callable[[float], float]) -> tuple[list[Array], list[Array]]:
        """function(value) of the baseline and of the results, an array (seeds,) for each sequence."""
        base, head = (self.by_sequence(lambda b, h, k=k: function((b, h)[k])) for k in range(2))
        return base, head

    def by_sequence(self, function: Any) -> list[Array]:
        """function(base, head) of each pair, an array (seeds,) for each sequence."""
        return [
            np.array([function(self.base[key], self.head[key]) for key in sorted(self.head) if key[0] == name])
            for name in self.sequences
        ]


def read_timing(folder: Path, baseline: Path) -> dict[str, PairedValues]:
    """Latencies of interleaved runs by tracker and rate, as `uavbench compare` writes them into one of its sides.

    None without the file, and with any other baseline than the other side, whose times these are.
    """
    path = folder / "timing.json"
    if not path.is_file() or baseline.resolve() != folder.resolve().with_name(OTHER_SIDE):
        return {}
    try:
        runs = read_json(path)["runs"]
        return {
            run: PairedValues(
                {(row["sequence"], int(row["seed"])): float(row["base_ms"]) for row in rows},
                {(row["sequence"], int(row["seed"])): float(row["head_ms"]) for row in rows},
            )
            for run, rows in runs.items()
        }
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise UserError(f"{path}: not a timing of `uavbench compare`: {error}") from None
