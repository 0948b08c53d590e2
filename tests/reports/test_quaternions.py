"""Quaternion arithmetic against SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from uavbench.reports.metrics.quaternions import (
    angle,
    between,
    chord,
    conjugate,
    multiply,
    norm,
    normalized,
    rotate,
    rotate_back,
    slerp,
)
from uavbench.trajectories.pose import Array

A, B = (Rotation.random(50, random_state=seed) for seed in (1, 2))
V = np.random.default_rng(3).normal(size=(50, 3))


def wxyz(R: Rotation) -> Array:
    return np.asarray(R.as_quat()[:, [3, 0, 1, 2]])


def assert_rotations(q: Array, R: Rotation) -> None:
    np.testing.assert_allclose(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix(), R.as_matrix(), atol=1e-12)


def test_products_inverses_and_rotated_vectors_are_those_of_scipy() -> None:
    a, b = wxyz(A), wxyz(B)
    assert_rotations(multiply(a, b), A * B)
    assert_rotations(conjugate(a), A.inv())
    assert_rotations(between(a, b), A.inv() * B)
    np.testing.assert_allclose(rotate(a, V), A.apply(V), atol=1e-12)
    np.testing.assert_allclose(rotate_back(a, V), A.inv().apply(V), atol=1e-12)
    np.testing.assert_allclose(norm(V), np.linalg.norm(V, axis=1))
    np.testing.assert_allclose(normalized(7.0 * a), a, atol=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_angles_and_chords_of_either_sign(sign: float) -> None:
    np.testing.assert_allclose(angle(sign * wxyz(A)), A.magnitude())
    np.testing.assert_allclose(chord(sign * wxyz(A)), np.linalg.norm(A.as_matrix() - np.eye(3), axis=(1, 2)))
    ends = np.array([[1.0, 0, 0, 0], [1.0, 5e-10, 0, 0], [0, 0, 1.0, 0]])
    np.testing.assert_allclose(angle(sign * ends), [0.0, 1e-9, np.pi], rtol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_interpolation_goes_along_the_shorter_arc(sign: float) -> None:
    w = np.linspace(0.0, 1.0, 50)
    expected = [Slerp([0.0, 1.0], Rotation.concatenate([a, b]))(x) for a, b, x in zip(A, B, w, strict=True)]
    assert_rotations(slerp(wxyz(A), sign * wxyz(B), w), Rotation.concatenate(expected))
    assert_rotations(slerp(wxyz(A), sign * wxyz(A), w), A)
