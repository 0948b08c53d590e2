"""Features of an image, those on the structure as landmarks, and matches of both."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.patches.corner_kernels import first_hits
from uavbench.tracker.robust.places.descriptor_kernels import nearest_two
from uavbench.trajectories.pose import Array, Pose

MOST = 1000
"""Features of an image: limits their time. With 500 of them 17 of 32 poses are found, with 1000 21."""
MOST_LANDMARKS = 500
"""Landmarks of a place, for the same reason."""
LEAST_CORNER_GREY = 5
"""Contrast of the weakest corner, grey levels: a little more than the largest noise that is not smoothed."""
LEVELS, SMALLER = 4, 2.0**0.5
"""Images in which corners are sought, each so many times smaller than the one before: 2.8 times in all. Of 278 pairs of
frames of 20 flights 188 poses are found so, and 178 with 8 images that are 1.2 times smaller, which take 1.4 to 1.6
times as long.
"""
MOST_RATIO = 0.85
"""Distance of a match over that of the second nearest feature. Lowe (2004) takes 0.8 for features of another kind."""
NO_DESCRIPTORS = np.zeros((0, 32), dtype=np.uint8)


class Features(NamedTuple):
    """Pixels (n, 2) of corners, and what they look like: descriptors (n, 32) of Rublee et al. 2011 (ORB)."""

    pixels: Array
    descriptors: NDArray[np.uint8]


class Landmarks(NamedTuple):
    """Points (n, 3) of the structure in the world, and what they look like: descriptors (n, 32)."""

    points: Array
    descriptors: NDArray[np.uint8]

    def some(self, most: int) -> "Landmarks":
        """No more than so many of the landmarks, from all of the image."""
        rows = slice(None, None, max(1, -(-len(self.points) // most)))
        return Landmarks(self.points[rows], self.descriptors[rows])


class Matches(NamedTuple):
    """Points (n, 3) of the structure, where they are seen (n, 2), in units of the focal length, and their ratio (n,).

    ratio: distance of the descriptors over that of the second nearest (Lowe 2004), each one bit more.
    """

    points: Array
    seen: Array
    ratio: Array


NO_MATCHES = Matches(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))


def features_of(image: Image, camera: Camera) -> Features:
    """The features of a grey image (h, w) of a camera, which may have been reduced; their pixels are the camera's."""
    detector = cv2.ORB.create(MOST, scaleFactor=SMALLER, nlevels=LEVELS, fastThreshold=LEAST_CORNER_GREY)
    corners, descriptors = detector.detectAndCompute(image, None)
    scale = np.array([camera.width, camera.height]) / image.shape[::-1]
    pixels = (np.array([corner.pt for corner in corners]).reshape(-1, 2) + 0.5) * scale - 0.5
    return Features(pixels, np.asarray(descriptors if len(pixels) else NO_DESCRIPTORS, dtype=np.uint8))


def landmarks_of(image: Image, pose: Pose, camera: Camera, edges: EdgeMap) -> Landmarks:
    """The features of a grey image (h, w) that lie on the structure at a pose."""
    seen, eye = features_of(image, camera), pose.inverse().translation
    rays = np.ascontiguousarray(camera.rays(seen.pixels) @ pose.rotation)
    faces = first_hits(eye, rays, edges.triangles)
    hit = np.flatnonzero(faces >= 0)
    hit = hit[:: max(1, -(-len(hit) // MOST_LANDMARKS))]
    planes, rays = edges.planes[faces[hit]], rays[hit]
    depth = (planes[:, 3] - planes[:, :3] @ eye) / np.einsum("ij,ij->i", rays, planes[:, :3])
    return Landmarks(eye + rays * depth[:, None], seen.descriptors[hit])


def matched(landmarks: Landmarks, features: Features, camera: Camera) -> Matches:
    """The landmarks that are clearly most like one of the features."""
    if not len(landmarks.points) or len(features.pixels) < 2:
        return NO_MATCHES
    others = np.ascontiguousarray(features.descriptors.view(np.uint64).T)
    first, second, which = nearest_two(landmarks.descriptors.view(np.uint64), others)
    ratio = (first + 1.0) / (second + 1.0)
    clear = ratio < MOST_RATIO
    rays = camera.rays(features.pixels[which[clear]])
    return Matches(landmarks.points[clear], rays[:, :2] / rays[:, 2:], ratio[clear])


def clearest_first(matches: list[Matches]) -> Matches:
    """All matches of several landmarks, the clearest first."""
    points, seen, ratio = (np.concatenate(column) for column in zip(*matches, strict=True))
    order = np.argsort(ratio, kind="stable")
    return Matches(points[order], seen[order], ratio[order])
