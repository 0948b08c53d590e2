"""Places at which a structure looks like itself: which there are, and that no frame is believed at a wrong one."""

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at, pose_error
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.motion_model import Motion, PredictionErrors
from uavbench.tracker.robust.relocalization.self_similarity import SelfSimilarity, direction_numbers
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.pose import Pose

PITCH_M = 0.3
SIZE_M = (0.12, 0.15, 0.25)
COUNT = 7


def row_corners(count=COUNT):
    middle = (count - 1) / 2
    return [box_corners(SIZE_M, ((k - middle) * PITCH_M, 0.0)) for k in range(count)]


@pytest.fixture(scope="module")
def row():
    """Equal boxes in a row along x."""
    corners = row_corners()
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(COUNT)])
    return Structure.from_mesh(np.concatenate(corners), triangles)


@pytest.fixture(scope="module")
def similarity(row):
    return SelfSimilarity(EdgeMap.of(row, 35.0))


def edge_points(row, boxes):
    """Points inside the edges of some boxes, and the directions of those edges."""
    ends = row.edge_segments
    k = np.round(ends.mean(axis=1)[:, 0] / PITCH_M + (COUNT - 1) / 2).astype(int)
    ends = ends[np.isin(k, boxes)]
    along = ends[:, 1] - ends[:, 0]
    parts = np.random.default_rng(0).uniform(0.1, 0.9, (len(ends), 1))
    return ends[:, 0] + parts * along, along / np.linalg.norm(along, axis=1, keepdims=True)


def share_of(similarity, shift, points, along):
    k = np.abs(similarity.shifts - shift).sum(axis=1).argmin()
    assert similarity.shifts[k] == pytest.approx(shift, abs=1e-9)
    return similarity.shares(points, along)[k]


def test_the_shifts_of_a_row_are_those_of_its_pitch_both_ways(similarity):
    for k in range(1, COUNT):
        for sign in (-1, 1):
            away = np.abs(similarity.shifts - [sign * k * PITCH_M, 0.0, 0.0]).sum(axis=1)
            assert away.min() < 1e-9, (sign, k)
    assert sorted(map(tuple, similarity.shifts.round(9))) == sorted(map(tuple, (-similarity.shifts).round(9)))


@pytest.mark.parametrize(("boxes", "steps", "share"), [
    ([3], 1, 1.0), ([3], -3, 1.0), ([3], 4, 0.0), ([0, 1], -1, 0.5), ([6], -6, 1.0), ([5, 6], 1, 0.5),
])  # fmt: skip
def test_a_shift_is_worth_what_of_the_seen_edges_it_brings_onto_others(row, similarity, boxes, steps, share):
    points, along = edge_points(row, boxes)
    for turned in (along, -along):
        found = share_of(similarity, np.array([steps * PITCH_M, 0.0, 0.0]), points, turned) if abs(steps) < COUNT else 0
        assert found == pytest.approx(share)


def test_an_edge_of_another_direction_does_not_count(row, similarity):
    points, along = edge_points(row, [3])
    diagonal = np.tile(np.array([0.6, 0.64, 0.48]), (len(points), 1))
    assert len(set(direction_numbers(np.concatenate([along, diagonal[:1]])))) == 4
    assert similarity.shares(points, diagonal).max() == 0.0


@pytest.mark.parametrize("unit", [0.001, 1.0, 1000.0])
def test_the_unit_of_the_structure_does_not_matter(row, unit):
    scaled = Structure.from_mesh(row.vertices * unit, row.triangles)
    found = SelfSimilarity(EdgeMap.of(scaled, 35.0))
    points, along = edge_points(row, [2, 3])
    assert share_of(found, np.array([PITCH_M * unit, 0, 0]), points * unit, along) == pytest.approx(1.0)


def test_a_structure_that_is_nowhere_like_itself_has_no_rivals():
    triangle = Structure.from_mesh(np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.9, 0], [0.4, 0.3, 1.1]], dtype=float),
                                   np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))  # fmt: skip
    found = SelfSimilarity(EdgeMap.of(triangle, 35.0))
    assert found.shares(triangle.vertices, np.eye(3)[[0, 1, 2, 0]]).max(initial=0.0) == 0.0


