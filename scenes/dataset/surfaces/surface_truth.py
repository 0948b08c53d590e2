"""Ground truth of the surfaces in a frame: optical flow to the next frame, occlusion, normals; with distortion, depth.

Every pixel is traced to the triangle that it shows, and the ray is intersected with its plane in float64, so flow,
normals and depth are exact up to the rounding of their files. Flow is the motion of the surface point at a pixel's
centre from one frame to the next: on moving objects (people, birds) that of their rigid part, on the sky that of the
camera's rotation alone. Normals are those of the triangles, not the interpolated ones of smooth shading.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import camera_array
from uavbench.scenes.dataset.surfaces.flow_kernels import (
    Lens,
    Motions,
    RowScratch,
    any_between,
    flow_rows,
    list_doubtful,
)
from uavbench.scenes.dataset.surfaces.normal_kernels import normal_rows
from uavbench.scenes.dataset.surfaces.shown_kernels import Shown
from uavbench.scenes.dataset.surfaces.surface_files import SEEN, UNKNOWN
from uavbench.scenes.dataset.surfaces.trace_kernels import trace, trace_centres
from uavbench.scenes.image_files import put_file
from uavbench.scenes.png.encoder import png, png_of_filtered
from uavbench.scenes.rendering.antialiasing.facet_table import FacetTable
from uavbench.scenes.rendering.antialiasing.outlines import Pixels
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, Geometry, pixel_grid
from uavbench.scenes.rendering.facets import NONE
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.pose import Array, Pose

CORNERS = [(0, 0), (1, 0), (0, 1), (1, 1)]
"""Offsets to the four pixels around a sub-pixel position."""
SQUARE = [*CORNERS, *((x, y) for x in range(-1, 3) for y in range(-1, 3) if (x, y) not in CORNERS)]
RING = [(0, 0), *((x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0))]
"""Offsets of neighbouring pixels whose facets are tried, the most likely first."""
LENS_ROUND_TRIP_PX = 0.01
"""Round-trip error in px beyond which the distortion folds over, so that a point has no unique pixel."""
TANGENTS, DIRECTIONS, WIDEST = 256, 64, 1.5
"""Points, up to so many times the widest ray's tangent, by which the part of a lens that is one-to-one is found."""


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """What the pixels of a camera show at one time; seen (h', w'): what those of the pinhole's image do."""

    time_ns: int
    cam_from_world: Pose
    seen: Pixels
    shown: Shown


class FlowTruth(NamedTuple):
    """Filtered rows (h, 1 + 6 w) of a flow file, see `flow_rows`; and occlusion (h, w)."""

    filtered: NDArray[np.uint8]
    occlusion: NDArray[np.uint8]


