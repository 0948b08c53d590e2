"""Errors and alignments against their definitions with 4 x 4 matrices, and what they refuse."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.reports.metrics.align import Similarity, align, alignment, umeyama, yaw_alignment
from uavbench.reports.metrics.ape import absolute_errors, error_table, pose_error_sizes
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.rpe import (
    BLOCK,
    PairInterval,
    interval_pairs,
    motion_error_sizes,
    relative_errors,
    relative_motion_errors,
)
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

RNG = np.random.default_rng


def quaternions(R: Rotation) -> Array:
    return np.asarray(R.as_quat()[:, [3, 0, 1, 2]])


def matrices(p: Array, q: Array) -> Array:
    T = np.tile(np.eye(4), (len(p), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
    T[:, :3, 3] = p
    return T


def walk(n: int, seed: int = 0, step_s: float = 0.1, error: float = 0.05) -> PosePairs:
    """A wandering reference, and an estimate that errs at random."""
    rng = RNG(seed)
    p = np.cumsum(rng.normal(0, 0.2, (n, 3)), axis=0)
    R = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.1, (n, 3)), axis=0))
    off = Rotation.from_rotvec(rng.normal(0, error, (n, 3)))
    stamps = np.round(np.arange(n) * step_s * NS).astype(np.int64)
    return PosePairs(stamps, p, quaternions(R), p + rng.normal(0, error, (n, 3)), quaternions(R * off))


def sizes(E: Array) -> dict[str, Array]:
    """All sizes of errors (n, 4, 4)."""
    turn = Rotation.from_matrix(E[:, :3, :3]).magnitude()
    return {
        "translation_m": np.linalg.norm(E[:, :3, 3], axis=1),
        "angle_rad": turn,
        "angle_deg": np.degrees(turn),
        "rotation": np.linalg.norm(E[:, :3, :3] - np.eye(3), axis=(1, 2)),
        "full": np.linalg.norm(E - np.eye(4), axis=(1, 2)),
    }


@pytest.mark.parametrize("n", [1, 30])
def test_absolute_errors_are_those_of_the_matrices(n: int) -> None:
    pairs = walk(n)
    P, Q = matrices(pairs.reference_m, pairs.reference_q), matrices(pairs.estimate_m, pairs.estimate_q)
    for name, expected in sizes(np.linalg.inv(P) @ Q).items():
        np.testing.assert_allclose(absolute_errors(pairs, name), expected, rtol=1e-9, atol=1e-12)  # type: ignore[arg-type]


def test_errors_in_blocks_are_those_of_the_whole() -> None:
    pairs = walk(BLOCK + 7)
    metres, radians = pose_error_sizes(pairs)
    np.testing.assert_allclose(metres, absolute_errors(pairs, "translation_m"), rtol=1e-12)
    np.testing.assert_allclose(radians, absolute_errors(pairs, "angle_rad"), rtol=1e-12)
    i, j = interval_pairs(pairs, PairInterval(3, all_pairs=True))
    assert len(i) > BLOCK
    metres, radians = motion_error_sizes(pairs, i, j)
    np.testing.assert_allclose(metres, relative_errors(pairs, i, j, "translation_m"), rtol=1e-12)
    np.testing.assert_allclose(radians, relative_errors(pairs, i, j, "angle_rad"), rtol=1e-12)


def test_the_table_of_errors_has_a_row_for_each_pair() -> None:
    pairs = walk(5)
    later = PosePairs(
        pairs.stamps_ns + 7 * NS, pairs.reference_m, pairs.reference_q, pairs.estimate_m, pairs.estimate_q
    )
    table = error_table(later)
    assert list(table["stamp_ns"]) == [7 * NS + k * NS // 10 for k in range(5)]
    np.testing.assert_allclose(table["time_s"], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-12)
    np.testing.assert_array_equal(table["position_error_m"], absolute_errors(pairs, "translation_m"))
    np.testing.assert_array_equal(table["rotation_error_deg"], absolute_errors(pairs, "angle_deg"))
    np.testing.assert_array_equal(table[["reference_x_m", "reference_y_m", "reference_z_m"]], pairs.reference_m)
    np.testing.assert_array_equal(table[["estimate_x_m", "estimate_y_m", "estimate_z_m"]], pairs.estimate_m)
    assert len(table.columns) == 10


def test_relative_errors_are_those_of_the_matrices() -> None:
    pairs, i, j = walk(40), np.arange(0, 30), np.arange(0, 30) + 7
    P, Q = matrices(pairs.reference_m, pairs.reference_q), matrices(pairs.estimate_m, pairs.estimate_q)
    E = np.linalg.inv(np.linalg.inv(Q[i]) @ Q[j]) @ (np.linalg.inv(P[i]) @ P[j])
    for name, expected in sizes(E).items():
        np.testing.assert_allclose(relative_errors(pairs, i, j, name), expected, rtol=1e-9, atol=1e-12)  # type: ignore[arg-type]
    q, t = relative_motion_errors(pairs, i, j)
    turned = (np.linalg.inv(Q[i]) @ Q[j])[:, :3, :3] @ E[:, :3, 3:]
    np.testing.assert_allclose(t, turned[..., 0], atol=1e-12)
    np.testing.assert_allclose(matrices(t, q)[:, :3, :3], E[:, :3, :3], atol=1e-12)


def test_point_distances_compare_the_ways_as_the_crow_flies() -> None:
    p = np.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, 2]])
    q = np.array([[0.0, 0, 0], [0, 6, 0], [1, 6, 0], [1, 6, 1]])
    unit = np.tile([1.0, 0, 0, 0], (4, 1))
    pairs = PosePairs(np.arange(4), p, unit, q, unit)
    i, j = np.arange(3), np.arange(1, 4)
    assert relative_errors(pairs, i, j, "point_distance_m").tolist() == [1.0, 1.0, 1.0]
    assert relative_errors(pairs, i, j, "point_distance_percent").tolist() == [20.0, 50.0]


# Stretches


def along(places: list[float], stamps_s: Array | None = None, estimate: list[float] | None = None) -> PosePairs:
    """Poses on the x axis."""
    n = len(places)
    p, e = np.zeros((n, 3)), np.zeros((n, 3))
    p[:, 0], e[:, 0] = places, places if estimate is None else estimate
    unit = np.tile([1.0, 0, 0, 0], (n, 1))
    stamps = np.arange(n) if stamps_s is None else np.round(np.asarray(stamps_s) * NS)
    return PosePairs(stamps.astype(np.int64), p, unit, e, unit.copy())


def turning(degrees: list[float], estimate: list[float] | None = None) -> PosePairs:
    """Poses that turn about z."""
    n = len(degrees)
    q = [quaternions(Rotation.from_euler("z", d, degrees=True)) for d in (np.c_[degrees], np.c_[estimate or degrees])]
    return PosePairs(np.arange(n), np.zeros((n, 3)), q[0], np.zeros((n, 3)), q[1])


def rows(pairs: PosePairs, *over: object) -> list[tuple[int, int]]:
    i, j = interval_pairs(pairs, PairInterval(*over))  # type: ignore[arg-type]
    return list(zip(i.tolist(), j.tolist(), strict=True))


def test_stretches_of_frames_follow_each_other_or_start_everywhere() -> None:
    pairs = along([0.0] * 7)
    assert rows(pairs, 3) == [(0, 3), (3, 6)]
    assert rows(pairs, 3, "frames", True) == [(0, 3), (1, 4), (2, 5), (3, 6)]
    assert rows(pairs, 6) == [(0, 6)]
    assert rows(pairs, 7) == rows(pairs, 7, "frames", True) == []


def test_stretches_of_metres_end_where_their_own_steps_sum_to_delta() -> None:
    pairs = along([0.0, 0.5, 1.0, 2.5, 2.5, 3.0, 3.5], estimate=[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert rows(pairs, 1.0, "m") == [(0, 2), (2, 3), (3, 6)]
    assert rows(pairs, 2.0, "m", False, "estimate") == [(0, 2), (2, 4), (4, 6)]
    assert rows(pairs, 1.0, "m", True) == [(0, 2), (3, 6), (4, 6)]
    assert rows(pairs, 1.0, "m", True, "reference", 0.5) == [(0, 2), (1, 2), (2, 3), (3, 6), (4, 6), (5, 6)]
    assert rows(pairs, 2.0, "m", True, "estimate") == [(0, 2), (1, 3), (2, 4), (3, 5), (4, 6)]
    assert rows(pairs, 9.0, "m") == rows(pairs, 9.0, "m", True) == rows(along([1.0]), 9.0, "m", True) == []


def test_stretches_of_seconds_take_the_nearest_frame_within_the_tolerance_and_do_not_overlap() -> None:
    stamps = np.array([0.0, 0.45, 0.95, 1.5, 2.08, 3.0, 3.5, 4.05]) + 100.0
    pairs = along([0.0] * 8, stamps)
    assert rows(pairs, 1.0, "s", True) == [(0, 2), (1, 3), (4, 5), (5, 7)]
    assert rows(pairs, 1.0, "s") == [(0, 2), (4, 5), (5, 7)]
    assert rows(pairs, 1.0, "s", True, "reference", 0.2) == [(0, 2), (1, 3), (2, 4), (4, 5), (5, 7)]
    assert rows(along([0.0] * 3, np.array([0.0, 1.0, 2.0])), 1.0, "s") == [(0, 1), (1, 2)]
    assert rows(along([0.0] * 2, np.array([0.0, 0.95])), 1.0, "s") == []


def test_of_two_frames_equally_near_the_earlier_ends_a_stretch() -> None:
    pairs = along([0.0] * 3, np.array([0.0, 0.75, 1.25]))
    assert rows(pairs, 1.0, "s", True, "reference", 0.25) == [(0, 1)]


@pytest.mark.parametrize(("unit", "delta"), [("deg", 30.0), ("rad", np.pi / 6)])
def test_stretches_of_turning(unit: str, delta: float) -> None:
    pairs = turning([0.0, 16.0, 31.0, 40.0, 62.0, 61.0], estimate=[0.0, 1.0, 2.0, 30.5, 31.0, 32.0])
    assert rows(pairs, delta, unit) == [(0, 2), (2, 4)]
    assert rows(pairs, delta, unit, False, "estimate") == [(0, 3)]
    assert rows(pairs, delta, unit, True) == [(0, 2), (2, 4), (2, 5)]
    assert rows(pairs, delta, unit, True, "estimate") == [
        (0, 3),
        (0, 4),
        (0, 5),
        (1, 3),
        (1, 4),
        (1, 5),
        (2, 3),
        (2, 4),
        (2, 5),
    ]
    assert rows(pairs, delta, unit, True, "reference", 0.0) == []
    assert rows(turning([5.0]), delta, unit, True) == []
    assert rows(turning([5.0, 6.0, 35.0]), delta, unit, True) == [(0, 2), (1, 2)], "also from the last but one"


def test_too_many_stretches_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = turning([0.0, 30.0, 60.0, 90.0])
    monkeypatch.setattr("uavbench.reports.metrics.rpe.MAX_PAIRS", 3)
    assert len(rows(pairs, 30.0, "deg", True)) == 3
    monkeypatch.setattr("uavbench.reports.metrics.rpe.MAX_PAIRS", 2)
    with pytest.raises(UserError, match="more than 2 pairs"):
        rows(pairs, 30.0, "deg", True)


@pytest.mark.parametrize(
    ("over", "told"),
    [
        ((0.0,), "must be positive"),
        ((-1.0,), "must be positive"),
        ((np.inf, "m"), "must be positive"),
        ((np.nan, "m"), "must be positive"),
        ((1.5,), "whole number of frames"),
        ((1.0, "s", True, "reference", 1.0), "0 .. 1"),
        ((1.0, "s", True, "reference", -0.1), "0 .. 1"),
    ],
)
def test_a_stretch_of_nonsense_is_refused(over: tuple[object, ...], told: str) -> None:
    with pytest.raises(UserError, match=told):
        PairInterval(*over)  # type: ignore[arg-type]


def test_a_stretch_is_one_frame_by_default_and_may_be_any_length_in_metres() -> None:
    assert PairInterval() == PairInterval(1.0, "frames", False, "reference", 0.1)
    assert PairInterval(1.5, "m", tolerance=0.0).delta == 1.5


# Alignment


def similar(n: int = 20, scale: float = 1.7, seed: int = 1) -> tuple[PosePairs, Similarity]:
    """Pairs whose reference is a similarity of the estimate, and that similarity."""
    rng = RNG(seed)
    made = Similarity(scale, Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))
    pairs = walk(n, seed)
    R = Rotation.from_matrix(made.rotation)
    p = scale * pairs.estimate_m @ made.rotation.T + made.translation
    q = quaternions(R * Rotation.from_quat(pairs.estimate_q[:, [1, 2, 3, 0]]))
    return PosePairs(pairs.stamps_ns, p, q, pairs.estimate_m, pairs.estimate_q), made


def assert_same(found: Similarity, scale: float, R: Array, t: Array) -> None:
    assert found.scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found.rotation, R, atol=1e-9)
    np.testing.assert_allclose(found.translation, t, atol=1e-9)


def test_a_similarity_is_found_again_and_leaves_no_error() -> None:
    pairs, made = similar()
    assert_same(alignment(pairs, "sim3"), made.scale, made.rotation, made.translation)
    aligned = align(pairs, "sim3")
    assert absolute_errors(aligned, "full").max() < 1e-9
    np.testing.assert_array_equal(aligned.reference_m, pairs.reference_m)
    assert_same(alignment(pairs, "scale"), made.scale, np.eye(3), np.zeros(3))
    assert_same(alignment(pairs, "none"), 1.0, np.eye(3), np.zeros(3))
    assert align(pairs, "none") is pairs
    assert_same(Similarity.identity(), 1.0, np.eye(3), np.zeros(3))


def test_se3_is_the_best_rotation_and_translation() -> None:
    pairs, made = similar(scale=1.0)
    assert_same(alignment(pairs, "se3"), 1.0, made.rotation, made.translation)
    scaled, made = similar(scale=1.4)
    found = alignment(scaled, "se3")
    expected, _ = Rotation.align_vectors(
        scaled.reference_m - scaled.reference_m.mean(axis=0), scaled.estimate_m - scaled.estimate_m.mean(axis=0)
    )
    assert_same(
        found,
        1.0,
        expected.as_matrix(),
        scaled.reference_m.mean(axis=0) - expected.apply(scaled.estimate_m.mean(axis=0)),
    )


def test_the_first_poses_are_brought_together() -> None:
    pairs, made = similar()
    found = alignment(pairs, "origin")
    t = pairs.reference_m[0] - made.rotation @ pairs.estimate_m[0]
    assert_same(found, 1.0, made.rotation, t)
    with_scale = alignment(pairs, "origin-scale")
    assert_same(with_scale, made.scale, made.rotation, made.translation)
    assert absolute_errors(align(walk(9), "origin"), "full")[0] == pytest.approx(0.0, abs=1e-9)


def test_yaw_turns_about_z_only() -> None:
    pairs = walk(20, 3)
    turn = Rotation.from_euler("z", 0.7).as_matrix()
    moved = PosePairs(
        pairs.stamps_ns,
        pairs.estimate_m @ turn.T + [1.0, -2.0, 0.5],
        pairs.reference_q,
        pairs.estimate_m,
        pairs.estimate_q,
    )
    assert_same(alignment(moved, "yaw"), 1.0, turn, np.array([1.0, -2.0, 0.5]))
    assert_same(yaw_alignment(moved.reference_m, moved.estimate_m), 1.0, turn, np.array([1.0, -2.0, 0.5]))
    noisy = yaw_alignment(pairs.reference_m, pairs.estimate_m)

    def cost(yaw: float) -> float:
        R = Rotation.from_euler("z", yaw).as_matrix()
        p, q = (x - x.mean(axis=0) for x in (pairs.reference_m, pairs.estimate_m))
        return float(((p - q @ R.T) ** 2).sum())

    best = float(np.arctan2(noisy.rotation[1, 0], noisy.rotation[0, 0]))
    assert cost(best) < min(cost(best + 1e-4), cost(best - 1e-4))
    assert noisy.rotation[2].tolist() == [0.0, 0.0, 1.0] == noisy.rotation[:, 2].tolist()


@pytest.mark.parametrize("first_n", [1, None])
def test_yaw_of_a_single_pair_is_that_of_its_rotations(first_n: int | None) -> None:
    """The yaw that leaves the least rotation between the two, pitch and roll being what they are."""
    pairs, made = similar(1 if first_n is None else 6)
    found = alignment(pairs, "yaw", first_n)
    R = made.rotation
    yaw = np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    expected = Rotation.from_euler("z", yaw).as_matrix()
    assert_same(found, 1.0, expected, pairs.reference_m[0] - expected @ pairs.estimate_m[0])


@pytest.mark.parametrize("kind", ["se3", "sim3", "yaw", "scale"])
def test_only_the_first_pairs_are_looked_at_when_asked(kind: str) -> None:
    pairs = walk(30)
    first = PosePairs(*(getattr(pairs, name)[:8] for name in PosePairs.__dataclass_fields__))
    a, b = alignment(pairs, kind, 8), alignment(first, kind)  # type: ignore[arg-type]
    assert_same(a, b.scale, b.rotation, b.translation)
    far = alignment(pairs, kind)  # type: ignore[arg-type]
    assert (
        abs(far.scale - a.scale)
        + np.abs(far.rotation - a.rotation).max()
        + np.abs(far.translation - a.translation).max()
        > 1e-6
    )
    for bad in (0, -1):
        with pytest.raises(UserError, match="at least one pair"):
            alignment(pairs, kind, bad)  # type: ignore[arg-type]


def test_a_mirrored_estimate_is_not_mirrored_back() -> None:
    q = RNG(5).normal(size=(30, 3)) * [3.0, 2.0, 1.0]
    found = umeyama(q * [1, 1, -1], q, with_scale=True)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    centred = q - q.mean(axis=0)
    d = np.linalg.svd((centred * [1, 1, -1]).T @ centred / len(q), compute_uv=False)
    assert found.scale == pytest.approx((d[0] + d[1] - d[2]) / (centred**2).sum(axis=1).mean())


LINE = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
STILL = 1e3 + RNG(0).normal(0, 1e-11, (5, 3))
"""As close to one place as the round-off of its coordinates allows."""
FAR = np.array([5e6, -4e6, 1e3])
"""Coordinates as of a map's grid."""
PLANE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]])


