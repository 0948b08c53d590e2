"""Alignment of straight lines: what positions determine is found, and the rotation about the line is the smallest."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.reports.metrics.align import alignment, umeyama
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.straight_line import line_fit, smallest_rotation, vertical_fit
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

N = 200
FORWARD = np.array([0.6, 0.0, 0.8])
ALONG = np.linspace(0, 50, N)
LINE = np.outer(ALONG, FORWARD) + np.array([3.0, -2.0, 1.0])


def noise(seed: int, sigma_m: float) -> Array:
    return np.random.default_rng(seed).normal(0, sigma_m, (N, 3))


def pairs(p: Array, q: Array) -> PosePairs:
    level = np.tile([1.0, 0, 0, 0], (len(p), 1))
    return PosePairs(np.arange(len(p)) * 10**8, p, level, q, level)


def angle_deg(R: Array) -> float:
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


def test_the_smallest_rotation_takes_one_vector_to_the_other() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        a, b = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        R = smallest_rotation(a, b)
        np.testing.assert_allclose(R @ a, b, atol=1e-12)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert angle_deg(R) == pytest.approx(np.degrees(np.arccos(a @ b)))
    for axis in np.eye(3):
        half = smallest_rotation(axis, -axis)
        np.testing.assert_allclose(half @ axis, -axis, atol=1e-12)
        assert np.linalg.det(half) == pytest.approx(1)
        np.testing.assert_array_equal(smallest_rotation(axis, axis), np.eye(3))


@pytest.mark.parametrize("sigma_m", [0.0, 1e-9, 0.001, 0.1])
@pytest.mark.parametrize("kind", ["se3", "sim3"])
def test_a_line_is_laid_on_the_line_by_the_smallest_rotation(kind: str, sigma_m: float) -> None:
    """Errors across the line turn nothing about it: they would by any angle, as the plain alignment shows."""
    turn = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix()
    scale = 2.0 if kind == "sim3" else 1.0
    q = (LINE @ turn + [1.0, 1.0, 1.0]) / scale + noise(1, sigma_m)
    found = alignment(pairs(LINE, q), kind)  # type: ignore[arg-type]
    assert found.undetermined.startswith("straight line: ") and "reference" in found.undetermined
    np.testing.assert_allclose(
        found.scale * q @ found.rotation.T + found.translation, LINE, atol=6 * scale * sigma_m + 1e-9
    )
    smallest = smallest_rotation(turn.T @ FORWARD, FORWARD)
    assert angle_deg(found.rotation @ smallest.T) < 0.01 + sigma_m * scale
    assert angle_deg(found.rotation) == pytest.approx(angle_deg(smallest), abs=0.01 + sigma_m * scale)
    assert found.scale == pytest.approx(scale, rel=1e-3)
    if sigma_m > 0.01:
        plain = umeyama(LINE + noise(2, 1e-6), q, with_scale=False).rotation
        assert angle_deg(plain @ smallest.T) > 5


def test_rotations_stay_near_the_true_ones_on_a_line_with_errors() -> None:
    """With a plain alignment the rotation error of a perfect attitude would be any angle."""
    for seed in range(5):
        found = alignment(pairs(LINE + noise(seed, 0.02), LINE + noise(seed + 9, 0.02)), "se3")
        assert found.undetermined
        assert angle_deg(found.rotation) < 0.1


def test_a_line_backwards_is_turned_by_half_a_turn() -> None:
    found = alignment(pairs(LINE, -LINE), "se3")
    np.testing.assert_allclose(-LINE @ found.rotation.T + found.translation, LINE, atol=1e-9)
    assert angle_deg(found.rotation) == pytest.approx(180)


def test_sideways_motion_that_both_share_fixes_the_rotation() -> None:
    """Nearly straight, but the estimate follows the weave: nothing is undetermined, and the full rotation is found."""
    across = np.cross(FORWARD, [0, 1.0, 0])
    weave = LINE + 0.1 * np.outer(np.sin(ALONG), across)
    turn = Rotation.from_rotvec(0.8 * FORWARD).as_matrix()
    found = alignment(pairs(weave, weave @ turn + noise(3, 0.02)), "se3")
    assert found.undetermined == ""
    assert angle_deg(found.rotation @ turn.T) < 3
    np.testing.assert_array_equal(
        found.rotation, umeyama(weave, weave @ turn + noise(3, 0.02), with_scale=False).rotation
    )
    # The same weave, and an estimate that shows none of it:
    assert alignment(pairs(weave, LINE + noise(3, 0.02)), "se3").undetermined


E1, E2 = np.array([0.8, 0.0, -0.6]), np.array([0.0, 1.0, 0.0])
"""Across FORWARD, and across each other."""


@pytest.mark.parametrize("size_m", [1e-3, 0.1, 30.0])
@pytest.mark.parametrize("roll_deg", [0.0, 45.0, 90.0, 180.0, -90.0])
def test_a_weave_shared_at_any_roll_and_size_is_determined(size_m: float, roll_deg: float) -> None:
    way = np.outer(300 * size_m * ALONG, FORWARD)
    turns = np.outer(np.cos(ALONG), E1) + np.outer(np.sin(ALONG), E2)
    turn = Rotation.from_rotvec(np.radians(roll_deg) * FORWARD).as_matrix()
    p = way + size_m * turns
    assert line_fit(p, p @ turn) is None
    assert line_fit(p, p @ turn + noise(7, 0.5 * size_m)) is None
    assert angle_deg(alignment(pairs(p, p @ turn), "se3").rotation @ turn.T) < 1e-3
    mirrored = way + size_m * (np.outer(np.cos(ALONG), E1) - np.outer(np.sin(ALONG), E2))
    assert line_fit(p, mirrored) is not None  # turned about the line it never fits
    assert line_fit(p, p @ turn + noise(7, 5 * size_m)) is not None


@pytest.mark.parametrize(("width_m", "straight"), [(0.4, True), (0.6, False)])
def test_a_way_is_straight_when_it_is_a_hundred_times_longer_than_wide(width_m: float, straight: bool) -> None:
    """Of unlike sideways motions: 0.4 m and 0.6 m rms on a way of 50 m rms."""
    way = np.outer(50 * ALONG / ALONG.std(), FORWARD)
    p = way + width_m * np.sqrt(2) * np.outer(np.sin(ALONG), E1)
    q = way + width_m * np.sqrt(2) * np.outer(np.sin(2.3 * ALONG + 1), E2)
    assert (line_fit(p, q) is not None) == straight
    up = np.column_stack([p @ E1, p @ E2, p @ FORWARD]), np.column_stack([q @ E1, q @ E2, q @ FORWARD])
    assert (vertical_fit(*up) is not None) == straight


def test_what_moves_no_more_than_round_off_stands_still() -> None:
    """A millionth of the unit at a million is round-off's neighbour: it moves; a billionth of it does not."""
    far = np.full((N, 3), 1e6)
    for fit in (line_fit, vertical_fit):
        assert fit(far + noise(1, 1e-10), LINE) is None and fit(LINE, far + noise(1, 1e-10)) is None
    up = np.outer(ALONG, [0, 0, 1.0])
    assert line_fit(far + 1e-4 * LINE, LINE) is not None and vertical_fit(far + 1e-4 * up, up) is not None
    assert line_fit(LINE[:1], LINE[:1]) is None and line_fit(LINE[:2], LINE[:2]) is not None


