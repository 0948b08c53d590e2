"""The tracker protocol: a frozen set of parameters that starts a run, and a run that takes frames.

What a run is given is all that it may know; the table in docs/my-tracker.md says the same for programs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body, Samples
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose

Image = NDArray[np.uint8]
Status = Literal["ok", "ambiguous", "lost", "not_initialized"]


@dataclass(frozen=True, kw_only=True)
class TrackResult:
    """A tracker's result for one frame.

    status is `ambiguous` where several poses explain the frame about equally well; like `lost`, it comes without an
    estimate. `cam_from_world` is the estimate, None unless status is `ok`; `guess` is the best guess of a tracker that
    searches, and no estimate. `covariance` (6, 6) is of the twist xi with cam_from_world_true = exp(xi) @
    cam_from_world, translation (m) first, rotation (rad) last, None where the tracker claims none. `stage_ms` holds the
    wall time of each stage by its name. The counts are None where they mean nothing.
    """

    status: Status
    cam_from_world: Pose | None = None
    covariance: Array | None = None
    stage_ms: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    segments: int | None = None
    control_points: int | None = None
    candidates: int | None = None
    inliers: int | None = None
    guess: Pose | None = None

    def __post_init__(self) -> None:
        if (self.status == "ok") != (self.cam_from_world is not None):
            raise ValueError("a frame has a pose exactly when its status is ok")


class Run(Protocol):
    """A tracker at work on one sequence."""

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; image (h, w) grey or (h, w, 3) BGR, stamps strictly increasing."""
        ...


class SensingRun(Run, Protocol):
    """A run that takes the readings of the body's sensors too."""

    def sense(self, samples: Mapping[str, Samples]) -> None:
        """Samples of each sensor, by name, since the last call; before each frame, up to and with its stamp."""
        ...


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where the vehicle's filter expects the camera at the next frame.

    covariance (6, 6) is of the twist xi with cam_from_world_true = exp(xi) @ cam_from_world, as in `TrackResult`.
    """

    cam_from_world: Pose
    covariance: Array


class PredictedRun(Run, Protocol):
    """A run that takes what the vehicle's filter expects, in flight; nothing of the frame itself is in that."""

    def predict(self, cam_from_world: Pose, covariance: Array) -> None:
        """Expected pose of the next frame with its covariance (6, 6), as in `Prediction`; before each such frame."""
        ...


class Tracker(Protocol):
    """Parameters of a tracker variant: a frozen dataclass with this one method."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from a known initial pose; the first frame tracked is the one that the pose belongs to."""
        ...


class BodyTracker(Protocol):
    """A tracker whose `start` takes the `body` as well: the camera's place on it, and its sensors."""

    def start(
        self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator, *, body: Body
    ) -> Run:
        """Start a run from a known initial pose."""
        ...


class ImageError(UserError):
    """An image is none that a tracker takes."""


def check_image(image: Image, camera: Camera) -> Image:
    """The image in rows of its own, as kernels and OpenCV need it: a view, a crop or a read-only one is copied.

    ImageError unless it is of the camera's size, grey or BGR, and of 8 bits.
    """
    wanted = f"({camera.height}, {camera.width}) grey or ({camera.height}, {camera.width}, 3) BGR of type uint8"
    if not isinstance(image, np.ndarray) or isinstance(image, np.ma.MaskedArray):
        raise ImageError(f"the image is {type(image).__name__}; give an array {wanted}")
    if image.shape[:2] != (camera.height, camera.width) or image.shape[2:] not in ((), (3,)):
        raise ImageError(f"the image has the shape {image.shape}; give {wanted}")
    if image.dtype != np.uint8:
        raise ImageError(f"the image has the type {image.dtype}; give {wanted}, values from 0 to 255")
    return np.require(np.asarray(image), requirements=["C", "A", "W"])
