"""Biases shared across frames: the patches' pose error and the offsets of edges, against dense linear algebra."""

import numpy as np
import pytest

from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.solver.bias_kernels import linearize
from uavbench.tracker.robust.solver.bias_state import FrameSums
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases, observability
from uavbench.tracker.robust.solver.solve_kernels import Step
from uavbench.tracker.robust.solver.twist_kernels import adjoint
from uavbench.trajectories.pose import Pose

EDGES, POINTS, SHARED = 7, 12, 0.4
APART = EdgeKinds(np.full(EDGES, -1), np.ones(EDGES), 0)
"""No edge looks like another."""
ALIKE = EdgeKinds(np.array([0, 1, 0, -1, 1, 0, -1]), np.array([1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0]), 2)
"""Two kinds of edges, some of them with opposite normals, and two edges that look like no other."""
STILL = Step(np.eye(6), np.zeros(6), np.zeros(6), np.eye(6), np.zeros(0))
"""The step of a fit that has converged, by a response that is known."""
SURE = np.eye(6) * 1e18
"""Information of patches that leave no doubt about the pose."""


def a_pose(rng):
    return Pose.exp(np.concatenate([rng.normal(size=3) * 2, rng.normal(size=3)]))


def sums_of(edge, J, residual, weight):
    """Sums over the points of each edge in view, and of all."""
    views = np.unique(edge)
    S = np.array([weight[edge == e].sum() for e in views])
    s = np.array([(weight[edge == e, None] * J[edge == e]).sum(axis=0) for e in views])
    d = np.array([(weight[edge == e] * residual[edge == e]).sum() for e in views])
    return views, FrameSums(S, s, d, (J.T * weight) @ J, J.T @ (weight * residual), SURE, np.zeros(6))


def frame(rng, pose, D, offsets, noise_px=0.0):
    """Edges in view, their Jacobians for twists of the camera, and what is found beside a pose that patches tell."""
    edge = np.sort(rng.choice(EDGES, POINTS))
    J = rng.normal(size=(POINTS, 6)) * 300
    residual = J @ adjoint(pose.rotation, pose.translation) @ D + offsets[edge] + rng.normal(size=POINTS) * noise_px
    return edge, J, residual


def test_a_twist_in_the_world_is_the_same_motion_as_its_adjoint_of_the_camera():
    rng = np.random.default_rng(1)
    pose, xi = a_pose(rng), rng.normal(size=6) * 0.1
    moved = pose @ Pose.exp(xi) @ pose.inverse()
    np.testing.assert_allclose(adjoint(pose.rotation, pose.translation) @ xi, moved.log(), atol=1e-9)


def prior_of(kinds, variance_px2, part):
    """Prior covariance of all offsets: this part of it is common to the edges of a kind."""
    alike = (kinds.kinds[:, None] == kinds.kinds) & (kinds.kinds[:, None] >= 0)
    common = part * np.outer(kinds.signs, kinds.signs)
    return variance_px2 * np.where(np.eye(len(kinds.kinds)), 1.0, np.where(alike, common, 0.0))


