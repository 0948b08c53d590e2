"""Covariances of poses: read from columns, and carried to another point or world as their errors are."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory_files.covariances import COLUMNS, UPPER, PoseCovariances

STEPS = np.eye(6) * 1e-6


def some(n: int = 3) -> Array:
    A = np.random.default_rng(0).normal(size=(n, 6, 6))
    return np.asarray(A @ np.swapaxes(A, 1, 2))


def erred(pose: Pose, error: Array, axes: str) -> Pose:
    """The true pose of an estimate with an error, in either way of writing one."""
    if axes == "moving":
        return pose @ Pose.exp(error)
    return Pose(Rotation.from_rotvec(error[3:]).as_matrix() @ pose.rotation, pose.translation + error[:3])


def error_of(true: Pose, pose: Pose, axes: str) -> Array:
    if axes == "moving":
        return np.asarray((pose.inverse() @ true).log())
    turn = Rotation.from_matrix(true.rotation @ pose.rotation.T).as_rotvec()
    return np.concatenate([true.translation - pose.translation, turn])


@pytest.mark.parametrize("axes", ["moving", "fixed"])
def test_covariances_go_along_with_the_errors_of_another_point_and_another_world(axes: str) -> None:
    P, lever = some(), Pose.exp(np.array([0.5, -0.2, 0.1, 0.3, 0.2, -0.6]))
    turn, shift, scale = Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix(), np.array([3.0, 1.0, -2.0]), 1.7
    poses = [Pose.exp(np.random.default_rng(k).normal(size=6)) for k in range(3)]
    claimed = PoseCovariances(P, axes)  # type: ignore[arg-type]
    moved = claimed.moved(lever, np.array([pose.quaternion_wxyz for pose in poses]))
    aligned = claimed.aligned(scale, turn)
    assert moved.axes == aligned.axes == axes

    def carried(pose: Pose) -> Pose:
        return Pose(turn @ pose.rotation, scale * turn @ pose.translation + shift)

    for k, pose in enumerate(poses):
        for found, by in ((moved, lambda pose: pose @ lever), (aligned, carried)):
            J = np.column_stack([
                (error_of(by(erred(pose, h, axes)), by(pose), axes)
                 - error_of(by(erred(pose, -h, axes)), by(pose), axes)) / 2e-6 for h in STEPS
            ])  # fmt: skip
            np.testing.assert_allclose(found.values[k], J @ P[k] @ J.T, rtol=1e-6, atol=1e-6)


def test_columns_are_the_upper_triangle_by_rows_or_all() -> None:
    P = some()
    for columns in (P[:, UPPER[0], UPPER[1]], P.reshape(-1, 36)):
        found = PoseCovariances.of_columns(columns, "fixed")
        assert found is not None and found.axes == "fixed"
        np.testing.assert_array_equal(
            found.values, P if columns.shape[1] == 36 else np.triu(P) + np.swapaxes(np.triu(P, 1), 1, 2)
        )
    assert (COLUMNS[0], COLUMNS[1], COLUMNS[6], COLUMNS[-1], len(COLUMNS)) == (
        "cov_00", "cov_01", "cov_11", "cov_55", 21,
    )  # fmt: skip


def test_what_claims_nothing_is_unknown() -> None:
    """Zeros all over, a -1 in the first place as in ROS, and what is no number; a few zeros are a claim."""
    P = np.tile(np.eye(6), (5, 1, 1))
    P[0], P[1, 0, 0], P[2, 3, 4], P[3, 0, 0] = 0.0, -1.0, np.inf, 0.0
    found = PoseCovariances.of_columns(P.reshape(-1, 36), "moving")
    assert found is not None
    assert np.isnan(found.values).all(axis=(1, 2)).tolist() == [True, True, True, False, False]
    np.testing.assert_array_equal(found.values[3:], P[3:])
    assert PoseCovariances.of_columns(P[:3].reshape(-1, 36), "moving") is None
    np.testing.assert_array_equal(found.of_rows(np.array([4, 3])).values, P[[4, 3]])
    assert found.of_rows(np.array([4])).axes == "moving"
