"""Effects of the shutter: motion blur and rolling shutter."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, NamedTuple

import cv2
import numpy as np
from annotated_types import Gt, Interval

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


@dataclass(frozen=True)
class RollingShutter:
    """Rolling shutter: rows are exposed one after another; the exposure of the middle row is centred on the stamp.

    readout_ms is the time from the first row to the last. One render at the middle of the frame is warped by its depth
    to the pose of each row; a pixel that mixes two depths moves with the nearer one.
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

        def places(view: View, at_ns: int) -> Map:
            world_from_view = view.cam_from_world.inverse()
            known = [(source.cam_from_world(int(at_ns + late_ns[k])) @ world_from_view).matrix[:3] for k in knots]
            return moved_rows(source, view, np.einsum("rk,kij->rij", share, np.array(known)))

        def expose(start_ns: int, end_ns: int) -> Radiance:
            out = np.zeros((height, source.camera.width, 3), dtype=np.float32)
            view = source.render((start_ns + end_ns) // 2)
            slices = 1
            if end_ns > start_ns:
                flow = flow_between(
                    view, source.pinhole, source.cam_from_world(start_ns), source.cam_from_world(end_ns)
                )
                slices = max(1, min(MAX_SLICES, int(np.ceil(float(np.abs(flow).max()) / SLICE_PX))))
            for k in range(slices):
                a = start_ns + (end_ns - start_ns) * k // slices
                b = start_ns + (end_ns - start_ns) * (k + 1) // slices
                seen = view if slices == 1 else source.render((a + b) // 2)
                light = light_of(seen.color)
                first = places(seen, a)
                last = first if a == b else places(seen, b)
                taps = 1 if a == b else max(2, int(np.ceil(float(np.abs(last - first).max()) * 1.25 + 0.2)))
                for tap in range(taps):
                    share = np.float32((tap + 0.5) / taps)
                    add(sample(light, first + share * (last - first)), 1 / (slices * taps), out)
            return out

        return replace(source, expose=expose, image=lambda t: expose(t, t), row_delay_ns=delay_ns)


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


def moved_rows(source: CameraSimulator, view: View, rows: Array) -> Map:
    """Sampling positions (h, w, 2) in the view, px, of each pixel; rows (h, 3, 4) are `row_camera_from_view`."""
    base = source.lens if source.lens is not None else pixel_grid(source.camera.width, source.camera.height)
    nearness = np.divide(1, view.depth, out=np.zeros_like(view.depth), where=view.depth > 0)
    nearness = np.asarray(cv2.dilate(nearness, np.ones((3, 3), dtype=np.uint8)))  # mixed pixels go with the nearer
    nearest = np.asarray(cv2.dilate(nearness, np.ones((9, 9), dtype=np.uint8)), dtype=np.float32)
    out = np.empty_like(base)
    pinhole = source.pinhole
    row_places(nearness, nearest, base, (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy), rows, out)
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

        return replace(source, image=image)
