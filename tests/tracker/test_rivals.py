"""Rivals of a fit: what counts in a comparison of poses at which the structure looks alike."""

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.rivals import Rivals
from uavbench.tracker.stage_clock import StageClock

CONFIG = RobustConfig()
PANEL_M, RANGE_M = 0.3, 0.9


def compared(count, learned):
    """Fits of a row of equal boxes from its middle, and of that pose's rival by one of them; learned: looks before."""
    corners = [box_corners((0.12, 0.15, 0.25), ((k - count // 2) * PANEL_M, 0.0)) for k in range(count)]
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(count)])
    structure = Structure.from_mesh(np.concatenate(corners), triangles)
    fitter = EdgeFitter(structure, CAMERA, np.random.default_rng(0), CONFIG)
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    scene, rng = Scene(corners, seed=2), np.random.default_rng(3)
    known = isotropic_covariance(0.005, RANGE_M)
    for k in range(learned):
        fitter.begin(k * 1_000_000_000, 1.0, sharp=True)
        image = scene.render(pose, noise_rng=rng)
        fitter.learn(image, fitter.fit(image, pose, known, StageClock()), 1.0)
    fitter.forget_patches()
    fitter.begin(learned * 1_000_000_000, 1.0, sharp=True)
    image = scene.render(pose, noise_rng=rng)
    top = fitter.searched(image, pose, known, StageClock())
    rivals: Rivals = Relocator(fitter, CAMERA).rivals
    at = top.cam_from_world
    shifted = RigidMotion(at.rotation, at.translation - at.rotation @ np.array([PANEL_M, 0.0, 0.0]))
    return top, rivals.fitted(Sought(image, [at], known, RANGE_M, top), top, shifted)


@pytest.mark.parametrize("learned", [0, 1, 5])
def test_edges_that_were_seen_before_are_no_reason_to_stay_where_they_are(learned):
    """In the middle of a long row the image is the same from one box beside, whose edges nobody has seen yet."""
    top, rival = compared(15, learned)
    assert rival.compared_support == pytest.approx(top.support, abs=0.05)
    if learned:
        assert top.support - rival.support > 0.05


@pytest.mark.parametrize("learned", [0, 5])
def test_what_only_one_of_two_poses_shows_tells_them_apart(learned):
    """Of two boxes one is where the other pose shows nothing."""
    top, rival = compared(2, learned)
    assert rival.compared_support < 0.85 * top.support


def test_an_own_fit_has_no_credit():
    top, _ = compared(2, 0)
    assert top.credit == 0.0
    assert top.compared_support == top.support
