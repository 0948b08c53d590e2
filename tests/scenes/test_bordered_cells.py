"""Windows of an image without borders: groups of pixels that lie in them are not hidden, which is not looked into."""

from dataclasses import replace

import numpy as np

from tests.scenes.conftest import FLAT_LIGHT, looking, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.surfaces.surface_files import HIDDEN
from uavbench.scenes.dataset.surfaces.surface_truth import SurfaceTruth
from uavbench.scenes.primitives.meshes import panel
from uavbench.scenes.renderables import Part
from uavbench.scenes.rendering.antialiasing.coverage import (
    BORDERED,
    CELL_COLUMNS,
    CELL_ROWS,
    WINDOW_COLUMNS,
    WINDOW_ROWS,
    cells,
)
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.renderer import Renderer

CAMERA = Camera.from_field_of_view(172, 123, 70.0)
"""No whole number of cells or groups."""
POSES = [looking((0.0, 0.03 * k, 0.0), (1.0, 0.05 * k, 0.02 * k)) for k in range(6)]


def renderer_of_a_room() -> Renderer:
    """A box before a wall of many triangles in one plane, and the open air beside it."""
    vertices, triangles, uv = panel((4.0, 3.0, -1.5), (0.0, -4.0, 0.0), (0.0, 0.0, 3.0), 0.5)
    wall = Part(vertices=vertices, triangles=triangles, uv=uv)
    return Renderer((wall, white_box((2.0, -0.2, -0.2), (2.4, 0.2, 0.2))), FLAT_LIGHT, CAMERA.width, CAMERA.height)


def test_windows_without_borders_show_one_plane() -> None:
    with renderer_of_a_room() as renderer:
        renderer.color(POSES[0], CAMERA)
        seen, plane = renderer.pixels_seen(POSES[0], CAMERA), renderer.facet_table(POSES[0], CAMERA).plane
    planes = np.where(seen.facets >= 0, plane[seen.facets], -1)
    wide = np.pad(planes, ((0, 1), (0, 1)), mode="edge")
    unlike = (planes != wide[:-1, 1:]) | (planes != wide[1:, :-1])
    expected = np.empty(cells(*planes.shape), dtype=int)
    for line, cell in np.ndindex(*expected.shape):
        v, u = line * CELL_ROWS, cell * CELL_COLUMNS
        within = unlike[v : v + WINDOW_ROWS * CELL_ROWS, u : u + WINDOW_COLUMNS * CELL_COLUMNS]
        expected[line, cell] = BORDERED if within.any() else planes[v, u]
    assert np.array_equal(seen.windows, expected)
    assert 0.05 < (expected == BORDERED).mean() < 0.6
    assert len(np.unique(seen.facets)) > 4 * len(np.unique(planes))


def test_occlusion_is_the_same_where_no_window_is_known_to_be_without_borders() -> None:
    with renderer_of_a_room() as renderer:
        pinhole, lens = render_camera(CAMERA)
        source = ideal_camera(renderer, CAMERA, pinhole, lens, lambda ns: POSES[ns])
        truth = SurfaceTruth(renderer, source)
        hidden = 0
        before = truth.view(0)
        for number in range(1, len(POSES)):
            source.frame(number)
            view = truth.view(number)
            assert not (view.seen.windows == BORDERED).all()
            found = truth.flow(before, view)
            unknown = view.seen._replace(windows=np.full_like(view.seen.windows, BORDERED))
            in_full = truth.flow(before, replace(view, seen=unknown))
            assert np.array_equal(found.occlusion, in_full.occlusion)
            assert np.array_equal(found.filtered, in_full.filtered)
            hidden += int((found.occlusion == HIDDEN).sum())
            before = view
        assert hidden > 50
