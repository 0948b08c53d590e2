"""Ground truth of the surfaces in a frame: optical flow to the next frame, occlusion, normals; with distortion, depth.

Every pixel is traced to the triangle that it shows, and the ray is intersected with its plane in float64, so flow,
normals and depth are exact up to the rounding of their files. Flow is the motion of the surface point at a pixel's
centre from one frame to the next: on moving objects (people, birds) that of their rigid part, on the sky that of the
camera's rotation alone. Normals are those of the triangles, not the interpolated ones of smooth shading.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import camera_array
from uavbench.scenes.dataset.surfaces.flow_kernels import DOUBTFUL, carry, compare, face, flow_codes, normal_codes
from uavbench.scenes.dataset.surfaces.surface_files import SEEN, UNKNOWN
from uavbench.scenes.dataset.surfaces.trace_kernels import trace
from uavbench.scenes.png.encoder import png
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, Geometry, pixel_grid
from uavbench.scenes.rendering.facets import NONE, Planes, Rows
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
    """Facets and depths of the k pixels of a camera at one time.

    seen (h', w') facets in the pinhole's image; rows (k,) facets of the camera's pixels, NONE for none; planes of all
    facets at that time; depths_m (k,) along the optical axis, inf for sky, NaN for none.
    """

    time_ns: int
    cam_from_world: Pose
    seen: Rows
    rows: Rows
    planes: Planes
    depths_m: Array


class FlowTruth(NamedTuple):
    """Flow (h, w, 2) in px, NaN where it is not known, and occlusion (h, w)."""

    flow: Array
    occlusion: NDArray[np.uint8]


class SurfaceTruth:
    """Traces the pixels of a simulated camera to the scene's facets."""

    def __init__(self, renderer: Renderer, source: CameraSimulator) -> None:
        self._renderer, self._source = renderer, source
        camera, pinhole = source.camera, source.pinhole
        pixels = pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64)
        self._rays = camera.rays(pixels)
        place = self._in_pinhole(self._rays)
        self._at = np.rint(place).astype(np.int64)
        centres = (self._at - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        self._centre_rays = np.column_stack([centres, np.ones(len(centres))])
        self._base = self._at if source.lens is None else np.floor(place).astype(np.int64)
        self._steps = np.array(RING if source.lens is None else SQUARE, dtype=np.int64)
        self._sure = 1 if source.lens is None else len(CORNERS)
        self._widest, self._moved = self._one_to_one(), np.empty((len(self._rays), 3))

    def view(self, time_ns: int) -> SurfaceView:
        """Facets and depths of all pixels at a time in ns."""
        pose, facets = self._source.cam_from_world(time_ns), self._renderer.facets
        seen = np.ascontiguousarray(self._renderer.facets_seen(pose, self._source.pinhole, time_ns * 1e-9))
        planes, world_from_cam = facets.planes(time_ns * 1e-9), pose.inverse()
        rows = np.empty(len(self._rays), dtype=np.int64)
        depths = np.full(len(rows), np.inf if facets.has_sky else np.nan)
        rays = world_from_cam.translation, _matrix(world_from_cam), self._rays, self._centre_rays
        pixels, tried = (self._at, self._base), (self._steps, self._sure)
        places = (planes.normals, planes.offsets_m, planes.corners_m)
        trace(seen, pixels, tried, places, rays, rows, depths)
        return SurfaceView(time_ns, pose, seen, rows, planes, depths)

    def geometry(self, view: SurfaceView) -> Geometry:
        """Depth (h, w) along the optical axis in metres, 0 where there is no surface, and instances (h, w)."""
        size = self._source.camera.height, self._source.camera.width
        there = view.rows != NONE
        instances = np.zeros(len(view.rows), dtype=np.uint8)
        instances[there] = self._renderer.facets.instances[view.rows[there]]
        depths = np.where(there & np.isfinite(view.depths_m), view.depths_m, 0.0)
        return Geometry(depths.astype(np.float32).reshape(size), instances.reshape(size))

    def normals(self, view: SurfaceView) -> Array:
        """Unit normals (h, w, 3) in the camera's frame, towards the camera; NaN where there is no surface."""
        normals = np.empty((len(view.rows), 3))
        face(view.rows, view.planes.normals, _matrix(view.cam_from_world), self._rays, normals)
        return self._image(normals)

    def flow(self, view: SurfaceView, later: SurfaceView) -> FlowTruth:
        """Flow (h, w, 2) in px from one view to a later one, NaN where it is not known; and occlusion (h, w)."""
        pinhole, height, width = self._source.pinhole, self._source.camera.height, self._source.camera.width
        flow, occlusion = np.empty((height, width, 2)), np.empty((height, width), dtype=np.uint8)
        shown, found = (self._rays, view.depths_m, view.rows), occlusion.reshape(-1)
        if carry(shown, self._renderer.facets.mover_of, self._motions(view, later), self._widest, self._moved, found):
            asked = np.flatnonzero(found == DOUBTFUL)
            found[asked] = np.where(self._met_again(self._moved[asked]), SEEN, UNKNOWN)
        world_from_cam, planes = later.cam_from_world.inverse(), later.planes
        lens = camera_array(self._source.camera), (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)
        place = world_from_cam.translation, _matrix(world_from_cam)
        compare(shown, self._moved, lens, (later.seen, planes.normals, planes.offsets_m, *place), flow, occlusion)
        return FlowTruth(flow, occlusion)

    def _motions(self, view: SurfaceView, later: SurfaceView) -> Array:
        """Matrices (m, 3, 4) of what rests and of each mover, from the camera's frame to the later camera's."""
        world_from_cam = view.cam_from_world.inverse()
        steps = self._renderer.facets.steps(view.time_ns * 1e-9, later.time_ns * 1e-9)
        return np.array([(later.cam_from_world @ step @ world_from_cam).matrix[:3] for step in steps])

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

    def _image(self, values: Array) -> Array:
        return values.reshape(self._source.camera.height, self._source.camera.width, -1)


def _matrix(pose: Pose) -> Array:
    """Rotation of a pose, its rows one after the other in memory."""
    return np.ascontiguousarray(pose.rotation)


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


def write_normals(folder: Path, frame: int, normals: Array) -> None:
    """Write `normals/NNNNNN.png` from unit normals (h, w, 3)."""
    codes = np.empty(normals.shape, dtype=np.uint16)
    normal_codes(normals.reshape(-1, 3), codes.reshape(-1, 3))
    _write(folder / "normals" / f"{frame:06d}.png", codes)


def write_flow(folder: Path, frame: int, flow: Array, occlusion: NDArray[np.uint8]) -> None:
    """Write `flow/NNNNNN.png` from flow (h, w, 2) in px, and `occlusion/NNNNNN.png`."""
    codes = np.empty((*flow.shape[:2], 3), dtype=np.uint16)
    flow_codes(flow.reshape(-1, 2), codes.reshape(-1, 3))
    _write(folder / "flow" / f"{frame:06d}.png", codes)
    _write(folder / "occlusion" / f"{frame:06d}.png", occlusion)


def _write(path: Path, codes: NDArray[Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png(codes, smooth=True))
