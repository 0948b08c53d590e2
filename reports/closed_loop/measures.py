"""Measures of one flight in closed loop.

Conventions: path error is the distance of the true from the planned position at the same time. A flight succeeds when
it is completed without a crash and never leaves its corridor. A pose is false beyond 5 cm or 5 deg. NEES divided by its
degrees of freedom has mean 1 for a consistent estimator.
"""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from uavbench.reports.closed_loop.coverage import coverage
from uavbench.reports.closed_loop.files import MARKER
from uavbench.reports.closed_loop.flown import Flown, planned_bodies
from uavbench.reports.metrics.frame_errors import SUCCESS_DEG, SUCCESS_M
from uavbench.reports.uncertainty.consistency import DEGREES_OF_FREEDOM
from uavbench.reports.uncertainty.nees import is_singular
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose, rotation_log

NOT_FLOWN = "not flown"
"""Status of a flight that could not be flown or measured, which has no numbers."""
FILTER_STATES = 9
"""Degrees of freedom of the filter's NEES: position, velocity and attitude."""
LOOK_EVERY_S = 0.5
"""Interval between the views used for coverage; an inspection camera moves little in between."""


@dataclass(frozen=True, kw_only=True)
class FlightScore:
    """Measures of one flight; None where a measure is undefined.

    run: tracker, rate and loop, `lsd@15hz`. path_*: error of the true against the planned position; path_added_m:
    rms path error minus that of the same flight on its true state, as far as this one came. clearance_min_m: least
    distance of the vehicle's sphere to structure or floor. estimate_*: position error of the filter, and its NEES
    over its degrees of freedom; tracker_*: the same of the tracker's poses. ok_share: of frames with a pose;
    refused_share: of the camera's poses that the filter's innovation gate rejected; gnss_share: of time with a fix.
    first_false_s: stamp of the first false pose; false_to_crash_s: time from it to the crash. coverage,
    coverage_planned: share of the surface seen along the flight, and along the plan. All shares are from 0 to 1.
    """

    label: str
    run: str
    rate_hz: float
    sequence: str
    seed: int
    status: str
    why: str
    success: bool
    ended_s: float
    planned_s: float
    path_rms_m: float
    path_max_m: float
    path_added_m: float
    clearance_min_m: float
    estimate_rms_m: float | None
    estimate_max_m: float | None
    estimate_nees: float | None
    frames: int
    ok_share: float
    tracker_rms_m: float | None
    tracker_nees: float | None
    refused_share: float | None
    first_false_s: float | None
    false_to_crash_s: float | None
    gnss_share: float
    coverage: float
    coverage_planned: float
    faults: tuple[str, ...]

    @classmethod
    def not_flown(cls, sequence: str, run: str, why: str) -> "FlightScore":
        """A flight that could not be flown, by the names of its folders: no success, and NaN or None in all measures.

        ValueError for names that are not of the form `SEQUENCE-sSEED` and `LABEL@RATEhz`.
        """
        label, _, rate = run.partition("+")[0].rpartition("@")
        numbers: dict[str, Any] = {f.name: None if "None" in str(f.type) else np.nan for f in fields(cls)}
        named: dict[str, Any] = {"label": label, "run": run, "rate_hz": float(rate.removesuffix("hz"))}
        named |= {"sequence": sequence, "seed": int(sequence.rpartition("-s")[2]), "why": why, "faults": ()}
        return cls(**{**numbers, **named, "status": NOT_FLOWN, "success": False, "frames": 0})

    def save(self, path: Path, content_hash: str = "") -> None:
        """Write `score.json`; content_hash: of its inputs."""
        text = json.dumps({"content_hash": content_hash, **asdict(self)}, indent=1, allow_nan=False)
        write_text(path, text + "\n", kind=MARKER.kind)

    @classmethod
    def load(cls, path: Path) -> "FlightScore":
        """Read what `save` wrote; UserError naming the file when it is not the score of a flight."""
        values = read_json(path)
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        try:
            return _ADAPTER.validate_python(known)
        except ValidationError as error:
            first = error.errors()[0]
            what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
            raise UserError(f"{path}: not the score of a flight: {what}; score the flight again") from None


_ADAPTER = TypeAdapter(FlightScore)


