"""What an image shows of a structure's surface at a pose."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.patches.corner_kernels import first_hits
from uavbench.tracker.robust.preprocessing.small_images import grey
from uavbench.tracker.robust.relocalization.pose_arrays import centre_of, motion
from uavbench.tracker.robust.relocalization.scoring.pose_search import PoseSearch
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import LEAST_POINTS, Surface
from uavbench.tracker.robust.relocalization.surfaces.copies import is_copied
from uavbench.trajectories.pose import Array, Pose

MOST_POINTS = 240
"""About as many points of a surface are kept: limits the time of an alignment."""
MOST_RAYS = 4 * MOST_POINTS
"""Rays by which they are sought: on a truss every fourth one hits it."""
BLURS_PX = 2.5, 1.0
"""Standard deviations of the blur, px of the small image: of poses 6 to 10 px away 6 in 10 are reached so on boxes,
9 in 10 on buildings."""
EDGE_PX = 2
"""Distance from edges, px of the small image, at which a surface shows what it is like itself: two standard deviations
of the lesser blur."""
MANY = 10_000
"""Ends of edges of which it takes longer to project all, 0.1 ms, than it is worth."""
MOST_EDGE_POINTS = 4000
"""Points of edges that are kept away from: limits their memory, where an image has 19,200 px."""
LEAST_WEIGHT = 1e-6
"""Weight of a masked pixel that no other one is near."""

Indices = NDArray[np.int64]


class Shown(NamedTuple):
    """An image (h, w) in the size of the small one, blurred much and little; nan where it is masked."""

    much: Array
    little: Array


class Hits(NamedTuple):
    """Pixels (n, 2) of the small image, the rays (n, 3) through them in the world, and the faces (n,) they hit."""

    pixels: Indices
    rays: Array
    faces: Indices


class SurfaceReader:
    """Reads surfaces of a structure from images."""

    def __init__(self, edges: EdgeMap, searcher: PoseSearch) -> None:
        self.edges, self.searcher = edges, searcher
        self.copied = is_copied(edges)
        """Whether each face (f,) of the structure is made as another one."""
        self.outermost = outermost(edges.ends.reshape(-1, 3))
        """Ends (k, 3) of edges, between which all others are."""

    def shown(self, image: Image) -> Shown:
        """An image (h, w) or (h, w, c) as surfaces are compared with it."""
        small = grey(self.searcher.small(image)).astype(np.float64)
        return Shown(*(blurred(small, self.searcher.masked, blur) for blur in BLURS_PX))

    def surface(self, image: Image, pose: Pose) -> Surface | None:
        """The surface that an image (h, w) or (h, w, c) shows at a pose, None where it shows too little of it."""
        shown, seen_from = self.shown(image), motion(pose)
        hits = self.hits(seen_from, MOST_POINTS)
        if LEAST_POINTS <= len(hits.faces) < MOST_POINTS // 2:
            hits = self.hits(seen_from, min(MOST_RAYS, MOST_POINTS**2 // len(hits.faces)))
        values = np.stack([level[hits.pixels[:, 1], hits.pixels[:, 0]] for level in shown])
        kept = np.isfinite(values).all(axis=0)
        if np.count_nonzero(kept) < LEAST_POINTS:
            return None
        faces, rays, eye = hits.faces[kept], hits.rays[kept], centre_of(seen_from)
        planes = self.edges.planes[faces]
        slant = np.einsum("ij,ij->i", rays, planes[:, :3])
        points = eye + rays * ((planes[:, 3] - planes[:, :3] @ eye) / slant)[:, None]
        normals = planes[:, :3] * -np.sign(slant)[:, None]
        grey_values = np.ascontiguousarray(values[:, kept])
        return Surface(points, normals, faces, grey_values, points.mean(axis=0), *seen_from)

    def between_edges(self, surface: Surface) -> Surface:
        """The points of a surface that are seen away from all edges, which look alike wherever a structure repeats."""
        (width, height), seen_from = self.searcher.size, RigidMotion(surface.R, surface.t)
        view = self.searcher.view.to(*seen_from)
        edges = sample_edges(self.edges, view, 2.0 * EDGE_PX, MOST_EDGE_POINTS).points
        on_edges = np.zeros((height, width), np.uint8)
        across, down = self.pixels_of(edges, seen_from)
        inside = (across >= 0) & (across < width) & (down >= 0) & (down < height)
        on_edges[down[inside], across[inside]] = 1
        near = np.asarray(cv2.dilate(on_edges, np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)))
        across, down = self.pixels_of(surface.points, seen_from)
        away = near[down, across] == 0
        return some_of(surface, away)

    def pixels_of(self, points: Array, pose: RigidMotion) -> Indices:
        """Pixels (2, n) of the small image, right and down, at which points (n, 3) in front of the camera are seen."""
        ahead = points @ pose.R.T + pose.t
        f = self.searcher.f
        return np.asarray((ahead[:, :2] / ahead[:, 2:] * f[:2] + f[2:]).round().T, np.int64)

    def hits(self, pose: RigidMotion, rays: int) -> Hits:
        """What about so many rays hit, in a grid over the part of the small image in which the structure is."""
        pixels, f = self.pixels(pose, rays), self.searcher.f
        through = np.column_stack([(pixels - f[2:]) / f[:2], np.ones(len(pixels))]) @ pose.R
        faces = first_hits(centre_of(pose), np.ascontiguousarray(through), self.edges.triangles)
        return Hits(pixels[faces >= 0], through[faces >= 0], faces[faces >= 0])

    def pixels(self, pose: RigidMotion, count: int) -> Indices:
        """About so many pixels (n, 2) in a grid over the part of the small image in which the structure is."""
        low, high = np.zeros(2), np.array(self.searcher.size) - 1.0
        ends = self.outermost @ pose.R.T + pose.t
        if (ends[:, 2] > self.searcher.camera.near).all():
            seen = ends[:, :2] / ends[:, 2:] * self.searcher.f[:2] + self.searcher.f[2:]
            low, high = np.maximum(low, seen.min(axis=0)), np.minimum(high, seen.max(axis=0))
        step = max(2.0, math.sqrt(float(np.prod(np.maximum(high - low, 1.0))) / count))
        across, down = (np.arange(low[k] + step / 2, high[k], step) for k in range(2))
        return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2).astype(np.int64)


def outermost(points: Array) -> Array:
    """Those of points (n, 3), if they are many, that are corners of their convex hull; all of a flat structure."""
    if len(points) < MANY:
        return points
    from scipy.spatial import ConvexHull, QhullError  # lazy: few structures are so large

    try:
        return np.asarray(points[np.sort(ConvexHull(points).vertices)])
    except QhullError:
        return points


def some_of(surface: Surface, rows: NDArray[np.bool_] | slice) -> Surface:
    """Some of the points of a surface."""
    points, normals, grey = surface.points[rows], surface.normals[rows], surface.grey[:, rows]
    points, normals, grey = (np.ascontiguousarray(each) for each in (points, normals, grey))
    return surface._replace(points=points, normals=normals, faces=np.ascontiguousarray(surface.faces[rows]), grey=grey)


def blurred(image: Array, masked: NDArray[np.bool_] | None, blur_px: float) -> Array:
    """An image (h, w) blurred without what is masked, where it is nan.

    Source: normalized convolution (Knutsson & Westin 1993).
    """
    if masked is None:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), np.float64)
    weight = np.where(masked, 0.0, 1.0)
    values, total = (cv2.GaussianBlur(each, (0, 0), blur_px) for each in (image * weight, weight))
    return np.asarray(np.where(masked, np.nan, values / np.maximum(total, LEAST_WEIGHT)), np.float64)
