"""Small scenes and cameras that several tests use."""

import numpy as np
import pytest
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.surfaces.surface_truth import FlowTruth
from uavbench.scenes.primitives.meshes import box, panel
from uavbench.scenes.renderables import Light, Part
from uavbench.trajectories.pose import Pose

FLAT_LIGHT = Light(
    to_lamp=(0.0, 0.0, 1.0), lamp=(0.0, 0.0, 0.0), above=(1.0, 1.0, 1.0), below=(1.0, 1.0, 1.0), shadow_map=False
)


def looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Pose:
    """cam_from_world of a camera at `eye` that looks at `at`, upright."""
    z = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.array([x, np.cross(z, x), z])
    return Pose(R, -R @ np.array(eye))


def white_box(low: tuple[float, float, float], high: tuple[float, float, float], instance: int = 1) -> Part:
    vertices, triangles = box(low, high)
    return Part(vertices=vertices, triangles=triangles, instance=instance)


def grey_wall(distance_m: float, size_m: float, level: float) -> Part:
    """A wall across the x axis, seen from the origin, of an albedo in linear light."""
    vertices, triangles, uv = panel((distance_m, size_m / 2, -size_m / 2), (0, -size_m, 0), (0, 0, size_m), size_m)
    tint = np.column_stack([np.full((4, 3), level), np.ones(4)])
    return Part(vertices=vertices, triangles=triangles, uv=uv, tint=tint)


def flow_codes(found: FlowTruth) -> NDArray[np.uint16]:
    """Numbers (h, w, 3) of a flow file: u, v, known."""
    rows = np.cumsum(found.filtered[:, 1:], axis=0, dtype=np.uint8)
    return rows.view(">u2").reshape(*found.occlusion.shape, 3).astype(np.uint16)


@pytest.fixture
def camera() -> Camera:
    return Camera(320, 240, 300.0, 310.0, 161.3, 117.8)
