"""Covariances of trajectory files: read from every form that has them, moved, aligned, and their NEES."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from tests.reports.drawn import make_sequence, results_of
from uavbench.bench.cli.main import main
from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.evaluation.evaluation import evaluate
from uavbench.reports.evaluation.options import Options
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.scoring.score import score
from uavbench.reports.uncertainty.nees import consistency
from uavbench.reports.uncertainty.pose_nees import pose_nees
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.covariances import UPPER, PoseCovariances
from uavbench.trajectories.trajectory_files.formats import read_covariant_tum, read_tum, write_tum

N = 400
SIGMA = np.array([0.03, 0.01, 0.02, 0.01, 0.03, 0.005])
"""Of position in m and rotation in rad: unlike in every direction."""


def truth() -> Trajectory:
    t = np.arange(N) / 20
    turn = Rotation.from_euler("zyx", np.column_stack([t, 0.3 * np.sin(t), 0.2 * np.cos(t)]))
    p = np.column_stack([5 * np.cos(t / 3), 5 * np.sin(t / 3), 0.2 * t])
    return Trajectory((t * 1e9).astype(np.int64), p, turn.as_quat()[:, [3, 0, 1, 2]])


@pytest.mark.parametrize("claimed", [-1e-4, 1e308])
def test_covariances_that_are_none_give_json_that_can_be_read(tmp_path, claimed):
    """Negative ones, and ones whose sums are too large for a number."""
    write_tum(truth(), tmp_path / "gt.tum")
    for name in ("a", "b"):
        write_covariant(tmp_path / f"{name}.tum", truth(), np.tile(claimed * np.eye(6), (N, 1, 1)))
    paths = [str(tmp_path / f"{name}.tum") for name in ("gt", "a", "b")]

    def refuse(constant):
        raise AssertionError(constant)

    one = CliRunner().invoke(main, ["evaluate", *paths[:2], "--json"])
    assert one.exit_code == 0, one.output
    nees = json.loads(one.stdout, parse_constant=refuse)["nees"]["before"]
    assert nees["singular"] == (N if claimed < 0 else 0)
    many = CliRunner().invoke(main, ["evaluate", *paths, "--json"])
    assert many.exit_code == 0, many.output
    json.loads(many.stdout, parse_constant=refuse)


def covariances() -> Array:
    """One (6, 6) per pose, full and different."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(N, 6, 6)) * 0.3 + np.eye(6)
    return np.einsum("nij,nkj->nik", A, A) * np.outer(SIGMA, SIGMA)


def honest(P: Array) -> Trajectory:
    """An estimate whose errors, in the axes of the world, are drawn from its covariances."""
    true = truth()
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(P), np.random.default_rng(9).normal(size=(N, 6)))
    q = Rotation.from_rotvec(-errors[:, 3:]) * Rotation.from_quat(true.quaternions_wxyz[:, [1, 2, 3, 0]])
    return Trajectory(true.stamps_ns, true.positions_m - errors[:, :3], q.as_quat()[:, [3, 0, 1, 2]])


def write_covariant(path: Path, trajectory: Trajectory, P: Array, whole: bool = False) -> None:
    write_tum(trajectory, path)
    rows = P.reshape(-1, 36) if whole else P[:, UPPER[0], UPPER[1]]
    lines = zip(path.read_text().splitlines(), rows.tolist(), strict=True)
    path.unlink()
    path.write_text("".join(f"{line} {' '.join(map(repr, row))}\n" for line, row in lines))


def moved_by(trajectory: Trajectory, R: Array, t: Array, scale: float = 1.0) -> Trajectory:
    q = Rotation.from_matrix(R) * Rotation.from_quat(trajectory.quaternions_wxyz[:, [1, 2, 3, 0]])
    return Trajectory(trajectory.stamps_ns, scale * trajectory.positions_m @ R.T + t, q.as_quat()[:, [3, 0, 1, 2]])


