"""Effects of the shutter: motion blur and rolling shutter."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, ClassVar, NamedTuple

import cv2
import numpy as np
from annotated_types import Gt, Interval
from numpy.typing import NDArray

from uavbench.scenes.rendering.camera_simulator import (
    MAX_SLICES,
    SLICE_PX,
    CameraSimulator,
    Map,
    View,
    add,
    flow_between,
    light_of,
    pixel_grid,
    sample,
)
from uavbench.scenes.rendering.pixel_kernels import row_places
from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.pose import Array

LEAST_ROWS = 8
"""Rows that are always taken from one view: within so few of them hardly anything moves."""


@dataclass(frozen=True)
class RollingShutter:
    """Rolling shutter: rows are exposed one after another; the exposure of the middle row is centred on the stamp.

    readout_ms is the time from the first row to the last. One render at the middle of the frame is warped by its depth
    to the pose of each row; a pixel that mixes two depths moves with the nearer one. Rows that see beyond that render
    and its margin have one of their own, at their own middle, and so on.
    """

    readout_ms: Annotated[float, Gt(0), Interval(le=200)] = 20.0
    margin_px: ClassVar[int] = 24
    only_one: ClassVar[bool] = True

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator in which each row has its own pose; the generator is not used."""
        height = source.camera.height
        delay_ns = self.readout_ms * 1e6 / max(height - 1, 1)
        late_ns = np.rint((np.arange(height) - (height - 1) / 2) * delay_ns).astype(np.int64)

        knots, share = row_knots(height)

        def places(view: View, rows: slice, at_ns: int) -> Map:
            world_from_view = view.cam_from_world.inverse()
            known = [(source.cam_from_world(int(at_ns + late_ns[k])) @ world_from_view).matrix[:3] for k in knots]
            return moved_rows(source, view, rows, np.einsum("rk,kij->rij", share[rows], np.array(known)))

        def add_rows(rows: slice, start_ns: int, end_ns: int, slices: int, out: Radiance) -> None:
            late = round(((rows.start + rows.stop) / 2 - height / 2) * delay_ns)
            view = source.render((start_ns + end_ns) // 2 + late)
            first = places(view, rows, start_ns)
            last = first if start_ns == end_ns else places(view, rows, end_ns)
            taps = 1 if last is first else max(2, int(np.ceil(float(np.abs(last - first).max()) * 1.25 + 0.2)))
            held = _held(view, first) & _held(view, last)
            held[len(held) // 2] = True  # the view is from its own pose: so fewer rows remain each time
            light = light_of(view.color)
            for a, b in pairwise([0, *(np.flatnonzero(np.diff(held)) + 1).tolist(), len(held)]):
                run = slice(rows.start + a, rows.start + b)
                if not held[a] and len(held) > LEAST_ROWS:
                    add_rows(run, start_ns, end_ns, slices, out)
                    continue
                for tap in range(taps):
                    part = np.float32((tap + 0.5) / taps)
                    seen = sample(light, first[a:b] + part * (last[a:b] - first[a:b]))
                    add(seen, 1 / (slices * taps), out[run])

        def expose(start_ns: int, end_ns: int) -> Radiance:
            out = np.zeros((height, source.camera.width, 3), dtype=np.float32)
            slices = 1
            if end_ns > start_ns:
                view = source.render((start_ns + end_ns) // 2)
                flow = flow_between(
                    view, source.pinhole, source.cam_from_world(start_ns), source.cam_from_world(end_ns)
                )
                slices = max(1, min(MAX_SLICES, int(np.ceil(float(np.abs(flow).max()) / SLICE_PX))))
            cuts = [start_ns + (end_ns - start_ns) * k // slices for k in range(slices + 1)]
            for k in range(slices):
                add_rows(slice(0, height), cuts[k], cuts[k + 1], slices, out)
            return out

        def wider(px: int) -> CameraSimulator:
            slower = replace(self, readout_ms=(height - 1 + 2 * px) * delay_ns * 1e-6)
            return slower.start(source.wider(px), rng)

        def image(stamp_ns: int) -> Radiance:
            return expose(stamp_ns, stamp_ns)

        return replace(source, expose=expose, image=image, row_delay_ns=delay_ns, wider=wider)


def _held(view: View, places: Map) -> NDArray[np.bool_]:
    """Whether all places of each row (h, w, 2), px, are within the image of a view."""
    height, width = view.depth.shape
    return np.asarray(((places >= 0) & (places <= (width - 1, height - 1))).all(axis=(1, 2)))


class RowKnots(NamedTuple):
    """Rows whose poses are computed, and the interpolation weights (h, knots) of each image row."""

    rows: list[int]
    weights: Array


def row_knots(height: int) -> RowKnots:
    """Knots for linear interpolation of the poses of all rows of an image.

    Knots are at most 1/16 of the readout apart: at 10 rad/s^2 and 20 ms the error is below 1e-5 rad, 0.005 px.
    """
    knots = np.unique(np.rint(np.linspace(0, height - 1, 17)).astype(int)).tolist()
    share = np.array([np.interp(np.arange(height), knots, np.eye(len(knots))[k]) for k in range(len(knots))]).T
    return RowKnots(knots, share)


def moved_rows(source: CameraSimulator, view: View, rows: slice, row_camera_from_view: Array) -> Map:
    """Sampling positions (n, w, 2) in the view, px, of the pixels of n rows with the poses (n, 3, 4)."""
    whole = source.lens if source.lens is not None else pixel_grid(source.camera.width, source.camera.height)
    base = whole[rows]
    nearness = np.divide(1, view.depth, out=np.zeros_like(view.depth), where=view.depth > 0)
    nearness = np.asarray(cv2.dilate(nearness, np.ones((3, 3), dtype=np.uint8)))  # mixed pixels go with the nearer
    nearest = np.asarray(cv2.dilate(nearness, np.ones((9, 9), dtype=np.uint8)), dtype=np.float32)
    out = np.empty_like(base)
    pinhole = source.pinhole
    row_places(nearness, nearest, base, (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy), row_camera_from_view, out)
    return out


@dataclass(frozen=True)
class MotionBlur:
    """Motion blur: irradiance is integrated over the exposure, centred on the frame's stamp."""

    exposure_ms: Annotated[float, Gt(0), Interval(le=1000)] = 8.0
    only_one: ClassVar[bool] = True

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose images are integrals over the exposure; the generator is not used."""
        half_ns = round(self.exposure_ms * 5e5)

        def image(stamp_ns: int) -> Radiance:
            return source.expose(stamp_ns - half_ns, stamp_ns + half_ns)

        return replace(source, image=image, wider=lambda px: self.start(source.wider(px), rng))
