"""Errors in the structure's space: closed forms and symmetries; NEES: the chi-square law."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reports.drawn import box, results_of, true_rows
from uavbench.reports.metrics.model_space import add, box_symmetries, edge_reprojection, model_space, mspd, mssd
from uavbench.reports.scoring.crlb_ratio import edge_bounds
from uavbench.reports.uncertainty.nees import component_sigmas, consistency, euler_zyx, nees
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.shang_shen.control_points import control_points
from uavbench.tracker.visible_edges import pinhole, visible_edges
from uavbench.trajectories.pose import Pose

CAMERA = Camera.from_field_of_view(320, 240, 70)
GROUND_TRUTH = Pose(np.eye(3), [0, 0, 3.0])


def one(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    return pose.rotation[None], pose.translation[None]


def cuboid(x: float, y: float, z: float) -> Structure:
    b = box()
    size = b.bounds[1] - b.bounds[0]
    return Structure.from_mesh(b.vertices / size * [x, y, z], b.triangles)


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_shift_is_its_own_error(x: float, y: float, z: float) -> None:
    points = box().vertices
    shifted = Pose(np.eye(3), np.add(GROUND_TRUTH.translation, [x, y, z]))
    length = float(np.linalg.norm([x, y, z]))
    assert add(points, one(GROUND_TRUTH), one(shifted)) == pytest.approx(length, abs=1e-12)
    assert mssd(points, one(GROUND_TRUTH), one(shifted), (Pose.identity(),)) == pytest.approx(length, abs=1e-12)


def test_the_symmetries_of_a_box_are_found() -> None:
    assert len(box_symmetries(cuboid(0.3, 0.4, 0.5))) == 4
    assert len(box_symmetries(cuboid(0.4, 0.4, 0.5))) == 8
    assert len(box_symmetries(cuboid(0.4, 0.4, 0.4))) == 24


@pytest.mark.parametrize(("open_sides", "left"), [([2], 4), ([0], 4), ([0, 1], 8), ([0, 2], 2)])
def test_a_cube_without_some_sides_is_symmetric_only_where_its_surface_is(open_sides: list[int], left: int) -> None:
    """All have the vertices of a cube: about the axis of an open side, of two opposite ones, between two."""
    whole = cuboid(0.4, 0.4, 0.4)
    side = whole.triangle_face
    assert len(np.unique(side)) == 6
    normals = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])
    gone = [int(np.argmax(whole.face_normals @ normals[k])) for k in open_sides]
    structure = Structure.from_mesh(whole.vertices, whole.triangles[~np.isin(side, gone)])
    assert len(structure.vertices) == 8
    assert len(box_symmetries(structure)) == left


def test_a_half_turn_of_a_box_is_no_surface_error_but_an_add_error() -> None:
    structure = cuboid(0.3, 0.4, 0.5)
    symmetries = box_symmetries(structure)
    turned = GROUND_TRUTH @ symmetries[1]
    assert add(structure.vertices, one(GROUND_TRUTH), one(turned)) > 0.2
    assert mssd(structure.vertices, one(GROUND_TRUTH), one(turned), symmetries) == pytest.approx(0, abs=1e-12)
    assert mspd(structure.vertices, one(GROUND_TRUTH), one(turned), symmetries, CAMERA) == pytest.approx(0, abs=1e-9)


def test_a_sideways_shift_in_pixels() -> None:
    far = Pose(np.eye(3), [0, 0, 100.0])
    moved = Pose(np.eye(3), [0.1, 0, 100.0])
    expected = CAMERA.fx * 0.1 / 100
    assert mspd(box().vertices, one(far), one(moved), (Pose.identity(),), CAMERA) == pytest.approx(expected, rel=0.01)
    assert edge_reprojection(box(), CAMERA, one(far), one(moved)) == pytest.approx(expected, rel=0.01)


def test_a_point_behind_the_camera_is_wholly_wrong() -> None:
    assert (
        mspd(box().vertices, one(GROUND_TRUTH), one(Pose(np.eye(3), [0, 0, -0.1])), (Pose.identity(),), CAMERA) == 400
    )


def test_a_run_is_summarized_over_the_frames_with_a_pose(sequence: Sequence) -> None:
    rows = true_rows(sequence, offset_m=0.02)
    rows[3] = TrackResult(status="lost")
    results = results_of(sequence, rows)
    found = model_space(sequence, results)
    assert found.add_m is not None and found.add_m.n == len(sequence) - 1
    assert found.add_m.max == pytest.approx(0.02, abs=1e-9)
    assert found.edges_px is not None and 1 < found.edges_px.mean < 10


def honest(sequence: Sequence, scale: float) -> list[TrackResult]:
    """Poses disturbed by noise of a known covariance that is claimed `scale` times too small."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6)) * 0.01
    P = A @ A.T + 1e-5 * np.eye(6)
    return [
        replace(
            row,
            cam_from_world=Pose.exp(-rng.multivariate_normal(np.zeros(6), P)) @ row.cam_from_world,
            covariance=P / scale,
        )
        for row in true_rows(sequence)
    ]


