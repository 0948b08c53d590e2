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

from uavbench.scenes.dataset.annotations import write_depth, write_mask
from uavbench.scenes.dataset.surfaces.surface_files import (
    FLOW_UNITS_PER_PX,
    FLOW_ZERO,
    HIDDEN,
    LARGEST_FLOW_PX,
    NORMAL_UNITS,
    OUTSIDE,
    SEEN,
    UNKNOWN,
)
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
BEFORE = 1e-3
"""Relative depth difference above which a nearer surface occludes a point."""
LENS_ROUND_TRIP_PX = 0.01
"""Round-trip error in px beyond which the distortion folds over, so that a point has no unique pixel."""


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
        self._pixels, self._rays = pixels, camera.rays(pixels)
        place = self._in_pinhole(self._rays)
        self._at = np.rint(place).astype(np.int64)
        centres = (self._at - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        self._centre_rays = np.column_stack([centres, np.ones(len(centres))])
        self._base = self._at if source.lens is None else np.floor(place).astype(np.int64)
        self._steps = np.array(RING if source.lens is None else SQUARE, dtype=np.int64)
        self._sure = 1 if source.lens is None else len(CORNERS)

    def view(self, time_ns: int) -> SurfaceView:
        """Facets and depths of all pixels at a time in ns."""
        pose, facets = self._source.cam_from_world(time_ns), self._renderer.facets
        seen = np.ascontiguousarray(self._renderer.facets_seen(pose, self._source.pinhole, time_ns * 1e-9))
        planes, world_from_cam = facets.planes(time_ns * 1e-9), pose.inverse()
        rays, eye = self._rays @ world_from_cam.rotation.T, world_from_cam.translation
        centre_rays = self._centre_rays @ world_from_cam.rotation.T
        rows = np.empty(len(rays), dtype=np.int64)
        depths = np.full(len(rays), np.inf if facets.has_sky else np.nan)
        pixels, tried = (self._at, self._base), (self._steps, self._sure)
        places = (planes.normals, planes.offsets_m, planes.corners_m)
        trace(seen, pixels, tried, places, (eye, rays, centre_rays), rows, depths)
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
        normals = np.full((len(view.rows), 3), np.nan)
        there = view.rows != NONE
        turned = view.planes.normals[view.rows[there]] @ view.cam_from_world.rotation.T
        away = np.einsum("ij,ij->i", turned, self._rays[there]) > 0
        normals[there] = np.where(away[:, None], -turned, turned)
        return self._image(normals)

    def flow(self, view: SurfaceView, later: SurfaceView) -> FlowTruth:
        """Flow (h, w, 2) in px from one view to a later one, NaN where it is not known; and occlusion (h, w)."""
        moved = self._moved(view, later)
        camera, h, w = self._source.camera, self._source.camera.height, self._source.camera.width
        before_camera = moved[:, 2] > 1e-6 * np.linalg.norm(moved, axis=1)  # false for NaN
        pixels = np.full((len(moved), 2), np.nan)
        pixels[before_camera] = camera.project(moved[before_camera])
        known = before_camera & self._met_again(moved, pixels)
        flow = pixels - self._pixels
        known &= (np.abs(flow) < LARGEST_FLOW_PX).all(axis=1)
        inside = known & ((pixels >= -0.5) & (pixels <= [w - 0.5, h - 0.5])).all(axis=1)
        occlusion = np.full(len(moved), UNKNOWN, dtype=np.uint8)
        occlusion[known] = OUTSIDE
        occlusion[inside] = np.where(self._hidden(view, later, moved, inside), HIDDEN, SEEN)
        flow[~known] = np.nan
        return FlowTruth(self._image(flow), occlusion.reshape(h, w))

    def _moved(self, view: SurfaceView, later: SurfaceView) -> Array:
        """Surface points (k, 3) of the pixels in the camera frame at a later time; for the sky, directions."""
        world_from_cam = view.cam_from_world.inverse()
        near = np.isfinite(view.depths_m)
        points = world_from_cam.transform(self._rays[near] * view.depths_m[near, None])
        carried = self._renderer.facets.carried(view.rows[near], points, view.time_ns * 1e-9, later.time_ns * 1e-9)
        moved = self._rays @ (later.cam_from_world.rotation @ world_from_cam.rotation).T
        moved[near] = later.cam_from_world.transform(carried)
        moved[np.isnan(view.depths_m)] = np.nan
        return moved

    def _hidden(
        self, view: SurfaceView, later: SurfaceView, moved: Array, asked: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Mask of the requested points that are occluded in the later view, in all four pixels around them."""
        points, rows, there = moved[asked], view.rows[asked], np.isfinite(view.depths_m[asked])
        world_from_cam = later.cam_from_world.inverse()
        rays = points @ world_from_cam.rotation.T
        place = self._in_pinhole(points)
        hidden = np.ones(len(points), dtype=bool)
        base = np.floor(place).astype(np.int64)
        for step in CORNERS:
            other = _shifted(later.seen, base, step)
            nearer = other != NONE
            share = later.planes.along(other[nearer], world_from_cam.translation, rays[nearer])
            nearer[nearer] = ~there[nearer] | (share < 1 - BEFORE)
            hidden &= nearer & (other != rows)
        return hidden

    def _in_pinhole(self, points: Array) -> Array:
        """Projections (k, 2) in px of points (k, 3) in the camera frame into the pinhole image."""
        pinhole = self._source.pinhole
        return np.asarray(points[:, :2] / points[:, 2:] * [pinhole.fx, pinhole.fy] + [pinhole.cx, pinhole.cy])

    def _met_again(self, points: Array, pixels: Array) -> NDArray[np.bool_]:
        """Whether the rays of pixels (k, 2) pass through points (k, 3); false where the distortion folds over."""
        camera = self._source.camera
        if camera.distortion_model == "none":
            return np.asarray(np.isfinite(pixels).all(axis=1))
        found: NDArray[np.bool_] = np.asarray(np.isfinite(pixels).all(axis=1))
        straight = points[found, :2] / points[found, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        with np.errstate(invalid="ignore"):
            found[found] = np.abs(camera.undistort(pixels[found]) - straight).max(axis=1) < LENS_ROUND_TRIP_PX
        return found

    def _image(self, values: Array) -> Array:
        return values.reshape(self._source.camera.height, self._source.camera.width, -1)


def _shifted(seen: Rows, pixels: NDArray[np.int64], step: tuple[int, int]) -> Rows:
    """Facets (k,) at an offset (column, row) from pixels (k, 2), clamped to the image."""
    column, row = (np.clip(pixels[:, k] + step[k], 0, seen.shape[1 - k] - 1) for k in (0, 1))
    return np.asarray(seen[row, column])


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

    def write(self, frame: int, time_ns: int) -> None:
        """Write the annotations of a frame exposed at time_ns, and the flow from the previous frame to it."""
        view = self._truth.view(time_ns)
        if {"depth", "mask"} & self.annotations:
            seen = self._truth.geometry(view)
            if "depth" in self.annotations:
                write_depth(self._folder, frame, seen.depth_m)
            if "mask" in self.annotations:
                write_mask(self._folder, frame, seen.instances)
        if "normals" in self.annotations:
            write_normals(self._folder, frame, self._truth.normals(view))
        if "flow" in self.annotations:
            if self._last is not None:
                write_flow(self._folder, self._last[0], *self._truth.flow(self._last[1], view))
            self._last = frame, view


def write_normals(folder: Path, frame: int, normals: Array) -> None:
    """Write `normals/NNNNNN.png` from unit normals (h, w, 3)."""
    codes = np.nan_to_num(np.rint((normals + 1) / 2 * NORMAL_UNITS), nan=0.0)
    _write(folder / "normals" / f"{frame:06d}.png", codes[..., ::-1])


def write_flow(folder: Path, frame: int, flow: Array, occlusion: NDArray[np.uint8]) -> None:
    """Write `flow/NNNNNN.png` from flow (h, w, 2) in px, and `occlusion/NNNNNN.png`."""
    known = np.asarray(np.isfinite(flow).all(axis=2))
    codes = np.where(known[..., None], np.rint(np.nan_to_num(flow) * FLOW_UNITS_PER_PX) + FLOW_ZERO, 0.0)
    _write(folder / "flow" / f"{frame:06d}.png", np.dstack([known, codes[..., 1], codes[..., 0]]))
    path = folder / "occlusion" / f"{frame:06d}.png"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png(occlusion, smooth=True))


def _write(path: Path, codes: Array) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png(codes.astype(np.uint16), smooth=True))
