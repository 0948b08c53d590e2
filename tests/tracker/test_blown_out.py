"""Structures before light that is more than a pixel holds: their outlines come inwards together."""

from typing import NamedTuple

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit, pose_error
from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.edges.columns import APPEARANCE_COLUMNS, BLOWN, TIMES_SEEN
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, Optics, blown_side, learned_light
from uavbench.tracker.robust.fit.shared_numbers import SIGMA, SharedNumbers
from uavbench.tracker.robust.optics.response import CODES, srgb_light
from uavbench.tracker.robust.solver.number_kernels import NumbersSeen
from uavbench.tracker.robust.tracker import Robust

STEP_NS = 66_666_667
LIGHT = srgb_light(CODES)[None]


class Followed(NamedTuple):
    """Errors of the camera's place in m and NEES of the frames that are ok."""

    errors_m: np.ndarray
    nees: np.ndarray


def before_light(times, blur_px, seed, frames=16):
    """Poses and images of a box, half as bright as a pixel holds, before light so many times that bright."""
    rng, poses = np.random.default_rng(seed), orbit(frames, seed=seed)
    black, white = Scene([box_corners()], seed=seed), Scene([box_corners()], seed=seed)
    black.floor[:], white.floor[:] = 0.0, 255.0
    for pose in poses:
        dark = black.render(pose).astype(np.float32) / 255
        beside = white.render(pose).astype(np.float32) / 255 - dark
        light = cv2.GaussianBlur(0.5 * (dark + times * beside), (0, 0), blur_px)
        yield pose, encode(np.maximum(light + rng.normal(0, 0.004, light.shape), 0).astype(np.float32))


def followed(times, blur_px, seed):
    found, run = [], None
    for i, (pose, image) in enumerate(before_light(times, blur_px, seed)):
        run = run or Robust().start(box(), CAMERA, pose, np.random.default_rng(0))
        result = run.track(image, i * STEP_NS)
        if result.status == "ok":
            xi = (pose @ result.cam_from_world.inverse()).log()
            nees = xi @ np.linalg.solve(result.covariance, xi) / 6
            found.append((pose_error(result.cam_from_world, pose).distance_m, nees))
    return Followed(*np.transpose(found))


@pytest.mark.parametrize(("times", "blur_px"), [(3.0, 1.0), (8.0, 0.5)])
def test_a_box_before_blown_out_light_is_as_exact_as_it_says(times, blur_px):
    """It was 5.8 and 8.8 mm off, with a NEES of 27 and 26, when each outline was thought to be displaced by itself."""
    for seed in range(2):
        found = followed(times, blur_px, seed)
        assert len(found.nees) == 16
        assert found.nees.mean() < 3
        assert np.sqrt(np.mean(found.errors_m**2)) < 6e-3


def appearance(negative, positive):
    row = np.zeros(APPEARANCE_COLUMNS)
    row[:3], row[3:6], row[TIMES_SEEN] = negative, positive, 5
    return row


@pytest.mark.parametrize(
    ("negative", "positive", "side"),
    [
        ((40, 60, 50), (255, 255, 255), 1),
        ((255, 254, 251), (40, 60, 50), -1),
        ((40, 60, 50), (250, 253, 251), 1),
        ((40, 60, 50), (248, 253, 251), 1),  # white, as video has it
        ((40, 60, 50), (249, 249, 249), 0),
        ((40, 60, 50), (255, 200, 180), 0),  # a blue sky: green and red are enough
        ((40, 190, 175), (255, 200, 180), 1),  # which hardly show the edge
    ],
)
def test_the_side_that_is_blown_out_is_known(negative, positive, side):
    assert blown_side.py_func(appearance(negative, positive), 3, LIGHT) == side


def test_nothing_is_blown_out_that_was_not_seen():
    row = appearance((40, 60, 50), (255, 255, 255))
    row[TIMES_SEEN] = 0
    assert blown_side.py_func(row, 3, LIGHT) == 0


def test_a_channel_that_video_keeps_below_white_tells_no_step():
    colour = np.empty(3)
    learned_light.py_func(appearance((40, 60, 50), (248, 235, 253)), 3, Optics(LIGHT, 0.5, ALIGNED), colour)
    assert colour[0] == colour[2] == 0.0
    assert colour[1] == 1.0


def test_a_grey_image_has_one_channel():
    assert blown_side.py_func(appearance((40, 0, 0), (255, 0, 0)), 1, LIGHT) == 1


def test_the_shift_is_known_to_half_a_pixel_and_moves_no_edge():
    state = SharedNumbers(CAMERA, 1.0, BiasConfig())
    assert state.posterior.covariance[BLOWN, BLOWN] == pytest.approx(SIGMA**2)
    told = np.zeros((state.count, state.count))
    told[BLOWN, BLOWN] = 400.0
    state.learn(NumbersSeen(told, told @ np.array([0.3, 0.0])), 0.1)
    assert not state.locate().any()
    assert state.known.mean[BLOWN] == pytest.approx(0.3, rel=0.02)
    assert np.sqrt(state.known.covariance[BLOWN, BLOWN]) == pytest.approx(0.05, rel=0.02)