def test_nees_of_an_honest_covariance_lies_in_its_interval(sequence: Sequence) -> None:
    found = consistency(sequence, results_of(sequence, honest(sequence, 1.0)))
    assert found is not None
    assert found.low < found.mean < found.high
    assert found.inside > 0.85
    boastful = consistency(sequence, results_of(sequence, honest(sequence, 9.0)))
    assert boastful is not None and boastful.mean == pytest.approx(9 * found.mean) and boastful.mean > boastful.high


def test_no_covariance_no_nees(sequence: Sequence) -> None:
    results = results_of(sequence, true_rows(sequence))
    assert consistency(sequence, results) is None
    assert np.isnan(nees(sequence, results)).all()


def test_component_sigmas_agree_with_sampling(sequence: Sequence) -> None:
    rng = np.random.default_rng(1)
    sigma = np.array([1, 2, 3, 2, 1, 2]) * 1e-4
    base = sequence.true_cam_from_world(7)
    row = TrackResult(status="ok", cam_from_world=base, covariance=np.diag(sigma**2))
    results = results_of(sequence, [row])
    sampled = []
    for _ in range(4000):
        body = (Pose.exp(rng.normal(size=6) * sigma) @ base).inverse() @ sequence.cam_from_body
        sampled.append([*body.translation, *euler_zyx(body.quaternion_wxyz[None])[0]])
    np.testing.assert_allclose(component_sigmas(results)[0], np.std(sampled, axis=0), rtol=0.05)


def test_the_position_bound_is_met_by_least_squares(sequence: Sequence) -> None:
    """Gauss-Newton on noisy normal distances at the true pose reaches the bound to a few percent."""
    sigma = 0.3
    ground_truth = sequence.true_cam_from_world(4)
    points = control_points(visible_edges(sequence.structure, sequence.camera, ground_truth))

    def distances(xi: np.ndarray) -> np.ndarray:
        moved = pinhole((Pose.exp(xi) @ ground_truth).transform(points.points_m), sequence.camera)
        return np.einsum("ij,ij->i", points.normals, moved - points.pixels)

    step = 1e-6
    J = np.column_stack([(distances(step * e) - distances(-step * e)) / (2 * step) for e in np.eye(6)])
    rng = np.random.default_rng(0)
    solve = np.linalg.pinv(J)
    at = ground_truth.inverse().translation
    estimates = [Pose.exp(solve @ rng.normal(0, sigma, len(points))) @ ground_truth for _ in range(2000)]
    errors = [np.linalg.norm(estimate.inverse().translation - at) for estimate in estimates]
    bound = edge_bounds(sequence, [4], sigma)[0]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(bound, rel=0.05)
    assert edge_bounds(sequence, [4], 2 * sigma)[0] == pytest.approx(2 * bound)


