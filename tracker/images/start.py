"""`uavbench.start`: starts a tracker on a model and a camera, for images from any source."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uavbench.scenes.camera import Camera, implausible
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.track_images import UNKNOWN_BODY, load_model
from uavbench.tracker.protocol import Run, Tracker, check_start
from uavbench.tracker.registry import TRACKERS, tracker_kind
from uavbench.tracker.run import started
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream


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
    return started(
        tracker, structure, lens, check_start(structure, lens, _pose(cam_from_world), rng), rng, UNKNOWN_BODY
    )


def _pose(given: Any) -> Pose:
    if isinstance(given, Pose):
        return given
    try:
        return Pose.from_matrix(given)
    except (ValueError, TypeError, OverflowError) as error:
        raise UserError(f"cam_from_world: {error}; give a Pose or a homogeneous matrix (4, 4)") from None