class SurfaceTruth:
    """Traces the pixels of a simulated camera to the scene's facets."""

    def __init__(self, renderer: Renderer, source: CameraSimulator) -> None:
        self._renderer, self._source = renderer, source
        camera, pinhole = source.camera, source.pinhole
        self._size = camera.height, camera.width
        self._rays = camera.rays(pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64))
        self._places = self._in_pinhole(self._rays).reshape(*self._size, 2)
        steps, sure = (RING, 1) if source.lens is None else (SQUARE, len(CORNERS))
        self._tried = np.array(steps, dtype=np.int64), sure, renderer.facets.masked
        intrinsics = np.array([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy], dtype=np.float64)
        self._lens, self._scratch = Lens(camera_array(camera), intrinsics), RowScratch.of(camera.width)
        self._widest = self._one_to_one()

    def view(self, time_ns: int) -> SurfaceView:
        """Facets and inverse depths of all pixels at a time in ns."""
        pose, pinhole = self._source.cam_from_world(time_ns), self._source.pinhole
        seen = self._renderer.pixels_seen(pose, pinhole, time_ns * 1e-9)
        facets = self._renderer.facet_table(pose, pinhole, time_ns * 1e-9)
        background = 0.0 if self._renderer.facets.has_sky else np.nan
        if self._source.lens is None:
            shown = Shown.rendered(self._size, len(facets.corners))
            trace_centres(seen.facets, facets, self._tried, background, shown.rows, shown.planes)
        else:
            shown = Shown.through_lens(self._places)
            trace(seen.facets, self._places, facets, self._tried, background, shown.rows, shown.near)
        return SurfaceView(time_ns, pose, seen, shown)

    def geometry(self, view: SurfaceView) -> Geometry:
        """Depth (h, w) along the optical axis in metres, 0 where there is no surface, and instances (h, w)."""
        rows, near = view.shown.rows, view.shown.near
        there = rows != NONE
        instances = np.zeros(self._size, dtype=np.uint8)
        instances[there] = self._renderer.facets.instances[rows[there]]
        depths = np.divide(1.0, near, out=np.zeros(self._size), where=there & (near > 0))
        return Geometry(depths.astype(np.float32), instances)

    def normals(self, view: SurfaceView) -> NDArray[np.uint8]:
        """Filtered rows (h, 1 + 6 w) of a file of normals in the camera's frame, towards the camera: see `normal_rows`.

        0 where there is no surface.
        """
        out = np.empty((self._size[0], 1 + 6 * self._size[1]), dtype=np.uint8)
        corners = self._facets(view).corners
        codes = np.zeros(len(corners) + 1, dtype=np.uint64)
        normal_rows(view.shown.rows, corners, np.ascontiguousarray(view.cam_from_world.matrix[:3]), codes, out)
        return out

    def flow(self, view: SurfaceView, later: SurfaceView) -> FlowTruth:
        """Flow from one view to a later one, and occlusion there."""
        motions = self._motions(view, later)
        height, width = self._size
        out = FlowTruth(np.empty((height, 1 + 6 * width), dtype=np.uint8), np.full(self._size, SEEN, dtype=np.uint8))
        if self._widest < np.inf:
            points, pixels = np.empty((height * width, 3)), np.empty((height * width, 2), dtype=np.int64)
            if count := list_doubtful(view.shown, motions, self._widest, self._scratch, points, pixels):
                column, row = pixels[:count][~self._met_again(points[:count])].T
                out.occlusion[row, column] = UNKNOWN
        image = later.seen.facets, later.seen.windows
        flow_rows(view.shown, motions, self._lens, image, self._facets(later), self._scratch, tuple(out))
        return out

    def _facets(self, view: SurfaceView) -> FacetTable:
        """The facets as they are in a view."""
        return self._renderer.facet_table(view.cam_from_world, self._source.pinhole, view.time_ns * 1e-9)

    def _motions(self, view: SurfaceView, later: SurfaceView) -> Motions:
        """Motions of what rests, and of what moves if any of it is in view."""
        pinhole, world_from_cam, drawn = self._source.pinhole, view.cam_from_world.inverse(), self._renderer.facets
        steps, moving = [Pose.identity()], drawn.moving
        if drawn.movers and any_between(view.shown.rows.reshape(-1), moving[0], moving[1]):
            steps += drawn.steps(view.time_ns * 1e-9, later.time_ns * 1e-9)
        ray_from_place = np.eye(4)
        ray_from_place[:2, :3] = [
            [1 / pinhole.fx, 0, -pinhole.cx / pinhole.fx],
            [0, 1 / pinhole.fy, -pinhole.cy / pinhole.fy],
        ]
        matrices = [(later.cam_from_world @ step @ world_from_cam).matrix[:3] @ ray_from_place for step in steps]
        return Motions(drawn.mover_of, np.array(matrices), moving)

    def _in_pinhole(self, points: Array) -> Array:
        """Projections (k, 2) in px of points (k, 3) in the camera frame into the pinhole image."""
        pinhole = self._source.pinhole
        return np.asarray(points[:, :2] / points[:, 2:] * [pinhole.fx, pinhole.fy] + [pinhole.cx, pinhole.cy])

    def _met_again(self, points: Array) -> NDArray[np.bool_]:
        """Whether the rays of the pixels of points (k, 3) pass through them; false where the distortion folds over."""
        camera = self._source.camera
        pixels = camera.project(points)
        found: NDArray[np.bool_] = np.asarray(np.isfinite(pixels).all(axis=1))
        straight = camera.without_distortion.project(points[found])
        with np.errstate(invalid="ignore"):
            found[found] = np.abs(camera.undistort(pixels[found]) - straight).max(axis=1) < LENS_ROUND_TRIP_PX
        return found

    def _one_to_one(self) -> float:
        """Tangent of an angle to the optical axis up to which all points are met again; inf without distortion."""
        if self._source.camera.distortion_model == "none":
            return np.inf
        tangents = np.linspace(0, WIDEST * np.linalg.norm(self._rays[:, :2], axis=1).max(), TANGENTS)
        angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
        x, y = (np.outer(tangents, turn(angles)).reshape(-1) for turn in (np.cos, np.sin))
        met = self._met_again(np.column_stack([x, y, np.ones(len(x))])).reshape(TANGENTS, DIRECTIONS).all(axis=1)
        return float(tangents[-1] if met.all() else tangents[max(int(np.argmin(met)) - 2, 0)])


class SurfaceFiles:
    """Writer of some annotations of a camera's frames; flow and occlusion are written with the following frame."""

    def __init__(self, folder: Path, annotations: set[str], truth: SurfaceTruth) -> None:
        self._folder, self.annotations, self._truth = folder, annotations, truth
        self._last: tuple[int, SurfaceView] | None = None

    @classmethod
    def asked(
        cls, folder: Path, annotations: tuple[str, ...], renderer: Renderer, source: CameraSimulator
    ) -> "SurfaceFiles | None":
        """Writer of those requested annotations that need the rays of pixels; None when none of them is requested.

        Depth and masks need them with distortion: the pinhole's pixels lie up to half a pixel beside the camera's.
        """
        traced = {"flow", "normals"} | ({"depth", "mask"} if source.camera.distortion_model != "none" else set())
        wanted = traced & set(annotations)
        return cls(folder, wanted, SurfaceTruth(renderer, source)) if wanted else None

    def write(self, frame: int, time_ns: int) -> Geometry | None:
        """Write normals of a frame exposed at time_ns, and the flow from the previous frame to it.

        Returns depth and instances where they are among the annotations.
        """
        view = self._truth.view(time_ns)
        if "normals" in self.annotations:
            write_normals(self._folder, frame, self._truth.normals(view))
        if "flow" in self.annotations:
            if self._last is not None:
                write_flow(self._folder, self._last[0], *self._truth.flow(self._last[1], view))
            self._last = frame, view
        return self._truth.geometry(view) if {"depth", "mask"} & self.annotations else None


def write_normals(folder: Path, frame: int, filtered: NDArray[np.uint8]) -> None:
    """Write `normals/NNNNNN.png` from its filtered rows (h, 1 + 6 w)."""
    put_file(folder / "normals" / f"{frame:06d}.png", png_of_filtered(filtered, filtered.shape[1] // 6, smooth=True))


def write_flow(folder: Path, frame: int, filtered: NDArray[np.uint8], occlusion: NDArray[np.uint8]) -> None:
    """Write `flow/NNNNNN.png` from its filtered rows (h, 1 + 6 w), and `occlusion/NNNNNN.png` (h, w)."""
    put_file(folder / "flow" / f"{frame:06d}.png", png_of_filtered(filtered, occlusion.shape[1], smooth=True))
    put_file(folder / "occlusion" / f"{frame:06d}.png", png(occlusion, smooth=True))
