"""The overlay: the model at a tracker's estimate, drawn on the image, and how much of it lies on edges there."""

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.seen_edges import seen_edges_px
from uavbench.tracker.protocol import Image, TrackResult
from uavbench.tracker.visible_edges import to_image
from uavbench.trajectories.pose import Array, Pose

OK_COLOUR = (60, 220, 60)
LOST_COLOUR = (40, 40, 230)
PIECES = 16
"""Number of straight pieces that approximate an edge under lens distortion."""
EDGE_GREY, EDGE_SIGMA_PX = (30, 80), 1.0
"""Thresholds of Canny's edges in grey levels, and the blur before."""
SHIFT = 4
"""Fractional bits of pixel coordinates in OpenCV's drawing functions."""


def draw_edges(image: Image, structure: Structure, camera: Camera, result: TrackResult) -> Image:
    """Copy (h, w, 3) of an image with the unoccluded model edges at the estimate, or with the status as text."""
    drawn = np.array(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    if result.cam_from_world is None:
        cv2.putText(drawn, result.status, (12, 32), cv2.FONT_HERSHEY_SIMPLEX, 1.0, LOST_COLOUR, 2, cv2.LINE_AA)
        return drawn
    for line in lines_in_image(seen_edges_px(structure, camera, result.cam_from_world), camera):
        points = np.round(line * 2**SHIFT).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(drawn, [points], False, OK_COLOUR, 1, cv2.LINE_AA, SHIFT)
    return drawn


def share_on_edges(image: Image, structure: Structure, camera: Camera, cam_from_world: Pose) -> float:
    """Share of the pixels of the drawn model edges that are within a pixel of an edge of the image; 0 without any."""
    grey = np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    edges = cv2.Canny(cv2.GaussianBlur(grey, (0, 0), EDGE_SIGMA_PX), *EDGE_GREY)
    near = cv2.dilate(edges, np.ones((3, 3), np.uint8)) > 0
    drawn = np.zeros_like(grey)
    for line in lines_in_image(seen_edges_px(structure, camera, cam_from_world), camera):
        points = np.round(line * 2**SHIFT).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(drawn, [points], False, 255, 1, cv2.LINE_8, SHIFT)
    return float(near[drawn > 0].mean()) if drawn.any() else 0.0


def lines_in_image(segments_px: Array, camera: Camera) -> list[Array]:
    """Lines (n, 2) in px of segments (k, 2, 2) in undistorted px, without their parts beyond a fold of the lens."""
    if camera.distortion_model == "none" or not len(segments_px):
        return list(segments_px)
    a, b = segments_px[:, :1], segments_px[:, 1:]
    flat = (a + np.linspace(0, 1, PIECES + 1)[:, None] * (b - a)).reshape(-1, 2)
    lines = to_image(flat, camera).reshape(-1, PIECES + 1, 2)
    seen = camera.before_fold(camera.without_distortion.rays(flat)).reshape(-1, PIECES + 1)
    pieces = []
    for line, shown in zip(lines, seen, strict=True):
        ends = np.flatnonzero(np.diff(shown)) + 1
        pieces += [piece for piece, kept in zip(np.split(line, ends), np.split(shown, ends), strict=True) if kept[0]]
    return [piece for piece in pieces if len(piece) > 1]
