"""True poses of one's own images: a trajectory in any form that `evaluate` reads, at the stamp of each image."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.own_images.conventions import Seen, check_in_view, doubts_of_edges
from uavbench.bench.own_images.plausible_poses import doubts_of_poses, doubts_of_stamps
from uavbench.reports.evaluation.find_trajectory import Found, find_trajectory, mount_of, world_from_cameras
from uavbench.reports.metrics.association import interpolate
from uavbench.tracker.images.image_names import stamps_in_names
from uavbench.tracker.images.recorded_sequence import GroundTruth, Recording, RecordingSpec, stamps_of_rate
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory

SAME_S = 1e-3
"""Most by which the time of an image may differ from that of its pose: many programs write milliseconds."""
LONGEST_GAP_S = 0.1
"""Longest time between two poses that are interpolated at an image: motion capture has ten times more poses or more."""
SAME_RATE = 0.1
"""Share by which a rate may differ from that of the stamps, as where it is rounded."""
ONE_GAP = 1.5
"""Steps of the median one from which on images are missing between two."""
BODY, CAMERA = "world_from_body", "world_from_cam"
FROM = {"poses": "the stamps of the poses", "names": "the names of the images", "rate": "their rate"}
"""Where the stamps of images are from, in words."""


class Stamped(NamedTuple):
    """Poses at images, where their stamps are from, and how many poses are interpolated."""

    poses: Trajectory
    stamps_from: Literal["poses", "names", "rate"]
    interpolated: int


def ground_truth_of(spec: RecordingSpec, recording: Recording) -> GroundTruth:
    """True poses of a recording by the file that its spec names; UserError as `true_poses`."""
    found = find_trajectory(Path(spec.ground_truth_file))
    return true_poses(found, recording, cam_from_body=spec.mount, rate_hz=spec.rate_hz)


def true_poses(
    found: Found, recording: Recording, *, cam_from_body: Pose | None = None, rate_hz: float | None = None
) -> GroundTruth:
    """True poses of the images of a recording, by a trajectory in the model's frame.

    A trajectory that declares no frame is of the body where cam_from_body is given, else of the camera; of the latter
    the body is the camera. rate_hz: of images without times, in their names or by a pose for each. UserError naming the
    first image without a pose, a rate that is not that of the stamps, poses at which the model is not in the images,
    and poses of a body whose camera is not known.
    """
    found, mount = _moving(found, cam_from_body)
    stamped = _at_images(found, recording.images, rate_hz)
    name, seen = str(found.file), Seen(recording, stamped.poses, mount)
    _check_rate(name, stamped, rate_hz)
    check_in_view(name, seen)
    about: dict[str, Any] = {
        "poses": found.file.name,
        "stamps": FROM[stamped.stamps_from],
        "interpolated": stamped.interpolated,
        "motion": "differences of the poses",
    }
    told = [*doubts_of_poses(name, found.trajectory), *doubts_of_edges(name, seen)]
    if stamped.stamps_from == "poses":
        told += doubts_of_stamps(name, recording.images, stamped.poses.stamps_ns, rate_hz)
    return GroundTruth(stamped.poses, mount, stamped.stamps_from, about, tuple(told))


def rate_of(stamps_ns: NDArray[np.int64]) -> float:
    """Rate in Hz of images with these stamps (n,), where some may be missing; UserError for a single one."""
    steps_s = np.diff(stamps_ns) / 1e9
    if not len(steps_s):
        raise UserError("one image has no rate; give rate_hz")
    return float(f"{1 / steps_s[steps_s <= ONE_GAP * np.median(steps_s)].mean():.6g}")


class _Moving(NamedTuple):
    """Poses of the body, and the camera on it; where no body is known, those of the camera, and the identity."""

    found: Found
    cam_from_body: Pose


def _moving(found: Found, cam_from_body: Pose | None) -> _Moving:
    """What the poses of a file are of, by the frame that it declares; UserError for a body without its camera."""
    frame = found.frame or ""
    if frame == "cam_from_world":
        table = np.hstack([found.trajectory.positions_m, found.trajectory.quaternions_wxyz])
        inverted = world_from_cameras(found.trajectory.stamps_ns, table)
        found, frame = replace(found, trajectory=inverted, frame=CAMERA), CAMERA
    if cam_from_body is not None:
        return _Moving(found.seen_as(BODY, cam_from_body) if frame.endswith("_from_cam") else found, cam_from_body)
    if not frame.endswith("_from_body"):
        return _Moving(found, Pose.identity())
    try:
        return _Moving(found, mount_of(found.file.parent))
    except UserError:
        raise UserError(
            f"{found.file}: has poses of the body ({frame}), and the camera's pose on it is not known; give "
            "cam_from_body, or poses of the camera"
        ) from None


def _at_images(found: Found, images: tuple[Path, ...], rate_hz: float | None) -> Stamped:
    """The pose at each image: by the times in the names, by their order where there is one for each, or by the rate."""
    given, n, named = found.trajectory, len(images), stamps_in_names(images)
    if named is not None and found.stamped:
        return _by_time(found, images, named, "names")
    if len(given) == n and found.stamped:
        return Stamped(given, "poses", 0)
    if named is None and rate_hz is None:
        raise UserError(
            f"{found.file}: has {len(given)} poses{'' if found.stamped else ' without times'} for {n} images without "
            "times; give the rate of the images, rate_hz"
        )
    stamps_ns = named if named is not None else stamps_of_rate(n, rate_hz or 0.0)
    if found.stamped:
        return _by_time(found, images, stamps_ns, "rate")
    if len(given) != n:
        raise UserError(
            f"{found.file}: has {len(given)} poses without times for {n} images; give one for each image, in order"
        )
    in_order = Trajectory(stamps_ns, given.positions_m, given.quaternions_wxyz)
    return Stamped(in_order, "rate" if named is None else "names", 0)


def _by_time(
    found: Found, images: tuple[Path, ...], stamps_ns: NDArray[np.int64], stamps_from: Literal["names", "rate"]
) -> Stamped:
    """Poses at the stamps (n,) of images; UserError naming the first image without a pose."""
    table = found.trajectory.stamps_ns
    behind = np.clip(np.searchsorted(table, stamps_ns), 1, max(len(table) - 1, 1)).clip(max=len(table) - 1)
    before = np.maximum(behind - 1, 0)
    away_s = np.minimum(np.abs(stamps_ns - table[before]), np.abs(stamps_ns - table[behind])) / 1e9
    within = (table[before] <= stamps_ns) & (stamps_ns <= table[behind])
    gap_s = (table[behind] - table[before]) / 1e9
    missing = (away_s > SAME_S) & ~(within & (gap_s <= LONGEST_GAP_S))
    if missing.any():
        k = int(np.argmax(missing))
        raise UserError(
            f"{found.file}: has no pose for {images[k].name} at {stamps_ns[k] / 1e9:.6f} s, by "
            f"{FROM[stamps_from]}: the nearest is {away_s[k]:.6g} s away, and its {len(table)} poses last from "
            f"{table[0] / 1e9:.6f} to {table[-1] / 1e9:.6f} s ({missing.sum()} of {len(images)} images); leave these "
            "images out, give a pose for each image, or correct the stamps"
        )
    zero = table[0]
    poses = interpolate(found.trajectory, (table - zero) / 1e9, (stamps_ns - zero) / 1e9)
    return Stamped(Trajectory(stamps_ns, *poses), stamps_from, int((away_s > SAME_S).sum()))


def _check_rate(name: str, stamped: Stamped, rate_hz: float | None) -> None:
    """UserError for a rate that is not that of the stamps."""
    if rate_hz is None or stamped.stamps_from == "rate" or len(stamped.poses) < 2:
        return
    own_hz = rate_of(stamped.poses.stamps_ns)
    if abs(own_hz - rate_hz) > SAME_RATE * own_hz:
        raise UserError(
            f"{name}: by {FROM[stamped.stamps_from]} there are {own_hz:g} images a second, and rate_hz is "
            f"{rate_hz:g}; write rate_hz = {own_hz:g}, or correct the stamps, which are in seconds in a TUM file"
        )
