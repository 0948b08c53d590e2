"""Places where a run had a pose: an image is recognized as one of them, and its pose found by landmarks seen there."""

from dataclasses import dataclass

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.places.features import (
    MOST_LANDMARKS,
    Landmarks,
    Matches,
    features_of,
    landmarks_of,
    least_doubtful_first,
    matched,
)
from uavbench.tracker.robust.places.match_kernels import DRAWN, HYPOTHESES, pose_of_matches
from uavbench.tracker.robust.places.small_images import grey, small_image
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, motion
from uavbench.tracker.robust.work import FEATURES, Work, recall_evaluations
from uavbench.trajectories.pose import Array, Pose

MOST_PLACES = 64
"""Places kept: 20 MB of images of 640x480."""
MOST_TRIED = 3
"""Places whose landmarks are matched: the last one, and those that look most like an image."""
OUTLIER_PX = 4.0
"""Distance beyond which a match is an outlier: in the coarsest of ORB's images, 3.6 times smaller, a pixel."""
LEAST_MATCHES = 4
"""Matches of which a pose is computed: one more than determine it."""


@dataclass
class Place:
    """A pose with its range (m), grey image (h, w) and small image (n,); landmarks: None until they are needed."""

    pose: Pose
    range_m: float
    image: Image
    small: Array
    landmarks: Landmarks | None = None


class Places:
    """Places of a run, a step apart: of camera centres as a part of the range, or of rotations in rad."""

    def __init__(self, edges: EdgeMap, camera: Camera, step: float, rng: np.random.Generator) -> None:
        self.edges, self.camera, self.step = edges, camera, step
        self.draws = rng.random((HYPOTHESES, DRAWN))
        self.places: list[Place] = []
        self.poses = NONE
        self.apart, self.waited = self.step, False

    def add(self, image: Image, pose: Pose, range_m: float) -> None:
        """Add a place with its image (h, w) or (h, w, c), unless there is one near it; fewer are kept of too many."""
        if not self.is_new(pose, range_m):
            return
        image = grey(image)
        self.keep(Place(pose, range_m, image.copy(), small_image(image)))
        while len(self.places) > MOST_PLACES:
            before, self.places, self.poses = self.places, [], NONE
            self.apart *= 2.0
            for place in before:
                if self.is_new(place.pose, place.range_m):
                    self.keep(place)

    def is_new(self, pose: Pose, range_m: float) -> bool:
        """Whether a pose is apart from all places."""
        return bool(self.poses.apart(motion(pose), range_m, self.apart).all())

    def keep(self, place: Place) -> None:
        """Keep one more place."""
        self.places.append(place)
        self.poses = self.poses.added(motion(place.pose))

    def recalled(self, image: Image, work: Work) -> list[Pose]:
        """Likely poses of an image (h, w) or (h, w, c): by landmarks, and of the place that looks most like it.

        It spends at most half of what is left of a frame's work, or all of it in every second frame.
        """
        self.waited = not self.waited
        allowed = work.left // 2
        if allowed < 2 * FEATURES + recall_evaluations(MOST_LANDMARKS):
            allowed = work.left if self.waited else 0
        if not self.places or not allowed:
            return []
        image = grey(image)
        likeness = np.array([place.small for place in self.places]) @ small_image(image)
        likely = [self.places[k] for k in np.argsort(-likeness, kind="stable")]
        last = self.places[-1]
        tried = [last, *(place for place in likely if place is not last)][:MOST_TRIED]
        return [*self.by_landmarks(image, tried, work, work.done + allowed), likely[0].pose]

    def by_landmarks(self, image: Image, places: list[Place], work: Work, until: int) -> list[Pose]:
        """The pose of a grey image (h, w) by the landmarks of some places, for as much work as is allowed."""
        matches: list[Matches] = []
        starts, features = [], None
        for place in places:
            if place.landmarks is None and work.done + FEATURES <= until:
                work.done += FEATURES
                place.landmarks = landmarks_of(place.image, place.pose, self.camera, self.edges)
            if place.landmarks is None:
                break
            needed = recall_evaluations(len(place.landmarks.points)) + (FEATURES if features is None else 0)
            if work.done + needed > until:
                break
            work.done += needed
            features = features_of(image) if features is None else features
            matches.append(matched(place.landmarks, features, self.camera))
            starts.append(motion(place.pose))
        if sum(len(each.doubt) for each in matches) < LEAST_MATCHES:
            return []
        points, seen, _ = least_doubtful_first(matches)
        outlier = OUTLIER_PX / self.camera.fx
        found = [pose_of_matches(points, seen, R, t, self.draws, outlier) for R, t in starts]
        best = min(found, key=lambda each: each.cost)
        return [Pose(best.R, best.t)] if np.isfinite(best.cost) else []