def expected_nees(reference: Trajectory, estimate: Trajectory, P: Array) -> Array:
    """By scipy, pose by pose, in the axes of the world."""
    true, found = (Rotation.from_quat(t.quaternions_wxyz[:, [1, 2, 3, 0]]) for t in (reference, estimate))
    e = np.column_stack([reference.positions_m - estimate.positions_m, (true * found.inv()).as_rotvec()])
    return np.array([x @ np.linalg.inv(C) @ x for x, C in zip(e, P, strict=True)])


@pytest.mark.parametrize("whole", [False, True])
def test_a_tum_file_with_covariances_is_read_and_its_nees_is_that_of_its_errors(tmp_path: Path, whole: bool) -> None:
    P = covariances()
    write_covariant(tmp_path / "e.tum", honest(P), P, whole)
    write_tum(truth(), tmp_path / "r.tum")
    read = read_covariant_tum(tmp_path / "e.tum")
    assert read.covariances is not None and read.covariances.axes == "fixed"
    np.testing.assert_allclose(read.covariances.values, P, rtol=1e-12)
    np.testing.assert_array_equal(read_tum(tmp_path / "e.tum").positions_m, honest(P).positions_m)
    found = evaluate_files(tmp_path / "r.tum", tmp_path / "e.tum")
    wanted = expected_nees(truth(), honest(P), P)
    assert found.nees is not None and found.nees.before is not None
    assert found.nees.before.mean == pytest.approx(wanted.mean(), rel=1e-9)
    assert found.nees.before.low < found.nees.before.mean < found.nees.before.high
    assert 0.9 < found.nees.before.inside < 0.99
    assert found.nees.after == found.nees.before
    assert "NEES   " in found.text() and "aligned" not in found.text()


@pytest.mark.parametrize(("align", "scale"), [("se3", 1.0), ("sim3", 2.5)])
def test_covariances_turn_and_scale_with_the_alignment(tmp_path: Path, align: str, scale: float) -> None:
    """An honest estimate in a world of its own is honest again after alignment, and only then."""
    P, R = covariances(), Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix()
    away = moved_by(honest(P), R, np.array([10.0, -3.0, 2.0]), 1 / scale)
    J = np.zeros((6, 6))
    J[:3, :3], J[3:, 3:] = R / scale, R
    write_covariant(tmp_path / "e.tum", away, J @ P @ J.T)
    found = evaluate_files(truth(), tmp_path / "e.tum", align=align)  # type: ignore[arg-type]
    assert found.nees is not None and found.nees.before is not None and found.nees.after is not None
    assert found.nees.before.mean is not None and found.nees.before.mean > 1e3
    said = found.record["alignment"]
    R, s = np.array(said["rotation"]), said["scale"]
    K = np.zeros((6, 6))
    K[:3, :3], K[3:, 3:] = s * R, R
    back = moved_by(away, R, np.array(said["translation_m"]), s)
    wanted = expected_nees(truth(), back, K @ J @ P @ J.T @ K.T).mean()
    assert found.nees.after.mean == pytest.approx(wanted, rel=1e-9)
    assert 5.0 < wanted < 8.0
    assert "NEES, aligned" in found.text()
    said = json.loads(json.dumps(found.to_json()))["nees"]
    assert said["after"]["mean"] == found.nees.after.mean and said["before"]["n"] == N


def test_covariances_of_what_moves_are_the_same_after_a_rotation_of_the_world() -> None:
    P, R = covariances(), Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix()
    moving = PoseCovariances(P, "moving")
    np.testing.assert_array_equal(moving.aligned(1.0, R).values, P)
    np.testing.assert_allclose(moving.aligned(2.0, R).values[:, :3, 3:], 2 * P[:, :3, 3:])
    np.testing.assert_allclose(moving.aligned(2.0, R).values[:, :3, :3], 4 * P[:, :3, :3])


