"""Edges of the structure in each frame, projected at the true pose."""

from functools import lru_cache

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.visible_edges import ProjectedEdges, visible_edges


@lru_cache(maxsize=4096)  # several figures use the same frames
def true_edges(sequence: Sequence, frame: int) -> ProjectedEdges:
    """Visible edges of the structure at the true pose of a frame, in undistorted pixels."""
    return visible_edges(sequence.structure, sequence.camera, sequence.true_cam_from_world(frame))
