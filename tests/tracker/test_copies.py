"""Of what is made alike one place may look as another: it is told by what is made but once beside it."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.self_similarity import DIRECTION_STEP, LENGTH_STEP
from uavbench.tracker.robust.relocalization.surfaces.aligner import rarity
from uavbench.tracker.robust.relocalization.surfaces.copies import is_copied
from uavbench.tracker.robust.relocalization.surfaces.known_surfaces import UNSEEN, KnownSurfaces
from uavbench.tracker.robust.work import Work
from uavbench.trajectories.pose import Pose

APART_M, RANGE_M, BOXES = 0.3, 0.9, 9
ROW = [box_corners((0.12, 0.15, 0.25), ((k - BOXES // 2) * APART_M, 0.0)) for k in range(BOXES)]
WALL = box_corners((BOXES * APART_M + 1.0, 0.05, 0.6), (0.0, 0.15))
FRONT_GREY, TOP_GREY = 20, 240


def structure_of(*corners):
    triangles = [BOX_TRIANGLES + 8 * k for k in range(len(corners))]
    return Structure.from_mesh(np.concatenate(corners), np.concatenate(triangles))


def before(right_m, up_m):
    """The camera before the row, so far to the right of its middle."""
    return look_at(np.array([right_m, -RANGE_M, up_m]), (right_m + 0.03, 0.0, 0.12))


def beside(pose, boxes):
    """The pose at which the row looks as at another one, so many boxes to the right of it."""
    return Pose(pose.rotation, pose.translation - pose.rotation @ np.array([boxes * APART_M, 0.0, 0.0]))


def paint(image, pose):
    """Paint all boxes alike, dark in front and bright on top."""
    for corners in ROW:
        (left, front, low), (right, back, high) = corners.min(axis=0), corners.max(axis=0)
        side = [(left, front, low), (right, front, low), (right, front, high), (left, front, high)]
        top = [(left, front, high), (right, front, high), (right, back, high), (left, back, high)]
        for corner, grey in (side, FRONT_GREY), (top, TOP_GREY):
            pixels = CAMERA.project(pose.transform(np.array(corner))).round().astype(np.int32)
            cv2.fillConvexPoly(image, pixels, (grey,) * 3)
    return image


@pytest.fixture(scope="module")
def sight():
    """What the row before a wall looks like from before the box left of the middle, and from where it was seen."""
    rng, scene = np.random.default_rng(3), Scene([*ROW, WALL], seed=2)
    here, there = before(-APART_M, 0.35), before(0.02 - APART_M, 0.37)
    fitter = EdgeFitter(structure_of(*ROW, WALL), CAMERA, np.random.default_rng(0), RobustConfig())
    reader = Relocator(fitter, CAMERA).reader
    was, now = (paint(scene.render(pose, noise_rng=rng), pose) for pose in (there, here))
    seen = reader.between_edges(reader.surface(was, there))
    return here, seen, KnownSurfaces(reader, [seen], reader.shown(now), Work(10**9))


def test_a_place_of_copies_that_were_seen_is_told_by_the_wall_behind_them(sight):
    here, _, known = sight
    assert known.rarity(motion(here)) > UNSEEN


def test_a_place_where_copies_look_as_seen_and_the_wall_does_not_counts_as_not_seen(sight):
    """From before the next box the boxes look as those that were seen did."""
    here, seen, known = sight
    there = motion(beside(here, 1))
    assert rarity(known.likeness(seen, there).correlation, 1.0) > UNSEEN
    assert known.rarity(there) == UNSEEN


def test_boxes_that_are_alike_are_copies_and_the_wall_behind_them_is_none():
    copied = is_copied(EdgeMap.of(structure_of(*ROW, WALL), 30.0))
    assert copied[: 6 * BOXES].all() and not copied[6 * BOXES :].any()


def test_sides_of_one_box_that_look_elsewhere_are_no_copies():
    assert not is_copied(EdgeMap.of(box(), 30.0)).any()


def test_faces_to_two_sides_are_not_alike_whatever_the_lengths_of_their_edges():
    """Of the first two faces each has an edge of such a length that its number is that of the other face's side."""
    ends = np.zeros((3, 2, 3))
    ends[:, 1, 2] = np.exp(LENGTH_STEP * np.array([257.0, 240.0, 273.0]))
    planes = np.array([[16.0, 0, 0, 0], [16.0, 1, 0, 0], [0, 16.0, 0, 0], [0, 0, 16.0, 0]]) * DIRECTION_STEP
    edges = SimpleNamespace(ends=ends, planes=planes, faces=np.array([[0, -1], [1, -1], [2, -1]]))
    assert not is_copied(edges).any()