@pytest.mark.parametrize("axes", ["moving", "fixed"])
def test_covariances_move_with_the_mount(axes: str) -> None:
    """NEES does not depend on which point of the vehicle is looked at: exactly for twists, to first order in ROS's."""
    P, true = covariances(), truth()
    lever = Pose.exp(np.array([0.5, -0.2, 0.1, 0.3, 0.2, -0.6]))
    claimed = PoseCovariances(P * (1.0 if axes == "moving" else 1e-4), axes)  # type: ignore[arg-type]
    estimate = honest(claimed.values)

    def at(trajectory: Trajectory) -> Trajectory:
        poses = [trajectory.pose(k) @ lever for k in range(N)]
        return Trajectory.from_poses(trajectory.stamps_ns.tolist(), poses)

    here = evaluate(true, estimate, claimed=claimed).nees
    there = evaluate(at(true), at(estimate), claimed=claimed.moved(lever, estimate.quaternions_wxyz)).nees
    assert here and there and here.before and there.before
    assert there.before.mean == pytest.approx(here.before.mean, rel=1e-9 if axes == "moving" else 1e-2)


def test_unknown_and_singular_covariances_are_told_apart(tmp_path: Path) -> None:
    P = covariances()
    P[0], P[1], P[2], P[3] = 0.0, np.nan, np.diag([1e-4, 1e-4, 0.0, 1e-4, 1e-4, 1e-4]), 0.0
    P[3, 0, 0] = -1.0
    write_covariant(tmp_path / "e.tum", honest(covariances()), P, whole=True)
    found = evaluate_files(truth(), tmp_path / "e.tum").nees
    assert found is not None and found.before is not None
    assert (found.before.n, found.before.singular) == (N - 4, 1)
    write_covariant(tmp_path / "none.tum", truth(), np.zeros((N, 6, 6)))
    assert evaluate_files(truth(), tmp_path / "none.tum").nees is None
    assert "nees" not in evaluate_files(truth(), tmp_path / "none.tum").to_json()


def test_lines_of_unlike_lengths_are_refused(tmp_path: Path) -> None:
    write_covariant(tmp_path / "e.tum", honest(covariances()), covariances())
    text = (tmp_path / "e.tum").read_text().splitlines()
    (tmp_path / "e.tum").write_text("\n".join([*text[:5], " ".join(text[5].split()[:8])]) + "\n")
    with pytest.raises(UserError, match="line 6 has 8 values, expected 29"):
        read_tum(tmp_path / "e.tum")
    (tmp_path / "e.tum").write_text("\n".join(" ".join(line.split()[:21]) for line in text) + "\n")
    with pytest.raises(UserError, match=r"21 values, so it is neither tum \(8, or 29 or 44 with a covariance\)"):
        evaluate_files(truth(), tmp_path / "e.tum")


def test_a_trackers_folder_and_table_have_the_nees_of_its_score(tmp_path: Path) -> None:
    sequence = make_sequence(tmp_path / "sequence", 20)
    rng, rows = np.random.default_rng(3), []
    A = rng.normal(size=(6, 6)) * 0.3 + np.eye(6)
    P = A @ A.T * np.outer(SIGMA, SIGMA)
    for k in range(len(sequence)):
        xi = np.linalg.cholesky(P) @ rng.normal(size=6)
        pose = Pose.exp(-xi) @ sequence.true_cam_from_world(k)
        rows.append(TrackResult(status="ok", cam_from_world=pose, covariance=P if k else None, stage_ms={}))
    results = results_of(sequence, rows)
    results.save(tmp_path / "results")
    wanted = consistency(sequence, results)
    assert wanted is not None and score(sequence, results).consistency == wanted
    for estimate in (
        tmp_path / "results", tmp_path / "results" / "frames.csv", pd.read_csv(tmp_path / "results" / "frames.csv")
    ):  # fmt: skip
        found = evaluate_files(sequence.folder, estimate, mount=sequence.folder).nees
        assert found is not None and found.before is not None
        assert (found.before.n, found.before.inside) == (19, wanted.inside)
        assert found.before.mean == pytest.approx(wanted.mean, rel=1e-6)


