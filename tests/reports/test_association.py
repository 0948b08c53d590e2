"""Association against its definition, worked out the long way on stamps with ties, gaps and ends."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from uavbench.reports.metrics.association import NS, PosePairs, associate, nearest_to_shorter, one_to_one
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory


def trajectory(stamps_s: Array, seed: int = 0) -> Trajectory:
    rng, n = np.random.default_rng(seed), len(stamps_s)
    q = rng.normal(size=(n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return Trajectory(np.round(np.asarray(stamps_s) * NS).astype(np.int64), rng.normal(size=(n, 3)), q)


def stamps(rng: np.random.Generator, n: int) -> Array:
    """Rising stamps on a grid of 1/64 s, so that differences tie exactly."""
    return np.asarray(np.sort(rng.choice(4 * n, n, replace=False)) / 64)


def greedy(a: Array, b: Array, limit: float) -> list[tuple[int, int]]:
    """All pairs by (difference, row of a, row of b), each row used once."""
    every = sorted((abs(x - y), i, j) for i, x in enumerate(a) for j, y in enumerate(b) if abs(x - y) <= limit)
    used_a, used_b, found = set[int](), set[int](), []
    for _, i, j in every:
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            found.append((i, j))
    return sorted(found)


@pytest.mark.parametrize("seed", range(40))
def test_one_to_one_is_the_greedy_matching(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = stamps(rng, int(rng.integers(1, 30))), stamps(rng, int(rng.integers(1, 30)))
    for limit in (0.0, 1 / 64, 3 / 64, 10.0):
        rows_a, rows_b = one_to_one(a, b, limit)
        assert list(zip(rows_a.tolist(), rows_b.tolist(), strict=True)) == greedy(a, b, limit)


def test_one_to_one_of_chains_in_which_each_wants_what_the_next_has() -> None:
    """Gaps that shrink along the way: no two are each other's nearest but the last, again and again."""
    a = np.array([0.0, 20.0, 38.0, 54.0, 68.0, 80.0])
    b = np.array([11.0, 30.0, 47.0, 62.0, 75.0, 85.0])
    for limit in (5.0, 8.0, 30.0, 100.0):
        rows_a, rows_b = one_to_one(a, b, limit)
        assert list(zip(rows_a.tolist(), rows_b.tolist(), strict=True)) == greedy(a, b, limit)
        swapped_b, swapped_a = one_to_one(b, a, limit)
        assert list(zip(swapped_b.tolist(), swapped_a.tolist(), strict=True)) == greedy(b, a, limit)


def test_one_to_one_of_nothing_is_nothing() -> None:
    for a, b in (([], [1.0]), ([1.0], []), ([], [])):
        assert [len(rows) for rows in one_to_one(np.array(a), np.array(b), 1.0)] == [0, 0]


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("offset_s", [0.0, 5 / 64, -5 / 64])
def test_each_of_the_shorter_takes_the_nearest_of_the_longer(seed: int, offset_s: float) -> None:
    rng = np.random.default_rng(seed)
    a, b = stamps(rng, int(rng.integers(1, 20))), stamps(rng, int(rng.integers(1, 20)))
    moved = b + offset_s
    expected = []
    if len(b) <= len(a):
        for j, y in enumerate(moved):
            i = int(np.argmin(np.abs(a - y)))  # the first of two that are equally near
            expected += [(i, j)] if abs(a[i] - y) <= 3 / 64 else []
    else:
        for i, x in enumerate(a):
            j = int(np.argmin(np.abs(moved - x)))
            expected += [(i, j)] if abs(moved[j] - x) <= 3 / 64 else []
    rows = nearest_to_shorter((a * NS).astype(np.int64), (b * NS).astype(np.int64), 3 / 64, offset_s)
    assert list(zip(*(r.tolist() for r in rows), strict=True)) == expected
    none = nearest_to_shorter(np.empty(0, np.int64), (b * NS).astype(np.int64), 1.0)
    assert [len(r) for r in none] == [0, 0]


def interpolated(t: Trajectory, at_s: Array, offset_s: float = 0.0) -> tuple[Array, Array]:
    """Positions and rotations (n, 3, 3) of a trajectory at stamps inside of it, by NumPy and SciPy."""
    table = t.stamps_ns / NS + offset_s
    p = np.column_stack([np.interp(at_s, table, t.positions_m[:, k]) for k in range(3)])
    turns = Slerp(table, Rotation.from_quat(t.quaternions_wxyz[:, [1, 2, 3, 0]]))
    return p, np.asarray(turns(np.clip(at_s, table[0], table[-1])).as_matrix())


def rotations(q: Array) -> Array:
    return np.asarray(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix())


