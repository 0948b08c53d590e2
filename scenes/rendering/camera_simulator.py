"""Camera simulator: images of a rendered scene from a moving camera at any time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.pixel_kernels import displacement, square_codes
from uavbench.scenes.rendering.radiance import Radiance, decode, encode
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose, rotation_log

FLOW_STEP = 2
SLICE_PX = 3.0
STILL_PX = 0.4
"""Image motion during an exposure that is neglected: it adds less than 0.014 px^2 to the variance of an edge."""
MAX_SLICES = 64
LARGEST_RENDER = 4.0
"""Largest ratio of the rendered pinhole image to that of a distorted camera, per side."""
LEAST_ROUND_TRIP_PX = 0.01
"""Round-trip error of undistortion and distortion above which a pixel has no valid ray."""
Map = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class View:
    """Pinhole image at one instant: square-root coded colour (h, w, 3) BGR, depth (h, w) in metres (0: background).

    Its arrays are read-only: all effects and the annotations of a frame share them.
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.float32]
    instances: NDArray[np.uint8]
    cam_from_world: Pose

    def __post_init__(self) -> None:
        for array in (self.color, self.depth, self.instances):
            array.setflags(write=False)


class Geometry(NamedTuple):
    """Depth (h, w) along the optical axis in metres, 0 for the background, and instances (h, w)."""

    depth_m: NDArray[np.float32]
    instances: NDArray[np.uint8]


