"""Pictures of a tracker's features: segments, model edges on detected edges, overlays.

Everything is drawn on the undistorted image, which trackers process.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.seen_edges import seen_edges_px
from uavbench.tracker.shang_shen.segments import MIN_SEGMENT_PX, detect_edge_pixels, detect_segments, grey
from uavbench.trajectories.pose import Array, Pose

Image = NDArray[np.uint8]
GREEN, WHITE = (60, 220, 70), (255, 255, 255)
HUES = ((40, 60, 235), (30, 160, 30), (220, 90, 20), (20, 140, 240), (190, 40, 170), (150, 150, 0))
SHIFT = 4


class SegmentPicture(NamedTuple):
    """The image (h, w, 3) in grey with its LSD segments in alternating colours, and their number."""

    image: Image
    found: int


@dataclass(frozen=True, eq=False)
class View:
    """One frame of a sequence to draw on: undistorted image (h, w, 3) BGR, camera, structure."""

    image: Image
    camera: Camera
    structure: Structure

    @classmethod
    def of(cls, image: Image, camera: Camera, structure: Structure) -> "View":
        """View of a distorted image (h, w, 3) BGR of the camera."""
        return cls(undistorted(image, camera), camera, structure)

    def projected(self, cam_from_world: Pose | None) -> Array:
        """Visible edges of the structure (k, 2, 2) in undistorted px; k = 0 without a pose."""
        if cam_from_world is None:
            return np.zeros((0, 2, 2))
        return seen_edges_px(self.structure, self.camera, cam_from_world)

    def segments(self) -> SegmentPicture:
        """The LSD segments of at least MIN_SEGMENT_PX."""
        found = detect_segments(grey(self.image), MIN_SEGMENT_PX)
        canvas = np.ascontiguousarray(np.repeat((255 - (255 - grey(self.image)) // 2)[..., None], 3, axis=2))
        for i, segment in enumerate(found):
            draw(canvas, segment.reshape(1, 2, 2), HUES[i % len(HUES)], 2)
        return SegmentPicture(canvas, len(found))

    def model_on_edges(self, cam_from_world: Pose | None) -> Image:
        """Image (h, w, 3) of the detected edge pixels in white on black, with the model's visible edges in green."""
        edges = cv2.dilate(detect_edge_pixels(grey(self.image)), np.ones((3, 3), dtype=np.uint8))
        canvas: Image = np.repeat(np.asarray(edges, dtype=np.uint8)[..., None], 3, axis=2)
        draw(canvas, self.projected(cam_from_world), GREEN, 1)
        return canvas

    def overlay(self, estimate: Pose | None, ground_truth: Pose | None = None) -> Image:
        """The image with the model at the estimated cam_from_world in green, over that at the true one in white."""
        canvas = self.image.copy()
        if ground_truth is not None:
            draw(canvas, self.projected(ground_truth), WHITE, 1)
        draw(canvas, self.projected(estimate), GREEN, 2)
        return canvas


def draw(canvas: Image, segments_px: Array, colour: tuple[int, ...], thickness: int) -> None:
    """Draw segments (k, 2, 2) in px into an image with sub-pixel precision; colour BGR, thickness in px."""
    limit = 4.0 * max(canvas.shape[:2])
    points = np.round(np.clip(segments_px, -limit, limit) * (1 << SHIFT)).astype(np.int32)
    for (x0, y0), (x1, y1) in points.tolist():
        cv2.line(canvas, (x0, y0), (x1, y1), colour, thickness, cv2.LINE_AA, SHIFT)


def write_text_on(canvas: Image, text: str, colour: tuple[int, ...] = WHITE) -> None:
    """Write a line of text on a dark background into the top left corner of an image, smaller where it is long."""
    scale = canvas.shape[1] / 900
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 1)
    scale *= min(1.0, (canvas.shape[1] - 12) / max(width, 1))
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 1)
    cv2.rectangle(canvas, (0, 0), (width + 12, height + base + 8), (28, 26, 24), -1)
    cv2.putText(canvas, text, (6, height + 5), cv2.FONT_HERSHEY_DUPLEX, scale, colour, 1, cv2.LINE_AA)


def undistorted(image: Image, camera: Camera) -> Image:
    """An image (h, w, 3) resampled to the camera without distortion."""
    if camera.distortion_model == "none":
        return image
    return np.asarray(cv2.remap(image, *_maps(camera), cv2.INTER_LINEAR), dtype=np.uint8)


@lru_cache(maxsize=4)
def _maps(camera: Camera) -> tuple[Any, Any]:
    size = (camera.width, camera.height)
    if camera.distortion_model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(
            camera.K, camera.coefficients, np.eye(3), camera.K, size, cv2.CV_32FC1
        )
    return cv2.initUndistortRectifyMap(camera.K, camera.coefficients, np.eye(3), camera.K, size, cv2.CV_32FC1)
