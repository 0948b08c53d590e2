"""Annotations of a frame: depth, instance mask, visible edges of the model, and row poses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, EDGE_COLUMNS, Sequence
from uavbench.scenes.dataset.table_files import read_numbers
from uavbench.scenes.effects.exposure import row_knots
from uavbench.scenes.image_files import load_image
from uavbench.scenes.png.encoder import png
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, View, sample
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Array, Pose

STEP_PX = 2.0
NEAR_M = 0.02
"""Near plane, metres: nearer parts of an edge are ignored."""
SIDE_PX = 2.5
"""Distance on either side of an edge at which its contrast is measured, px."""


def write_depth(folder: Path, frame: int, source: CameraSimulator, view: View) -> None:
    """Write `depth/NNNNNN.png`: along the optical axis at the frame's stamp, 16 bits of DEPTH_M_PER_UNIT metres."""
    units = np.rint(_as_camera(source, view.depth) / DEPTH_M_PER_UNIT)
    units[units > 65535] = 0
    _write(folder / "depth" / f"{frame:06d}.png", units.astype(np.uint16))


def write_mask(folder: Path, frame: int, source: CameraSimulator, view: View) -> None:
    """Write `mask/NNNNNN.png`: 1 structure, 2 plants, 3 people, 4 birds, 10 and up lookalikes, 0 everything else."""
    _write(folder / "mask" / f"{frame:06d}.png", _as_camera(source, view.instances))


def write_edges(
    folder: Path, frame: int, source: CameraSimulator, view: View, structure: Structure, image: NDArray[np.uint8]
) -> None:
    """Write `edges/NNNNNN.csv`: each visible part of each edge, with its ends, share of the edge, and contrast."""
    rows = visible_edges(structure, source, view, image)
    lines = [",".join(EDGE_COLUMNS)]
    lines += [f"{int(r[0])}," + ",".join(f"{value:.4f}" for value in r[1:]) for r in rows.tolist()]
    path = folder / "edges" / f"{frame:06d}.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def visible_edges(structure: Structure, source: CameraSimulator, view: View, image: NDArray[np.uint8]) -> Array:
    """Visible parts (n, 7) of the model's edges in a view, columns as EDGE_COLUMNS.

    A part is visible where it is inside the image and not occluded in the depth image of the view (tolerance 1 %, over
    the adjacent pixels). visible_share is its fraction of the edge's length in metres; contrast the mean difference of
    grey levels SIDE_PX to its left and right.
    """
    pinhole = source.pinhole
    ends = view.cam_from_world.transform(structure.edge_segments.reshape(-1, 3)).reshape(-1, 2, 3)
    which, share, points = _samples(ends, pinhole)
    column, row = np.rint(_projected(points, pinhole)).astype(int).T
    h, w = view.depth.shape
    column, row = column.clip(0, w - 1), row.clip(0, h - 1)
    behind = np.where(view.depth > 0, view.depth, np.float32(1e9))
    furthest = np.asarray(cv2.dilate(behind, np.ones((3, 3), dtype=np.uint8)))
    seen = points[:, 2] <= 1.01 * furthest[row, column] + 1e-3
    pixels = source.camera.project(points) if len(points) else np.zeros((0, 2))
    seen &= ((pixels >= -0.5) & (pixels <= [source.camera.width - 0.5, source.camera.height - 0.5])).all(axis=1)
    return _stretches(which, share, pixels, seen, _contrast(pixels, which, seen, image))


class EdgeSamples(NamedTuple):
    """Samples (n,) of edges: the edge, the place along it (0..1), and the point (n, 3)."""

    edge: NDArray[np.int64]
    share: Array
    points: Array


def _samples(ends: Array, pinhole: Camera) -> EdgeSamples:
    """Samples STEP_PX apart in the image on the parts of edges (n, 2, 3) inside the view frustum."""
    begin, end = _within(ends, pinhole)
    kept = np.flatnonzero(begin < end)
    from_end = [ends[kept, 0] + t[kept, None] * (ends[kept, 1] - ends[kept, 0]) for t in (begin, end)]
    a, b = (_projected(points, pinhole) for points in from_end)
    count = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / STEP_PX).astype(int) + 1, 3)
    row = np.repeat(np.arange(len(kept)), count)
    first = np.cumsum(count) - count
    even = (np.arange(len(row)) - first[row]) / (count[row] - 1)
    near, far = (points[row, 2] for points in from_end)
    along = even * near / (even * near + (1 - even) * far)  # perspective: even steps in the image are uneven in space
    points = from_end[0][row] + along[:, None] * (from_end[1] - from_end[0])[row]
    return EdgeSamples(kept[row], begin[kept][row] + along * (end - begin)[kept][row], points)


class SharesInView(NamedTuple):
    """Parameters (n,) along edges, 0..1, at which they enter and leave the view frustum."""

    begin: Array
    end: Array