class SceneRenderer(Protocol):
    """Interface of renderers, such as `Renderer` or a path tracer."""

    def color(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR, the square root of linear light, of a pinhole camera."""
        ...

    def geometry(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> Geometry:
        """Depth and instances (h, w) at pixel centres of a pinhole camera."""
        ...

    def nearest_m(self, eye: Array) -> float:
        """Lower bound of the distance in metres from a point (3,) in the world to all static parts."""
        ...


@dataclass(frozen=True, eq=False)
class Rendered:
    """An `image` of a camera simulator that is the linear radiance of the renderer's square-root coded images."""

    roots: Callable[[int], NDArray[np.uint8]]

    def __call__(self, stamp_ns: int) -> Radiance:
        """The radiance at a stamp."""
        return light_of(self.roots(stamp_ns))


@dataclass(frozen=True, eq=False)
class Coded:
    """An `image` of a camera simulator of which `codes` gives what `encode` would, in less time."""

    light: Callable[[int], Radiance | None]
    codes: Callable[[int], NDArray[np.uint8]]

    def __call__(self, stamp_ns: int) -> Radiance | None:
        """The radiance at a stamp."""
        return self.light(stamp_ns)


def no_wider(px: int) -> "CameraSimulator":
    """ValueError: of a simulator that has images alone, none shows what lies beyond them."""
    raise ValueError(f"this camera simulator has no {px} px beyond its images")


@dataclass(frozen=True, eq=False)
class CameraSimulator:
    """A simulated camera; an effect maps one to another.

    pinhole is the camera that is rendered; lens (h, w, 2) the position in its image, px, of each pixel of the camera,
    None where the two are the same. render returns a view at a stamp; expose the mean irradiance over a time interval;
    image the frame that the camera delivers, None when it is dropped. Times are in ns. The stamp of a frame is the
    middle of its exposure, for a rolling shutter that of the middle row. row_delay_ns is the delay between rows. wider
    returns the same camera with a number of pixels more on each side, behind lens and shutter.
    """

    camera: Camera
    pinhole: Camera
    lens: Map | None
    cam_from_world: Callable[[int], Pose]
    render: Callable[[int], View]
    expose: Callable[[int, int], Radiance]
    image: Callable[[int], Radiance | None]
    row_delay_ns: float = 0.0
    wider: "Callable[[int], CameraSimulator]" = no_wider

    @property
    def told(self) -> Camera:
        """The camera with the time in which its rows are read out, as trackers are told it."""
        return self.camera.with_row_delay(self.row_delay_ns)

    def frame(self, stamp_ns: int) -> NDArray[np.uint8] | None:
        """The image at a stamp in 8-bit sRGB codes (h, w, 3) BGR, None when it is dropped."""
        if isinstance(self.image, Coded):
            return self.image.codes(stamp_ns)
        light = self.image(stamp_ns)
        return None if light is None else encode(light)


def ideal_camera(
    renderer: SceneRenderer,
    camera: Camera,
    pinhole: Camera,
    lens: Map | None,
    cam_from_world: Callable[[int], Pose],
    blur_px: float = 0.0,
) -> CameraSimulator:
    """Ideal camera: global shutter, no noise, Gaussian point spread of standard deviation blur_px (pinhole pixels)."""

    @lru_cache(maxsize=2)
    def color(stamp_ns: int) -> NDArray[np.uint8]:
        return through_lens(renderer, cam_from_world(stamp_ns), pinhole, stamp_ns * 1e-9, blur_px)

    @lru_cache(maxsize=2)
    def render(stamp_ns: int) -> View:
        pose = cam_from_world(stamp_ns)
        return View(color(stamp_ns), *renderer.geometry(pose, pinhole, stamp_ns * 1e-9), pose)

    def through(camera: Camera, lens: Map | None) -> CameraSimulator:
        def sharp(stamp_ns: int) -> Radiance:
            light = light_of(color(stamp_ns))
            return light if lens is None else sample(light, lens)

        def expose(start_ns: int, end_ns: int) -> Radiance:
            out = np.zeros((camera.height, camera.width, 3), dtype=np.float32)
            if start_ns == end_ns or _still(renderer, pinhole, cam_from_world(start_ns), cam_from_world(end_ns)):
                return sharp((start_ns + end_ns) // 2)
            _expose(start_ns, end_ns, 1.0, out)
            return out

        def _expose(start_ns: int, end_ns: int, weight: float, out: Radiance) -> None:
            view = render((start_ns + end_ns) // 2)
            flow = flow_between(view, pinhole, cam_from_world(start_ns), cam_from_world(end_ns))
            fastest = float(np.abs(flow).max()) if flow.size else 0.0
            slices = min(MAX_SLICES, int(np.ceil(fastest / SLICE_PX)))
            if slices > 1:
                slices += 1 - slices % 2
                cuts = [start_ns + (end_ns - start_ns) * k // slices for k in range(slices + 1)]
                for k in range(slices):
                    a, b = cuts[k], cuts[k + 1]
                    seen = view if k == slices // 2 else render((a + b) // 2)
                    add_motion_blur(seen.color, flow / np.float32(slices), lens, weight / slices, out)
            else:
                add_motion_blur(view.color, flow, lens, weight, out)

        def wider(px: int) -> CameraSimulator:
            grid = pixel_grid(camera.width, camera.height) if lens is None else lens
            return through(camera.wider(px), np.pad(grid, ((px, px), (px, px), (0, 0)), "reflect", reflect_type="odd"))

        image = Rendered(color) if lens is None else sharp
        return CameraSimulator(camera, pinhole, lens, cam_from_world, render, expose, image, wider=wider)

    return through(camera, lens)


def through_lens(
    renderer: SceneRenderer, cam_from_world: Pose, pinhole: Camera, time_s: float, blur_px: float
) -> NDArray[np.uint8]:
    """Square-root coded image (h, w, 3) through a lens: the mean irradiance of renders shifted by its point spread.

    The shifts refine the sampling, so that the position of an edge is accurate to a few thousandths of a pixel.
    """
    if blur_px == 0.0:
        return renderer.color(cam_from_world, pinhole, time_s)
    light = np.zeros((pinhole.height, pinhole.width, 3), dtype=np.float32)
    spread = normal_spread()
    for dx, dy in product(blur_px * spread, repeat=2):
        shifted = replace(pinhole, cx=pinhole.cx + dx, cy=pinhole.cy + dy)
        add(light_of(renderer.color(cam_from_world, shifted, time_s)), 1 / len(spread) ** 2, light)
    return np.asarray(np.rint(255 * np.sqrt(light)), dtype=np.uint8)


@cache
def normal_spread() -> Array:
    """Four quantiles (4,) of the normal distribution, scaled to unit standard deviation."""
    from scipy.special import ndtri  # lazy: it takes 0.2 s, and every command imports this module

    quantiles = ndtri((np.arange(4) + 0.5) / 4)
    return np.asarray(quantiles / np.std(quantiles))


def _still(renderer: SceneRenderer, pinhole: Camera, before: Pose, after: Pose) -> bool:
    """Whether the image motion of every static surface between two poses is bounded by STILL_PX."""
    step = after @ before.inverse()
    nearest = renderer.nearest_m(before.inverse().translation)
    widest = 1 + (max(pinhole.cx, pinhole.width - pinhole.cx) / pinhole.fx) ** 2
    widest += (max(pinhole.cy, pinhole.height - pinhole.cy) / pinhole.fy) ** 2
    turn, way = float(np.linalg.norm(rotation_log(step.rotation))), float(np.linalg.norm(step.translation))
    return bool(max(pinhole.fx, pinhole.fy) * widest * (turn + way / max(nearest, 1e-6)) < STILL_PX)


def flow_between(view: View, pinhole: Camera, before: Pose, after: Pose) -> Map:
    """Optical flow (h, w, 2) in px from pose `before` to pose `after`, both `cam_from_world`, at the pixels of a view.

    Evaluated at every FLOW_STEP-th pixel and interpolated; background counts as infinitely far.
    """
    world_from_cam = view.cam_from_world.inverse()
    h, w = view.depth.shape
    flow = np.empty(((h + FLOW_STEP - 1) // FLOW_STEP, (w + FLOW_STEP - 1) // FLOW_STEP, 2), dtype=np.float32)
    intrinsics = (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)
    poses = [(pose @ world_from_cam).matrix[:3] for pose in (before, after)]
    displacement(view.depth, FLOW_STEP, intrinsics, poses[0], poses[1], flow)
    return np.asarray(cv2.resize(flow, (w, h), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def add_motion_blur(color: NDArray[np.uint8], flow: Map, lens: Map | None, weight: float, out: Radiance) -> None:
    """Add to out the mean irradiance along the flow (h, w, 2) of each pixel, times weight."""
    taps = max(1, int(np.ceil(float(np.abs(flow).max()) * 1.25 + 0.2)))
    place = pixel_grid(color.shape[1], color.shape[0]) if lens is None else lens
    if lens is not None:
        flow = sample(flow, lens)
    light = light_of(color)
    for k in range(taps):
        share = (k + 0.5) / taps - 0.5
        add(sample(light, place - np.float32(share) * flow), weight / taps, out)


def light_of(color: NDArray[np.uint8]) -> Radiance:
    """Linear radiance of a square-root coded image; only linear values can be averaged without bias."""
    light = np.empty(color.shape, dtype=np.float32)
    square_codes(np.ascontiguousarray(color).reshape(-1), light.reshape(-1))
    return light


def add(light: Radiance, weight: float, out: Radiance) -> None:
    """Accumulate in place: out += weight * light."""
    cv2.scaleAdd(light, weight, out, out)


def on_codes(source: CameraSimulator, change: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]) -> CameraSimulator:
    """CameraSimulator whose images in 8-bit sRGB codes (h, w, 3) are passed through a function."""

    def image(stamp_ns: int) -> Radiance | None:
        light = source.image(stamp_ns)
        return None if light is None else decode(change(encode(light)))

    return replace(source, image=image)


def pixel_grid(width: int, height: int) -> Map:
    """Coordinates (h, w, 2) of all pixel centres: column, row."""
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float32)


def sample(image: NDArray[Any], place: Map) -> NDArray[Any]:
    """The image (h, w, channels) at positions (h', w', 2) in px, by bilinear interpolation with replicated border."""
    none: Any = None
    return np.asarray(cv2.remap(image, place, none, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


class RenderCamera(NamedTuple):
    """The pinhole camera that is rendered, and the position (h, w, 2) in its image, px, of each pixel of a camera.

    lens: None where the two cameras are the same.
    """

    pinhole: Camera
    lens: Map | None


def render_camera(camera: Camera, margin_px: int = 0) -> RenderCamera:
    """Pinhole camera that covers the field of view of a camera plus a margin in px, and the map between their pixels.

    It has the focal lengths of the camera, so that the centre of the image keeps its resolution. UserError when the
    pinhole would exceed LARGEST_RENDER times the image, or when the distortion is not invertible within it.
    """
    if camera.distortion_model == "none" and margin_px == 0:
        return RenderCamera(camera, None)
    pixels = pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64)
    place = camera.undistort(pixels)
    low, high = np.floor(place.min(axis=0)) - 2 - margin_px, np.ceil(place.max(axis=0)) + 3 + margin_px
    if not (
        np.isfinite(place).all() and ((high - low) < LARGEST_RENDER * np.array([camera.width, camera.height])).all()
    ):
        raise UserError(
            "with this distortion some pixels are too far off-axis to be rendered (the field of view of a "
            "fisheye is limited to about 120 degrees); lower the distortion or raise fx_px and fy_px"
        )
    rays = np.column_stack([(place - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(place))])
    off_px = np.abs(camera.project(rays) - pixels).max(axis=1)
    if not off_px.max() < LEAST_ROUND_TRIP_PX:
        u, v = pixels[int(np.argmax(off_px))]
        raise UserError(
            f"the distortion folds over before pixel ({u:.0f}, {v:.0f}), which no ray reaches; "
            "lower its coefficients, add the higher ones, or raise fx_px and fy_px"
        )
    width, height = (int(n) for n in high - low)
    pinhole = Camera(width, height, camera.fx, camera.fy, camera.cx - low[0], camera.cy - low[1])
    shifted: Array = place - low
    return RenderCamera(pinhole, shifted.reshape(camera.height, camera.width, 2).astype(np.float32))
