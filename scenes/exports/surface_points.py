"""Points on the model's surface and their exact projections into each frame, instead of features."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.exports.shown_images import Shown
from uavbench.scenes.hidden_lines import unhidden
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

POINTS = 5000
"""Points on the whole surface; a frame of a box shows some 1,700, about as many as COLMAP finds features."""
NEAR_M = 0.01
"""Near plane, metres."""

Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class OnSurface:
    """Points (n, 3) on a structure in the world, m, and the outward normals (n, 3) of their faces."""

    points_m: Array
    normals: Array

    @classmethod
    def drawn(cls, structure: Structure, count: int = POINTS) -> "OnSurface":
        """Points sampled uniformly over the area of a structure; deterministic."""
        rng = stream(0, "exports", "surface points")
        corners = structure.vertices[structure.triangles]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = np.linalg.norm(np.cross(a, b), axis=1)
        rows = rng.choice(len(areas), size=count, p=areas / areas.sum())
        along = rng.random((count, 2))
        along = np.where(along.sum(axis=1, keepdims=True) > 1, 1 - along, along)  # the other half of a parallelogram
        points = corners[rows, 0] + along[:, :1] * a[rows] + along[:, 1:] * b[rows]
        return cls(points, structure.face_normals[structure.triangle_face[rows]])

    def seen(self, shown: Shown, frame: int) -> "Seen":
        """The points visible in a frame: in front of the camera, inside the image, and not occluded.

        Occluders are the structure itself, and anything else (trees, people) if the sequence has masks.
        """
        pose, camera = shown.sequence.true_cam_from_world(frame), shown.camera
        eye = pose.inverse().translation
        in_camera = pose.transform(self.points_m)
        towards = np.einsum("ij,ij->i", self.normals, eye - self.points_m) > 0
        rows = np.flatnonzero(towards & (in_camera[:, 2] > NEAR_M))
        if not len(rows):
            return Seen(rows, np.zeros((0, 2)))
        rows = rows[camera.in_image(in_camera[rows])]
        pixels = camera.project(in_camera[rows])
        clear = unhidden(shown.sequence.structure, eye, self.points_m[rows])
        if (mask := shown.mask(frame)) is not None:
            column, row = np.rint(pixels).astype(int).T
            clear &= mask[row, column]
        return Seen(rows[clear], pixels[clear])


@dataclass(frozen=True, eq=False)
class Seen:
    """Rows (k,) of the points visible in a frame, and their pixels (k, 2), pixel centres at integer coordinates."""

    rows: Rows
    pixels: Array


@dataclass(eq=False)
class PointCloud:
    """The points observed so far, each in the colour of its first observation."""

    surface: OnSurface
    by_frame: list[Seen] = field(default_factory=list)
    colours: NDArray[np.uint8] = field(init=False)
    known: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.colours = np.zeros((len(self.surface.points_m), 3), dtype=np.uint8)
        self.known = np.zeros(len(self.surface.points_m), dtype=bool)

    def look(self, shown: Shown, frame: int) -> None:
        """Add the observations of a frame; call it for the frames in order."""
        seen = self.surface.seen(shown, frame)
        self.by_frame.append(seen)
        new = ~self.known[seen.rows]
        if new.any():
            column, row = np.rint(seen.pixels[new]).astype(int).T
            self.colours[seen.rows[new]] = shown.image(frame)[row, column, ::-1]
            self.known[seen.rows] = True

    @property
    def rows(self) -> Rows:
        """Rows (m,) of the points observed by any frame; the others are left out of an export."""
        return np.flatnonzero(self.known)

    def limits(self, shown: Shown) -> ListOf[str]:
        """Limitations of the points, a sentence each."""
        lines = [
            f"Points: {len(self.rows)} of {len(self.surface.points_m)} drawn on the designed model's surface, those "
            "visible in a frame, at their exact projections; they are not features detected in the images."
        ]
        if not (shown.sequence.folder / "mask").is_dir():
            lines.append(
                'Visibility: the sequence has no annotations = ["mask"], so that points behind trees, '
                "people and other objects count as visible; and there are no masks."
            )
        return lines
