"""Which parts of the visible edges no other face hides: what a drawing shows."""

from uavbench.scenes.camera import Camera
from uavbench.scenes.hidden_lines import seen_parts
from uavbench.scenes.structure import Structure
from uavbench.tracker.visible_edges import pinhole, visible_edges
from uavbench.trajectories.pose import Array, Pose


def seen_edges_px(structure: Structure, camera: Camera, cam_from_world: Pose) -> Array:
    """Parts (k, 2, 2) of the visible edges that no other face hides, in undistorted pixels: what a drawing shows."""
    edges = visible_edges(structure, camera, cam_from_world)
    parts = seen_parts(structure, cam_from_world.inverse().translation, edges.segments_m)
    return pinhole(cam_from_world.transform(parts.reshape(-1, 3)), camera).reshape(-1, 2, 2)
