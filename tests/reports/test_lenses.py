"""Attributes of frames and the drawn cameras are those of the lens, by a projection of its own."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.reports.drawn import make_sequence
from uavbench.reports.figures.flight import frustum
from uavbench.reports.scoring.attributes import blur_px, contrast, distance_m, occlusion, visible_edge_count
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.annotations import EDGE_COLUMNS, edges_file
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.pose import Array, Pose

FRAMES = [0, 1, 2]
EXPOSURE_MS = 20.0


def lens(camera: Camera, *, f: float, model: str = "equidistant") -> Camera:
    k = (0.0, 0.0, 0.0, 0.0) if model == "equidistant" else (-0.28, 0.07, 0.0, 0.0)
    return replace(camera, fx=f, fy=1.1 * f, distortion_model=model, distortion=k)


def pixels(camera: Camera, pose: Pose, points: Array) -> Array:
    """By the formulas of the two lenses."""
    cam = points @ pose.rotation.T + pose.translation
    x, y = cam[:, 0] / cam[:, 2], cam[:, 1] / cam[:, 2]
    r = np.maximum(np.hypot(x, y), 1e-12)
    scale = np.arctan(r) / r if camera.distortion_model == "equidistant" else 1 - 0.28 * r**2 + 0.07 * r**4
    return np.column_stack([camera.fx * x * scale + camera.cx, camera.fy * y * scale + camera.cy])


def parts_in_image(sequence: Sequence, frame: int) -> Iterator[Array]:
    """Points (n, 3) along the part in the image of each edge of which a face is seen."""
    s, camera, pose = sequence.structure, sequence.camera, sequence.true_cam_from_world(frame)
    facing = ((s.face_points - pose.inverse().translation) * s.face_normals).sum(axis=1) < 0
    for (a, b), faces in zip(s.edge_segments, s.edge_faces, strict=True):
        if any(facing[face] for face in faces if face >= 0):
            points = a + np.linspace(0, 1, 2000)[:, None] * (b - a)
            at = pixels(camera, pose, points)
            inside = ((at > -0.5) & (at < [camera.width - 0.5, camera.height - 0.5])).all(axis=1)
            if inside.any():
                yield points[inside]


def blurred(sequence: Sequence) -> Sequence:
    config = {"effects": [{"kind": "motion-blur", "exposure_ms": EXPOSURE_MS}]}
    return replace(sequence, info={**sequence.info, "config": config})


@pytest.mark.parametrize(("model", "zoom"), [("equidistant", 3.0), ("equidistant", 0.6), ("radtan", 2.5)])
def test_attributes_are_those_of_the_image_that_the_lens_gives(tmp_path: Path, model: str, zoom: float) -> None:
    made = make_sequence(tmp_path / "arc", 5)
    sequence = blurred(replace(made, camera=lens(made.camera, f=zoom * made.camera.fx, model=model)))
    counts, depths, moved = [], [], []
    for frame in FRAMES:
        now, later = (sequence.true_cam_from_world(k) for k in (frame, frame + 1))
        parts = list(parts_in_image(sequence, frame))
        ends = np.concatenate([points[[0, -1]] for points in parts])
        rows = pixels(sequence.camera, now, ends).reshape(-1, 4)
        edges_file(sequence, frame).parent.mkdir(exist_ok=True)
        lines = [f"0,{','.join(map(str, row))},1,9" for row in rows.tolist()]
        edges_file(sequence, frame).write_text("\n".join([",".join(EDGE_COLUMNS), *lines]) + "\n")
        counts.append(len(parts))
        depths.append(np.median((ends @ now.rotation.T + now.translation)[:, 2]))
        step_ms = (sequence.stamps_ns[frame + 1] - sequence.stamps_ns[frame]) / 1e6
        away = pixels(sequence.camera, later, ends) - pixels(sequence.camera, now, ends)
        moved.append(np.median(np.linalg.norm(away, axis=1)) * EXPOSURE_MS / step_ms)
    assert visible_edge_count(sequence, FRAMES).tolist() == counts
    assert distance_m(sequence, FRAMES) == pytest.approx(depths, rel=0.01)
    assert blur_px(sequence, FRAMES) == pytest.approx(moved, rel=0.02)
    assert occlusion(sequence, FRAMES).max() < 1.0  # nothing is hidden
    assert np.isfinite(contrast(sequence, FRAMES)).all()


@pytest.mark.parametrize("model", ["equidistant", "radtan"])
def test_a_lens_projects_no_points_to_no_pixels(model: str) -> None:
    camera = lens(Camera.from_field_of_view(64, 48, 60.0), f=50.0, model=model)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.in_image(np.zeros((0, 3))).shape == (0,)


def test_a_lens_that_shows_no_edge_has_none(tmp_path: Path) -> None:
    made = make_sequence(tmp_path / "arc", 5)
    away = replace(lens(made.camera, f=60 * made.camera.fx), cx=9000.0)
    sequence = blurred(replace(made, camera=away))
    assert visible_edge_count(sequence, FRAMES).tolist() == [0, 0, 0]
    for values in (distance_m, blur_px, contrast):
        assert np.isnan(values(sequence, FRAMES)).all()


def test_the_frustum_of_a_lens_ends_where_its_corners_look() -> None:
    camera = lens(Camera.from_field_of_view(640, 480, 60.0), f=360.0)
    base = frustum(camera, Pose.identity(), 0.5)[:4, 1]
    corners = pixels(camera, Pose.identity(), base)
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]], atol=1e-4)
    np.testing.assert_array_less(np.linalg.norm(base, axis=1), 1.0 + 1e-9)


def test_the_frustum_of_a_fisheye_beyond_its_half_space_stays_before_the_camera() -> None:
    camera = lens(Camera.from_field_of_view(640, 480, 60.0), f=180.0)  # 128 degrees off-axis in a corner
    base = frustum(camera, Pose.identity(), 0.5)[:4, 1]
    assert (base[:, 2] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(base, axis=1), 1.0)
    assert np.sign(base[:, :2]).tolist() == [[-1, -1], [1, -1], [1, 1], [-1, 1]]
