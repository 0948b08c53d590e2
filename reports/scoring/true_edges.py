"""Edges of the structure in each frame, projected at the true pose."""

from functools import lru_cache

import numpy as np

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.visible_edges import ProjectedEdges, visible_edges

POINTS = 256
"""Points of an edge at which it is looked whether a lens shows it: some 2 px apart."""


@lru_cache(maxsize=4096)  # several figures use the same frames
def true_edges(sequence: Sequence, frame: int) -> ProjectedEdges:
    """Visible edges of the structure at the true pose of a frame, in undistorted pixels."""
    return visible_edges(sequence.structure, sequence.camera, sequence.true_cam_from_world(frame))


@lru_cache(maxsize=4096)
def edges_in_image(sequence: Sequence, frame: int) -> ProjectedEdges:
    """The parts of `true_edges` within the image of the camera, whose segments_px are pixels of that image.

    Edges of a camera with distortion are clipped to a rectangle around its undistorted image, which is larger.
    """
    edges, camera = true_edges(sequence, frame), sequence.camera
    if camera.distortion_model == "none":
        return edges
    a, b = edges.segments_m[:, :1], edges.segments_m[:, 1:]
    points_m = a + np.linspace(0, 1, POINTS)[:, None] * (b - a)
    in_camera = sequence.true_cam_from_world(frame).transform(points_m.reshape(-1, 3))
    inside = camera.in_image(in_camera).reshape(-1, POINTS)
    rows = np.flatnonzero(inside.sum(axis=1) > 1)
    first, last = inside[rows].argmax(axis=1), POINTS - 1 - inside[rows, ::-1].argmax(axis=1)
    ends = np.column_stack([first, last])
    cut = in_camera.reshape(-1, POINTS, 3)[rows[:, None], ends]
    pixels = camera.project(cut.reshape(-1, 3)).reshape(-1, 2, 2)
    return ProjectedEdges(edges.edges[rows], pixels, points_m[rows[:, None], ends], cut[..., 2])