def measure_flight(flown: Flown) -> FlightScore:
    """Measures of a flight."""
    record, flight, path = flown.record, flown.record["flight"], flown.path
    true_m = path.group("true_p_m")
    path_error_m = np.linalg.norm(true_m - path.group("planned_p_m"), axis=1)
    estimate_m = np.linalg.norm(true_m - path.group("estimated_p_m"), axis=1)
    estimate_m = estimate_m[np.isfinite(estimate_m)]
    translation_m, angle_deg, nees = tracker_errors(flown)
    false = (translation_m > SUCCESS_M) | (angle_deg > SUCCESS_DEG)
    first_false_s = float(flown.results.stamps_ns[np.argmax(false)] / 1e9) if false.any() else None
    crashed = flight["status"] == "crashed"
    obstacles = ObstacleMesh(flown.structure.vertices, flown.structure.triangles)
    px_m = float(record["loop"]["coverage_px_m"])
    known = translation_m[np.isfinite(translation_m)]
    return FlightScore(
        label=str(record["label"]),
        run=str(record["run"]),
        rate_hz=float(record["rate_hz"]),
        sequence=str(record["sequence"]["name"]),
        seed=int(record["seed"]),
        status=flight["status"],
        why=flight["why"],
        success=flight["status"] == "completed" and bool(path_error_m.max() <= record["loop"]["corridor_m"]),
        ended_s=flight["ended_s"],
        planned_s=flight["planned_s"],
        path_rms_m=rms(path_error_m),
        path_max_m=float(path_error_m.max()),
        path_added_m=rms(path_error_m) - flight["open_loop_rms_m"],
        clearance_min_m=float(obstacles.clearance(true_m).min()) - flight["radius_m"],
        estimate_rms_m=rms(estimate_m) if len(estimate_m) else None,
        estimate_max_m=float(estimate_m.max()) if len(estimate_m) else None,
        estimate_nees=mean(path.group("nees")[:, 0] / FILTER_STATES),
        frames=len(flown.results),
        ok_share=float(flown.results.ok.mean()) if len(flown.results) else 0.0,
        tracker_rms_m=rms(known) if len(known) else None,
        tracker_nees=mean(nees / DEGREES_OF_FREEDOM),
        refused_share=refused_share(flown),
        first_false_s=first_false_s,
        false_to_crash_s=flight["ended_s"] - first_false_s if crashed and first_false_s is not None else None,
        gnss_share=float(path.group("gnss_fix").mean()),
        coverage=coverage(flown.structure, flown.camera, cameras_flown(flown), px_m),
        coverage_planned=coverage(flown.structure, flown.camera, cameras_planned(flown), px_m),
        faults=tuple(map(str, record["errors"])),
    )


class TrackerErrors(NamedTuple):
    """Position and rotation errors (n,) in m and deg, and NEES (n,) of each frame; NaN without a pose.

    They are those of the body, of a camera on a gimbal the camera's.
    """

    metres: Array
    degrees: Array
    nees: Array


def tracker_errors(flown: Flown) -> TrackerErrors:
    """Errors of the tracker's poses at each frame against ground truth; NEES is NaN without a regular covariance."""
    mount = flown.results.cam_from_body
    out = np.full((3, len(flown.results)), np.nan)
    for i, row in enumerate(flown.results.rows):
        if row.cam_from_world is None:
            continue
        true, found = flown.groundtruth.pose(i), row.cam_from_world.inverse() @ mount
        out[0, i] = np.linalg.norm(true.translation - found.translation)
        out[1, i] = np.degrees(np.linalg.norm(rotation_log(found.rotation.T @ true.rotation)))
        if row.covariance is not None and not is_singular(row.covariance):
            xi = (mount @ true.inverse() @ row.cam_from_world.inverse()).log()
            out[2, i] = xi @ np.linalg.solve(row.covariance, xi)
    return TrackerErrors(out[0], out[1], out[2])


def refused_share(flown: Flown) -> float | None:
    """Share of the camera's poses that the filter rejected; None when it was given none."""
    poses = [row for row in flown.innovations if row[1] == "CameraPose"]
    return sum(bool(row[4]) for row in poses) / len(poses) if poses else None


def cameras_flown(flown: Flown) -> list[Pose]:
    """True cam_from_world along a flight, every LOOK_EVERY_S."""
    path = flown.path
    positions, quaternions = path.group("true_p_m"), path.group("true_q")
    rows = spaced(path.seconds)
    return [flown.cam_from_body(i) @ Pose.from_quaternion(quaternions[i], positions[i]).inverse() for i in rows]


def cameras_planned(flown: Flown) -> list[Pose]:
    """cam_from_world along the plan with the vehicle level, every LOOK_EVERY_S."""
    bodies = planned_bodies(flown.plan)
    return [flown.planned_cam_from_body(i) @ bodies[i].inverse() for i in spaced(flown.plan[:, 0])]


def spaced(seconds: Array) -> list[int]:
    """Indices of times (n,) in s, ascending, that are LOOK_EVERY_S apart."""
    times = np.arange(seconds[0], seconds[-1] + 1e-9, LOOK_EVERY_S)
    return [int(row) for row in np.unique(np.searchsorted(seconds, times))]


def rms(values: Array) -> float:
    """Root of the mean square of values (n,)."""
    return float(np.sqrt(np.mean(values**2)))


def mean(values: Array) -> float | None:
    """Mean of the finite values of an array; None without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None
