"""Images of a sequence for an export: distorted as recorded, or undistorted."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import FOLDED_PX, Camera
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, Sequence
from uavbench.scenes.dataset.surfaces.annotation_images import annotation_file
from uavbench.scenes.dataset.surfaces.depth_between_pixels import sampled_depth
from uavbench.scenes.image_files import image_of
from uavbench.scenes.rendering.camera_simulator import Map, pixel_grid
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

OUTSIDE = -1e4
"""Sampling position of a pixel outside the field of view of the lens."""


@dataclass(frozen=True, eq=False)
class Picture:
    """An image (h, w, 3), BGR, and the PNG file that holds it."""

    image: NDArray[np.uint8]
    png: bytes


@dataclass(frozen=True, eq=False)
class Shown:
    """Images, depth and masks of a sequence; `undistorted` ones are those of the pinhole with the same matrix K."""

    sequence: Sequence
    undistorted: bool = False

    @property
    def camera(self) -> Camera:
        """The camera of the images: the recorded one, or the pinhole of undistorted ones."""
        return self.sequence.camera.without_distortion if self.undistorted else self.sequence.camera

    @property
    def cameras(self) -> dict[str, "Shown"]:
        """All cameras of the sequence by name, the main one, `camera`, first."""
        others = {name: Shown(camera, self.undistorted) for name, camera in self.sequence.cameras.items()}
        return {MAIN: self, **others}

    def picture(self, frame: int) -> Picture:
        """The image of a frame and its PNG file, read and decoded once; UserError when it cannot be read."""
        sequence, path = self.sequence, self.sequence.folder / self.sequence.files[frame]
        if self._places is None and path.suffix == ".png":
            data = sequence.image_bytes(frame)
            return Picture(image_of(path, data, sequence.camera), data)
        image = self.image(frame)
        return Picture(image, png(image))

    def png(self, frame: int) -> bytes:
        """The image of a frame as a PNG file; UserError when it cannot be read."""
        return self.picture(frame).png

    def image(self, frame: int) -> NDArray[np.uint8]:
        """The image (h, w, 3) of a frame, BGR; UserError when it cannot be read."""
        return np.asarray(self._as_shown(self.sequence.image(frame), cv2.INTER_LINEAR), dtype=np.uint8)

    def has(self, annotation: Literal["depth", "mask"], frame: int) -> bool:
        """Whether the sequence has this annotation; UserError when it has, and not of this frame."""
        return annotation_file(self.sequence.folder, annotation, frame, len(self.sequence)) is not None

    def depth(self, frame: int) -> Array | None:
        """Depth (h, w) in metres, 0 where there is none; None where the sequence has no depth."""
        depth_m = self.sequence[frame].depth_m
        if depth_m is None or self._places is None:
            return depth_m
        unit_m = float(self.sequence.info.get("depth_m_per_unit", DEPTH_M_PER_UNIT))
        return sampled_depth(depth_m, self._places, unit_m)

    def mask(self, frame: int) -> NDArray[np.bool_] | None:
        """Mask (h, w) of the visible structure; None where the sequence has no masks."""
        instances = self.sequence[frame].mask
        return None if instances is None else np.asarray(self._as_shown(instances, cv2.INTER_NEAREST) == 1)

    @cached_property
    def _places(self) -> Map | None:
        """Position (h, w, 2) in the recorded image of each exported pixel; None where they are the same."""
        lens = self.sequence.camera
        if not self.undistorted or lens.distortion_model == "none":
            return None
        pixels = pixel_grid(lens.width, lens.height).reshape(-1, 2).astype(np.float64)
        rays = np.column_stack([(pixels - [lens.cx, lens.cy]) / [lens.fx, lens.fy], np.ones(len(pixels))])
        places = lens.project(rays)
        with np.errstate(invalid="ignore"):
            known = np.abs(lens.undistort(places) - pixels).max(axis=1) < FOLDED_PX
        places[~known] = OUTSIDE
        return places.reshape(lens.height, lens.width, 2).astype(np.float32)

    def _as_shown(self, image: NDArray[Any], how: int) -> NDArray[Any]:
        if self._places is None:
            return image
        none: Any = None
        return np.asarray(cv2.remap(image, self._places, none, how, borderMode=cv2.BORDER_CONSTANT))


def write_masks(shown: Shown, folder: Path, name: Callable[[int], str]) -> bool:
    """Write masks of the structure (255), if every frame has one; returns whether they were written."""
    if not all(shown.has("mask", frame) for frame in range(len(shown.sequence))):
        return False
    folder.mkdir()
    for frame in range(len(shown.sequence)):
        mask = shown.mask(frame)
        assert mask is not None
        (folder / name(frame)).write_bytes(png(np.where(mask, 255, 0).astype(np.uint8)))
    return True


STAMPS = "timestamps.csv"
"""Stamps of images that are numbered, so that the gaps of lost frames are known; readers of the formats skip it."""

NUMBERED = f"Stamps: in the format images are numbered and have no time stamps; {STAMPS} has them."


def write_stamps(folder: Path, stamps_ns: Mapping[str, int]) -> None:
    """Write the stamps of images by their names."""
    rows = (f"{stamp},{name}\n" for name, stamp in stamps_ns.items())
    write_text(folder / STAMPS, "".join(["#timestamp [ns],filename\n", *rows]))


def camera_ground_truth(sequence: Sequence) -> Trajectory:
    """True `world_from_cam` at each frame."""
    poses = [sequence.ground_truth.pose(k) @ sequence.cam_from_body_at(k).inverse() for k in range(len(sequence))]
    return Trajectory.from_poses(sequence.stamps_ns.tolist(), poses)


def png(image: NDArray[Any]) -> bytes:
    """An image as a PNG file."""
    done, data = cv2.imencode(".png", image)
    if not done:
        raise RuntimeError("OpenCV cannot encode the image")
    return data.tobytes()
