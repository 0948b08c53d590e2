"""Evaluation of runs of several trackers against one ground truth."""

import os
from collections.abc import Sequence as ListOf
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.evaluate import Side, evaluate_found
from uavbench.reports.evaluation.evaluation import ClaimedNees, Evaluation
from uavbench.reports.evaluation.find_trajectory import Found
from uavbench.reports.evaluation.frames import in_one_frame
from uavbench.reports.evaluation.gaps import with_gaps
from uavbench.reports.evaluation.options import EvaluateOptions, chosen_options
from uavbench.reports.evaluation.trajectory_input import found_in
from uavbench.reports.many_runs.common_frames import TimedErrors, in_common
from uavbench.reports.many_runs.curves import Axis, distance_axis, time_axis
from uavbench.reports.many_runs.groups import Pairing, Run, pairing
from uavbench.reports.metrics.align import Alignment
from uavbench.reports.metrics.ape import pose_error_sizes
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

THREADS = 4
"""Threads that read and evaluate files; the parser and numpy release the interpreter lock."""
SHOWN_POSES = 2000
"""Most points of a path in a figure."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluatedRun:
    """Errors of one run.

    ate, rpe, coverage, nees: as in `Evaluation`; errors: those of its poses or intervals by METRICS, in m or deg;
    over_time, over_distance: RMSE (b,) of `position` in m and `rotation` in deg in each bin; path_m (n, 3): estimated
    positions as aligned, NaN in gaps; scores: the JSON of the `Evaluation`.
    """

    run: Run
    ate: dict[str, ErrorSummary]
    rpe: dict[str, ErrorSummary] | None
    coverage: float
    nees: ClaimedNees | None
    record: dict[str, Any]
    errors: dict[str, TimedErrors]
    over_time: dict[str, Array]
    over_distance: dict[str, Array]
    path_m: Array
    scores: dict[str, Any]

    @property
    def undetermined(self) -> str:
        """The part of the alignment that the positions leave undetermined, as a sentence; "" without any."""
        return str(self.record["alignment"].get("undetermined", ""))

    def value(self, metric: str) -> float:
        """One of METRICS in m or deg; NaN where it is undefined, KeyError for any other name."""
        return METRICS[metric].of(self)

    def to_json(self) -> dict[str, Any]:
        """JSON object of `Evaluation`, with tracker and run."""
        return {"group": self.run.group, "run": self.run.name, **self.scores}


@dataclass(frozen=True)
class Metric:
    """A metric by which trackers are compared; scale: factor from m or deg to `unit`."""

    name: str
    unit: str
    scale: float
    key: str
    part: str

    def of(self, run: EvaluatedRun) -> float:
        """Value of a run in m or deg; NaN where it is undefined."""
        errors = run.ate if self.key == "ate" else run.rpe
        return float("nan") if errors is None else errors[self.part].rmse


METRICS = {
    "ate_position": Metric("ATE position", "cm", 100.0, "ate", "translation_m"),
    "ate_rotation": Metric("ATE rotation", "deg", 1.0, "ate", "rotation_deg"),
    "rpe_position": Metric("RPE position", "cm", 100.0, "rpe", "translation_m"),
    "rpe_rotation": Metric("RPE rotation", "deg", 1.0, "rpe", "rotation_deg"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ManyRuns:
    """Evaluated runs by tracker, the axes of their curves, the pairing of runs, and the true path (n, 3) in m."""

    truth: dict[str, Any]
    groups: dict[str, list[EvaluatedRun]]
    time: Axis
    distance: Axis
    pairs: Pairing
    truth_path_m: Array

    @property
    def runs(self) -> list[EvaluatedRun]:
        """The runs of all trackers."""
        return [run for group in self.groups.values() for run in group]

    def values(self, metric: str) -> dict[str, Array]:
        """One of METRICS (n,) in m or deg of the runs of each tracker; NaN where it is undefined."""
        return {name: np.array([run.value(metric) for run in group]) for name, group in self.groups.items()}

    def paired(self, metric: str, names: ListOf[str] = ()) -> dict[str, Array]:
        """Values of the paired runs of some trackers (all), in the same order, over the frames that these runs share.

        Empty when none are paired, and when two of a pair share no frame.
        """
        found: dict[str, list[float]] = {name: [] for name in names or self.pairs.rows}
        for runs in self._pairs_of(list(found)):
            if any(metric not in run.errors for run in runs):
                return {}
            for run, shared in zip(runs, in_common([run.errors[metric] for run in runs]), strict=True):
                if not shared.any():
                    return {}
                own = run.errors[metric].sizes[shared]
                value = run.value(metric) if shared.all() else float(np.sqrt(np.mean(own**2)))
                found[run.run.group].append(value)
        return {name: np.array(values) for name, values in found.items()} if self.pairs.n else {}

    def shared(self, names: ListOf[str]) -> float:
        """Share of the poses of the paired runs of some trackers that all of them have, of the one with the least."""
        shares = [
            [float(each.mean()) for each in in_common([run.errors["ate_position"] for run in runs])]
            for runs in self._pairs_of(names)
        ]
        return float(np.mean(shares, axis=0).min())

    def _pairs_of(self, names: ListOf[str]) -> list[list[EvaluatedRun]]:
        """The runs of these trackers, pair by pair."""
        if not self.pairs.rows:
            return []
        columns = [[self.groups[name][row] for row in self.pairs.rows[name]] for name in names]
        return [list(runs) for runs in zip(*columns, strict=True)]


def evaluate_many(truth: Path, runs: ListOf[Run], **options: Unpack[EvaluateOptions]) -> ManyRuns:
    """Evaluation of runs against one ground truth, with the options of `evaluate_files`.

    UserError as `evaluate_files`, for the option `plot`, for a file that is given twice or is the ground truth itself,
    and for files that declare different frames.
    """
    chosen = chosen_options(options)
    if options.get("plot") is not None:
        raise UserError("--plot draws one estimate; give --out FOLDER for the figures of many")
    with ThreadPoolExecutor(THREADS) as pool:
        reading = pool.submit(found_in, truth, "reference", options.get("reference_format"))
        read = list(pool.map(lambda run: found_in(run.path, "estimate", options.get("estimate_format")), runs))
        reference = reading.result()
        _refuse_twice(reference, truth, read, runs)
        if not options.get("ignore_frames"):
            _refuse_mixed(reference, read, options, chosen.align)
        timed = reference.trajectory if reference.stamped else _timed(reference.trajectory, read)
        axes = time_axis(timed), distance_axis(timed)

        def evaluated(run: Run, found: Found) -> EvaluatedRun:
            sides = Side(reference, str(truth)), Side(found, str(run.path))
            done = evaluate_found(*sides, chosen, options)
            return _reduced(run, done, *axes, done.pairs.stamps_ns if reference.stamped else timed.stamps_ns)

        done = list(pool.map(evaluated, runs, read))
    groups: dict[str, list[EvaluatedRun]] = {}
    for each in done:
        groups.setdefault(each.run.group, []).append(each)
    return ManyRuns(
        truth=done[0].record["reference"],
        groups=groups,
        time=axes[0],
        distance=axes[1],
        pairs=pairing({name: [each.run.name for each in group] for name, group in groups.items()}),
        truth_path_m=_thinned(reference.trajectory.positions_m, reference.trajectory.stamps_ns),
    )


def _timed(truth: Trajectory, read: ListOf[Found]) -> Trajectory:
    """A ground truth without stamps, with those of the first estimate that has any: both have the same rows."""
    stamps_ns = next((each.trajectory.stamps_ns for each in read if each.stamped), truth.stamps_ns)
    return Trajectory(stamps_ns, truth.positions_m, truth.quaternions_wxyz) if len(stamps_ns) == len(truth) else truth


def _reduced(run: Run, found: Evaluation, time: Axis, distance: Axis, stamps_ns: NDArray[np.int64]) -> EvaluatedRun:
    """Summaries, errors and curves of a run without its poses, to save memory; stamps_ns (n,): of its pairs."""
    position_m, rotation_rad = pose_error_sizes(found.pairs)
    errors = {"position": position_m, "rotation": np.degrees(rotation_rad)}
    poses = np.arange(len(position_m))
    timed = {f"ate_{what}": TimedErrors.of(sizes, stamps_ns, poses) for what, sizes in errors.items()}
    if found.motions:
        motion_m, turn_rad = found.motions.sizes
        rows, alike = found.motions.rows, found.record["unit"] == "frames"
        timed["rpe_position"] = TimedErrors.of(motion_m, stamps_ns, *rows, alike=alike)
        timed["rpe_rotation"] = TimedErrors.of(np.degrees(turn_rad), stamps_ns, *rows, alike=alike)
    return EvaluatedRun(
        run=run,
        ate=found.ate,
        rpe=found.rpe,
        coverage=found.coverage,
        nees=found.nees,
        record=found.record,
        errors=timed,
        over_time={name: time.binned(stamps_ns, values) for name, values in errors.items()},
        over_distance={name: distance.binned(stamps_ns, values) for name, values in errors.items()},
        path_m=_thinned(found.pairs.estimate_m, found.pairs.stamps_ns, found.longest_step_ns),
        scores=found.to_json(),
    )


def _thinned(positions_m: Array, stamps_ns: NDArray[np.int64], longest_ns: float = np.inf) -> Array:
    """At most SHOWN_POSES of the positions (n, 3), and a row of NaN in each step that is longer."""
    rows = with_gaps(positions_m, stamps_ns, longest_ns)
    shown = np.isnan(rows[:, 0])
    shown[:: max(1, -(-len(positions_m) // SHOWN_POSES))] = True
    return np.asarray(rows[shown])


def _refuse_twice(reference: Found, truth: Path, read: ListOf[Found], runs: ListOf[Run]) -> None:
    """UserError when two runs are the same file, or one is the ground truth."""
    seen = {_identity(reference.file): f"the truth {truth}"}
    for found, run in zip(read, runs, strict=True):
        place = _identity(found.file)
        if place in seen:
            raise UserError(f"{run.path}: is the same file as {seen[place]}; give each file once")
        seen[place] = str(run.path)


def _identity(file: Path) -> tuple[int, int] | str:
    """Identity of a file: device and inode, or, for a topic of a bag, path and topic."""
    try:
        found = file.stat()
    except (OSError, ValueError):
        return os.path.realpath(file)
    return found.st_dev, found.st_ino


def _refuse_mixed(reference: Found, read: ListOf[Found], options: EvaluateOptions, align: Alignment) -> None:
    """UserError when two files declare different frames and no mount converts between them."""
    mount = options.get("mount")
    declared = next((each for each in (reference, *read) if each.frame is not None), reference)
    for each in read:
        in_one_frame(declared, each, None if mount is None else Path(mount), align)
