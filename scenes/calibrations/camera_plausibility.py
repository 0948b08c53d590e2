"""Whether the numbers of a camera can be those of its images: focal lengths, principal point and lens distortion."""

from typing import Protocol

import numpy as np

from uavbench.trajectories.pose import Array

WIDEST = {"none": 45.0, "radtan": 45.0, "equidistant": 2 * np.pi}
"""Most sides of the image, in focal lengths: 175 degrees of a pinhole, 360 degrees of an equidistant fisheye."""
LEAST_ROUND_TRIP_PX = 0.5
"""Error of projecting the ray of a pixel, in px, from which on that ray is none of it."""
SHARES, FEWEST_PX = (0.3, 0.7), 16
"""Where a principal point given in shares of the image's size is, and the side of an image from which it is none in px.

A part of a larger image may have its principal point anywhere, as in its corner.
"""
MOST_TANGENTIAL = 0.03
"""Largest p1 and p2 of a lens: those of calibrations are below 0.01, and k3 in their place is often larger."""
CIRCLE_RAD, ANGLES = np.radians(80.0), 1001
"""Angle from the optical axis that all fisheyes see whose image is a circle, and angles up to it that are looked at."""


class _Calibrated(Protocol):
    """What is asked of a `Camera`, which itself asks whether that of a file is plausible."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def distortion_model(self) -> str: ...
    @property
    def distortion(self) -> tuple[float, ...]: ...
    def project(self, points_cam_m: Array) -> Array: ...
    def rays(self, pixels: Array) -> Array: ...


def implausible(camera: _Calibrated) -> str:
    """Why the numbers of a camera cannot be those of its images, "" if they can: those of a file, or of a script.

    A lens is checked at the middles of the image's sides: in the corners, where no board was seen, good calibrations of
    wide lenses fold over, too.
    """
    for name, side in (("fx", camera.width), ("fy", camera.height)):
        if side > WIDEST[camera.distortion_model] * (focal_px := getattr(camera, name)):
            return (
                f"{name} = {focal_px:g} px is too short for {side} px of any lens; it is in pixels, neither in mm "
                "nor a share of the image's width"
            )
    low, high = SHARES
    if min(camera.width, camera.height) >= FEWEST_PX and all(low <= at <= high for at in (camera.cx, camera.cy)):
        return f"cx = {camera.cx:g}, cy = {camera.cy:g} are shares of the image's size; give them in pixels"
    if camera.distortion_model == "equidistant":
        return _folded_fisheye(camera)
    if camera.distortion_model != "radtan":
        return ""
    if max(map(abs, camera.distortion[2:4])) > MOST_TANGENTIAL:
        p1, p2 = camera.distortion[2:4]
        return (
            f"distortion = {list(camera.distortion)}: p1 = {p1:g} and p2 = {p2:g} are larger than those of any lens; "
            "the order is k1, k2, p1, p2, k3"
        )
    border = _middles_of_sides(camera)
    with np.errstate(all="ignore"):
        off_px = np.abs(camera.project(camera.rays(border)) - border).max(axis=1)
    if (off_px < LEAST_ROUND_TRIP_PX).all():
        return ""
    return _folds_before(camera, border[int(np.argmin(off_px < LEAST_ROUND_TRIP_PX))], "k1, k2, p1, p2")


def _folded_fisheye(camera: _Calibrated) -> str:
    """Why the angles of an equidistant lens do not reach the nearest side of the image, "" if they do.

    The image of a lens may be a circle within the image's sides: its angles then go beyond CIRCLE_RAD.
    """
    angle = np.linspace(0.0, CIRCLE_RAD, ANGLES)
    k1, k2, k3, k4 = camera.distortion
    square = angle * angle
    radius = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    falling = np.flatnonzero(np.diff(radius) <= 0)
    border = _middles_of_sides(camera)
    far = np.linalg.norm((border - [camera.cx, camera.cy]) / [camera.fx, camera.fy], axis=1)
    if not len(falling) or far.min() <= radius[falling[0]]:
        return ""
    return _folds_before(camera, border[int(np.argmin(far))], "k1, k2, k3, k4")


def _middles_of_sides(camera: _Calibrated) -> Array:
    """Pixels (4, 2) in the middles of the image's sides."""
    right, bottom = camera.width - 1.0, camera.height - 1.0
    return np.array([(0.0, bottom / 2), (right, bottom / 2), (right / 2, 0.0), (right / 2, bottom)])


def _folds_before(camera: _Calibrated, pixel: Array, order: str) -> str:
    return (
        f"distortion = {list(camera.distortion)}: the lens folds over before pixel ({pixel[0]:.0f}, {pixel[1]:.0f}), "
        f"which no ray reaches; are they {order} of this camera? Calibrate with the board at the image's borders, too"
    )
