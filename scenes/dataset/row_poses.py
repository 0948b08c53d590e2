"""The file of the pose of each row of a rolling shutter: `row_poses.npy`."""

import numpy as np

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import ANY
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.pose import Array


def read_row_poses(sequence: Sequence) -> Array:
    """Poses `world_from_body` (n, h, 7) of the rows of all frames, px py pz qw qx qy qz, mapped and not read yet.

    UserError naming the file when it is missing, leads out of the folder, or does not hold them.
    """
    path = sequence.folder / "row_poses.npy"
    with opened(path, ANY, inside=sequence.folder):
        pass
    try:
        found = np.lib.format.open_memmap(path, mode="r")
    except (ValueError, SyntaxError, TypeError, OverflowError) as error:
        raise UserError(f"{path}: no array of poses: {error}; render the sequence again") from None
    expected = (len(sequence), sequence.camera.height, 7)
    if found.shape != expected or found.dtype != np.float64:
        raise UserError(f"{path}: is {found.shape} {found.dtype}, not {expected} float64; render the sequence again")
    return found
