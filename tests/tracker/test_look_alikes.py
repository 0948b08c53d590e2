"""After a loss, poses at which a structure looks alike are told apart by its surface, or not at all."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.decision.decider import Decision
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization import look_alikes
from uavbench.tracker.robust.relocalization.doubts import Doubts
from uavbench.tracker.robust.relocalization.look_alikes import CLEARLY, LookAlikes, Lost, Verdict
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import Likely
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.surfaces.known_surfaces import UNSEEN, KnownSurfaces
from uavbench.tracker.robust.relocalization.surfaces.surface import EDGE_PX
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.work import Work
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

PANEL_M, RANGE_M, STEP_NS = 0.3, 0.9, 66_666_667
BOXES = 9
ROW = [box_corners((0.12, 0.15, 0.25), ((k - BOXES // 2) * PANEL_M, 0.0)) for k in range(BOXES)]
ROW_OF_BOXES = Structure.from_mesh(np.concatenate(ROW), np.concatenate([BOX_TRIANGLES + 8 * k for k in range(BOXES)]))
ENOUGH = 10**9


def before(right_m, up_m=0.35):
    """The camera before the row, so far to the right of its middle."""
    return look_at(np.array([right_m, -RANGE_M, up_m]), (right_m + 0.03, 0.0, 0.12))


def beside(pose, boxes):
    """The pose at which the row looks as at another one, so many boxes to the right of it."""
    return Pose(pose.rotation, pose.translation - pose.rotation @ np.array([boxes * PANEL_M, 0.0, 0.0]))


def hang_posters(image, pose):
    """Draw a poster of another shade on the front of each box."""
    shades = np.random.default_rng(4).permutation(np.linspace(10, 250, BOXES)).tolist()
    for corners, shade in zip(ROW, shades, strict=True):
        left, right, front = corners[:, 0].min() + 0.02, corners[:, 0].max() - 0.02, corners[:, 1].min()
        poster = np.array([(left, front, 0.06), (right, front, 0.06), (right, front, 0.2), (left, front, 0.2)])
        cv2.fillConvexPoly(image, CAMERA.project(pose.transform(poster)).round().astype(np.int32), (shade,) * 3)


class Comparison:
    """What was seen of a row of equal boxes from some poses, and an image from the middle."""

    def __init__(self, *seen_from):
        self.scene, self.rng, self.pose = Scene(ROW, seed=2), np.random.default_rng(3), before(0.0)
        self.fitter = EdgeFitter(ROW_OF_BOXES, CAMERA, np.random.default_rng(0), RobustConfig())
        self.relocator = Relocator(self.fitter, CAMERA)
        reader = self.relocator.reader
        self.seen = [reader.between_edges(reader.surface(self.image(pose), pose)) for pose in seen_from]
        self.shown = self.image(self.pose)
        self.look_alikes = LookAlikes(Doubts(self.relocator))

    def image(self, pose):
        return self.scene.render(pose, noise_rng=self.rng)

    def known(self):
        shown = self.relocator.reader.shown(self.shown)
        return KnownSurfaces(self.relocator.reader, self.seen, shown, Work(ENOUGH))

    def compared(self, boxes=0, sigma=0.3, work=ENOUGH):
        """The verdict on a fit so many boxes beside the true pose, which may be as far away as sigma."""
        pose = beside(self.pose, boxes)
        self.fitter.begin(0, 0.1)
        fit = self.fitter.fit(self.shown, pose, isotropic_covariance(0.005, RANGE_M), StageClock())
        self.fitter.work = Work(work)
        reach = Motion(self.pose, isotropic_covariance(sigma, RANGE_M))
        return self.look_alikes.compared(Lost(self.shown, [reach], RANGE_M, [Likely(reach)], self.seen), fit)

    def off_m(self, fit):
        return float(np.linalg.norm(fit.cam_from_world.inverse().translation - self.pose.inverse().translation))


@pytest.fixture(scope="module")
def everywhere():
    """The row was seen from before each box but the first and last two."""
    return Comparison(*(before(k * PANEL_M + 0.02, 0.37) for k in range(-2, 3)))


@pytest.fixture(scope="module")
def nowhere():
    """Nothing of the row was seen."""
    return Comparison()


def test_of_places_beside_each_other_the_one_most_edges_are_moved_to_is_compared(nowhere, monkeypatch):
    """What both show is found by the move between them: one that is aside of it would part edges that both show."""
    fitted = nowhere.fitter.fit(nowhere.shown, nowhere.pose, isotropic_covariance(0.005, RANGE_M), StageClock())
    shifts = [(PANEL_M, 0.0, 0.0), (0.9 * PANEL_M, 0.0, 0.0), (-PANEL_M, 0.0, 0.0)]
    moves = [RigidMotion(np.eye(3), np.array(shift)) for shift in shifts]
    monkeypatch.setattr(nowhere.relocator.rivals, "moves", lambda *_: moves)
    reach = Motion(nowhere.pose, isotropic_covariance(0.3, RANGE_M))
    given, *others = nowhere.look_alikes.poses(Lost(nowhere.shown, [reach], RANGE_M, [], []), fitted)
    at = motion(fitted.cam_from_world)
    np.testing.assert_allclose(given.t, at.t)
    moved = sorted(float((at.R.T @ (at.t - each.t))[0]) for each in others)
    np.testing.assert_allclose(moved, [-PANEL_M, PANEL_M], atol=1e-12)


def test_a_surface_between_edges_is_away_from_all_that_are_seen(everywhere):
    pose, reader = before(0.0), everywhere.relocator.reader
    whole = reader.surface(everywhere.shown, pose)
    between = reader.between_edges(whole)
    ends = everywhere.fitter.edges.ends
    on_edges = (ends[:, :1] + np.linspace(0.0, 1.0, 200)[:, None] * (ends[:, 1:] - ends[:, :1])).reshape(-1, 3)
    seen = on_edges[on_edges[:, 1] == on_edges[:, 1].min()]  # of the fronts, all of which are in sight
    edges, points = (reader.pixels_of(each, motion(pose)) for each in (seen, between.points))
    apart_px = np.abs(points[:, :, None] - edges[:, None]).max(axis=0).min(axis=1)
    assert apart_px.min() >= EDGE_PX
    assert 40 < len(between.points) < len(whole.points)
    rows = {tuple(point) for point in whole.points}
    assert all(tuple(point) in rows for point in between.points)
    assert between.grey.shape == (2, len(between.points)) and between.normals.shape == between.points.shape


def test_the_surface_tells_a_place_from_others_that_look_alike(everywhere):
    known, pose = everywhere.known(), everywhere.pose
    here = known.rarity(motion(pose))
    assert here > UNSEEN
    for boxes in (-2, -1, 1, 2):
        assert known.rarity(motion(beside(pose, boxes))) < here - CLEARLY


def test_a_place_that_was_not_seen_is_neither_likely_nor_unlikely(nowhere):
    assert nowhere.known().rarity(motion(nowhere.pose)) == UNSEEN
    far = Comparison(before(-PANEL_M * 3))
    assert far.known().rarity(motion(beside(far.pose, 2))) == UNSEEN


def test_a_place_that_looks_otherwise_now_is_no_less_likely_than_one_that_was_not_seen():
    """Only the true place was seen, and posters hang there since: that does not make another one right."""
    changed = Comparison(before(0.02, 0.37))
    hang_posters(changed.shown, changed.pose)
    assert changed.known().rarity(motion(changed.pose)) == UNSEEN
    for boxes in (-1, 0, 1):
        verdict = changed.compared(boxes)
        assert not verdict.leads or changed.off_m(verdict.fit) < 0.01


def test_a_fit_at_the_right_place_leads(everywhere):
    verdict = everywhere.compared()
    assert verdict.leads and not verdict.contenders and not verdict.is_seen
    assert everywhere.off_m(verdict.fit) < 0.01


@pytest.mark.parametrize("boxes", [-1, 1])
def test_a_fit_beside_the_right_place_gives_way_to_the_one_there(everywhere, boxes):
    verdict = everywhere.compared(boxes)
    assert verdict.leads and verdict.is_seen
    assert everywhere.off_m(verdict.fit) < 0.01


@pytest.mark.parametrize("boxes", [-1, 0, 1])
def test_where_nothing_was_seen_equal_places_stay_equal(nowhere, boxes):
    verdict = nowhere.compared(boxes)
    assert not verdict.leads
    assert len(verdict.contenders) == 2
    apart_m = np.diff([nowhere.off_m(each.fit) for each in verdict.contenders])
    assert abs(apart_m) > 0.5 * PANEL_M


def test_places_out_of_reach_are_not_compared(nowhere):
    assert nowhere.compared(sigma=0.01) is None


@pytest.mark.parametrize("boxes", [-1, 0, 1])
def test_a_place_at_the_end_of_the_row_is_told_by_its_edges(boxes):
    """A box that another place shows beside those of this one is not there, or one that this one shows is there."""
    end = Comparison()
    end.pose = before((BOXES // 2) * PANEL_M)
    end.shown = end.image(end.pose)
    verdict = end.compared(boxes, sigma=1.0)
    assert verdict.leads and not verdict.is_seen
    assert end.off_m(verdict.fit) < 0.01


def test_where_the_camera_can_hardly_have_come_to_adds_to_what_edges_tell():
    """One box beyond the end hardly less is found than at the end, but the camera was there a moment ago."""
    end = Comparison()
    end.pose = before((BOXES // 2) * PANEL_M)
    end.shown = end.image(end.pose)
    verdict = end.compared(1, sigma=0.1)
    assert verdict.leads
    assert end.off_m(verdict.fit) < 0.01


def test_of_many_places_the_farther_ones_count_as_not_seen(everywhere, monkeypatch):
    """What was seen before leads them, and what only its edges tell from its neighbours does not."""
    monkeypatch.setattr(look_alikes, "MOST_COMPARED", 2)
    assert everywhere.compared().leads
    end = Comparison()
    end.pose = before((BOXES // 2) * PANEL_M)
    end.shown = end.image(end.pose)
    assert not end.compared().leads


def test_without_room_for_a_comparison_nothing_is_sure_and_the_next_frame_leaves_room(everywhere):
    verdict = everywhere.compared(work=1000)
    assert not verdict.leads
    awaited = everywhere.look_alikes.awaited
    assert awaited > 1000
    everywhere.fitter.work = Work(everywhere.fitter.cost(2) + 1000)
    assert everywhere.look_alikes.taken() == 1000, "as much as other fits leave"
    assert everywhere.look_alikes.taken() == 0
    assert everywhere.compared(work=awaited).leads


def test_without_room_for_fits_each_frame_leaves_more_until_they_say_that_places_are_equal(nowhere):
    work, frames = 600_000, 0
    while len(nowhere.compared(work=work).contenders) < 2:
        awaited, frames = nowhere.look_alikes.awaited, frames + 1
        assert awaited > work
        work = awaited
    assert 0 < frames <= 3


def flown(seen_from, found_at):
    """Statuses and errors (m) of a run that sees the row with posters on its way, then 3 s of noise, then again."""
    scene, rng = Scene(ROW, seed=2), np.random.default_rng(3)
    run, found = None, []
    images = [(pose, scene.render(pose, noise_rng=rng)) for pose in seen_from]
    images += [(None, rng.integers(100, 140, images[0][1].shape, dtype=np.uint8)) for _ in range(45)]
    images += [(pose, scene.render(pose, noise_rng=rng)) for pose in found_at]
    for pose, image in images:
        if pose is not None:
            hang_posters(image, pose)
    for k, (pose, image) in enumerate(images):
        run = run or Robust().start(ROW_OF_BOXES, CAMERA, pose, np.random.default_rng(0))
        result = run.track(image, k * STEP_NS)
        if pose is None or result.status != "ok":
            found.append((result.status, None))
        else:
            off_m = result.cam_from_world.inverse().translation - pose.inverse().translation
            found.append((result.status, float(np.linalg.norm(off_m))))
    return found[len(seen_from) + 45 :]


def test_a_run_is_found_again_at_a_box_that_it_saw_beside_the_one_where_it_was_lost():
    """It saw the left half of the row, is lost at the end of that, and comes back to the middle."""
    way = [before(x) for x in np.linspace(0.0, -3.0 * PANEL_M, 40)]
    found = flown(way, [before(x) for x in np.linspace(0.5 * PANEL_M, 0.7 * PANEL_M, 15)])
    errors = [off_m for _, off_m in found if off_m is not None]
    assert len(errors) >= 10
    assert max(errors) < 0.02


def test_a_run_that_sees_a_box_for_the_first_time_does_not_say_which():
    way = [before(x) for x in np.linspace(-3.0 * PANEL_M, -1.5 * PANEL_M, 40)]
    found = flown(way, [before(x) for x in np.linspace(0.2 * PANEL_M, 0.4 * PANEL_M, 15)])
    assert {status for status, _ in found} <= {"ambiguous", "lost"}


@pytest.mark.parametrize(("is_seen", "settled"), [(True, True), (False, False)])
def test_what_is_found_at_a_look_alike_is_enough_for_the_place_that_its_surface_tells(monkeypatch, is_seen, settled):
    """Of edges that were never seen before fewer are found as known than of those at the wrong place."""
    pose = before(0.0)
    image = Scene(ROW, seed=2).render(pose, noise_rng=np.random.default_rng(3))
    run = Robust().start(ROW_OF_BOXES, CAMERA, pose, np.random.default_rng(0))
    run.track(image, 0)
    decider, clock = run.decider, StageClock()
    frame = run.frames.prepared(image, STEP_NS, None, clock)
    found = run.fitter.searched(image, pose, isotropic_covariance(0.005, RANGE_M), clock)
    weak = replace(found, support=0.3, chance=Chance(-5.0, -5.0), cam_from_world=beside(pose, 1))
    run.state.is_lost = True
    monkeypatch.setattr(decider, "initialized_or_recovered", lambda *_: Decision(found, True, searched=True))
    monkeypatch.setattr(decider, "told", lambda *_: Verdict(weak, leads=True, is_seen=is_seen))
    assert decider.decide(frame, found, clock).settled == settled
