"""A contact sheet of a sequence, and frames with the model drawn at the true pose."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.hidden_lines import seen_parts
from uavbench.trajectories.files.writing import new_file

GREEN = (80, 220, 60)
WHITE = (255, 255, 255)
NEAR_M = 0.05
LEGEND_PX = 28
COLUMNS, ROWS, WIDTH_PX = 4, 3, 400
"""Images of a sheet, and the width of each."""
PIECES = 33
"""Points of the polyline that approximates an edge under lens distortion."""


def contact_sheet(
    sequence: Sequence, columns: int = COLUMNS, rows: int = ROWS, width_px: int = WIDTH_PX
) -> NDArray[np.uint8]:
    """Frames (BGR) evenly spread over the sequence, with a legend under them; the right half of each row with edges.

    A sequence with fewer frames has as many rows as they fill.
    """
    frames = np.unique(np.linspace(0, len(sequence) - 1, columns * rows).astype(int)).tolist()
    rows = -(-len(frames) // columns)
    height = round(width_px * sequence.camera.height / sequence.camera.width)
    sheet = np.full((rows * height + LEGEND_PX, columns * width_px, 3), 24, dtype=np.uint8)
    for k, frame in enumerate(frames):
        drawn = k % columns >= columns // 2
        image = with_edges(sequence, frame) if drawn else sequence.image(frame)
        small = np.asarray(cv2.resize(image, (width_px, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        seconds = float(sequence.stamps_ns[frame]) * 1e-9
        _write(small, f"{frame}  {seconds:.1f} s", (8, height - 10), WHITE)
        r, c = divmod(k, columns)
        sheet[r * height : (r + 1) * height, c * width_px : (c + 1) * width_px] = small
    base, half = rows * height + LEGEND_PX - 9, columns // 2 * width_px
    _write(sheet, "frames as the camera took them", (8, base), WHITE)
    cv2.line(sheet, (half + 8, base - 5), (half + 36, base - 5), GREEN, 2, cv2.LINE_AA)
    _write(sheet, "visible edges of the model at the true pose, drawn on other frames", (half + 46, base), WHITE)
    return sheet


def write_contact_sheet(sequence: Sequence, path: Path) -> None:
    """Write the contact sheet as PNG or JPEG."""
    data = cv2.imencode(path.suffix, contact_sheet(sequence))[1]
    with new_file(path) as new:
        new.write_bytes(data.tobytes())


def with_edges(sequence: Sequence, frame: int) -> NDArray[np.uint8]:
    """A frame (h, w, 3), BGR, with the visible edges of the model at the true pose (hidden lines removed)."""
    return edges_on(sequence.image(frame).copy(), sequence.camera, sequence, frame)


def edges_on(image: NDArray[np.uint8], camera: Camera, sequence: Sequence, frame: int) -> NDArray[np.uint8]:
    """An image (h, w, 3) of a frame by a camera, such as an undistorted one, with the edges of `with_edges`."""
    pose = sequence.true_cam_from_world(frame)
    limit = 4 * max(camera.width, camera.height)
    eye_m = pose.inverse().translation
    for a, b in seen_parts(sequence.structure, eye_m, sequence.structure.edge_segments):
        points = pose.transform(np.linspace(a, b, PIECES))
        points = points[points[:, 2] > NEAR_M]
        rays = np.abs(points[:, :2] / points[:, 2:])
        points = points[(rays < 3).all(axis=1)]
        points = points[camera.before_fold(points)]
        if len(points) < 2:
            continue
        pixels = np.clip(camera.project(points), -limit, limit)
        cv2.polylines(image, [np.rint(pixels * 16).astype(np.int32)], False, GREEN, 1, cv2.LINE_AA, 4)
    return image


def _write(image: NDArray[np.uint8], text: str, at_px: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(image, text, at_px, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
