"""Camera calibration from images of a checkerboard (Zhang 2000; Heikkila & Silven 1997), by OpenCV."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import SUFFIXES, OneTurn, decoded, frame_count, is_shown, open_video
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import IMAGE
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.files.writing import new_file
from uavbench.trajectories.pose import Array

Model = Literal["none", "radtan", "equidistant"]
MOST_VIEWS = 60
FEWEST_VIEWS = 4
CALIBRATION = "calibration of a camera"
CELLS = (6, 8)
SMALLEST_BOARD, LARGEST_BOARD = 3, 200
"""Inner corners of a side: OpenCV finds no smaller boards, and images show no larger ones."""
MOST_RMS_PART = 0.003
"""Largest reprojection error in image diagonals: 2.4 px at 640 x 480. That of good calibrations is below a tenth."""
LEAST_TURN_DEG = 10.0
"""Least turn of the board between two pictures: from parallel boards no focal length follows (Zhang 2000, section 3.1).
With corners found to 0.1 px in eight pictures, turns of 5 to 10 deg leave fx up to 11 % off, of 20 deg 4 %.
"""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a calibration: the camera, its reprojection error, and the images used.

    rms_px is over all corners, view_rms_px (n,) per image used; corners_px (n, k, 2) are the detected corners, normals
    (n, 3) those of the boards, in the camera's axes.
    """

    camera: Camera
    rms_px: float
    used: tuple[str, ...]
    unused: tuple[str, ...]
    view_rms_px: Array
    corners_px: Array
    normals: Array

    @property
    def turn_deg(self) -> float:
        """Largest angle between the planes of two boards, 0 to 90."""
        return float(np.degrees(np.arccos(np.abs(self.normals @ self.normals.T).min().clip(0.0, 1.0))))

    @property
    def covered(self) -> float:
        """Fraction of the CELLS of the image that contain a corner."""
        rows, columns = CELLS
        x = (self.corners_px[..., 0] / self.camera.width * columns).astype(int).clip(0, columns - 1)
        y = (self.corners_px[..., 1] / self.camera.height * rows).astype(int).clip(0, rows - 1)
        return len(np.unique(y * columns + x)) / (rows * columns)


def calibrate(
    sources: Sequence[Path], board: tuple[int, int], square_m: float, model: Model = "radtan", bits: int = 0
) -> Calibration:
    """Calibrate from images, folders of images, or videos of a board with (columns, rows) inner corners.

    bits: of a sample of the images, where they have 16 and do not say how many of them count; 0: as they say.
    UserError when a source cannot be read, images differ in size or are turned differently by Exif data, too few
    show the whole board, no camera fits them, or the board is parallel to itself in all of them.
    """
    if min(board) < SMALLEST_BOARD or max(board) > LARGEST_BOARD or not square_m > 0:
        raise UserError(
            f"board {board[0]}x{board[1]} with squares of {square_m} m: give inner corners, as in 7x8, "
            f"{SMALLEST_BOARD} or more along each side, and at most {LARGEST_BOARD}"
        )
    used: list[str] = []
    unused: list[str] = []
    corners: list[Array] = []
    size: tuple[int, int] | None = None
    for name, image in _pictures(sources, bits):
        shape = (image.shape[1], image.shape[0])
        if size not in (None, shape):
            raise UserError(
                f"{name}: is {shape[0]} x {shape[1]} px, the previous pictures {size}; calibrate one camera at a time"
            )
        size = shape
        found = find_corners(image, board)
        (unused if found is None else used).append(name)
        if found is not None:
            corners.append(found)
    if size is None or len(corners) < FEWEST_VIEWS:
        raise UserError(
            f"only {len(corners)} of {len(used) + len(unused)} pictures show the whole board of {board[0]}x{board[1]} "
            f"inner corners, {FEWEST_VIEWS} or more are needed; check --board, and that the board is in view and sharp"
        )
    try:
        found_camera = _solve(np.array(corners), size, board, square_m, model, tuple(used), tuple(unused))
    except cv2.error as error:
        raise UserError(
            f"the calibration does not converge ({error.err}); show the board from more directions, and sharp"
        ) from None
    if found_camera.rms_px > MOST_RMS_PART * np.hypot(*size):
        worst = int(np.argmax(found_camera.view_rms_px))
        raise UserError(
            f"no camera fits the corners: the reprojection error is {found_camera.rms_px:.1f} px, in {used[worst]} "
            f"{found_camera.view_rms_px[worst]:.1f} px; check --board, which may be found in a part of a larger one, "
            "and --model, or leave out blurred pictures"
        )
    if found_camera.turn_deg < LEAST_TURN_DEG:
        raise UserError(
            f"the board turns by {found_camera.turn_deg:.1f} deg at most from one picture to another, from which no "
            f"focal length can be told; tilt it to and fro and sideways, by {LEAST_TURN_DEG:g} deg or more, better 30"
        )
    return replace(found_camera, camera=replace(found_camera.camera, bits=bits))