def _within(ends: Array, pinhole: Camera) -> SharesInView:
    """Clip edges (n, 2, 3) in the camera frame against the view frustum (Liang & Barsky 1984).

    Not shared with the trackers' `geometry_kernels.clip_segment`, whose rounding would change the bytes of edges/*.csv.
    """
    x, y, z = (ends[..., k] for k in range(3))
    u, v = x * pinhole.fx + z * pinhole.cx, y * pinhole.fy + z * pinhole.cy
    inward = [z - NEAR_M, u + 0.5 * z, (pinhole.width - 0.5) * z - u, v + 0.5 * z, (pinhole.height - 0.5) * z - v]
    begin, end = np.zeros(len(ends)), np.ones(len(ends))
    for side in inward:
        start, stop = side.T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = start / (start - stop)
        begin = np.where((start < 0) & (stop >= 0), np.maximum(begin, crossing), begin)
        end = np.where((start >= 0) & (stop < 0), np.minimum(end, crossing), end)
        end = np.where((start < 0) & (stop < 0), 0.0, end)
    return SharesInView(begin, end)


def _projected(points: Array, pinhole: Camera) -> Array:
    return np.asarray(points[:, :2] / points[:, 2:] * [pinhole.fx, pinhole.fy] + [pinhole.cx, pinhole.cy])


def _contrast(pixels: Array, which: NDArray[np.int64], seen: NDArray[np.bool_], image: NDArray[np.uint8]) -> Array:
    """Difference (n,) of grey levels across the edge at each sample, 0 where it is not visible."""
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.float32)
    along = np.zeros_like(pixels)
    same = which[1:] == which[:-1]
    along[:-1][same] = (pixels[1:] - pixels[:-1])[same]
    along[1:][same] += (pixels[1:] - pixels[:-1])[same]
    norm = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.divide(along[:, ::-1] * [-1, 1], norm, out=np.zeros_like(along), where=norm > 1e-9)
    out = np.zeros(len(pixels))
    if seen.any():
        sides = [
            sample(grey, (pixels[seen] + sign * SIDE_PX * across[seen]).astype(np.float32)[None])[0] for sign in (1, -1)
        ]
        out[seen] = np.abs(sides[0] - sides[1])
    return out


def _stretches(
    which: NDArray[np.int64], share: Array, pixels: Array, seen: NDArray[np.bool_], contrast: Array
) -> Array:
    """Runs of at least two visible samples of one edge, as rows of EDGE_COLUMNS."""
    joined = seen[1:] & seen[:-1] & (which[1:] == which[:-1])
    starts = np.flatnonzero(joined & ~np.concatenate([[False], joined[:-1]]))
    stops = np.flatnonzero(joined & ~np.concatenate([joined[1:], [False]])) + 1
    total = np.concatenate([[0.0], np.cumsum(contrast)])
    mean = (total[stops + 1] - total[starts]) / (stops + 1 - starts)
    return np.column_stack([which[starts], pixels[starts], pixels[stops], share[stops] - share[starts], mean])


def row_poses(source: CameraSimulator, world_from_body: Callable[[int], Pose], stamp_ns: int) -> Array:
    """Pose `world_from_body` (h, 7) of each row of a rolling shutter: px py pz qw qx qy qz.

    Interpolated between 17 rows, as the images are.
    """
    height = source.camera.height
    knots, share = row_knots(height)
    late = [round((k - (height - 1) / 2) * source.row_delay_ns) for k in knots]
    poses = [world_from_body(stamp_ns + ns) for ns in late]
    quaternions = np.array([pose.quaternion_wxyz for pose in poses])
    quaternions *= np.where(quaternions @ quaternions[0] < 0, -1.0, 1.0)[:, None]
    turned = share @ quaternions
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return np.column_stack([share @ np.array([pose.translation for pose in poses]), turned])


def edges_file(sequence: Sequence, frame: int) -> Path:
    """Path of the edge file of a frame, as written by `write_edges`."""
    return sequence.folder / "edges" / f"{frame:06d}.csv"


def read_depth(sequence: Sequence, frame: int) -> Array:
    """Depth (h, w) of a frame along the optical axis in metres, 0 for the background."""
    path = sequence.folder / "depth" / f"{frame:06d}.png"
    image = load_image(path, cv2.IMREAD_UNCHANGED, inside=sequence.folder)
    return np.asarray(image, dtype=np.float64) * float(sequence.info.get("depth_m_per_unit", DEPTH_M_PER_UNIT))


def load_edges(sequence: Sequence, frame: int) -> Array:
    """Visible edges (n, 7) of a frame, columns as EDGE_COLUMNS."""
    return read_numbers(edges_file(sequence, frame), EDGE_COLUMNS)


def _as_camera(source: CameraSimulator, image: NDArray[Any]) -> NDArray[Any]:
    """Image of the pinhole resampled to the distorted camera, nearest neighbour."""
    if source.lens is None:
        return image
    column, row = (np.rint(source.lens[..., k]).astype(int) for k in (0, 1))
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)])


def _write(path: Path, image: NDArray[Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png(image, smooth=True))
