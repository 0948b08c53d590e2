"""`uavbench.start`: starts a tracker on a model and a camera, for images from any source."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uavbench.scenes.calibrations.camera_plausibility import implausible
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.track_images import UNKNOWN_BODY, load_model
from uavbench.tracker.protocol import Run, Tracker, check_start
from uavbench.tracker.registry import TRACKERS, tracker_kind
from uavbench.tracker.run import started
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

LEAST_PX = 2.0
"""Size of a model in the image below which its pose is doubted, as of one in millimetres."""


def start(
    tracker: str | Tracker,
    model: str | Path | Structure,
    camera: Camera | str | Path,
    cam_from_world: Pose | ArrayLike,
    *,
    seed: int = 0,
) -> Run:
    """Start a tracker; `run.track(image, stamp_ns)` returns the estimate for the next frame.

    tracker: a name that `uavbench list` shows, or a tracker object with its parameters. model: a file (OBJ, STL, PLY,
    glTF, CAO, IFC) in metres, z up, or a `Structure`. camera: a `Camera` or the path of its camera.toml.
    cam_from_world: pose of the first image, a `Pose` or a homogeneous matrix (4, 4), in metres; the world is the
    model's frame, the camera's axes are x right, y down, z forward.

    `track` takes an image (h, w, 3) BGR or (h, w) grey, uint8, and its stamp in ns, strictly increasing. Its result has
    `.status` (`ok`, `ambiguous`, `lost`, `not_initialized`), `.cam_from_world` and `.covariance` (6, 6) of the twist,
    translation (m) first. UserError for an invalid file, name, seed or pose, and for inputs of another type.
    UserWarning for a pose at which the image cannot show the model.

    >>> import numpy as np
    >>> from uavbench import Camera, Structure, start
    >>> corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
    >>> sides = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    >>> box = Structure.from_mesh(corners, np.vstack([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]]))
    >>> camera = Camera.from_field_of_view(160, 120, 60)
    >>> cam_from_world = [[1, 0, 0, 0], [0, 0, -1, 0.5], [0, 1, 0, 4], [0, 0, 0, 1]]
    >>> run = start("hold", box, camera, cam_from_world)
    >>> run.track(np.zeros((120, 160), np.uint8), stamp_ns=0).status
    'ok'
    """
    if isinstance(tracker, str):
        if tracker not in TRACKERS:
            raise unknown_name("tracker", tracker, list(TRACKERS))
        tracker = TRACKERS[tracker]()
    elif isinstance(tracker, type) or not callable(getattr(tracker, "start", None)):
        raise UserError(f"tracker is {tracker!r}; give a name, or an object with its parameters, as Robust()")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UserError(f"seed = {seed!r}: must be a whole number from 0 on")
    structure = load_model(Path(model)) if isinstance(model, str | Path) else model
    lens = Camera.load(Path(camera)) if isinstance(camera, str | Path) else camera
    if isinstance(lens, Camera) and (why := implausible(lens)):
        raise UserError(f"camera: {why}")
    rng = stream(int(seed), "tracker", tracker_kind(tracker))
    pose = check_start(structure, lens, _pose(cam_from_world), rng)
    if _out_of_sight(structure, lens, pose):
        warnings.warn(
            "cam_from_world: at this pose the image shows nothing of the model; is it in metres, and no inverse "
            "(world_from_cam)?",
            stacklevel=2,
        )
    return started(tracker, structure, lens, pose, rng, UNKNOWN_BODY)


def _pose(given: Any) -> Pose:
    if isinstance(given, Pose):
        return given
    try:
        return Pose.from_matrix(given)
    except (ValueError, TypeError, OverflowError) as error:
        raise UserError(f"cam_from_world: {error}; give a Pose or a homogeneous matrix (4, 4)") from None


def _out_of_sight(structure: Structure, camera: Camera, cam_from_world: Pose) -> bool:
    """Whether all of a model is behind the camera, beyond one side of the image, or smaller than LEAST_PX."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    x, y = (-0.5, 0.5 * camera.width, right), (-0.5, 0.5 * camera.height, bottom)
    border = camera.undistort(np.array([[u, v] for u in x for v in y]))
    f, c = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    low, high = (border.min(axis=0) - c) / f, (border.max(axis=0) - c) / f
    points = cam_from_world.transform(structure.vertices)
    sideways, z = points[:, :2], points[:, 2:]
    beyond = (z <= 0).all() or (sideways < low * z).all(axis=0).any() or (sideways > high * z).all(axis=0).any()
    return bool(beyond or ((z > 0).all() and (f * np.ptp(sideways / z, axis=0) < LEAST_PX).all()))
