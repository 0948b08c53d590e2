"""Where the edges of the structure lie in each frame, from the true poses."""

from functools import lru_cache

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.visible_edges import ProjectedEdges, visible_edges


@lru_cache(maxsize=4096)  # several figures ask for the same frames
def true_edges(sequence: Sequence, frame: int) -> ProjectedEdges:
    """Visible edges of the structure at the true pose of a frame."""
    return visible_edges(sequence.structure, sequence.camera, sequence.true_cam_from_world(frame))