@pytest.mark.parametrize("scale", [1e-4, 0.01, 0.3])
def test_the_scale_of_prediction_errors_is_bounded_from_the_first_frame_on(scale):
    """By its definition: of draws from a normal distribution at most some in a thousand lie above the bound."""
    rng, above, wide = np.random.default_rng(0), 0, []
    covariance = np.diag([4.0, 4.0, 4.0, 0.01, 0.01, 0.01])
    expected = Motion(Pose(np.eye(3), np.zeros(3)), covariance)
    for _ in range(300):
        errors = PredictionErrors()
        assert errors.scale == 1.0
        for _ in range(12):
            draw = rng.normal(size=6) * np.sqrt(scale * np.diag(covariance))
            errors = errors.updated(expected, Pose.exp(draw), rate=0.1)
            above += errors.scale < scale
        wide.append(errors.scale / scale)
    assert above <= 0.01 * 300 * 12
    assert np.median(wide) < 3.4


def flown_past(first_m, last_m, frames):
    """Poses of a camera that goes along the row at 1.1 m and turns a little."""
    along = np.linspace(first_m, last_m, frames)
    return [look_at(np.array([x, -1.1, 0.35 + 0.02 * np.sin(5 * x)]), (x + 0.03, 0.0, 0.12)) for x in along]


@pytest.mark.parametrize("step_ns", [400_000_000, 1_000_000_000])
def test_at_slow_rates_no_frame_is_believed_one_box_beside_its_place(row, step_ns):
    poses = flown_past(-0.35, 0.35, 8)
    scene, rng = Scene(row_corners(), seed=2), np.random.default_rng(3)
    run = Robust(RobustConfig()).start(row, CAMERA, poses[0], np.random.default_rng(0))
    found = []
    for k, pose in enumerate(poses):
        result = run.track(scene.render(pose, noise_rng=rng), k * step_ns)
        assert result.cam_from_world is None or pose_error(result.cam_from_world, pose)[0] < 0.05, (k, result.status)
        found.append(result.status)
    assert found.count("ok") >= 4, found


@pytest.mark.parametrize(("acceleration_m_s2", "step_s"), [(0.3, 0.5), (0.6, 0.5), (0.9, 0.4)])
def test_a_camera_that_accelerates_along_a_long_row_is_never_believed_beside_its_place(acceleration_m_s2, step_s):
    """The ends are out of view, and between two frames it may move by more than a pitch."""
    count = 15
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(count)])
    row = Structure.from_mesh(np.concatenate(row_corners(count)), triangles)
    scene, rng = Scene(row_corners(count), seed=2), np.random.default_rng(3)
    run, x, speed_m_s, found = None, -1.0, 0.0, []
    for k in range(8):
        pose = look_at(np.array([x, -0.9, 0.35]), (x + 0.03, 0.0, 0.12))
        run = run or Robust(RobustConfig()).start(row, CAMERA, pose, np.random.default_rng(0))
        result = run.track(scene.render(pose, noise_rng=rng), int(k * step_s * 1e9))
        assert result.cam_from_world is None or pose_error(result.cam_from_world, pose)[0] < 0.05, (k, found)
        found.append(result.status)
        speed_m_s = min(speed_m_s + acceleration_m_s2 * step_s, 0.9)
        x += speed_m_s * step_s
    assert found.count("ok") >= 2, found


@pytest.mark.parametrize("away_m", [0.6, 0.8])
@pytest.mark.parametrize("step_m", [0.25, 0.3])
def test_after_a_jump_of_about_a_pitch_it_is_not_sure_of_the_place_that_looks_alike(row, away_m, step_m):
    """Before rivals were looked for, it was: 0.3 m beside, and `ok`."""
    poses = [look_at(np.array([x, -away_m, 0.3]), (x + 0.03, 0.0, 0.12)) for x in (0.0, step_m)]
    scene, rng = Scene(row_corners(), seed=2), np.random.default_rng(3)
    run = Robust(RobustConfig()).start(row, CAMERA, poses[0], np.random.default_rng(0))
    first, second = (run.track(scene.render(p, noise_rng=rng), k * 1_000_000_000) for k, p in enumerate(poses))
    assert first.status == "ok"
    assert second.cam_from_world is None or pose_error(second.cam_from_world, poses[1])[0] < 0.05
