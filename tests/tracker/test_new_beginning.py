"""After a loss, a pose from which the structure looks unknown is tracked as `ambiguous`; what was known is kept."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, flown, look_at
from uavbench.tracker.robust.track_state import TrackState
from uavbench.tracker.robust.tracker import Robust

STEP_NS = 66_666_667
LEARNED, LOST = 8, 20


def error_m(pose, true):
    return np.linalg.norm(pose.inverse().translation - true.inverse().translation)


def blank(image):
    return np.full_like(image, 128)


class AfterALoss:
    """A run that saw a box, and then blank frames; what comes then shows edges and faces that it has not learned."""

    def __init__(self, known=False, seed=11):
        self.poses, self.images = flown(110, seed=seed)
        self.run = Robust().start(box(), CAMERA, self.poses[0], np.random.default_rng(0))
        self.frame = 0
        assert {self.next().status for _ in range(LEARNED)} == {"ok"}
        self.usual = self.run.state.usual_support
        assert {self.next(blank).status for _ in range(LOST)} == {"lost"}
        if not known:
            self.run.fitter.forget()
            self.run.decider.places.forget()
        self.known = self.run.fitter.memory

    def next(self, changed=lambda image: image):
        """The result of the next frame, changed."""
        result = self.run.track(changed(self.images[self.frame]), self.frame * STEP_NS)
        self.frame += 1
        return result

    @property
    def true(self):
        """The true pose of the last frame."""
        return self.poses[self.frame - 1]


@pytest.fixture
def run():
    return AfterALoss(seed=23)


def test_it_begins_again_where_nothing_is_known_and_says_so_until_it_is_sure(run):
    results = []
    for _ in range(45):
        results.append(run.next())
        pose = results[-1].cam_from_world if results[-1].status == "ok" else results[-1].guess
        assert results[-1].status == "lost" or error_m(pose, run.true) < 0.01
    statuses = [result.status for result in results]
    assert "ambiguous" in statuses
    assert set(statuses[statuses.index("ok") :]) == {"ok"}
    assert statuses[statuses.index("ok") - 1] == "ambiguous"


def test_what_was_known_returns_if_the_new_pose_is_not_confirmed(run):
    status = "lost"
    while run.run.fitter.appearance is run.known.appearance:
        assert run.frame < LEARNED + LOST + 40
        status = run.next().status
    assert status == "ambiguous"
    assert run.run.state.usual_support != run.usual
    assert run.next(blank).status == "lost"
    assert all(now is before for now, before in zip(run.run.fitter.memory[:3], run.known[:3], strict=True))
    assert run.run.state.usual_support == run.usual
    assert not run.run.fitter.appearance.any()  # nothing was learned at the doubted pose


@pytest.fixture
def doubtful(monkeypatch):
    """The same run, which knows the box; but chance may find as much as it finds of it."""
    monkeypatch.setattr(TrackState, "is_recognized", lambda *_: False)
    return AfterALoss(known=True)


def test_a_pose_found_long_after_the_last_one_is_followed_and_believed_once_it_is_not_doubted(doubtful):
    results = [doubtful.next() for _ in range(15)]
    statuses = [result.status for result in results]
    assert statuses[0] == "ambiguous"
    assert set(statuses[statuses.index("ok") :]) == {"ok"}
    assert error_m(results[-1].cam_from_world, doubtful.true) < 0.01
    assert doubtful.run.decider.beginnings.before is None


def test_what_was_known_returns_if_a_doubted_pose_after_a_loss_is_not_confirmed(doubtful):
    assert doubtful.next().status == "ambiguous"
    assert doubtful.run.state.frames_ok == LEARNED + 1
    assert doubtful.next(blank).status == "lost"
    assert doubtful.run.state.frames_ok == LEARNED
    assert all(now is before for now, before in zip(doubtful.run.fitter.memory[:3], doubtful.known[:3], strict=True))


@pytest.mark.parametrize(("height_m", "seed"), [(0.22, 1), (0.3, 0)])
def test_a_box_seen_from_the_front_is_recognized_by_its_label_after_a_loss(height_m, seed):
    """Fits that know nothing of the label leave open how far such a view is turned."""
    ks = np.arange(24)
    eyes = np.column_stack([0.05 * np.sin(ks / 6 + seed), np.full(24, -1.0), height_m + 0.02 * np.sin(ks / 9)])
    scene, rng, statuses = Scene([box_corners()], seed=seed), np.random.default_rng(seed), []
    poses = [look_at(eye, (0.0, 0.0, 0.15)) for eye in eyes]
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for k, pose in enumerate(poses):
        image = scene.render(pose, noise_rng=rng)
        result = run.track(blank(image) if 8 <= k < 15 else image, k * STEP_NS)
        statuses.append(result.status)
        assert result.status != "ok" or error_m(result.cam_from_world, pose) < 0.01
    assert set(statuses[:8] + statuses[15:]) == {"ok"}
