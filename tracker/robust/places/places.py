"""Places where a run had a pose: an image is recognized as one of them, and its pose found by landmarks seen there."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.places.features import (
    MOST_LANDMARKS,
    Landmarks,
    Matches,
    clearest_first,
    features_of,
    landmarks_of,
    matched,
)
from uavbench.tracker.robust.places.match_kernels import HYPOTHESES, LEAST_AGREEING, SAMPLE, pose_of_matches
from uavbench.tracker.robust.places.near_kernels import last_near
from uavbench.tracker.robust.preprocessing.small_images import grey, small_image
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, motion
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import Surface
from uavbench.tracker.robust.relocalization.surfaces.surface import SurfaceReader
from uavbench.tracker.robust.work import FEATURES, PER_LANDMARK, RECALLED, Work, recall_evaluations, surface_evaluations
from uavbench.trajectories.pose import Array, Pose

MOST_PLACES = 64
"""Places kept: 20 MB of images."""
MOST_TRIED = 3
"""Places whose landmarks are matched: the last one, and those that look most like an image."""
INLIER_PX = 4.0
"""Distance within which a match agrees with a pose: a little more than a pixel in the coarsest of the images in which
corners are sought."""


@dataclass
class Place:
    """A pose with its range (m), grey image (h, w) and small image (n,).

    landmarks: None until they are needed; surface: of the structure, None until it is read, and if it shows too little;
    between_edges: the part of it that is seen away from all edges.
    """

    pose: Pose
    range_m: float
    image: Image
    small: Array
    landmarks: Landmarks | None = None
    surface: Surface | None = None
    between_edges: Surface | None = None
    is_read: bool = False


class Recalled(NamedTuple):
    """Likely poses of an image by what a run has seen: by landmarks, and of the place that looks most like it."""

    landmarks: Sequence[Pose] = ()
    alike: Sequence[Pose] = ()

    def also_at(self, poses: Sequence[Pose]) -> "Recalled":
        """With poses from which the surface looks as it was seen, which tell where to look as landmarks do."""
        return self._replace(landmarks=[*self.landmarks, *poses])


class Places:
    """Places of a run, a step apart: of camera centres as a part of the range, or of rotations in rad."""

    def __init__(self, edges: EdgeMap, camera: Camera, step: float, rng: np.random.Generator) -> None:
        self.edges, self.camera, self.step = edges, camera, step
        self.samples = rng.random((HYPOTHESES, SAMPLE))
        self.forget()

    def empty(self) -> "Places":
        """Others of the same structure and camera, none yet."""
        others = copy(self)
        others.forget()
        return others

    def forget(self) -> None:
        """Forget all places."""
        self.places: list[Place] = []
        self.poses = NONE
        self.last: Place | None = None
        self.apart, self.waited, self.turn = self.step, False, 0

    def add(self, image: Image, pose: Pose, range_m: float) -> None:
        """Add a place with its image (h, w) or (h, w, c), unless there is one near it; fewer are kept of too many."""
        near = last_near(*self.poses, *motion(pose), range_m, self.apart)
        if near >= 0:
            self.last = self.places[near]
            return
        image = grey(image)
        self.keep(Place(pose, range_m, image, small_image(image)))
        while len(self.places) > MOST_PLACES:
            before, self.places, self.poses = self.places, [], NONE
            self.apart *= 2.0
            for place in before:
                if self.poses.apart(motion(place.pose), place.range_m, self.apart).all():
                    self.keep(place)

    def keep(self, place: Place) -> None:
        """Keep one more place."""
        self.last = place
        self.places.append(place)
        self.poses = self.poses.added(motion(place.pose))

    def surfaces(self, reader: SurfaceReader, work: Work) -> list[Surface]:
        """What the run saw of the structure's surface, the last place first; at most half of the work left is spent."""
        until, cost = work.done + work.left // 2, surface_evaluations(self.edges.looked_at)
        known = self.places[::-1]
        known.sort(key=lambda place: place is not self.last)
        for place in known:
            if not place.is_read and work.done + cost <= until:
                work.done += cost
                place.surface, place.is_read = reader.surface(place.image, place.pose), True
                place.between_edges = place.surface and reader.between_edges(place.surface)
        return [place.surface for place in known if place.surface is not None]

    def between_edges(self, reader: SurfaceReader, work: Work) -> list[Surface]:
        """What the run saw of the structure's surface away from its edges."""
        self.surfaces(reader, work)
        return [place.between_edges for place in self.places if place.between_edges is not None]

    def recalled(self, image: Image, work: Work, reserve: int) -> Recalled:
        """Likely poses of an image (h, w) or (h, w, c).

        It spends at most half of what is left of a frame's work, or all but the reserve in every second frame.
        """
        self.waited = not self.waited
        allowed = work.left // 2
        if allowed < 2 * FEATURES + recall_evaluations(MOST_LANDMARKS):
            allowed = work.left - reserve if self.waited else 0
        if self.last is None or allowed < FEATURES:
            return Recalled()
        image, last = grey(image), self.last
        correlation = np.array([place.small for place in self.places]) @ small_image(image)
        likely = [self.places[k] for k in np.argsort(-correlation, kind="stable")]
        tried = [last, *(place for place in likely if place is not last)][:MOST_TRIED]
        turn = self.turn % len(tried)
        tried = tried[turn:] + tried[:turn]
        return Recalled(self.by_landmarks(image, tried, work, work.done + allowed), [likely[0].pose])

    def by_landmarks(self, image: Image, places: list[Place], work: Work, until: int) -> list[Pose]:
        """The pose of a grey image (h, w) by as many landmarks of some places as the work allows.

        The next image begins with the place after the first that was matched, so that in the end each is.
        """
        matches: list[Matches] = []
        starts, features = [], None
        for place in places:
            if place.landmarks is None and work.done + FEATURES <= until:
                work.done += FEATURES
                place.landmarks = landmarks_of(place.image, place.pose, self.camera, self.edges)
            known = work.done + (FEATURES if features is None else 0)
            most = (until - known - RECALLED) // PER_LANDMARK
            if place.landmarks is None or most < LEAST_AGREEING:
                break
            if features is None:
                work.done += FEATURES
                features = features_of(image, self.camera)
            some = place.landmarks.some(most)
            work.done += recall_evaluations(len(some.points))
            matches.append(matched(some, features, self.camera))
            starts.append(motion(place.pose))
        self.turn += 1 if matches else 0
        if sum(len(each.ratio) for each in matches) < LEAST_AGREEING:
            return []
        points, seen, _ = clearest_first(matches)
        threshold = INLIER_PX / math.sqrt(self.camera.fx * self.camera.fy)
        found = [pose_of_matches(points, seen, R, t, self.samples, threshold) for R, t in starts]
        best = min(found, key=lambda each: each.cost)
        return [Pose(best.R, best.t)] if np.isfinite(best.cost) else []
