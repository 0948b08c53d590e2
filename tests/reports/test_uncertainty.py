"""What a tracker claims of its errors: closed forms, tables of chi-square, and numerical derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.reports.drawn import results_of, true_rows
from uavbench.reports.uncertainty.consistency import Consistency, chi_square_quantile, consistency_of
from uavbench.reports.uncertainty.nees import component_sigmas, consistency, euler_zyx, is_singular, nees
from uavbench.reports.uncertainty.whitened_errors import squares
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.trajectories.pose import Array, Pose

MOUNT = Pose.exp(np.array([0.3, -0.2, 0.5, 1.1, -0.7, 0.4]))
"""cam_from_body far from the middle of the body, and turned about all axes."""


def claims(sequence: Sequence, twists: Array, covariances: list[Array | None]) -> Results:
    """Poses that err by twists (n, 6), with the covariances that are claimed of them."""
    rows = [
        replace(row, cam_from_world=Pose.exp(xi).inverse() @ row.cam_from_world, covariance=covariance)
        for row, xi, covariance in zip(true_rows(sequence), twists, covariances, strict=False)
        if row.cam_from_world is not None
    ]
    return results_of(sequence, rows)


def some_covariance(seed: int) -> Array:
    A = np.random.default_rng(seed).normal(size=(6, 6))
    return np.asarray(A @ A.T + 0.1 * np.eye(6)) * 1e-4


def test_nees_is_the_true_twist_in_units_of_its_covariance(sequence: Sequence) -> None:
    twists = np.random.default_rng(0).normal(0, 0.05, (4, 6))
    covariances = [some_covariance(k) for k in range(4)]
    expected = [xi @ np.linalg.inv(P) @ xi for xi, P in zip(twists, covariances, strict=True)]
    assert nees(sequence, claims(sequence, twists, list(covariances))) == pytest.approx(expected, rel=1e-6)


def test_a_frame_without_a_claim_has_no_nees_and_one_that_is_sure_has_an_infinite_one(sequence: Sequence) -> None:
    twists = np.full((3, 6), 0.01)
    results = claims(sequence, twists, [None, np.zeros((6, 6)), np.eye(6)])
    results = results_of(sequence, [*results.rows, TrackResult(status="lost"), *results.rows[2:]])
    found = nees(sequence, results)
    assert np.isnan(found[[0, 3]]).all()
    assert found[1] == np.inf
    assert found[2] == pytest.approx(6e-4)
    assert np.isfinite(found[4])


def test_the_bounds_of_the_mean_are_those_of_the_tables(sequence: Sequence) -> None:
    """Chi-square with 6 degrees of freedom: 1.237 and 14.449 at 2.5 % and 97.5 %; with 12: 4.404 and 23.337."""
    unit = np.zeros(6)
    unit[0] = 0.1
    P = np.diag([0.04, 0.01, 0.01, 0.0001, 0.0004, 0.0004])
    one = consistency(sequence, claims(sequence, unit[None], [P]))
    assert one is not None
    assert (one.n, one.mean) == (1, pytest.approx(0.01 / 0.04))
    assert (one.low, one.high) == pytest.approx((1.237, 14.449), abs=1e-3)
    assert one.sharpness_m == pytest.approx(np.sqrt(0.06))
    assert one.sharpness_deg == pytest.approx(np.degrees(0.03))
    assert one.inside == 0.0
    two = consistency(sequence, claims(sequence, np.array([unit, -unit]), [P, P]))
    assert two is not None and two.effective == 2
    assert (two.low, two.high) == pytest.approx((4.404 / 2, 23.337 / 2), abs=1e-3)


def test_inside_is_the_share_of_frames_between_the_quantiles_and_sharpness_the_median(sequence: Sequence) -> None:
    unit = np.array([0.1, 0, 0, 0, 0, 0])
    sizes = np.array([1.2, 1.3, 14.4, 14.5, 5.0])  # NEES of a unit twist whose variance is 0.01 / size
    covariances: list[Array | None] = [np.eye(6) * 0.01 / size for size in sizes]
    found = consistency(sequence, claims(sequence, np.tile(unit, (5, 1)), covariances))
    assert found is not None
    assert found.inside == pytest.approx(3 / 5)
    assert found.mean == pytest.approx(sizes.mean())
    assert found.sharpness_m == pytest.approx(np.sqrt(3 * 0.01 / 5.0))
    assert found.sharpness_deg == pytest.approx(np.degrees(np.sqrt(3 * 0.01 / 5.0)))
    assert consistency(sequence, claims(sequence, np.tile(unit, (5, 1)), [None] * 5)) is None


def body(cam_from_world: Pose) -> Array:
    """x y z and roll pitch yaw (6,) of the body."""
    pose = cam_from_world.inverse() @ MOUNT
    return np.concatenate([pose.translation, Rotation.from_matrix(pose.rotation).as_euler("ZYX")[::-1]])


@pytest.mark.parametrize("frame", [0, 11, 30])
def test_sigmas_of_the_components_are_those_of_numerical_derivatives(sequence: Sequence, frame: int) -> None:
    P = some_covariance(frame)
    (row,) = claims(sequence, np.zeros((1, 6)), [P]).rows
    at = Pose.exp(np.random.default_rng(frame).normal(0, 0.8, 6)) @ sequence.true_cam_from_world(frame)
    results = results_of(sequence, [TrackResult(status="lost"), replace(row, cam_from_world=at)])
    results = replace(results, record={**results.record, "cam_from_body": MOUNT.matrix.tolist()})
    steps = np.eye(6) * 1e-6
    J = np.column_stack([(body(Pose.exp(h) @ at) - body(Pose.exp(-h) @ at)) / 2e-6 for h in steps])
    found = component_sigmas(results)
    assert np.isnan(found[0]).all()
    assert found[1] == pytest.approx(np.sqrt(np.diag(J @ P @ J.T)), rel=1e-5)


def test_sharpness_is_that_of_the_body_whose_errors_are_scored(sequence: Sequence) -> None:
    """A camera 10 m from the middle of the body, sure of its position, and by 0.01 rad not of its rotation."""
    P = np.diag([1e-12, 1e-12, 1e-12, 1e-4, 1e-4, 1e-4])
    results = claims(sequence, np.full((3, 6), 1e-3), [P, P, P])
    far = Pose(MOUNT.rotation, np.array([0.0, 0.0, 10.0]))
    found = consistency(sequence, replace(results, record={**results.record, "cam_from_body": far.matrix.tolist()}))
    assert found is not None
    assert found.sharpness_m == pytest.approx(10.0 * 0.01 * np.sqrt(2), rel=1e-6)  # across the arm, in two directions
    assert found.sharpness_deg == pytest.approx(np.degrees(0.01 * np.sqrt(3)))


def test_euler_angles_are_those_of_scipy() -> None:
    q = np.random.default_rng(1).normal(size=(50, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    expected = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_euler("ZYX")[:, ::-1]
    assert euler_zyx(q) == pytest.approx(expected, abs=1e-12)
    straight_up = np.array([[np.sqrt(0.5), 0.0, -np.sqrt(0.5) - 1e-16, 0.0]])
    assert euler_zyx(straight_up)[0, 1] == pytest.approx(-np.pi / 2)


NEARLY = np.eye(6)
NEARLY[0, 1] = NEARLY[1, 0] = 1 - 2**-46
"""Two errors so alike that the smallest eigenvalue is 2^-46, 1.4e-14, just above round-off."""


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e9])
def test_what_is_singular_does_not_depend_on_units(unit: float) -> None:
    scale = np.diag([unit, 1.0, 1.0, 1e-6, 1.0, 1.0 / unit])
    regular, alike, indefinite, none, negative = (
        some_covariance(3),
        np.ones((6, 6)),
        2 * NEARLY - np.eye(6),
        *(np.eye(6) for _ in range(2)),
    )
    alike = 0.5 * np.eye(6)
    alike[:2, :2] = 0.5
    indefinite[0, 1] = indefinite[1, 0] = 1.5
    none[4, 4], negative[4, 4] = 0.0, -1.0
    closer = NEARLY.copy()
    closer[0, 1] = closer[1, 0] = 1 - 2**-48
    for P, singular in (
        (regular, False), (NEARLY, False), (closer, True), (alike, True), (indefinite, True), (none, True),
        (negative, True),
    ):  # fmt: skip
        assert is_singular(scale @ P @ scale) is singular


def of_nees(*values: float) -> Array:
    """Whitened errors (n, 6) of these squares to the last digit: the second component has what the first one lacks."""
    first = np.sqrt(values) * (1 - 1e-9)
    with np.errstate(invalid="ignore"):
        rest = np.nan_to_num(np.sqrt(np.array(values) - first**2))
    errors = np.column_stack([first, rest, np.zeros((len(values), 4))])
    np.testing.assert_array_equal(squares(errors), values)
    return errors


def test_the_summary_counts_singular_claims_and_both_quantiles_in() -> None:
    low, high = (chi_square_quantile(p, 6) for p in (0.025, 0.975))
    variances = np.ones((4, 6))
    found = consistency_of(of_nees(low, high, np.inf, np.nan, high * 1.0001), variances)
    assert found is not None
    assert (found.n, found.singular, found.inside) == (3, 1, 2 / 4)
    assert found.mean == pytest.approx((low + 2.0001 * high) / 3)
    one = consistency_of(of_nees(5.0, np.inf), variances)
    assert one is not None and (one.n, one.singular, one.inside) == (1, 1, 0.5)
    none = consistency_of(of_nees(np.inf, np.inf), variances)
    assert none is not None and (none.n, none.singular, none.mean, none.inside) == (0, 2, None, 0.0)
    assert none.effective is None and (none.low, none.high) == pytest.approx((low, high))
    assert consistency_of(of_nees(np.nan), variances) is None
    assert Consistency(n=1, mean=1.0, low=0.0, high=2.0, inside=1.0, sharpness_m=1.0, sharpness_deg=1.0).singular == 0


def test_straight_up_the_sigmas_are_large_and_finite(sequence: Sequence) -> None:
    """At the singularity of Euler angles yaw and roll are as good as unknown, and no number is infinite."""
    level = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # pitch of 90 degrees
    results = results_of(sequence, [
        TrackResult(status="ok", cam_from_world=Pose(R.T, np.zeros(3)), covariance=1e-6 * np.eye(6))
        for R in (level, level.T)
    ])  # fmt: skip
    results = replace(results, record={**results.record, "cam_from_body": np.eye(4).tolist()})
    for sigmas in component_sigmas(results):
        np.testing.assert_allclose(sigmas[[0, 1, 2, 4]], 1e-3)
        assert (sigmas[[3, 5]] > 0.5).all() and np.isfinite(sigmas).all()
