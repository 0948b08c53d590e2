"""When a pose is searched while a track has some support, though a search found nothing better a few frames ago."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.decision import SEARCH_EVERY
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock

STEP_NS = 66_666_667


@pytest.fixture(scope="module")
def tracked():
    """The run of a box, two frames old, and the fit of the third one."""
    flight = flown(3, seed=11)
    run = Robust().start(box(), CAMERA, flight.poses[0], np.random.default_rng(0))
    for k in range(2):
        run.track(flight.images[k], k * STEP_NS)
    frame = run.frames.prepared(flight.images[2], 2 * STEP_NS, None, StageClock())
    fit = run.fitter.fit(frame.image, frame.predicted.cam_from_world, frame.predicted.covariance, StageClock())
    return SimpleNamespace(run=run, frame=frame, fit=fit)


@pytest.mark.parametrize(
    ("support", "log10_chance", "due"),
    [
        (0.55, -30.0, False),
        (0.55, -6.1, False),
        (0.55, -5.9, True),
        (0.65, -30.0, False),
        (0.65, -5.9, True),
        (0.45, -30.0, True),
    ],
)
def test_a_search_is_not_put_off_where_chance_may_have_found_the_fit(tracked, support, log10_chance, due):
    """A million poses of a search: one of them is expected to find as much by chance where that is 1e-6 for each."""
    tracked.run.decider.until_search = SEARCH_EVERY
    fit = replace(tracked.fit, support=support, chance=Chance(log10_chance, log10_chance))
    assert tracked.run.decider.search_is_due(tracked.frame, fit) == due


def test_after_a_long_interval_support_alone_counts(tracked):
    """The pose is then compared with those at which the structure looks alike, whatever chance may have found."""
    fit = replace(tracked.fit, support=0.99, chance=Chance(0.0, 0.0))
    late = tracked.frame._replace(extrapolated_s=1.0)
    assert tracked.run.decider.search_is_due(tracked.frame, fit)
    assert not tracked.run.decider.search_is_due(late, fit)
