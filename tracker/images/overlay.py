"""The overlay: the model at a tracker's estimate, drawn on the image."""

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.seen_edges import seen_edges_px
from uavbench.tracker.protocol import Image, TrackResult
from uavbench.tracker.visible_edges import to_image

OK_COLOUR = (60, 220, 60)
LOST_COLOUR = (40, 40, 230)
PIECES = 16
"""Number of straight pieces that approximate an edge under lens distortion."""
SHIFT = 4
"""Fractional bits of pixel coordinates in OpenCV's drawing functions."""


def draw_edges(image: Image, structure: Structure, camera: Camera, result: TrackResult) -> Image:
    """Copy (h, w, 3) of an image with the unoccluded model edges at the estimate, or with the status as text."""
    drawn = np.array(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    if result.cam_from_world is None:
        cv2.putText(drawn, result.status, (12, 32), cv2.FONT_HERSHEY_SIMPLEX, 1.0, LOST_COLOUR, 2, cv2.LINE_AA)
        return drawn
    part = np.linspace(0, 1, 2 if camera.distortion_model == "none" else PIECES + 1)[:, None]
    for a, b in seen_edges_px(structure, camera, result.cam_from_world):
        line = to_image(a + part * (b - a), camera)
        points = np.round(line * 2**SHIFT).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(drawn, [points], False, OK_COLOUR, 1, cv2.LINE_AA, SHIFT)
    return drawn