@pytest.mark.parametrize("kinds", [APART, ALIKE])
def test_the_arrow_is_solved_as_the_whole_system_is(kinds):
    config, rng = BiasConfig(forgotten_part=0.0), np.random.default_rng(2)
    common, spread = NuisanceBiases(kinds, config, 0, 0), np.full(EDGES, 0.2**2)
    prior, first, second = np.diag(rng.uniform(1e3, 1e4, 6)), a_pose(rng), a_pose(rng)
    offsets, nothing = rng.normal(size=EDGES) * 0.2, np.zeros(6)
    X = [adjoint(p.rotation, p.translation) for p in (first, second)]
    dense = np.zeros((6 + EDGES, 6 + EDGES))
    dense[:6, :6] = X[0].T @ prior @ X[0]
    dense[6:, 6:] = np.linalg.inv(prior_of(kinds, 0.2**2, SHARED))
    right = np.zeros(6 + EDGES)
    for k, pose in enumerate((first, second)):
        edge, J, residual = frame(rng, pose, rng.normal(size=6) * 1e-3, offsets)
        views, sums = sums_of(edge, J, residual, np.full(POINTS, 50.0))
        if k == 0:
            common.begin(common.offsets(views, spread[views], SHARED), sums, STILL, prior, pose)
        rows = np.concatenate([J @ X[k], np.eye(EDGES)[edge]], axis=1)
        part = 50.0 if k == 0 else 50.0 / 4
        dense += part * rows.T @ rows
        if k == 1:
            right += part * rows.T @ residual
        else:  # the patches are taken where the frame puts them: the first frame says nothing of D beside the offsets
            right[6:] += part * rows[:, 6:].T @ residual
            right[:6] = dense[:6, 6:] @ np.linalg.solve(dense[6:, 6:], right[6:])
    twist = common.learn(common.offsets(views, spread[views], SHARED), sums, nothing, second, config.correlation_s / 4)
    solution = np.linalg.solve(dense, right)
    np.testing.assert_allclose(twist, X[1] @ solution[:6], rtol=1e-6, atol=1e-12)
    schur = dense[:6, :6] - dense[:6, 6:] @ np.linalg.solve(dense[6:, 6:], dense[6:, :6])
    np.testing.assert_allclose(common.known.information, schur, rtol=1e-8)
    for view in (np.arange(EDGES), np.array([0, 3, 5]), np.array([1, 2, 4, 6]), np.array([6]), np.arange(0)):
        seen = common.seen_with(common.offsets(view, spread[view], SHARED))
        at = linearize(seen, second.rotation, second.translation)
        here, n, few = np.linalg.inv(X[1]), len(at.of_kinds.information), len(view)
        ties = np.zeros((few, n))
        ties[np.flatnonzero(at.kinds >= 0), at.kinds[at.kinds >= 0]] = at.ties[at.kinds >= 0]
        shared = np.diag(at.of_kinds.information + np.abs(ties).sum(axis=0))
        offsets = np.block([[np.diag(at.offset_information), -ties], [-ties.T, shared]])
        cross, vector = np.vstack([at.cross, at.of_kinds.cross]), np.concatenate([at.offset_vector, at.of_kinds.vector])
        left = at.information - cross.T @ np.linalg.solve(offsets, cross)
        np.testing.assert_allclose(left, here.T @ schur @ here, rtol=1e-6)  # whichever edges are in view
        expected = np.linalg.solve(offsets, vector)
        np.testing.assert_allclose(at.vector, cross.T @ expected, rtol=1e-6, atol=1e-9)  # nothing is expected of D
        np.testing.assert_allclose(expected[:few], solution[6 + view], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(at.expected.px, solution[6 + view], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(at.expected.variance_px2, np.diag(np.linalg.inv(offsets))[:few], rtol=1e-6)


def test_a_frame_counts_for_as_much_as_its_patches_tell_the_pose():
    E = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert observability(E, SURE) == pytest.approx(1.0)
    assert observability(E, E) == pytest.approx(0.5)
    assert observability(E, np.zeros((6, 6))) == 0.0


@pytest.mark.parametrize("offset_px", [0.0, 0.3])
def test_frames_from_many_sides_tell_the_patches_error_from_the_edges_offsets(offset_px):
    config = BiasConfig(forgotten_part=0.02)
    rng = np.random.default_rng(3)
    common, spread = NuisanceBiases(APART, config, 0, 0), np.full(EDGES, 0.3**2)
    offsets = offset_px * rng.choice([-1.0, 1.0], EDGES)
    left = rng.normal(size=6) * 1e-3  # of the places of the patches, as a twist in the world
    for k in range(100):
        pose = a_pose(rng)
        edge, J, residual = frame(rng, pose, left, offsets, noise_px=0.05)
        views, sums = sums_of(edge, J, residual, np.full(POINTS, 1 / 0.05**2))
        if k == 0:
            common.begin(common.offsets(views, spread[views], SHARED), sums, STILL, np.eye(6) * 1e-2, pose)
            continue
        X = adjoint(pose.rotation, pose.translation)
        left = left - np.linalg.solve(
            X, common.learn(common.offsets(views, spread[views], SHARED), sums, np.zeros(6), pose, config.correlation_s)
        )
    assert np.abs(left).max() < 1e-4
    np.testing.assert_allclose(
        common.state.offset_vector / (common.state.offset_information + common.state.offset_prior), offsets, atol=0.03
    )
