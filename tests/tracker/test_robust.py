"""The tracker robust: accuracy, uncertainty, bad input, loss and recovery on ray-cast frames."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, flown, look_at, pose_error
from uavbench.scenes.camera import camera_array
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import (
    RigidMotion,
    normal_row,
    se3_exp_left,
    se3_log_left,
    solve6,
)
from uavbench.tracker.protocol import ImageError, StampError
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.measurements import Candidates, ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.edges.weight_kernels import support
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.relocalization.scoring.pose_search import CANDIDATES, PoseSearch, Reach
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.view import View
from uavbench.tracker.visible_edges import near_depth
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.kernels.lens import project
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
CONFIG = RobustConfig()


def edge_map(structure):
    return EdgeMap.of(structure, CONFIG.edges.sampling.rounded_deg)


@pytest.fixture(scope="module")
def flight():
    """Poses and noisy frames of 1.3 seconds around a box."""
    return flown(20, seed=11)


def started(first):
    return Robust().start(box(), CAMERA, first, np.random.default_rng(0))


def test_it_follows_the_box_to_millimetres_and_knows_its_error(flight):
    poses, images = flight
    run = started(poses[0])
    errors, nees = [], []
    for i, (pose, image) in enumerate(zip(poses, images, strict=True)):
        result = run.track(image, i * STEP_NS)
        assert result.status == "ok"
        errors.append(pose_error(result.cam_from_world, pose)[0])
        twist = (pose @ result.cam_from_world.inverse()).log()
        nees.append(twist @ np.linalg.solve(result.covariance, twist) / 6)
        assert np.linalg.eigvalsh(result.covariance).min() > 0
    assert np.sqrt(np.mean(np.square(errors))) < 0.001
    assert np.max(errors) < 0.002
    # 1 would be honest; on flights like this one it is cautious: 0.42 to 0.78 with six seeds. Narrow
    # enough that a covariance wrong by a factor of three either way is noticed.
    assert 0.25 < np.mean(nees[1:]) < 1.3


def test_two_runs_are_the_same(flight):
    poses, images = flight
    results = [
        [run.track(image, i * STEP_NS) for i, image in enumerate(images[:6])]
        for run in (started(poses[0]), started(poses[0]))
    ]
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a.cam_from_world.matrix, b.cam_from_world.matrix)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_what_the_filter_expects_is_where_it_searches_and_how_far(flight):
    """A second without a frame: it fits where it is told to 1 cm, and passes over a wrong pose told with doubt."""
    poses, images = flight
    sure, doubtful = np.diag([1e-4] * 6), np.eye(6)
    away = Pose.exp(np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.2]))
    for told, covariance, surer in ((poses[19], sure, True), (away @ poses[19], doubtful, False)):
        run = started(poses[0])
        run.track(images[0], 0)
        run.predict(told, covariance)
        before = run.expected
        result = run.track(images[19], 19 * STEP_NS)
        assert run.expected is None  # it counts once
        own = run.state.motion.predict(19 * 1e-9 * STEP_NS, run.state.range_m, CONFIG.motion)
        assert (before.spread_m(run.state.range_m) < own.spread_m(run.state.range_m)) == surer
        if surer:
            assert result.status == "ok"
            assert pose_error(result.cam_from_world, poses[19])[0] < 0.003
            assert "relocalize" not in result.stage_ms  # a search was not needed


def test_it_recovers_from_a_start_error_of_four_percent_and_four_degrees(flight):
    poses, images = flight
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(4):
        t, r = rng.normal(size=3), rng.normal(size=3)
        away = Pose.exp(np.concatenate([0.04 * 1.1 * t / np.linalg.norm(t), np.radians(4) * r / np.linalg.norm(r)]))
        run = started(away @ poses[0])
        for i in range(10):
            result = run.track(images[i], i * STEP_NS)
        errors.append(pose_error(result.cam_from_world, poses[9])[0] if result.cam_from_world else np.inf)
    assert np.count_nonzero(np.array(errors) < 0.01) >= 3


def test_a_right_first_pose_is_kept_and_a_wrong_one_is_searched(flight):
    poses, images = flight
    wrong = Pose.exp([0.03, -0.02, 0.03, 0.04, -0.05, 0.03]) @ poses[0]
    for first, searched in ((poses[0], False), (wrong, True)):
        run = started(first)
        for i in range(9):
            result = run.track(images[i], i * STEP_NS)
            assert ("relocalize" in result.stage_ms) == searched
            if result.status == "ok":
                break
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.01
        assert np.linalg.eigvalsh(result.covariance).min() > 0


def test_a_frozen_image_is_lost_until_it_moves_again(flight):
    poses, images = flight
    run = started(poses[0])
    statuses = [run.track(images[i], k * STEP_NS).status for k, i in enumerate((0, 1, 2, 2, 2, 5))]
    assert statuses == ["ok", "ok", "ok", "lost", "lost", "ok"]


def test_a_patch_that_is_missed_lowers_the_support_and_one_not_looked_for_does_not():
    points, known = np.full(10, 0.8), np.zeros((10, 8))
    known[:, 6] = 1.0
    seen = EdgeMeasurements(
        ControlPoints(np.zeros((10, 3)), np.zeros((10, 3), np.int64), np.arange(10), np.array([0, 10])),
        SearchLines(np.zeros((10, 4)), np.zeros((10, 6)), np.zeros(10, np.int64)),
        Candidates(np.zeros((10, 4)), np.full((10, 4), 50.0)),
        np.ones(10),
        np.ones(10),
        np.zeros((10, 0)),
    )
    found, missed, untried = (np.array([1.0, 0.9]), np.ones(2)), (np.zeros(2), np.zeros(2)), (np.zeros(2), -np.ones(2))
    weak_step = CONFIG.edges.appearance.weak_step_grey
    shares = [support(seen, np.ones(10), points, *patches, known, weak_step) for patches in (found, missed, untried)]
    assert [edges for _, edges in shares] == pytest.approx([0.8] * 3)
    assert shares[0][0] == pytest.approx((8 + 2) / (10 + 2))
    assert shares[1][0] == pytest.approx(8 / (10 + 2))
    assert shares[2][0] == pytest.approx(0.8)


def test_a_second_between_frames_is_not_a_loss(flight):
    poses, images = flight
    run = started(poses[0])
    for i in (0, 15, 19):
        result = run.track(images[i], i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.01


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_blank_frame_is_lost_and_the_next_good_one_is_found(flight, level):
    poses, images = flight
    run = started(poses[0])
    for i in range(4):
        run.track(images[i], i * STEP_NS)
    for i in (4, 5):
        assert run.track(np.full((480, 640, 3), level, np.uint8), i * STEP_NS).status == "lost"
    result = run.track(images[6], 6 * STEP_NS)
    assert result.status == "ok"
    assert pose_error(result.cam_from_world, poses[6])[0] < 0.01


def test_a_view_without_the_structure_is_lost(flight):
    poses, images = flight
    run = started(poses[0])
    run.track(images[0], 0)
    empty = Scene([], seed=3)
    view = empty.render(poses[1], noise_rng=np.random.default_rng(0))
    statuses = [run.track(view, (i + 1) * STEP_NS).status for i in range(3)]
    assert statuses[1:] == ["lost", "lost"]


def test_bad_frames_are_lost_without_an_exception(flight):
    poses, images = flight
    run = started(poses[0])
    assert run.track(images[0], STEP_NS).status == "ok"
    assert run.track(images[1], STEP_NS).status == "lost"  # the stamp stands still
    assert run.track(images[1], 0).status == "lost"  # and goes back
    with pytest.raises(ImageError, match=r"shape \(240, 640, 3\); give \(480, 640\) grey"):
        run.track(images[1][:240], 2 * STEP_NS)  # a mistake of the caller's, which tells nothing of the flight
    assert run.track(images[0], 3 * STEP_NS).status == "lost"  # a frozen image says nothing of now
    assert run.track(images[2], 4 * STEP_NS).status == "ok"


@pytest.mark.parametrize("first_grey", [True, False])
def test_grey_and_coloured_images_in_one_run_are_refused_and_it_goes_on(flight, first_grey):
    poses, images = flight
    run = started(poses[0])
    grey = [image[..., 1].copy() for image in images[:3]]
    kinds = (grey, images) if first_grey else (images, grey)
    assert run.track(kinds[0][0], 0).status == "ok"
    with pytest.raises(ImageError, match=r"those before were (grey|BGR); give all of a run in grey, or all in BGR"):
        run.track(kinds[1][1], STEP_NS)
    assert run.track(kinds[0][2], 2 * STEP_NS).status == "ok"


@pytest.mark.parametrize("stamp", [0.0666, 66_666_667.0, "1", None, np.float64(1e9)])
def test_stamps_that_are_no_whole_nanoseconds_are_refused(flight, stamp):
    """Seconds would be frames 0.07 ns apart, between which nothing moves."""
    poses, images = flight
    with pytest.raises(StampError, match="give whole nanoseconds"):
        started(poses[0]).track(images[0], stamp)
    assert started(poses[0]).track(images[0], np.int64(STEP_NS)).status == "ok"


def test_grey_frames_are_frames(flight):
    poses, images = flight
    run = started(poses[0])
    for i in range(3):
        result = run.track(np.ascontiguousarray(images[i][..., 1]), i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.01


def test_it_follows_frames_of_so_much_noise_that_single_pixels_tell_nothing(flight):
    poses, images = flight
    run, rng = started(poses[0]), np.random.default_rng(3)
    for i in range(12):
        noisy = np.clip(images[i] + rng.normal(0, 20, images[i].shape), 0, 255).astype(np.uint8)
        result = run.track(noisy, i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.05


def test_noisy_frames_are_located_between_the_pixels(flight):
    """By the matches of a search in a smoothed image alone the box is off by 1.2 mm."""
    poses, images = flight
    run, rng, errors_m = started(poses[0]), np.random.default_rng(3), []
    for i in range(12):
        noisy = np.clip(images[i] + rng.normal(0, 8, images[i].shape), 0, 255).astype(np.uint8)
        errors_m.append(pose_error(run.track(noisy, i * STEP_NS).cam_from_world, poses[i])[0])
    assert np.sqrt(np.mean(np.square(errors_m[2:]))) < 0.0007


def test_a_first_pose_that_is_not_finite_is_the_users_mistake():
    with pytest.raises(UserError, match="finite"):
        started(Pose(np.eye(3), [np.nan, 0, 1]))


def test_a_model_behind_the_camera_is_lost(flight):
    _, images = flight
    run = started(look_at(np.array([1.0, 0.0, 0.3]), (3.0, 0, 0.3)))
    assert run.track(images[0], 0).status == "lost"


def test_hidden_lines_are_removed():
    front, back = box_corners((0.2, 0.6, 0.6), (0.5, 0.0)), box_corners((0.2, 0.2, 0.2), (-0.5, 0.0))
    both = Structure.from_mesh(np.concatenate([front, back]), np.concatenate([BOX_TRIANGLES, BOX_TRIANGLES + 8]))
    m = edge_map(both)
    pose = look_at(np.array([3.0, 0.0, 0.1]), (0, 0, 0.1))
    points = sample_edges(m, View.of(CAMERA, both).at(pose), 4.0, 400).points
    assert len(points) > 100
    assert (points[:, 0] > 0).all()


def test_compiled_geometry_is_that_of_pose_and_camera():
    rng = np.random.default_rng(4)
    cam = camera_array(CAMERA)
    pose, twist = Pose.exp(rng.normal(size=6)), rng.normal(size=6) * 0.3
    R, t = se3_exp_left(pose.rotation, pose.translation, twist)
    np.testing.assert_allclose(R, (Pose.exp(twist) @ pose).rotation, atol=1e-12)
    np.testing.assert_allclose(t, (Pose.exp(twist) @ pose).translation, atol=1e-12)
    np.testing.assert_allclose(se3_log_left(pose.rotation, pose.translation, R, t), twist, atol=1e-12)
    still = se3_log_left(pose.rotation, pose.translation, pose.rotation, pose.translation)
    np.testing.assert_allclose(still, 0, atol=1e-12)
    np.testing.assert_allclose(project(0.1, -0.2, 1.3, cam), CAMERA.project(np.array([[0.1, -0.2, 1.3]]))[0])
    row = np.zeros(6)
    normal_row(0.1, -0.2, 1.3, 0.6, 0.8, cam, row)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-6
        a, b = (Pose.exp(s * step).transform(np.array([[0.1, -0.2, 1.3]])) for s in (1, -1))
        np.testing.assert_allclose(row[axis], (CAMERA.project(a) - CAMERA.project(b))[0] @ [0.6, 0.8] / 2e-6, atol=1e-4)
    A = rng.normal(size=(6, 6))
    A = A @ A.T + np.eye(6)
    x = np.zeros(6)
    assert solve6(A, np.arange(6.0), x)
    np.testing.assert_allclose(A @ x, np.arange(6.0), atol=1e-10)
    assert not solve6(-A, np.arange(6.0), x)


def test_nothing_is_seen_between_the_sides_of_a_column():
    angle = np.arange(16) * np.pi / 8
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) * 0.2
    vertices = np.concatenate([np.column_stack([ring, np.full(16, z)]) for z in (0.0, 1.0)])
    sides = [t for i in range(16) for t in ([i, (i + 1) % 16, i + 16], [(i + 1) % 16, (i + 1) % 16 + 16, i + 16])]
    edges = edge_map(Structure.from_mesh(vertices, np.array(sides)))
    upright = np.ptp(edges.ends[..., 2], axis=1) > 0.5
    assert upright.any()
    assert edges.smooth[upright].all()
    assert not edge_map(box()).smooth.any()


def test_patches_taken_at_a_pose_are_found_again_there(flight):
    poses, images = flight
    texture = Texture(edge_map(box()), CAMERA, View.of(CAMERA, box()), CONFIG)
    view = View.of(CAMERA, box()).at(poses[1])
    texture.take(images[0], poses[0], np.zeros((0, 2)))
    assert len(texture) > 10
    texture.choose(view)
    places, observed, score, variance = texture.align(images[1], view)
    moved = observed - CAMERA.project(poses[1].transform(places))
    assert np.count_nonzero(score > 0) > 0.7 * len(texture.chosen)
    assert np.median(np.linalg.norm(moved[score > 0], axis=1)) < 0.3
    noise = np.random.default_rng(0).normal(0, 5, images[1].shape)
    noisy = np.clip(images[1] + noise, 0, 255).astype(np.uint8)
    _, _, less, vaguer = texture.align(noisy, view)
    both = (score > 0) & (less > 0)
    assert (vaguer[both] > variance[both]).mean() > 0.9


def test_patches_whose_scale_has_changed_take_no_place_of_others(flight):
    poses, images = flight
    view = View.of(CAMERA, box())
    texture = Texture(edge_map(box()), CAMERA, view, CONFIG)
    texture.take(images[0], poses[0], np.zeros((0, 2)))
    texture.choose(view.at(poses[1]))
    usual = texture.chosen
    assert 10 < len(usual) <= len(texture)
    old = usual[::2]
    texture.patches.axes[old] /= 2.0  # taken from half as far away: four times the area
    texture.patches.hits[old] = 100
    texture.choose(view.at(poses[1]))
    np.testing.assert_array_equal(np.intersect1d(texture.chosen, old), [])
    assert np.isin(usual[1::2], texture.chosen).all()
    assert (texture.align(images[1], view.at(poses[1]))[2] > 0).mean() > 0.7


def test_patches_on_faces_that_a_frame_does_not_show_keep_their_places(flight):
    poses, images = flight
    view = View.of(CAMERA, box())
    texture = Texture(edge_map(box()), CAMERA, view, CONFIG)
    texture.take(images[0], poses[0], np.zeros((0, 2)))
    face, before = texture.patches.face[: len(texture)], texture.patches.middles[: len(texture)].copy()
    shown, twist = face == face[0], np.array([0.002, 0.001, 0.0, 0.0, 0.001, 0.0])
    assert 0 < np.count_nonzero(shown) < len(texture)
    texture.shift(face[:1], twist, view.at(poses[0]))
    after = texture.patches.middles[: len(texture)]
    np.testing.assert_array_equal(after[~shown], before[~shown])
    pixels = CAMERA.project(poses[0].transform(before))
    again = CAMERA.project((Pose.exp(twist) @ poses[0]).transform(after))
    assert np.abs(again - pixels)[shown].max() < 0.01
    assert np.abs(again - pixels)[~shown].min(axis=1).max() > 0.1


def test_search_lines_of_the_pose_search_are_as_long_as_points_of_its_small_image_may_be_off():
    whole = PoseSearch(edge_map(box()), CAMERA, near_depth(box()), CONFIG)
    half = PoseSearch(edge_map(box()), replace(CAMERA, width=CAMERA.width // 2), near_depth(box()), CONFIG)
    assert whole.half_px == pytest.approx(CONFIG.relocalization.search.truncation_px * CAMERA.width / whole.size[0])
    assert half.half_px == pytest.approx(whole.half_px / 2)


def test_pose_search_ranks_a_near_pose_first(flight):
    poses, images = flight
    search = PoseSearch(edge_map(box()), CAMERA, near_depth(box()), CONFIG)
    guess = RigidMotion(np.array(poses[0].rotation), np.array(poses[0].translation))
    target = search.target(images[19], sigma_px=30.0)
    found = search.best_of(target, guess, search.block(-0.25, 0.0, Reach(0.12, 0.25, 0.3)), most=10**9)
    scores = [candidate.score for candidate in found.candidates]
    assert scores == sorted(scores, reverse=True)
    assert len(scores) == CANDIDATES
    assert min(pose_error(Pose(*candidate.pose), poses[19])[0] for candidate in found.candidates) < 0.15
    refined = search.refined(target, found.candidates[0]).candidates[0]
    assert refined.score >= scores[0]
