"""The tracker protocol: frozen parameters that start a run, and a run that processes frames.

A run may use only the arguments that it gets here; docs/my-tracker.md has the same table for external programs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import index
from types import MappingProxyType
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body, Samples
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose

Image = NDArray[np.uint8]
Status = Literal["ok", "ambiguous", "lost", "not_initialized"]
STATUSES: tuple[str, ...] = get_args(Status)
ROTATION_ERROR = 1e-3
"""Tolerance of R R^T - I of a rotation, as for the quaternions of external trackers."""
START_INPUTS: tuple[tuple[type, str], ...] = (
    (Structure, "load_structure(folder) or Structure.from_mesh(vertices, triangles)"),
    (Camera, 'Camera.load("camera.toml")'),
    (Pose, "Pose.from_matrix(matrix)"),
    (np.random.Generator, "np.random.default_rng(0)"),
)
"""Type of each input of `start`, and how one is made."""


@dataclass(frozen=True, kw_only=True)
class TrackResult:
    """A tracker's result for one frame.

    status: `ambiguous` when several poses explain the frame about equally well; like `lost`, it has no estimate.
    cam_from_world: the estimate, None unless status is `ok`; guess: best hypothesis of a tracker that is still
    searching, not an estimate. covariance (6, 6): of the twist xi with cam_from_world_true = exp(xi) @ cam_from_world,
    translation (m) first, rotation (rad) last; None if the tracker claims none. stage_ms: wall-clock time of each
    stage by name. Counts are None where not applicable. log10_nfa: decimal logarithm of the number of false alarms,
    how many random poses would explain the frame as well (Desolneux, Moisan & Morel 2000); None without such a test.
    """

    status: Status
    cam_from_world: Pose | None = None
    covariance: Array | None = None
    stage_ms: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    segments: int | None = None
    control_points: int | None = None
    candidates: int | None = None
    inliers: int | None = None
    log10_nfa: float | None = None
    guess: Pose | None = None

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"the status {self.status!r} is none of {', '.join(STATUSES)}")
        if self.status == "ok" and self.cam_from_world is None:
            raise ValueError("the status is ok, and cam_from_world is None: a frame without a pose has the status lost")
        if self.status != "ok" and self.cam_from_world is not None:
            raise ValueError(f"the status is {self.status}, and cam_from_world is given: a frame with a pose is ok")


class Run(Protocol):
    """A run of a tracker on one sequence."""

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; image (h, w) grey or (h, w, 3) BGR, stamps strictly increasing.

        A frame whose stamp is not later than all before is `lost` to uavbench's own trackers.
        """
        ...


class SensingRun(Run, Protocol):
    """A run that also uses the readings of the body's sensors."""

    def sense(self, samples: Mapping[str, Samples]) -> None:
        """Samples of each sensor, by name, since the last call; before each frame, up to and with its stamp."""
        ...


@dataclass(frozen=True, eq=False)
class Prediction:
    """Pose of the camera at the next frame, as predicted by the vehicle's filter.

    covariance (6, 6): of the twist xi with cam_from_world_true = exp(xi) @ cam_from_world, as in `TrackResult`.
    """

    cam_from_world: Pose
    covariance: Array


class PredictedRun(Run, Protocol):
    """A run that also uses the prediction of the vehicle's filter, which does not depend on the frame itself."""

    def predict(self, cam_from_world: Pose, covariance: Array) -> None:
        """Set the predicted pose and covariance (6, 6) of the next frame, as in `Prediction`; called before it."""
        ...


class Tracker(Protocol):
    """Parameters of a tracker variant: a frozen dataclass with this one method."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from a known initial pose, which is that of the first tracked frame."""
        ...


class BodyTracker(Protocol):
    """A tracker whose `start` also takes the `body`: the camera's mounting on it, and its sensors."""

    def start(
        self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator, *, body: Body
    ) -> Run:
        """Start a run from a known initial pose."""
        ...


class StartError(UserError):
    """An input of `start` that no run can begin with."""


class ImageError(UserError):
    """An image of an unsupported shape or type."""


class StampError(UserError):
    """A stamp that is no whole number of nanoseconds."""


def check_start(structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Pose:
    """The initial pose with its arrays stored by rows, as kernels take them.

    StartError for an input of another type, and for a pose that is not finite or not rigid (ROTATION_ERROR).
    """
    given = {"structure": structure, "camera": camera, "cam_from_world": cam_from_world, "rng": rng}
    for (name, value), (kind, hint) in zip(given.items(), START_INPUTS, strict=True):
        if not isinstance(value, kind):
            raise StartError(f"{name} is {type(value).__name__}; give a {kind.__name__}, as {hint}")
    if not np.isfinite(cam_from_world.matrix).all():
        raise StartError("the initial pose is not finite; give numbers")
    if not is_rotation(cam_from_world.rotation):
        raise StartError("the rotation of the initial pose is none: its rows are not orthonormal, or it mirrors")
    return Pose(np.ascontiguousarray(cam_from_world.rotation), cam_from_world.translation)


def is_rotation(R: Array) -> bool:
    """Whether a finite matrix (3, 3) is a rotation, to ROTATION_ERROR."""
    return bool(np.abs(R @ R.T - np.eye(3)).max() < ROTATION_ERROR and np.linalg.det(R) > 0)


def check_stamp(stamp_ns: int) -> int:
    """The stamp as an integer; StampError for another number, such as seconds."""
    try:
        return index(stamp_ns)
    except TypeError:
        raise StampError(f"the stamp is {stamp_ns!r}; give whole nanoseconds, as round(1e9 * seconds)") from None


@dataclass
class StampOrder:
    """The latest stamp of a run, by which it tells a frame that is not later than all before."""

    latest_ns: int | None = None

    def is_later(self, stamp_ns: int) -> bool:
        """Whether a frame is later than all before; stores its stamp. StampError as `check_stamp`."""
        stamp_ns = check_stamp(stamp_ns)
        later = self.latest_ns is None or stamp_ns > self.latest_ns
        self.latest_ns = stamp_ns if later else self.latest_ns
        return later


def check_image(image: Image, camera: Camera) -> Image:
    """The image as a contiguous, writable array for kernels and OpenCV; copied if necessary.

    ImageError unless it has the camera's size, is grey or BGR, and has 8 bits.
    """
    size = camera.height, camera.width
    usual = type(image) is np.ndarray and image.dtype == np.uint8 and image.flags.carray
    if usual and image.shape in (size, (*size, 3)):
        return image
    wanted = f"{size} grey or {(*size, 3)} BGR of type uint8"
    if not isinstance(image, np.ndarray) or isinstance(image, np.ma.MaskedArray):
        raise ImageError(f"the image is {type(image).__name__}; give an array {wanted}")
    if image.shape[:2] != size or image.shape[2:] not in ((), (3,)):
        raise ImageError(f"the image has the shape {image.shape}; give {wanted}")
    if image.dtype != np.uint8:
        raise ImageError(f"the image has the type {image.dtype}; give {wanted}, values from 0 to 255")
    return np.require(np.asarray(image), requirements=["C", "A", "W"])