def test_a_curve_is_aligned_as_ever() -> None:
    curve = np.column_stack([np.cos(ALONG / 9), np.sin(ALONG / 9), 0.1 * ALONG])
    q = curve + noise(4, 0.3)  # errors as large as the curve change nothing
    assert line_fit(curve, q) is None
    np.testing.assert_array_equal(
        alignment(pairs(curve, q), "se3").rotation, umeyama(curve, q, with_scale=False).rotation
    )


def test_an_estimate_on_a_line_is_named() -> None:
    curve = np.column_stack([np.cos(ALONG / 9), np.sin(ALONG / 9), 0.1 * ALONG])
    said = alignment(pairs(curve, LINE), "se3").undetermined
    assert "of the estimate lie on one" in said


def test_the_fit_of_a_line_is_the_best_there_is() -> None:
    """Whichever rotation about the line is taken, the positions fit as well as by scipy's best rotation."""
    curve = np.column_stack([np.cos(ALONG / 9), np.sin(ALONG / 9), 0.1 * ALONG])
    for p, q in ((curve, LINE), (LINE, curve), (LINE, LINE + noise(1, 0.05)), (LINE + noise(1, 0.05), -LINE)):
        found = alignment(pairs(p, q), "se3")
        assert found.undetermined
        left = np.linalg.norm(q @ found.rotation.T + found.translation - p)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the rotation is not unique
            _, least = Rotation.align_vectors(p - p.mean(axis=0), q - q.mean(axis=0))
        assert left == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
def test_straight_up_fixes_no_yaw(sigma_m: float) -> None:
    up, away = np.outer(ALONG, [0, 0, 1.0]), np.array([1.0, 2.0, 3.0])
    found = alignment(pairs(up + noise(5, sigma_m), up + away + noise(6, sigma_m)), "yaw")
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    np.testing.assert_allclose(found.translation, [-1, -2, -3], atol=0.01)
    assert "yaw undetermined" in found.undetermined
    assert vertical_fit(LINE, LINE) is None
    assert not alignment(pairs(LINE, LINE), "yaw").undetermined  # a slanted line has a yaw


@pytest.mark.parametrize("kind", ["se3", "sim3", "yaw", "scale", "origin-scale"])
def test_what_stands_still_is_refused_still(kind: str) -> None:
    still = np.tile([1.0, 2.0, 3.0], (N, 1))
    for p, q in ((LINE, still), (still, LINE)):
        with pytest.raises(UserError, match="undefined"):
            alignment(pairs(p, q), kind)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["scale", "origin-scale"])
def test_the_scale_of_a_line_is_found(kind: str) -> None:
    assert alignment(pairs(LINE, LINE / 3), kind).scale == pytest.approx(3.0)  # type: ignore[arg-type]
