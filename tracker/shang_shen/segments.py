"""Step 5, edge detection: LSD line segments, or Canny edge pixels."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import FOLDED_PX, Camera
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array

MIN_SEGMENT_PX = 15.0
"""Segments shorter than this are dropped (Shang & Shen)."""
GRADIENT_ERROR = 1.0
"""Bound on the error of a gradient in grey levels (LSD's `quant`).

The authors use 2; with 1, edges of low contrast, such as cardboard on a wooden floor, are still detected.
"""
CANNY_LOW, CANNY_HIGH = 40.0, 120.0
"""Thresholds of Canny's hysteresis on the gradient of 8-bit images (ratio 1:3, Canny 1986)."""


def grey(image: Image) -> Image:
    """Grey image (h, w) of a BGR or grey one."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def detect_segments(gray: Image, min_length_px: float = MIN_SEGMENT_PX) -> Array:
    """LSD line segments x1 y1 x2 y2 (n, 4) in px, no shorter than min_length_px (von Gioi et al. 2010)."""
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, quant=GRADIENT_ERROR)
    found: Any = detector.detect(gray)[0]  # None when there is none
    if found is None:
        return np.zeros((0, 4))
    segments = found.reshape(-1, 4).astype(np.float64)
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return np.asarray(segments[lengths >= min_length_px], dtype=np.float64)


def undistort_segments(segments: Array, camera: Camera) -> Array:
    """Segments (k, 4) in the undistorted image, without those of pixels that no ray in front of the camera reaches.

    So are corners of the image of a fisheye of 180 degrees and more, which OpenCV undistorts to the other side.
    """
    if camera.distortion_model == "none" or not len(segments):
        return segments
    ends = segments.reshape(-1, 2)
    flat = camera.undistort(ends)
    off_px = np.abs(camera.project(camera.without_distortion.rays(flat)) - ends).max(axis=1)
    reached = (off_px < FOLDED_PX).reshape(-1, 2).all(axis=1)
    return np.asarray(flat.reshape(-1, 4)[reached])


def detect_edge_pixels(gray: Image, low: float = CANNY_LOW, high: float = CANNY_HIGH) -> NDArray[np.uint8]:
    """Canny edge image (h, w): 255 on an edge, 0 elsewhere (Canny 1986), after smoothing the noise (sigma 1 px)."""
    smooth = cv2.GaussianBlur(gray, (5, 5), 1.0)
    return np.asarray(cv2.Canny(smooth, low, high), dtype=np.uint8)
