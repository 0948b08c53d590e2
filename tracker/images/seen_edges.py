"""Hidden-line removal for drawings: the unoccluded parts of the visible edges."""

from uavbench.scenes.camera import Camera
from uavbench.scenes.hidden_lines import seen_parts
from uavbench.scenes.structure import Structure
from uavbench.tracker.visible_edges import pinhole, visible_edges
from uavbench.trajectories.pose import Array, Pose


def seen_edges_px(structure: Structure, camera: Camera, cam_from_world: Pose) -> Array:
    """Unoccluded parts (k, 2, 2) of the visible edges, in undistorted pixels."""
    edges = visible_edges(structure, camera, cam_from_world)
    parts = seen_parts(structure, cam_from_world.inverse().translation, edges.segments_m)
    return pinhole(cam_from_world.transform(parts.reshape(-1, 3)), camera).reshape(-1, 2, 2)
