"""The edges that the ground truth tells of lie where they are drawn, by measurement below the pixel."""

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, grey_wall, looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.annotations import EDGE_COLUMNS, visible_edges
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.renderables import Part
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera, sample
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.structure import Structure

REACH_PX, FAR_PX = 6.0, 3.0
"""How far across an edge the light is gathered, and beyond what distance it is that of one side alone."""
TONES = (0.05, 0.9, 0.35, 0.15, 0.6, 0.25)
CAMERAS = {
    "pinhole": Camera(640, 480, 520.0, 523.0, 322.0, 236.0),
    "radtan": Camera(640, 480, 520.0, 523.0, 322.0, 236.0, "radtan", (-0.21, 0.06, 0.0006, -0.0004)),
    "fisheye": Camera(640, 480, 420.0, 420.0, 319.5, 239.5, "equidistant", (-0.02, 0.01, 0.0, 0.0)),
}


def block() -> tuple[Structure, Part]:
    """A box each of whose faces has a tone of its own."""
    vertices, triangles = box((-0.2, -0.15, 0.0), (0.2, 0.15, 0.3))
    tone = np.repeat(np.array(TONES), 6)
    tint = np.column_stack([tone, tone, tone, np.ones(36)])
    corners = np.arange(36).reshape(12, 3)
    return Structure.from_mesh(vertices, triangles), Part(
        vertices=vertices[triangles.ravel()], triangles=corners, tint=tint, instance=1
    )


@pytest.mark.parametrize("name", list(CAMERAS))
def test_true_edges_lie_within_a_tenth_of_a_pixel_of_the_drawn_ones(name: str) -> None:
    camera = CAMERAS[name]
    structure, part = block()
    pinhole, lens = render_camera(camera)
    poses = [looking(eye, (0.02, 0.01, 0.14)) for eye in ((0.8, -0.5, 0.6), (-0.55, -0.75, 0.7), (0.5, 0.62, 0.8))]
    backdrop = [grey_wall(s * 4.0, 60.0, 0.45) for s in (1, -1)]
    off: list[float] = []
    with Renderer((part, *backdrop), FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        source = ideal_camera(renderer, camera, pinhole, lens, lambda k: poses[k])
        for k in range(len(poses)):
            light = source.image(k)
            assert light is not None
            for row in visible_edges(structure, source, source.render(k), encode(light)):
                if row[EDGE_COLUMNS.index("visible_share")] > 0.99:
                    off.append(across_the_edge(light[..., 1], structure.edge_segments[int(row[0])], camera, poses[k]))
    assert len(off) >= 20
    assert np.abs(off).max() < 0.1
    assert abs(np.mean(off)) < 0.03


def test_a_frame_may_have_more_visible_samples_than_a_row_of_an_image_of_opencv() -> None:
    structure, part = block()
    many = replace(structure, edges=np.tile(structure.edges, (200, 1)))
    camera, pose = CAMERAS["pinhole"], looking((0.8, -0.5, 0.6), (0.02, 0.01, 0.14))
    with Renderer((part,), FLAT_LIGHT, camera.width, camera.height) as renderer:
        source = ideal_camera(renderer, camera, camera, None, lambda _: pose)
        light = source.image(0)
        assert light is not None
        once, often = (visible_edges(each, source, source.render(0), encode(light)) for each in (structure, many))
    assert np.hypot(*(often[:, 3:5] - often[:, 1:3]).T).sum() > 2 * 32767  # samples are 2 px apart
    assert np.array_equal(often[: len(once)], once)


def across_the_edge(light: np.ndarray, ends: np.ndarray, camera: Camera, pose: object) -> float:
    """Mean distance, px, from the true edge to the step of light across it (moment-preserving: Tabatabai 1984)."""
    share = np.linspace(0.12, 0.88, 200)[:, None]
    at = camera.project(pose.transform(ends[0] + share * (ends[1] - ends[0])))  # type: ignore[attr-defined]
    along = np.gradient(at, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    steps = np.arange(-REACH_PX, REACH_PX + 0.01, 0.125)
    profile = sample(light, (at[:, None] + steps[:, None] * across[:, None]).astype(np.float32)).mean(axis=0)
    before, after = profile[steps < -FAR_PX].mean(), profile[steps > FAR_PX].mean()
    return float(((after - profile) / (after - before)).sum() * 0.125 - REACH_PX - 0.0625)
