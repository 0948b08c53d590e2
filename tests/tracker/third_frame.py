"""A run of `robust` around a box in its third frame, for tests of what it does then."""

from types import SimpleNamespace

import numpy as np

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock

STEP_NS = 66_666_667


def third_frame():
    """The run, two frames old, the third frame, and its fit."""
    flight = flown(3, seed=11)
    run = Robust().start(box(), CAMERA, flight.poses[0], np.random.default_rng(0))
    for k in range(2):
        run.track(flight.images[k], k * STEP_NS)
    frame = run.frames.prepared(flight.images[2], 2 * STEP_NS, None, StageClock())
    fit = run.fitter.fit(frame.image, frame.predicted.cam_from_world, frame.predicted.covariance, StageClock())
    return SimpleNamespace(run=run, frame=frame, fit=fit)
