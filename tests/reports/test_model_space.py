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
