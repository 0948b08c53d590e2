"""A calibrated camera: pinhole intrinsics and lens distortion.

Axes are OpenCV's: x right, y down, z forward. Pixel centres lie at integer coordinates: the image
spans -0.5 .. width - 0.5.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.calibrations.camera_file import read_camera_file, row_delay_ns, write_camera_file
from uavbench.scenes.calibrations.camera_plausibility import implausible
from uavbench.scenes.calibrations.other_tools import own_name
from uavbench.scenes.decoding.sample_bits import FEWEST_BITS, MOST_BITS
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MOST_PIXELS
from uavbench.trajectories.pose import Array

DISTORTION_COEFFICIENTS = {"none": (0,), "radtan": (4, 5), "equidistant": (4,)}
BITS = (0, *range(FEWEST_BITS, MOST_BITS + 1))
"""Bits of a sample that a camera may have; 0: as its images say."""
FOLDED_PX = 0.1
"""Distance in px from its pixel's ray, from which on a point is seen nowhere: the distortion folds over before it."""
LONGEST_READOUT_MS = 1000.0
"""A second; sensors with a rolling shutter read out their rows in some 5 to 50 ms."""
MODELS = {"none": 0.0, "radtan": 1.0, "equidistant": 2.0}
Polygon = tuple[tuple[float, float], ...]
RESPONSES = ("srgb", "linear", "unknown")
"""Responses that have a name: codes by IEC 61966-2-1, in proportion to light, and to be found by who uses them."""


