"""Rolling shutters: where a point is seen while the rows are read out, and poses of cameras that move meanwhile."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.view import View, pixel_of
from uavbench.trajectories.pose import Pose

READOUT_MS, BANDS, RATE_HZ = 32.0, 24, 15.0
ROW_S = READOUT_MS * 1e-3 / (CAMERA.height - 1)


@given(st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6), st.floats(-0.4, 0.4), st.floats(-0.3, 0.3))
def test_a_point_is_seen_where_the_pose_of_its_row_has_it(velocity, x, y):
    point = np.array([x, y, 1.3])
    u, v = pixel_of(*point, View.of(CAMERA, box()).swept(ROW_S * np.array(velocity)))
    later = Pose.exp((v - 0.5 * (CAMERA.height - 1)) * ROW_S * np.array(velocity))
    np.testing.assert_allclose((u, v), CAMERA.project(later.transform(point[None]))[0], atol=0.05)


@pytest.fixture(scope="module")
def rolled():
    """Ten frames of a fast orbit, each of bands of rows that are exposed one after another."""
    every = round(1e3 / RATE_HZ / (READOUT_MS / BANDS))
    fine = orbit(10 * every + BANDS, rate_hz=RATE_HZ * every, speed_m_s=1.0, seed=3)
    scene, images, poses = Scene([box_corners()]), [], []
    rows = CAMERA.height // BANDS
    parts = [replace(CAMERA, height=rows, cy=CAMERA.cy - band * rows) for band in range(BANDS)]
    for first in range(0, 10 * every, every):
        bands = [scene.render(fine[first + k], camera, supersample=1) for k, camera in enumerate(parts)]
        images.append(np.concatenate(bands))
        a, b = fine[first + BANDS // 2 - 1], fine[first + BANDS // 2]
        poses.append(Pose.exp(0.5 * (b @ a.inverse()).log()) @ a)
    return images, poses


def errors(camera, images, poses):
    run = Robust().start(box(), camera, poses[0], np.random.default_rng(0))
    results = [run.track(image, round(k * 1e9 / RATE_HZ)) for k, image in enumerate(images)]
    assert [each.status for each in results] == ["ok"] * len(images)
    pairs = zip(results, poses, strict=True)
    return np.array([(true @ each.cam_from_world.inverse()).log() for each, true in pairs])[3:]


def test_poses_are_those_of_the_middle_row(rolled):
    told, untold = errors(replace(CAMERA, readout_ms=READOUT_MS), *rolled), errors(CAMERA, *rolled)
    rms, before = np.sqrt((told**2).mean(axis=0)), np.sqrt((untold**2).mean(axis=0))
    assert np.linalg.norm(rms[:3]) < 0.005
    assert np.linalg.norm(before[:3]) > 1.5 * np.linalg.norm(rms[:3])


def test_rows_from_the_bottom_are_those_of_an_image_upside_down(rolled):
    """A camera upside down, whose last row is read first, sees the same at the same times."""
    images, poses = rolled
    turned = Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    over = [np.ascontiguousarray(image[::-1, ::-1]) for image in images]
    told = errors(replace(CAMERA, readout_ms=-READOUT_MS), over, [turned @ pose for pose in poses])
    assert np.sqrt((told[:, :3] ** 2).sum(axis=1).mean()) < 0.005