def poses(*those: Pose) -> tuple[np.ndarray, np.ndarray]:
    return np.array([pose.rotation for pose in those]), np.array([pose.translation for pose in those])


def looking(eye: list[float], at: tuple[float, float, float] = (0.0, 0.0, 0.25)) -> Pose:
    """cam_from_world of a camera at a place."""
    forward = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    right = np.cross(forward, [0.1, 0.2, 1.0])
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(forward, right), forward])
    return Pose(R, -R @ eye)


def edges_one_by_one(true: Pose, found: Pose) -> float:
    """The mean over points of the box's twelve edges that a face beside shows and the image holds, at eleven each."""
    x, y, z = 0.3, 0.2, 0.5
    faces = [(0, -x), (0, x), (1, -y), (1, y), (2, 0.0), (2, z)]
    eye, low, high = true.inverse().translation, np.array([-x, -y, 0.0]), np.array([x, y, z])
    seen = {(a, v): (eye[a] > v) if v == high[a] else (eye[a] < v) for a, v in faces}
    distances = []
    for axis in range(3):
        b, c = (k for k in range(3) if k != axis)
        for side_b in (low[b], high[b]):
            for side_c in (low[c], high[c]):
                for w in np.linspace(0, 1, 11):
                    point = np.empty(3)
                    point[axis], point[b], point[c] = low[axis] + w * (high[axis] - low[axis]), side_b, side_c
                    here, there = (pose.rotation @ point + pose.translation for pose in (true, found))
                    u, v = CAMERA.fx * here[0] / here[2] + CAMERA.cx, CAMERA.fy * here[1] / here[2] + CAMERA.cy
                    inside = here[2] > 1e-3 and -0.5 <= u <= 319.5 and -0.5 <= v <= 239.5
                    if not ((seen[b, side_b] or seen[c, side_c]) and inside):
                        continue
                    if there[2] <= 1e-3:
                        distances.append(400.0)
                        continue
                    s, t = CAMERA.fx * there[0] / there[2] + CAMERA.cx, CAMERA.fy * there[1] / there[2] + CAMERA.cy
                    distances.append(min(np.hypot(s - u, t - v), 400.0))
    return float(np.mean(distances)) if distances else np.nan


def test_edges_are_compared_point_by_point_where_they_can_be_seen() -> None:
    """From around the box, partly out of the image, with estimates a little and quite wrong, and behind."""
    rng = np.random.default_rng(2)
    true = [looking([1.2, 0.3, 0.6]), looking([0.75, 0.2, 0.35]), looking([-0.2, -0.6, 0.3]), looking([0.1, 0.1, 1.0]),
            looking([1.0, 0.0, 0.25]), looking([1.0, 1.0, 0.5], at=(9.0, 9.0, 0.5)),
            looking([0.9, 0.3, 0.6], at=(0.4, 0.5, 0.2))]  # fmt: skip
    sizes = (0.01, 0.3, 0.05, 0.1, 2.0, 0, 0.02)
    found = [Pose.exp(rng.normal(0, size, 6)) @ pose for pose, size in zip(true, sizes, strict=True)]
    errors = edge_reprojection(box(), CAMERA, poses(*true), poses(*found))
    np.testing.assert_allclose(errors, [edges_one_by_one(a, b) for a, b in zip(true, found, strict=True)], rtol=1e-9)
    assert np.isnan(errors[5]) and np.isfinite(np.delete(errors, 5)).all()