@pytest.mark.parametrize(
    ("p", "q"),
    [
        (LINE, LINE),
        (LINE, PLANE),
        (PLANE, LINE),
        (STILL, PLANE),
        (PLANE, STILL),
        (STILL - 1e3, STILL),
        (PLANE[:1], PLANE[:1]),
    ],
)
def test_positions_on_a_line_or_in_one_place_fix_no_rotation(p: Array, q: Array) -> None:
    with pytest.raises(UserError, match=f"the {len(p)} matched positions .* do not move or lie on one line"):
        umeyama(p, q, with_scale=False)


def test_positions_in_a_plane_fix_it() -> None:
    R = Rotation.random(random_state=0).as_matrix()
    assert_same(umeyama(PLANE @ R.T, PLANE, with_scale=True), 1.0, R, np.zeros(3))
    assert_same(umeyama(PLANE * 1e-5, PLANE, with_scale=True), 1e-5, np.eye(3), np.zeros(3))
    far = umeyama(PLANE + FAR, PLANE @ R + FAR, with_scale=False)
    np.testing.assert_allclose(far.rotation, R, atol=1e-8)


@pytest.mark.parametrize(
    ("p", "q"),
    [
        (PLANE[:, [2, 2, 0]], PLANE),
        (PLANE, PLANE[:, [2, 2, 0]]),
        (PLANE, PLANE * 1e-13),
        (PLANE * 1e-13, PLANE),
        (-PLANE, PLANE * -1e-13),
        (PLANE * -1e-13, -PLANE),
        (np.zeros((4, 3)), np.zeros((4, 3))),
    ],
)
def test_positions_that_do_not_move_sideways_fix_no_yaw(p: Array, q: Array) -> None:
    with pytest.raises(UserError, match="do not move sideways"):
        yaw_alignment(p, q)


@pytest.mark.parametrize("scale", [1.0, 1e-9])
def test_little_sideways_motion_far_from_the_origin_fixes_a_yaw(scale: float) -> None:
    assert_same(yaw_alignment(LINE * scale, LINE), 1.0, np.eye(3), (scale - 1.0) * LINE.mean(axis=0))
    turn = Rotation.from_euler("z", 0.3).as_matrix()
    for p, q in ((PLANE @ turn.T + FAR, PLANE), (PLANE, PLANE @ turn + FAR), (PLANE @ turn.T + FAR, PLANE + FAR)):
        np.testing.assert_allclose(yaw_alignment(p, q).rotation, turn, atol=1e-7)