def test_the_command_prints_it(tmp_path: Path) -> None:
    P = covariances()
    write_covariant(tmp_path / "e.tum", honest(P), P)
    write_tum(truth(), tmp_path / "r.tum")
    done = CliRunner().invoke(main, ["evaluate", str(tmp_path / "r.tum"), str(tmp_path / "e.tum"), "--align", "se3"])
    assert (
        done.exit_code == 0 and "NEES, aligned" in done.output and "% inside, n 400, as 400 independent" in done.output
    )
    assert evaluate(truth(), truth(), Options(align="se3")).nees is None


def paired(true: list[Pose], found: list[Pose]) -> PosePairs:
    reference, estimate = (Trajectory.from_poses(list(range(len(poses))), poses) for poses in (true, found))
    return PosePairs(
        reference.stamps_ns, reference.positions_m, reference.quaternions_wxyz,
        estimate.positions_m, estimate.quaternions_wxyz,
    )  # fmt: skip


def test_twists_of_large_and_small_errors_are_logarithms() -> None:
    """Errors of any size, up to half a turn and down to none; P such that every component of the twist counts."""
    rng = np.random.default_rng(5)
    found = [Pose.exp(rng.normal(size=6)) for _ in range(30)]
    sizes = np.concatenate([np.geomspace(1e-9, 3.0, 28), [0.0, 3.1]])
    axes = rng.normal(size=(30, 3))
    phi = sizes[:, None] * axes / np.linalg.norm(axes, axis=1)[:, None]
    twists = np.column_stack([rng.normal(size=(30, 3)), phi])
    true = [pose @ Pose.exp(xi) for pose, xi in zip(found, twists, strict=True)]
    P = covariances()[:30]
    wanted = [xi @ np.linalg.inv(C) @ xi for xi, C in zip(twists, P, strict=True)]
    np.testing.assert_allclose(pose_nees(paired(true, found), PoseCovariances(P, "moving")), wanted, rtol=1e-6)


def test_the_twist_of_a_far_point_and_a_small_angle_has_its_second_order() -> None:
    """A turn by a about z and 1e5 m along x: x has a/2 cot(a/2), some 1 - a^2 / 12, and y -a/2 of the way."""
    way, a = 1e5, 0.9e-5
    true = Pose(Rotation.from_rotvec([0, 0, a]).as_matrix(), np.array([way, 0.0, 0.0]))
    found = pose_nees(paired([true], [Pose.identity()]), PoseCovariances(np.eye(6)[None], "moving"))
    x, y = way * (a / 2) / np.tan(a / 2), -way * a / 2
    assert found[0] - way**2 == pytest.approx((x - way) * (x + way) + y**2 + a**2, abs=2e-3)


def test_singular_claims_are_infinite_whatever_the_units() -> None:
    regular = covariances()[0]
    alike = np.eye(6)
    alike[:2, :2] = 1.0  # two errors that are the same
    nearly, closer = np.eye(6), np.eye(6)
    nearly[0, 1] = nearly[1, 0] = 1 - 2**-46
    closer[0, 1] = closer[1, 0] = 1 - 2**-48
    negative = np.diag([1.0, 1, -1, 1, 1, 1])
    unknown = np.full((6, 6), np.nan)
    for unit in (1e-12, 1.0, 1e9):
        S = np.diag([unit, unit, unit, 1e-3, 1.0, 1.0])
        P = np.array([S @ C @ S for C in (regular, alike, nearly, closer, negative, unknown)])
        pairs = paired([Pose.exp(np.full(6, 0.01))] * 6, [Pose.identity()] * 6)
        for axes in ("moving", "fixed"):
            found = pose_nees(pairs, PoseCovariances(P, axes))  # type: ignore[arg-type]
            assert np.isfinite(found).tolist() == [True, False, True, False, False, False]
            assert np.isinf(found).tolist() == [False, True, False, True, True, False]
