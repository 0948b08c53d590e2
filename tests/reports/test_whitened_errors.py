"""How many independent errors a run has: sums by hand, closed forms, and the share of intervals that hold the mean."""

from dataclasses import replace

import numpy as np
import pytest

from tests.reports.drawn import make_sequence, results_of, true_rows
from uavbench.reports.evaluation.evaluation import evaluate
from uavbench.reports.metrics.quaternions import multiply
from uavbench.reports.scoring.score import Score, score
from uavbench.reports.uncertainty.consistency import chi_square_quantile, consistency_of
from uavbench.reports.uncertainty.whitened_errors import effective_poses, squares, whitened
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.covariances import PoseCovariances

ONE = np.array([0.3, -1.2, 0.5, 0.9, -0.1, 1.4])
"""A whitened error."""


def along_x(*values: float) -> Array:
    return np.column_stack([values, *[np.where(np.isfinite(values), 0.0, values)] * 5])


def lasting(rho: float, shape: tuple[int, ...], seed: int) -> Array:
    """Errors (..., n, 6) of unit variance, each rho times the one before, and noise: an AR(1) process."""
    z = np.random.default_rng(seed).normal(size=shape)
    for k in range(1, shape[-2]):
        z[..., k, :] = rho * z[..., k - 1, :] + np.sqrt(1 - rho**2) * z[..., k, :]
    return z


def covariances(n: int) -> Array:
    A = np.random.default_rng(4).normal(size=(n, 6, 6))
    return np.asarray(A @ A.transpose(0, 2, 1) + 0.1 * np.eye(6)) * 1e-4


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        (along_x(2, 1, 1, -1), 16 / (4 + 2 * 3 * (8 / 21) ** 2 + 2 * 2 * (2 / 7) ** 2)),
        (along_x(1, -1, 1, -1), 4),  # the correlation of 1 at lag 2 is beyond one of -1
        (along_x(np.nan, 2, np.nan, 1, np.inf, 1, np.nan), 9 / (3 + 2 * 2 * 0.75**2 + 2 * 1**2)),  # no pairs at 1, 3
        (along_x(np.inf, 3), 1),
        (np.array([ONE, ONE[::-1]]), 4 / (2 + 2 * (1.98 / 4.56) ** 2)),
    ],
)
def test_the_sum_is_that_by_hand(errors: Array, expected: float) -> None:
    assert effective_poses(errors) == pytest.approx(expected, rel=1e-12)


def test_white_errors_are_as_many_as_there_are() -> None:
    """The first correlations of 6 n products are noise of 1 / sqrt(6 n): their squares take 1 / 3 off, or a few."""
    for seed in range(5):
        assert 590 < effective_poses(lasting(0.0, (600, 6), seed)) <= 600


@pytest.mark.parametrize("size", [1e-170, 1.0, 1e150])
def test_a_constant_error_is_one_whatever_its_size(size: float) -> None:
    errors = np.tile(size * ONE, (501, 1))
    errors[::7], errors[250:320] = np.nan, np.inf
    with np.errstate(all="raise", under="ignore"):
        assert effective_poses(errors) == pytest.approx(1.0, rel=1e-9)


def test_errors_of_zero_are_one() -> None:
    with np.errstate(all="raise"):
        assert effective_poses(np.zeros((9, 6))) == effective_poses(np.zeros((1, 6))) == 1.0


def test_an_offset_for_all_of_a_run_is_one_error() -> None:
    """White noise of a tenth of it: with the mean taken off there would be 400."""
    assert 1 <= effective_poses(ONE + 0.1 * lasting(0.0, (400, 6), 0)) < 1.1


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.98])
def test_errors_of_known_correlation_are_as_many_as_its_squares_tell(rho: float) -> None:
    n = 40_000
    lags = np.arange(1, n)
    expected = n**2 / (n + 2 * ((n - lags) * rho ** (2.0 * lags)).sum())
    assert effective_poses(lasting(rho, (n, 6), 1)) == pytest.approx(expected, rel=0.05)


