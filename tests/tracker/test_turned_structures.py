"""A structure that looks alike from behind: after a loss a run says on which side it is once it knows that."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.look_alikes import after, moved
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.self_similarity import SelfSimilarity, turns_about
from uavbench.tracker.robust.track_state import Told, usual_rate_1_s
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.pose import Pose

STEP_NS, RATE_HZ = 66_666_667, 15
SIZE = (0.4, 0.3, 0.3)


def similarity_of(*corners):
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(corners))])
    structure = Structure.from_mesh(np.concatenate(corners), triangles)
    return SelfSimilarity(EdgeMap.of(structure, RobustConfig().edges.sampling.rounded_deg))


def degrees(similarity):
    return sorted(round(np.degrees(np.arctan2(turn.R[1, 0], turn.R[0, 0]))) % 360 for turn in similarity.turns)


def prism(sides):
    """Corners and triangles of an upright prism, regular, beside the origin."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angle) + 5.0, np.sin(angle) - 3.0, np.zeros(sides)])
    k, n = np.arange(sides), (np.arange(sides) + 1) % sides
    walls = [np.column_stack([k, n, n + sides]), np.column_stack([k, n + sides, k + sides])]
    floor, roof = (np.column_stack([np.zeros(sides - 2, int), k[1:-1], k[2:]]) for _ in range(2))
    return np.concatenate([ring, ring + np.array([0.0, 0.0, 2.0])]), np.concatenate(
        [*walls, floor[:, ::-1], roof + sides]
    )


def test_a_box_looks_alike_from_behind_a_square_one_from_each_side_and_a_lone_corner_from_nowhere():
    assert degrees(similarity_of(box_corners(SIZE))) == [180]
    assert degrees(similarity_of(box_corners((0.3, 0.3, 0.5), (7.0, -2.0)))) == [90, 180, 270]
    beside = box_corners((0.1, 0.2, 0.7), (0.6, 0.5)), box_corners((0.15, 0.12, 0.2), (-0.5, 0.3))
    assert degrees(similarity_of(box_corners(SIZE), *beside)) == []


@pytest.mark.parametrize(("sides", "step"), [(3, 120), (6, 60), (8, 45), (12, 30)])
def test_a_prism_looks_alike_from_each_of_its_sides(sides, step):
    edges = EdgeMap.of(Structure.from_mesh(*prism(sides)), 20.0)
    assert set(range(step, 360, step)) <= set(degrees(SelfSimilarity(edges)))


@given(st.integers(0, 22), st.tuples(*[st.floats(-2.0, 2.0)] * 6))
def test_a_structure_that_is_moved_looks_as_before_from_the_pose_after_the_move(turn, twist):
    pose, move = Pose.exp(np.array(twist)), turns_about(np.array([1.0, -2.0, 0.5]))[turn]
    points = np.random.default_rng(0).normal(size=(5, 3))
    there = after(move, motion(pose))
    np.testing.assert_allclose(Pose(*there).transform(points @ move.R.T + move.t), pose.transform(points), atol=1e-9)
    again = moved(there, motion(pose))
    np.testing.assert_allclose(again.R, move.R, atol=1e-9)
    np.testing.assert_allclose(again.t, move.t, atol=1e-9)


def test_a_forgotten_velocity_is_told_by_the_last_one_and_the_assumed_one_alike():
    config = RobustConfig()
    assumed, still = config.motion.initial_rate_1_s, np.zeros(6)
    for velocity, rate in ((None, assumed), (still, assumed / 2**0.5), (2.0 * assumed * np.ones(6), None)):
        at = Motion(Pose(np.eye(3), np.zeros(3)), isotropic_covariance(0.01, 1.0), velocity, velocity)
        found = usual_rate_1_s(Told(at, 1.0, 0.0), config)
        assert found == pytest.approx(assumed * 2.5**0.5 if rate is None else rate)


def at_side(angle_deg):
    angle = np.radians(angle_deg)
    return look_at(np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.6]), (0.0, 0.0, 0.12))


def flown(unseen_s, seen_deg, again_deg):
    """Statuses and errors (m) of a run that sees the box from some sides, nothing for so long, and it again."""
    scene, rng = Scene([box_corners(SIZE)], seed=4), np.random.default_rng(5)
    structure = Structure.from_mesh(box_corners(SIZE), BOX_TRIANGLES)
    run = Robust().start(structure, CAMERA, at_side(seen_deg[0]), np.random.default_rng(0))
    found, unseen = [], round(unseen_s * RATE_HZ)
    for k, angle in enumerate([*seen_deg, *[None] * unseen, *again_deg]):
        pose = None if angle is None else at_side(angle)
        shown = scene.render(pose, noise_rng=rng) if pose else rng.integers(100, 140, (480, 640, 3), np.uint8)
        result = run.track(shown, k * STEP_NS)
        if pose is not None:
            known = result.cam_from_world
            off_m = known and np.linalg.norm(known.inverse().translation - pose.inverse().translation)
            found.append((result.status, off_m))
    return found[len(seen_deg) :]


@pytest.mark.slow
def test_after_a_long_loss_a_run_does_not_say_on_which_of_two_like_sides_it_is_until_it_knows():
    """It saw the front, comes back behind the box, and flies on to the front that it knows."""
    seen, behind = np.linspace(70.0, 110.0, 45), np.linspace(265.0, 275.0, 20)
    found = flown(12.0, seen, [*behind, *np.linspace(275.0, 435.0, 110)])
    assert {status for status, _ in found[: len(behind)]} <= {"ambiguous", "lost"}
    assert all(off_m is None or off_m < 0.05 for _, off_m in found)
    assert [status for status, _ in found[-5:]] == ["ok"] * 5


def test_after_a_short_loss_it_is_on_the_side_that_it_can_have_come_to():
    found = flown(4.0, np.linspace(70.0, 95.0, 45), np.linspace(110.0, 118.0, 20))
    assert all(off_m is None or off_m < 0.05 for _, off_m in found)
    assert [status for status, _ in found[-5:]] == ["ok"] * 5
