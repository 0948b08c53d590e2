"""Sub-trajectories: their lengths, their ends by both rules, and their errors by 4 x 4 matrices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.reports.test_metrics import matrices, walk
from uavbench.reports.metrics import sub_trajectories
from uavbench.reports.metrics.sub_trajectories import distance_along, rpg_lengths, segment_ends, segment_errors


def along_x(places: list[float]) -> np.ndarray:
    return np.column_stack([places, np.zeros((len(places), 2))])


def ends(places: list[float], length: float, *rule: object) -> list[tuple[int, int]]:
    return list(zip(*(rows.tolist() for rows in segment_ends(along_x(places), length, *rule)), strict=True))  # type: ignore[arg-type]


def test_the_settings_are_those_of_the_publications() -> None:
    """KITTI's devkit, evaluate_odometry.cpp (lengths and step_size), and rpg_trajectory_evaluation's defaults."""
    assert [float(k) for k in range(100, 801, 100)] == list(sub_trajectories.KITTI_LENGTHS_M)
    assert (sub_trajectories.KITTI_STEP, sub_trajectories.RPG_MAX_MISS) == (10, 0.2)
    assert rpg_lengths(along_x([0.0, 10.0, 3.0, 20.777])) == (3.47, 6.95, 10.43, 13.91, 17.38)


def test_distance_is_that_of_the_steps() -> None:
    np.testing.assert_allclose(distance_along(np.array([[1.0, 1, 1], [1, 4, 5], [1, 4, 5], [3, 7, 11]])), [0, 5, 5, 12])


def test_kitti_starts_at_every_tenth_pose_and_ends_beyond_the_length() -> None:
    assert ends([float(k) for k in range(26)], 4.0, "kitti") == [(0, 5), (10, 15), (20, 25)]
    assert ends([float(k) for k in range(25)], 4.0, "kitti") == [(0, 5), (10, 15)]


def test_rpg_starts_everywhere_and_ends_at_the_nearest_within_the_miss() -> None:
    assert ends([0.0, 1.0, 2.0, 3.25], 1.0) == [(0, 1), (1, 2)]
    assert ends([0.0, 1.0, 2.0, 3.25], 1.0, "rpg", 0.25) == [(0, 1), (1, 2)], "a miss at the limit is one"
    assert ends([0.0, 1.0, 2.0, 3.25], 1.0, "rpg", 0.26) == [(0, 1), (1, 2), (2, 3)]
    assert ends([0.0, 0.75, 1.25], 1.0, "rpg", 0.3) == [(0, 1)], "of two as near the earlier"
    assert ends([0.0, 0.1], 1.0, "rpg", 2.0) == [(0, 1)], "none ends where it starts"
    assert ends([0.0, 0.9], 1.0, "rpg", 0.05) == ends([0.0], 1.0) == ends([0.0], 1.0, "kitti") == []


def test_errors_are_those_of_the_matrices() -> None:
    pairs, length = walk(60, seed=4, error=0.2), 3.0
    i, j = segment_ends(pairs.reference_m, length)
    assert len(i) > 20
    P, Q = matrices(pairs.reference_m, pairs.reference_q), matrices(pairs.estimate_m, pairs.estimate_q)
    # In rpg's world frame of the estimate: R E R^T, R the rotation at the end of the estimate.
    E = np.linalg.inv(np.linalg.inv(P[i]) @ P[j]) @ (np.linalg.inv(Q[i]) @ Q[j])
    R = Q[j][:, :3, :3]
    turn = Rotation.from_matrix(R @ E[:, :3, :3] @ np.swapaxes(R, 1, 2))
    yaw, pitch, roll = np.degrees(turn.as_euler("ZYX")).T
    metres, degrees = np.linalg.norm(E[:, :3, 3], axis=1), np.degrees(turn.magnitude())
    found = segment_errors(pairs, length)
    assert found.length_m == length
    for summary, values in (
        (found.translation_percent, 100 * metres / length),
        (found.translation_m, metres),
        (found.rotation_deg, degrees),
        (found.rotation_deg_per_m, degrees / length),
        (found.yaw_deg, np.abs(yaw)),
        (found.tilt_deg, np.hypot(pitch, roll)),
    ):
        assert (summary.n, summary.mean, summary.max) == (
            len(i), pytest.approx(values.mean(), rel=1e-9), pytest.approx(values.max(), rel=1e-9),
        )  # fmt: skip