def test_the_interval_holds_the_mean_of_consistent_runs() -> None:
    """In 95 of 100, by a binomial distribution in 380 +- 4.4 of 400; that of independent errors in 51."""
    runs = lasting(0.9, (400, 200, 6), 2)
    low, high = (chi_square_quantile(p, 6 * 200) / 200 for p in (0.025, 0.975))
    held = too_narrow = 0
    for errors in runs:
        found = consistency_of(errors, np.ones((1, 6)))
        assert found is not None and found.mean is not None
        held += found.low < found.mean < found.high
        too_narrow += low < found.mean < high
    assert 360 <= held <= 396
    assert too_narrow < 240


def test_the_interval_is_of_chi_square_of_the_effective_poses() -> None:
    """One pose: 1.237 and 14.449 by the tables; and none where every covariance is singular."""
    found = consistency_of(np.tile(ONE, (50, 1)), np.ones((1, 6)))
    assert found is not None and found.n == 50
    assert (found.effective, found.low, found.high) == pytest.approx((1.0, 1.237, 14.449), abs=1e-3)


def test_whitened_errors_are_those_of_the_cholesky_factor() -> None:
    P, L = covariances(40), np.linalg.cholesky(covariances(40))
    z = lasting(0.0, (40, 6), 3)
    errors = np.einsum("nij,nj->ni", L, z)
    np.testing.assert_allclose(whitened(errors, P), z, rtol=1e-7, atol=1e-9)
    solved = [e @ np.linalg.solve(C, e) for e, C in zip(errors, P, strict=True)]
    np.testing.assert_allclose(squares(whitened(errors, P)), solved, rtol=1e-9)


def test_squares_too_large_for_a_number_are_infinite() -> None:
    errors = np.array([np.full(6, 1e-3), np.full(6, 1e160), np.full(6, 1e200)])
    with np.errstate(all="raise"):
        found = whitened(errors, np.array([1e-4, 1.0, 1e-300])[:, None, None] * np.eye(6))
    np.testing.assert_allclose(found[0], 0.1)
    assert np.isinf(found[1:]).all()


def test_runs_and_trajectory_files_have_as_many_poses_as_their_errors(tmp_path) -> None:
    """Errors of the same whitened size and direction, of covariances of all kinds: one error, though all differ."""
    sequence = make_sequence(tmp_path / "sequence", 20)
    P = covariances(20)
    errors = np.linalg.cholesky(P) @ ONE
    rows = [
        replace(row, cam_from_world=Pose.exp(-e) @ row.cam_from_world, covariance=C if k % 5 else None)
        for k, (row, e, C) in enumerate(zip(true_rows(sequence), errors, P, strict=True))
        if row.cam_from_world is not None
    ]
    found = score(sequence, results_of(sequence, rows))
    assert found.consistency is not None and found.consistency.n == 16
    assert found.consistency.effective == pytest.approx(1.0, rel=1e-6)
    earlier = found.to_json()
    del earlier["consistency"]["effective"]
    assert Score.from_json(earlier) == replace(found, consistency=replace(found.consistency, effective=None))

    true = sequence.ground_truth
    turn = Trajectory.from_poses(list(range(20)), [Pose.exp(np.concatenate([np.zeros(3), -e[3:]])) for e in errors])
    q = multiply(turn.quaternions_wxyz, true.quaternions_wxyz)
    estimate = Trajectory(true.stamps_ns, true.positions_m - errors[:, :3], q)
    evaluated = evaluate(true, estimate, claimed=PoseCovariances(P, "fixed"))
    assert evaluated.nees is not None and evaluated.nees.before is not None
    assert evaluated.nees.before.effective == pytest.approx(1.0, rel=1e-6)
    assert evaluated.to_json()["nees"]["before"]["effective"] == evaluated.nees.before.effective
    (line,) = evaluated.nees.lines()
    assert "; 95 % 1.24 .. 14.4 of a consistent tracker whose errors last as long), 100.0 % inside, n 20, as 1 " in line
