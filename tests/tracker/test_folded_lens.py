"""What lies beyond a fold of the lens, which its polynomial maps back into the image, is drawn nowhere."""

from pathlib import Path

import numpy as np
import pytest

from uavbench.bench.pick.server import Picking
from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.overlay import draw_edges, lines_in_image
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.pose import Pose

CAMERA = Camera(640, 480, 330.0, 330.0, 320.0, 240.0, "radtan", (-0.14, 0.0, 0.0, 0.0))
"""Folds over at 1.543 focal lengths, 339 px in the image: beyond the middles of its sides, before its corners."""
FOLD = (3 * 0.14) ** -0.5


def block(x: float, y: float) -> Structure:
    """A small box in front of the camera, x and y at a depth of 1."""
    return Structure.from_mesh(*box((x, y, 1.0), (x + 0.1, y + 0.1, 1.05)))


def test_a_box_beyond_the_fold_leaves_the_image_as_it_is() -> None:
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    result = TrackResult(status="ok", cam_from_world=Pose.identity())
    beyond, before = block(1.5, 1.15), block(0.5, 0.4)
    pixels = CAMERA.project(beyond.vertices)
    assert (pixels > 0).all() and (pixels < [640, 480]).all()  # where it would be drawn
    assert len(visible_edges(beyond, CAMERA, Pose.identity()).edges)
    assert not draw_edges(image, beyond, CAMERA, result).any()
    assert draw_edges(image, before, CAMERA, result).any()


def test_a_line_across_the_fold_ends_there() -> None:
    ends = CAMERA.without_distortion.project(np.array([[0.2, 0.15, 1.0], [1.6, 1.2, 1.0]]))
    (line,) = lines_in_image(ends[None], CAMERA)
    r = np.linalg.norm((CAMERA.undistort(line) - [320.0, 240.0]) / 330.0, axis=1)
    assert r[0] == pytest.approx(0.25) and (np.diff(r) > 0).all()
    assert FOLD - 0.2 < r[-1] < FOLD


def test_the_page_of_pick_draws_no_edges_beyond_the_fold(tmp_path: Path) -> None:
    near, far = block(0.5, 0.4), block(1.5, 1.15)
    both = Structure.from_mesh(
        np.concatenate([near.vertices, far.vertices]), np.concatenate([near.triangles, far.triangles + 8])
    )
    picking = Picking(np.zeros((480, 640, 3), dtype=np.uint8), CAMERA, both, tmp_path / "init.toml")
    at = np.flatnonzero(picking.corners[:, 0] < 1.0)
    pixels = CAMERA.project(picking.corners)
    lines = picking.solve([{"corner": int(k), "image_px": pixels[k].tolist()} for k in at])["lines"]
    reach = np.abs(np.concatenate(lines) - pixels[at].mean(axis=0)).max()
    assert reach < 60.0  # of the near box alone


@pytest.mark.parametrize(
    ("distortion", "fold_deg"),
    [
        ((1 / 12, 1 / 120, 17 / 20160, 31 / 362880), np.inf),  # stereographic: farther out than 90 degrees times f
        ((0.0, 0.0, 0.0, 0.0), np.inf),
        ((-0.25, 0.0, 0.0, 0.0), np.degrees((3 * 0.25) ** -0.5)),
        ((0.1, -0.1, 0.0, 0.0), np.degrees(np.sqrt(0.3 + np.sqrt(0.09 + 2.0)))),
    ],
)
def test_a_fisheye_shows_all_angles_up_to_its_fold(distortion: tuple[float, ...], fold_deg: float) -> None:
    """By where its polynomial ends to grow; edges beyond 77 degrees of a stereographic lens had been left out."""
    camera = Camera(640, 480, 160.0, 160.0, 320.0, 240.0, "equidistant", distortion)
    angle = np.radians(np.arange(60.0, 89.0, 0.5))
    points = np.column_stack([np.tan(angle), 0.0 * angle, np.ones(len(angle))])
    assert camera.before_fold(points).tolist() == (np.degrees(angle) < fold_deg).tolist()
    if np.isfinite(fold_deg):
        return
    (line,) = lines_in_image(camera.without_distortion.project(points[[0, -1]])[None], camera)
    assert line[-1] == pytest.approx(camera.project(points[-1:])[0], abs=1e-6)
