"""What ranging sensors meet is what the renderer draws: still parts, what moves, and leaves with holes."""

import numpy as np
import pytest

from tests.scenes.conftest import looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.clutter.people import People
from uavbench.scenes.clutter.trees import Trees
from uavbench.scenes.rendering.camera_simulator import pixel_grid
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.as_built import Deviation
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.trajectories.simulation.flight import FlightSpec

CAMERA = Camera.from_field_of_view(160, 120, 80.0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    spec = SequenceSpec(
        name="surfaces",
        seed=3,
        structure=Box(),
        environment=Indoor(),
        flight=FlightSpec(),
        clutter=(People(density=0.4, walking=1.0, nearest_m=0.8, furthest_m=2.5), Trees(density=0.1)),
        deviation=Deviation(scale_percent=5.0),
    )
    return build_scene(spec)


@pytest.mark.parametrize("time_s", [0.0, 1.37])
def test_rays_end_where_the_renderers_depth_is(scene: Scene, time_s: float) -> None:
    assert scene.movers and any(part.cutout for part in scene.parts)
    pixels = pixel_grid(CAMERA.width, CAMERA.height)[::2, ::2].reshape(-1, 2).astype(np.float64)
    rays = CAMERA.rays(pixels)
    agreeing = []
    with scene.renderer(CAMERA.width, CAMERA.height) as renderer:
        for eye in ((1.5, 0.3, 0.9), (-1.2, -1.4, 2.1)):
            pose = looking(eye, (0.0, 0.0, 0.4))
            depth = renderer.geometry(pose, CAMERA, time_s)[0][::2, ::2].reshape(-1)
            ways = rays @ pose.rotation
            length = np.linalg.norm(ways, axis=1)
            times = np.full(len(ways), round(time_s * 1e9))
            struck = scene.obstacles.surfaces.strike(np.tile(eye, (len(ways), 1)), ways / length[:, None], times)
            agreeing.append(np.abs(struck.distances_m / length - depth) < 1e-3)
            assert (struck.cosines[np.isfinite(struck.distances_m)] >= 0).all() and (struck.cosines <= 1).all()
    assert np.mean(agreeing) > 0.99  # the rest: edges, and the texture's filter at the rims of leaves


def test_where_somebody_walks_a_ray_ends_only_while_they_are_there(scene: Scene) -> None:
    mover = scene.movers[0]
    low, high = mover.part.vertices.min(axis=0), mover.part.vertices.max(axis=0)
    middle = mover.world_from_part(0.0).transform(((low + high) / 2)[None])[0]
    eye = np.add(middle, [1.0, 0.0, 0.3])
    times = np.arange(20) * 500_000_000
    struck = scene.obstacles.surfaces.strike(np.tile(eye, (20, 1)), np.tile([-1.0, 0.0, 0.0], (20, 1)), times)
    assert 0.6 < struck.distances_m[0] < 1.0
    assert (struck.distances_m > struck.distances_m[0] + 0.3).any()