def find_corners(image: NDArray[np.uint8], board: tuple[int, int]) -> Array | None:
    """Inner corners (k, 2) px, row by row, to a few hundredths of a pixel; None unless the whole board is visible."""
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCornersSB(grey, board, None, flags)
    if not found:
        return None
    corners = np.asarray(corners, dtype=np.float32)
    grid = corners.reshape(board[1], board[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    radius = int(np.clip(0.4 * spacing, 2, 9))
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    refined = cv2.cornerSubPix(grey, corners.reshape(-1, 1, 2), (radius, radius), (-1, -1), stop)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def write_coverage(calibration: Calibration, path: Path) -> None:
    """Write a coverage image: cells without corners in red, corners coloured by image."""
    camera = calibration.camera
    picture = np.full((camera.height, camera.width, 3), 40, dtype=np.uint8)
    rows, columns = CELLS
    points = calibration.corners_px
    for r in range(rows):
        for c in range(columns):
            low = np.array([c * camera.width / columns, r * camera.height / rows])
            high = low + np.array([camera.width / columns, camera.height / rows])
            if not ((points >= low) & (points < high)).all(axis=-1).any():
                a, b = low.astype(int).tolist(), high.astype(int).tolist()
                cv2.rectangle(picture, a, b, (40, 40, 120), -1)
    for k, view in enumerate(points):
        hue = np.array([[[int(179 * k / len(points)), 200, 255]]], dtype=np.uint8)
        color = np.asarray(cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)).reshape(3).tolist()
        for point in np.rint(view).astype(int).tolist():
            cv2.circle(picture, point, 2, color, -1, cv2.LINE_AA)
    text = f"{len(points)} pictures, rms {calibration.rms_px:.3f} px, {100 * calibration.covered:.0f} % covered"
    cv2.putText(picture, text, (8, camera.height - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    with new_file(path, kind=CALIBRATION) as new:
        new.write_bytes(cv2.imencode(path.suffix or ".png", picture)[1].tobytes())


def _solve(
    corners: Array,
    size: tuple[int, int],
    board: tuple[int, int],
    square_m: float,
    model: Model,
    used: tuple[str, ...],
    unused: tuple[str, ...],
) -> Calibration:
    flat = np.stack(np.meshgrid(np.arange(board[0]), np.arange(board[1])), axis=-1).reshape(-1, 2) * square_m
    world = np.column_stack([flat, np.zeros(len(flat))])
    if model == "equidistant":
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
        rms, K, d, rotations, shifts = cv2.fisheye.calibrate(
            [world[None]] * len(corners), [view[None] for view in corners], size, np.eye(3), np.zeros(4), flags=flags
        )
        coefficients = tuple(float(v) for v in np.asarray(d).ravel()[:4])
    else:
        fixed = cv2.CALIB_FIX_K3
        if model == "none":
            fixed |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_ZERO_TANGENT_DIST
        views = [view.astype(np.float32) for view in corners]
        boards = [world.astype(np.float32)] * len(views)
        rms, K, d, rotations, shifts = cv2.calibrateCamera(boards, views, size, np.eye(3), np.zeros(5), flags=fixed)
        coefficients = () if model == "none" else tuple(float(v) for v in np.asarray(d).ravel()[:4])
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    try:
        camera = Camera(size[0], size[1], fx, fy, cx, cy, model, coefficients)
    except ValueError as error:
        raise UserError(f"the calibration does not converge ({error}); show the board from more directions") from None
    errors, normals = [], []
    for view, r, t in zip(corners, rotations, shifts, strict=True):
        R = np.asarray(cv2.Rodrigues(np.asarray(r))[0], dtype=np.float64)
        normals.append(R[:, 2])
        points = world @ R.T + np.asarray(t, dtype=np.float64).ravel()
        errors.append(float(np.sqrt(np.square(camera.project(points) - view).sum(axis=1).mean())))
    return Calibration(camera, float(rms), used, unused, np.array(errors), corners, np.array(normals))


def _pictures(sources: Sequence[Path], bits: int) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    alike = OneTurn()
    for source in sources:
        if source.is_dir():
            files = sorted(p for p in source.rglob("*") if p.suffix.lower() in SUFFIXES and is_shown(p, source))
            if not files:
                raise UserError(f"{source}: has no pictures ({', '.join(SUFFIXES)})")
            yield from ((str(files[k]), _read(files[k], bits, alike)) for k in _spread(len(files)))
        elif source.suffix.lower() in SUFFIXES:
            yield str(source), _read(source, bits, alike)
        else:
            yield from _video(source)


def _spread(count: int) -> list[int]:
    """At most MOST_VIEWS of `count` numbers from 0, evenly spread."""
    return [round(k) for k in np.linspace(0, count - 1, min(count, MOST_VIEWS)).tolist()]


def _read(path: Path, bits: int, alike: OneTurn) -> NDArray[np.uint8]:
    data = read_bytes(path, IMAGE)
    alike.check(path, data)
    return decoded(path, data, cv2.IMREAD_GRAYSCALE, bits)


def _video(path: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """At most MOST_VIEWS frames, evenly spread."""
    count = frame_count(path)
    if count < 1:
        raise UserError(f"{path}: a video without images")
    film = open_video(path)
    chosen = {*_spread(count)}
    for number in range(count):
        read, frame = film.read()
        if not read:
            break
        if number in chosen:
            grey = np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
            yield f"{path} frame {number}", grey
    film.release()