@pytest.mark.parametrize("offset_s", [0.0, 0.25])
@pytest.mark.parametrize("estimate_is_longer", [False, True])
def test_the_longer_trajectory_is_interpolated(offset_s: float, estimate_is_longer: bool) -> None:
    """Also where the shorter begins before it and ends after it: there its ends are held."""
    long, short = trajectory(np.arange(1.0, 3.0, 0.125), 1), trajectory(np.array([0.97, 1.4, 2.03, 2.7, 2.91]), 2)
    limit = 0.125
    if estimate_is_longer:
        at = Trajectory(short.stamps_ns + round(offset_s * NS), short.positions_m, short.quaternions_wxyz)
        pairs = associate(at, long, "evo-interpolated", limit, offset_s)
        p, R = interpolated(long, at.stamps_ns / NS, offset_s)
        np.testing.assert_array_equal(pairs.stamps_ns, at.stamps_ns)
        np.testing.assert_array_equal(pairs.reference_m, at.positions_m)
        np.testing.assert_allclose(pairs.estimate_m, p, atol=1e-9)
        np.testing.assert_allclose(rotations(pairs.estimate_q), R, atol=1e-9)
    else:
        at = Trajectory(short.stamps_ns - round(offset_s * NS), short.positions_m, short.quaternions_wxyz)
        pairs = associate(long, at, "evo-interpolated", limit, offset_s)
        p, R = interpolated(long, short.stamps_ns / NS)
        np.testing.assert_array_equal(pairs.stamps_ns, short.stamps_ns)
        np.testing.assert_array_equal(pairs.estimate_m, at.positions_m)
        np.testing.assert_allclose(pairs.reference_m, p, atol=1e-9)
        np.testing.assert_allclose(rotations(pairs.reference_q), R, atol=1e-9)


def test_of_two_equally_long_trajectories_the_reference_is_interpolated() -> None:
    reference, estimate = trajectory(np.arange(1.0, 3.0, 0.1), 1), trajectory(np.arange(1.02, 3.02, 0.1), 2)
    pairs = associate(reference, estimate, "evo-interpolated", 0.05)
    np.testing.assert_array_equal(pairs.stamps_ns, estimate.stamps_ns)
    np.testing.assert_array_equal(pairs.estimate_m, estimate.positions_m)


def test_a_trajectory_of_one_pose_is_held() -> None:
    one = trajectory(np.array([1.0]))
    pairs = associate(one, one, "evo-interpolated", 0.1)
    np.testing.assert_allclose(pairs.reference_m, one.positions_m)
    np.testing.assert_allclose(rotations(pairs.reference_q), rotations(one.quaternions_wxyz), atol=1e-12)


@pytest.mark.parametrize("method", ["one-to-one", "evo", "evo-interpolated"])
def test_an_offset_is_added_to_the_estimate_and_the_limit_is_included(method: str) -> None:
    reference, estimate = trajectory(np.array([1.0, 2.0, 3.0])), trajectory(np.array([0.5, 1.5, 2.25]), 1)
    pairs = associate(reference, estimate, method, 0.25, 0.5)  # type: ignore[arg-type]
    assert len(pairs) == 3
    np.testing.assert_allclose(pairs.estimate_m, estimate.positions_m)
    assert len(associate(reference, estimate, method, 0.2499, 0.5)) == 2  # type: ignore[arg-type]
    exact = associate(reference, reference, method, 0.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(exact.estimate_m, reference.positions_m)


def test_quaternions_are_brought_to_unit_norm() -> None:
    t = trajectory(np.array([1.0, 2.0]))
    long = Trajectory(t.stamps_ns, t.positions_m, t.quaternions_wxyz * 1.0005)
    pairs = associate(long, long)
    for q in (pairs.reference_q, pairs.estimate_q):
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)


def test_pairs_are_read_only_and_keep_the_reference_under_another_estimate() -> None:
    t = trajectory(np.array([1.0, 2.0]))
    pairs = associate(t, t)
    other = pairs.with_estimate(pairs.estimate_m + 1, pairs.estimate_q[::-1].copy())
    assert isinstance(other, PosePairs)
    np.testing.assert_array_equal(other.estimate_m, pairs.estimate_m + 1)
    np.testing.assert_array_equal(other.reference_q, pairs.reference_q)
    for name in PosePairs.__dataclass_fields__:
        assert not getattr(pairs, name).flags.writeable


def test_stamps_that_never_meet_are_told_with_both_spans() -> None:
    reference, estimate = trajectory(np.array([1.0, 2.5])), trajectory(np.array([100.0, 101.25]))
    told = r"within 0.01 s .* the reference spans 1.000 .. 2.500 s, the estimate 100.000 .. 101.250 s \(\+ offset 3 s\)"
    for method in ("one-to-one", "evo"):
        with pytest.raises(UserError, match=told):
            associate(reference, estimate, method, 0.01, 3.0)  # type: ignore[arg-type]
    nothing = Trajectory(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 4)))
    with pytest.raises(UserError, match="the estimate nothing"):
        associate(reference, nothing)
    with pytest.raises(UserError, match="the reference spans nothing"):
        associate(nothing, reference, "evo")


@pytest.mark.parametrize(("limit", "offset"), [(-0.1, 0.0), (np.nan, 0.0), (0.1, np.inf), (0.1, np.nan)])
def test_a_limit_or_offset_that_is_no_number_is_refused(limit: float, offset: float) -> None:
    t = trajectory(np.array([1.0]))
    with pytest.raises(UserError, match="must be finite"):
        associate(t, t, "evo", limit, offset)


def test_without_an_offset_stamps_are_compared_as_they_are() -> None:
    rows = nearest_to_shorter(np.array([NS, 2 * NS, 3 * NS]), np.array([2 * NS]), 0.0)
    assert [r.tolist() for r in rows] == [[1], [0]]
