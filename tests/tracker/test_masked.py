"""Masked pixels: what they show changes nothing, and what they hide of the structure is not taken for evidence."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.view import CLEAR_PX, View

STEP_NS = 66_666_667
FRAME = (
    ((0, 0), (639, 0), (639, 79), (0, 79)),
    ((0, 400), (639, 400), (639, 479), (0, 479)),
    ((300, 230), (400, 230), (350, 290)),
)
MASKED = replace(CAMERA, masked=FRAME)


def tracked(camera, images, poses):
    run = Robust().start(box(), camera, poses[0], np.random.default_rng(0))
    return [run.track(image, k * STEP_NS) for k, image in enumerate(images)]


def overlaid(images, draw):
    out = [image.copy() for image in images]
    for k, image in enumerate(out):
        drawn = draw(k, image)
        image[~MASKED.unmasked] = drawn[~MASKED.unmasked]
    return out


def text(k, image):
    drawn = np.zeros_like(image)
    for y in range(20, 480, 30):
        cv2.putText(
            drawn, f"ALT {k}.{y} BAT 11.1V SAT 9", (5 * k, y), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (255, 255, 255), 3
        )
    return drawn


@pytest.fixture(scope="module")
def flight():
    return flown(12, seed=4)


def test_what_is_masked_changes_no_result(flight):
    ways = (lambda k, image: image, text, lambda k, image: np.zeros_like(image))
    plain, *others = (tracked(MASKED, overlaid(flight.images, draw), flight.poses) for draw in ways)
    assert [each.status for each in plain] == ["ok"] * len(flight.images)
    for other in others:
        for a, b in zip(plain, other, strict=True):
            np.testing.assert_array_equal(a.cam_from_world.matrix, b.cam_from_world.matrix)
            np.testing.assert_array_equal(a.covariance, b.covariance)
            assert a.log10_nfa == b.log10_nfa


def test_poses_beside_an_overlay_are_right(flight):
    for result, true in zip(tracked(MASKED, overlaid(flight.images, text), flight.poses), flight.poses, strict=True):
        moved = result.cam_from_world.inverse().translation - true.inverse().translation
        assert np.linalg.norm(moved) < 0.01


def test_a_pose_is_searched_beside_an_overlay(flight):
    """The masked parts have no edges of their own, and their borders are none."""
    images = overlaid(flight.images, text)
    blank = [np.full_like(images[0], 90 + k) for k in range(20)]
    results = tracked(MASKED, images[:4] + blank + images[4:], flight.poses)
    assert all(each.status != "ok" for each in results[4:24])
    found = [
        (result, true) for result, true in zip(results[24:], flight.poses[4:], strict=True) if result.status == "ok"
    ]
    assert len(found) >= 4
    for result, true in found:
        assert np.linalg.norm(result.cam_from_world.inverse().translation - true.inverse().translation) < 0.02


def test_no_control_point_or_patch_is_near_masked_pixels(flight):
    run = Robust().start(box(), MASKED, flight.poses[0], np.random.default_rng(0))
    for k, image in enumerate(flight.images[:3]):
        run.track(image, k * STEP_NS)
    view = View.of(MASKED, box()).at(flight.poses[2])
    y, x = np.nonzero(~MASKED.unmasked)
    masked = np.column_stack([x, y]).astype(float)
    patches = run.fitter.texture
    places = run.fitter.sample(view).points, patches.patches.middles[patches.chosen]
    assert all(map(len, places))
    for pixel in MASKED.project(flight.poses[2].transform(np.concatenate(places))):
        assert np.linalg.norm(masked - pixel, axis=1).min() > CLEAR_PX - 2.0