@dataclass(frozen=True)
class Camera:
    """Intrinsics in px, a distortion model, and how codes follow light.

    distortion_model: `none`; `radtan` with k1 k2 p1 p2 [k3] (Brown-Conrady, OpenCV order);
    `equidistant` with k1 k2 k3 k4 (Kannala & Brandt 2006, OpenCV's fisheye).
    bits: of a sample, where image files have 16 and do not say how many of them count; 0: as the files say.
    response: `srgb` (IEC 61966-2-1), `linear`, `unknown`, or the exponent by which codes in 0..1 become light.
    readout_ms: of a rolling shutter, time from the first row to the last, negative where the last row is the first one;
    stamps are those of the middle row.
    masked: polygons of three or more corners (x, y) in px where no scene shows: parts of the vehicle, an overlay.
    Raises ValueError naming the field that is out of range.

    >>> import numpy as np
    >>> camera = Camera.from_field_of_view(640, 480, horizontal_deg=90.0)
    >>> camera.project(np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]])).tolist()
    [[319.5, 239.5], [479.5, 239.5]]
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = "none"
    distortion: tuple[float, ...] = ()
    bits: int = 0
    response: str | float = "srgb"
    masked: tuple[Polygon, ...] = ()
    readout_ms: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if isinstance(side := getattr(self, name), bool) or not isinstance(side, int | np.integer):
                raise ValueError(f"{name} = {side!r}: must be a whole number of pixels, as in {name} = 640")
            object.__setattr__(self, name, int(side))
        if not (self.width > 0 and self.height > 0):
            raise ValueError(f"width and height must be positive, got {self.width} x {self.height}")
        if isinstance(self.bits, bool) or not isinstance(self.bits, int) or self.bits not in BITS:
            raise ValueError(f"bits = {self.bits!r}: must be a whole number from 8 to 16, as in bits = 12")
        if self.width * self.height > MOST_PIXELS:
            raise ValueError(
                f"{self.width} x {self.height} px are more than the {MOST_PIXELS:,} of the largest cameras"
            )
        for name in ("fx", "fy", "cx", "cy"):
            if isinstance(px := getattr(self, name), bool) or not isinstance(px, Real):
                raise ValueError(f"{name} = {px!r}: must be a number of pixels, as in {name} = 400.0")
            object.__setattr__(self, name, float(px))  # NumPy's numbers are written with their type
        if not (self.fx > 0 and self.fy > 0 and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            raise ValueError("fx and fy must be positive, and fx fy cx cy finite")
        counts = DISTORTION_COEFFICIENTS.get(str(self.distortion_model))
        if counts is None:
            known = own_name(str(self.distortion_model))
            raise ValueError(
                f"distortion_model {self.distortion_model!r} is not one of {', '.join(DISTORTION_COEFFICIENTS)}"
                + (f'; here it is "{known}"' if known else "; calibrate with one of them, as `uavbench calibrate` does")
            )
        numbers: Any = self.distortion
        if not isinstance(numbers, Iterable) or not all(isinstance(k, Real) for k in numbers):
            raise ValueError(f"distortion = {numbers!r}: must be a list of numbers, as in distortion = []")
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        if not np.isfinite(self.distortion).all():
            raise ValueError(f"distortion = {list(self.distortion)}: must be finite numbers")
        if len(self.distortion) not in counts:
            raise ValueError(_other_count(self.distortion_model, self.distortion))
        given: Any = self.response
        number = not isinstance(given, bool) and isinstance(given, Real)
        if not (0 < float(given) < np.inf if number else given in list(RESPONSES)):
            raise ValueError(
                f"response = {given!r}: must be one of {', '.join(RESPONSES)}, or the positive exponent by which codes "
                "become light, as in response = 2.2"
            )
        object.__setattr__(self, "readout_ms", _readout_ms(self.readout_ms))
        object.__setattr__(self, "masked", _polygons(self.masked))
        if self.masked and not self.unmasked.any():
            raise ValueError("masked: covers all of the image")

    @classmethod
    def from_field_of_view(cls, width: int, height: int, horizontal_deg: float) -> "Camera":
        """Distortion-free camera with square pixels, its principal point in the middle of the image.

        ValueError unless the angle lies between 0 and 180 degrees.
        """
        given: Any = horizontal_deg
        if isinstance(given, bool) or not isinstance(given, Real) or not 0 < float(given) < 180:
            raise ValueError(f"horizontal_deg = {horizontal_deg!r}: must be an angle between 0 and 180 degrees")
        f = 0.5 * width / np.tan(np.radians(horizontal_deg) / 2)
        return cls(width, height, float(f), float(f), (width - 1) / 2, (height - 1) / 2)

    @property
    def K(self) -> Array:
        """Intrinsic matrix (3, 3), px."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def coefficients(self) -> Array:
        """Distortion coefficients (k,) in OpenCV's order; zeros (4,) for `none`."""
        return np.array(self.distortion or (0.0, 0.0, 0.0, 0.0))

    @property
    def unmasked(self) -> NDArray[np.bool_]:
        """Whether each pixel (height, width) shows the scene: none inside a masked polygon or on its border does."""
        shown = np.ones((self.height, self.width), dtype=np.uint8)
        for polygon in self.masked:
            cv2.fillPoly(shown, [np.round(polygon).astype(np.int32)], 0)
        return shown.view(np.bool_)

    @property
    def without_distortion(self) -> "Camera":
        """The pinhole camera with the same intrinsic matrix."""
        return replace(self, distortion_model="none", distortion=())

    def wider(self, px: int) -> "Camera":
        """The same camera with px more pixels on each side of its image."""
        width, height = self.width + 2 * px, self.height + 2 * px
        shifted = tuple(tuple((x + px, y + px) for x, y in polygon) for polygon in self.masked)
        return replace(self, width=width, height=height, cx=self.cx + px, cy=self.cy + px, masked=shifted)

    def project(self, points_cam_m: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) in the camera frame, z > 0."""
        xy = points_cam_m[:, :2] / points_cam_m[:, 2:3]
        if self.distortion_model == "none" or not len(xy):  # OpenCV has no answer for none
            return xy * [self.fx, self.fy] + [self.cx, self.cy]
        zero = np.zeros(3)
        points = np.ascontiguousarray(np.column_stack([xy, np.ones(len(xy))]))[:, None]
        if self.distortion_model == "equidistant":
            return _pixels(cv2.fisheye.projectPoints(points, zero, zero, self.K, self.coefficients)[0])
        return _pixels(cv2.projectPoints(points, zero, zero, self.K, self.coefficients)[0])

    def undistort(self, pixels: Array) -> Array:
        """Pixels (n, 2) of `without_distortion` seen at the pixels (n, 2) of this camera."""
        if self.distortion_model == "none" or not len(pixels):  # OpenCV has no answer for none
            return np.array(pixels, dtype=np.float64)
        points = np.ascontiguousarray(pixels, dtype=np.float64)[:, None]
        if self.distortion_model == "equidistant":
            return _pixels(cv2.fisheye.undistortPoints(points, self.K, self.coefficients, P=self.K))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        return _pixels(cv2.undistortPoints(points, self.K, self.coefficients, P=self.K, criteria=criteria))

    def with_row_delay(self, delay_ns: float) -> "Camera":
        """The camera as trackers are told it: its rows are exposed delay_ns apart, 0 for a global shutter."""
        readout_ms = 1e-6 * delay_ns * (self.height - 1)
        return replace(self, readout_ms=readout_ms) if readout_ms else self

    def in_image(self, points_cam_m: Array) -> NDArray[np.bool_]:
        """Which points (n, 3) in the camera frame, z > 0, are in the image; none of those beyond a fold of the lens."""
        pixels = self.project(points_cam_m)
        within = (pixels >= -0.5) & (pixels < [self.width - 0.5, self.height - 0.5])
        inside: NDArray[np.bool_] = np.asarray(within.all(axis=1))
        inside[inside] = self.before_fold(points_cam_m[inside])
        return inside

    def before_fold(self, points_cam_m: Array) -> NDArray[np.bool_]:
        """Which points (n, 3) in the camera frame, z > 0, are seen at their pixels: none beyond a fold of the lens."""
        if self.distortion_model == "equidistant":  # OpenCV undistorts none farther than 90 degrees times f
            angle = np.arctan2(np.hypot(points_cam_m[:, 0], points_cam_m[:, 1]), points_cam_m[:, 2])
            return np.asarray(angle < self._fold_rad())
        straight = self.without_distortion.project(points_cam_m)
        with np.errstate(invalid="ignore"):
            off_px = np.abs(self.undistort(self.project(points_cam_m)) - straight).max(axis=1, initial=0.0)
        return np.asarray(off_px < FOLDED_PX)

    def _fold_rad(self) -> float:
        """Angle from the optical axis at which the radius in the image of an equidistant lens ends to grow, or inf."""
        odd = (9.0, 7.0, 5.0, 3.0)
        squares = np.roots([*(n * k for n, k in zip(odd, self.distortion[::-1], strict=True)), 1.0])
        return float(np.sqrt(squares[(squares.imag == 0) & (squares.real > 0)].real.min(initial=np.inf)))

    def rays(self, pixels: Array) -> Array:
        """Rays (n, 3) in the camera frame, z = 1, through pixels (n, 2) of this camera."""
        xy = (self.undistort(pixels) - [self.cx, self.cy]) / [self.fx, self.fy]
        return np.column_stack([xy, np.ones(len(xy))])

    def save(self, path: str | Path, *, kind: str = "") -> None:
        """Write `camera.toml`; kind: see `new_file`."""
        write_camera_file(Path(path), asdict(self), kind=kind)

    @classmethod
    def load(cls, path: str | Path, inside: Path | None = None) -> "Camera":
        """Read `camera.toml`, which must lie in the folder `inside` if given; UserError naming file and key.

        That of a rendered sequence has the rolling shutter of its `sequence.json`, unless it says `readout_ms` itself.
        """
        path = Path(path)
        values = read_camera_file(path, list(cls.__dataclass_fields__), inside)
        try:
            camera = cls(**values)
        except (ValueError, TypeError, OverflowError) as error:
            raise UserError(f"{path}: {error}") from None
        if inside is not None:  # a rendered one was checked
            return camera
        if why := implausible(camera):
            raise UserError(f"{path}: {why}")
        return camera if "readout_ms" in values else camera.with_row_delay(row_delay_ns(path))


def _other_count(model: str, distortion: tuple[float, ...]) -> str:
    """What to do about a number of coefficients that the model does not have."""
    many = " or ".join(map(str, DISTORTION_COEFFICIENTS[model]))
    told = f"distortion of model {model} takes {many} finite numbers, not {len(distortion)}"
    if model == "none":
        return f"{told}; name their distortion_model, or give distortion = []"
    if len(distortion) < min(DISTORTION_COEFFICIENTS[model]):
        return f"{told}; those that a calibration leaves out are 0"
    if model == "radtan" and not any(distortion[5:]):
        return f"{told}; leave out the zeros behind the fifth"
    return (
        f"{told}; more are of a rational, thin prism or tilted model: calibrate again without, as `uavbench calibrate`"
    )


def _readout_ms(given: Any) -> float:
    """Milliseconds as a number; ValueError where it is none, or longer than any camera takes."""
    if isinstance(given, bool) or not isinstance(given, Real) or not abs(float(given)) <= LONGEST_READOUT_MS:
        raise ValueError(
            f"readout_ms = {given!r}: must be the milliseconds from the first row to the last, of magnitude "
            f"{LONGEST_READOUT_MS:g} at most, as in readout_ms = 20.0"
        )
    return float(given)


def _polygons(given: Any) -> tuple[Polygon, ...]:
    """Polygons as tuples; ValueError where they are none, or have corners farther out than an image may be large."""
    hint = "as in masked = [[[0, 0], [639, 0], [639, 49], [0, 49]]], one list of corners [x, y] in px for each polygon"
    try:
        polygons = [np.array(polygon, dtype=np.float64) for polygon in given]
    except (TypeError, ValueError):
        raise ValueError(f"masked = {given!r}: must be polygons, {hint}") from None
    for polygon in polygons:
        if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not (np.abs(polygon) < MOST_PIXELS).all():
            raise ValueError(f"masked: {polygon.tolist()} is not a polygon of three or more corners, {hint}")
    return tuple(tuple((x, y) for x, y in polygon.tolist()) for polygon in polygons)


def _pixels(points: NDArray[Any]) -> Array:
    return points.reshape(-1, 2).astype(np.float64)


def camera_array(camera: Camera) -> Array:
    """A camera as an array (11,) for kernels: see `kernels.lens`."""
    out = np.zeros(11)
    out[:5] = [camera.fx, camera.fy, camera.cx, camera.cy, MODELS[camera.distortion_model]]
    out[5 : 5 + len(camera.distortion)] = camera.distortion
    return out
