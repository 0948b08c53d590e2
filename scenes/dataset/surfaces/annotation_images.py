"""Depth, masks and further images of a frame as a sequence folder holds them, be they rendered or somebody's own."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import load_image
from uavbench.trajectories.errors import UserError

TO_THE_NEXT = ("flow", "occlusion")
"""Annotations that relate a frame to the next one: the last frame has none."""
INSTANCES = "0 everything else, 1 structure, 2 plants, 3 people, 4 birds, 10 and up lookalikes"
WHITE = 255
"""Value of the structure in masks of other programs, which no instance has; 5 to 9 are left to clutter of users."""
BITS = {np.dtype(np.uint8): 8, np.dtype(np.uint16): 16}


def annotation_file(folder: Path, kind: str, frame: int, frames: int, suffix: str = ".png") -> Path | None:
    """File of an annotation of a frame, of a sequence of `frames`; None where the sequence has no such annotation.

    UserError when it has a folder of this kind, and no file of this frame.
    """
    path = folder / kind / f"{frame:06d}{suffix}"
    if path.is_file():
        return path
    if (kind in TO_THE_NEXT and frame == frames - 1) or not (folder / kind).is_dir():
        return None
    raise UserError(
        f"{path}: is missing, while the folder {kind}/ is there, which holds a file named like this one for each "
        f"of the {frames} frames; add what is missing, or remove the folder"
    )


def samples_of(path: Path, folder: Path, camera: Camera, kind: type[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
    """Samples (h, w) of a grey image of the camera's size; UserError for one of another size, depth or with colours."""
    found = np.asarray(load_image(path, cv2.IMREAD_UNCHANGED, inside=folder))
    if found.shape != (camera.height, camera.width) or found.dtype != kind:
        height, width, *channels = found.shape
        colours = f", {channels[0]} channels" if channels else ""
        raise UserError(
            f"{path}: has {width} x {height} px of {BITS.get(found.dtype, '?')} bits{colours}; expected {camera.width} "
            f"x {camera.height} px of {BITS[np.dtype(kind)]} bits, in one channel without a palette"
        )
    return found


def mask_of(path: Path, folder: Path, camera: Camera) -> NDArray[np.uint8]:
    """Instances (h, w) of a mask; UserError when it is none of the camera's, or black and white."""
    instances = samples_of(path, folder, camera, np.uint8).astype(np.uint8)
    if (instances == WHITE).any():
        told = f"which no instance has ({INSTANCES}); write 1 for the structure"
        raise UserError(f"{path}: has the value {WHITE}, {told}")
    return instances