def test_a_summary_is_that_of_each_measure_in_blocks_or_at_once(
    sequence: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        replace(row, cam_from_world=Pose.exp(np.array([0.01 * k, 0.02, 0.0, 0.02, 0.03, 0.0])) @ row.cam_from_world)
        for k, row in enumerate(true_rows(sequence))
    ]  # fmt: skip
    results = results_of(sequence, rows)
    found = model_space(sequence, results)
    symmetries, points = box_symmetries(sequence.structure), sequence.structure.vertices
    assert found.symmetries == len(symmetries) == 4
    P = poses(*(sequence.true_cam_from_world(k) for k in range(len(rows))))
    Q = poses(*(row.cam_from_world for row in rows))
    for summary, errors in (
        (found.add_m, add(points, P, Q)),
        (found.mssd_m, mssd(points, P, Q, symmetries)),
        (found.mspd_px, mspd(points, P, Q, symmetries, sequence.camera)),
        (found.edges_px, edge_reprojection(sequence.structure, sequence.camera, P, Q)),
    ):
        assert summary is not None and summary.n == len(rows)
        assert (summary.mean, summary.max) == (pytest.approx(errors.mean()), pytest.approx(errors.max()))
    for most in (1, 300, 1000):
        monkeypatch.setattr("uavbench.reports.metrics.model_space.BLOCK_POINTS", most)
        assert model_space(sequence, results) == found
    none = model_space(sequence, results_of(sequence, [TrackResult(status="lost")] * 3))
    assert (none.add_m, none.mssd_m, none.mspd_px, none.edges_px, none.symmetries) == (None, None, None, None, 4)


def test_distances_are_those_of_the_definitions() -> None:
    rng = np.random.default_rng(1)
    P, Q = (Pose.exp(rng.normal(0, 0.2, 6)) @ looking([1.2, 0.3, 0.6]) for _ in range(2))
    points, symmetries = box().vertices, box_symmetries(box())
    each = np.array([np.linalg.norm(P.transform(v[None]) - Q.transform(v[None])) for v in points])
    assert add(points, one(P), one(Q)) == pytest.approx(each.mean())
    far = [np.linalg.norm(Q.transform(points) - (P @ s).transform(points), axis=1).max() for s in symmetries]
    assert mssd(points, one(P), one(Q), symmetries) == pytest.approx(min(far))
    apart = [CAMERA.project(Q.transform(points)) - CAMERA.project((P @ s).transform(points)) for s in symmetries]
    expected = min(np.linalg.norm(a, axis=1).max() for a in apart)
    assert mspd(points, one(P), one(Q), symmetries, CAMERA) == pytest.approx(min(expected, 400.0))


@pytest.mark.parametrize(("depth_m", "seen"), [(0.0011, True), (0.0009, False), (-1.0, False)])
def test_a_point_nearer_than_a_millimetre_is_behind_the_camera(depth_m: float, seen: bool) -> None:
    at = Pose(np.eye(3), [0, 0, depth_m])
    error = mspd(np.zeros((1, 3)), one(at), one(at), (Pose.identity(),), CAMERA)
    assert error == (0.0 if seen else 400.0), "behind both cameras it is nowhere in either"


@pytest.mark.parametrize(("longer", "found"), [(0.0, 24), (0.0008, 24), (0.0025, 8)])
def test_a_symmetry_may_miss_by_a_thousandth_of_the_size(longer: float, found: int) -> None:
    """The longer side of a cube misses by half of what it is longer, of a size of sqrt(3) sides; and far from 0."""
    base = cuboid(1.0, 1.0, 1.0 + 2 * np.sqrt(3) * longer / 2)
    away = Structure.from_mesh(np.add(base.vertices, [5.0, -3.0, 2.0]), base.triangles)
    for structure in (base, away):
        symmetries = box_symmetries(structure)
        assert len(symmetries) == found
        np.testing.assert_array_equal(symmetries[0].matrix[:3, :3], np.eye(3))
        for S in symmetries:
            moved = S.transform(structure.vertices)
            gaps = np.linalg.norm(moved[:, None] - structure.vertices[None], axis=2).min(axis=1)
            assert gaps.max() < 2e-3 and np.linalg.det(S.rotation) == pytest.approx(1)


def test_symmetries_of_large_models_are_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for most, found in ((8, 24), (7, 1)):
        monkeypatch.setattr("uavbench.reports.metrics.model_space.MAX_SYMMETRIC_VERTICES", most)
        assert len(box_symmetries(cuboid(1.0, 1.0, 1.0))) == found
