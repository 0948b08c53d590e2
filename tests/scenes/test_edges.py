"""The edges that the ground truth tells of lie where they are drawn, by measurement below the pixel."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, grey_wall, looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.annotations import EDGE_COLUMNS, visible_edges
from uavbench.scenes.dataset.edges.contrast_kernels import SIDE_PX, find_contrasts
from uavbench.scenes.dataset.edges.edge_lines import edge_lines
from uavbench.scenes.dataset.edges.sample_kernels import see
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


def test_contrasts_are_differences_of_grey_levels_beside_an_edge() -> None:
    """As OpenCV interpolates them in the grey image, also beyond its border."""
    rng = np.random.default_rng(8)
    image = rng.integers(0, 256, (50, 70, 3), dtype=np.uint8)
    seen, which = rng.random(600) < 0.8, np.arange(600) // 20
    ways = np.repeat(rng.uniform(0, 2 * np.pi, 30), 20)
    along, across = np.stack([np.cos(ways), np.sin(ways)], 1), np.stack([-np.sin(ways), np.cos(ways)], 1)
    pixels = np.repeat(rng.uniform(0, 50, (30, 2)), 20, axis=0) + 2.0 * (np.arange(600) % 20)[:, None] * along
    out = np.full(600, np.nan)
    find_contrasts(pixels, which, seen, image, out)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    left, right = (sample(grey, (pixels + side * across).astype(np.float32)[None])[0] for side in (SIDE_PX, -SIDE_PX))
    np.testing.assert_allclose(out, np.abs(left - right) * seen, atol=0.01)
    assert (pixels[seen] > [72, 52]).any() and np.ptp(out) > 100


def test_lines_of_edges_are_as_python_formats_them() -> None:
    """Ties of the last digit, signs and zeros among them: files keep their bytes."""
    values = np.concatenate(
        [
            np.random.default_rng(0).uniform(-2.0, 16384.0, 6000),
            np.arange(-6000, 6000) / 32.0,
            np.arange(12000) / 20000.0,
            [-0.0, 0.0, -1e-9, 5e-5, -5e-5, 1.5e-4, 0.99995, 9.99995, 255.0, -16384.0, 123456789.25, 1e-300],
        ]
    ).reshape(-1, 6)
    rows = np.column_stack([np.arange(len(values)), values])
    line = "%d" + ",%.4f" * 6 + "\n"
    assert edge_lines(rows).decode() == line * len(rows) % tuple(rows.reshape(-1).tolist())
    assert edge_lines(np.zeros((0, 7))) == b""


@pytest.mark.parametrize(
    ("around", "visible"),
    [(1.0, False), (2.0, True), (1.989, True), (1.97, False), (0.0, True)],
    ids=["before", "as far", "within the tolerance", "just outside of it", "background"],
)
@pytest.mark.parametrize("place", [(0, 0), (1, 0), (2, 2), (1, 1)], ids=str)
def test_a_sample_is_visible_if_any_pixel_around_it_is_no_nearer(
    around: float, visible: bool, place: tuple[int, int]
) -> None:
    """The pixel that decides is one of nine; all others show something nearer."""
    depth = np.full((5, 5), 1.0, dtype=np.float32)
    depth[1 + place[0], 1 + place[1]] = around
    seen = np.empty(1, dtype=np.bool_)
    see(np.array([[0.0, 0.0, 2.0]]), (1.0, 1.0, 2.0, 2.0), depth, np.array([[2.0, 2.0]]), (5, 5), seen)
    assert bool(seen[0]) == visible


def test_a_sample_in_a_corner_sees_only_pixels_of_the_image() -> None:
    """Pixels that the neighbourhood would have beyond the border are none; those two away do not count."""
    depth = np.full((5, 5), 1.0, dtype=np.float32)
    depth[2:, :] = depth[:, 2:] = 2.0
    seen = np.empty(1, dtype=np.bool_)
    see(np.array([[0.0, 0.0, 2.0]]), (1.0, 1.0, 0.0, 0.0), depth, np.array([[0.0, 0.0]]), (5, 5), seen)
    assert not seen[0]
