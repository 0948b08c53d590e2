"""Annotations of a frame: depth, instance mask, visible edges of the model, and row poses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.edges.contrast_kernels import find_contrasts
from uavbench.scenes.dataset.edges.edge_lines import edge_lines
from uavbench.scenes.dataset.edges.sample_kernels import (
    clip_edges,
    join_seen,
    project,
    sample_edges,
    see,
)
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, EDGE_COLUMNS, Sequence
from uavbench.scenes.dataset.surfaces.depth_kernels import depth_rows
from uavbench.scenes.dataset.table_files import read_numbers
from uavbench.scenes.effects.exposure import row_knots
from uavbench.scenes.image_files import put_file
from uavbench.scenes.png.encoder import png, png_of_filtered
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, View
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose


def write_depth(folder: Path, frame: int, depth_m: NDArray[np.float32]) -> None:
    """Write `depth/NNNNNN.png`: along the optical axis at the frame's stamp, 16 bits of DEPTH_M_PER_UNIT metres."""
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    height, width = depth.shape
    codes, filtered = np.empty((2, width), dtype=np.uint16), np.empty((height, 1 + 2 * width), dtype=np.uint8)
    depth_rows(depth, DEPTH_M_PER_UNIT, codes, filtered)
    put_file(folder / "depth" / f"{frame:06d}.png", png_of_filtered(filtered, width, smooth=True))


def write_mask(folder: Path, frame: int, instances: NDArray[np.uint8]) -> None:
    """Write `mask/NNNNNN.png`: 1 structure, 2 plants, 3 people, 4 birds, 10 and up lookalikes, 0 everything else."""
    put_file(folder / "mask" / f"{frame:06d}.png", png(instances, smooth=True))


def write_edges(
    folder: Path, frame: int, source: CameraSimulator, view: View, structure: Structure, image: NDArray[np.uint8]
) -> None:
    """Write `edges/NNNNNN.csv`: each visible part of each edge, with its ends, share of the edge, and contrast."""
    rows = visible_edges(structure, source, view, image)
    header = (",".join(EDGE_COLUMNS) + "\n").encode()
    put_file(folder / "edges" / f"{frame:06d}.csv", header + edge_lines(rows))


def visible_edges(structure: Structure, source: CameraSimulator, view: View, image: NDArray[np.uint8]) -> Array:
    """Visible parts (n, 7) of the model's edges in a view, columns as EDGE_COLUMNS.

    A part is visible where it is inside the image and not occluded in the depth image of the view (tolerance 1 %, over
    the adjacent pixels). visible_share is its fraction of the edge's length in metres; contrast the mean difference of
    grey levels SIDE_PX to its left and right.
    """
    pinhole, camera = source.pinhole, source.camera
    ends = view.cam_from_world.transform(structure.edge_segments.reshape(-1, 3)).reshape(-1, 2, 3)
    which, share, points = _samples(ends, pinhole)
    pixels = _pixels(points, camera)
    seen = np.empty(len(points), dtype=np.bool_)
    see(points, _intrinsics(pinhole), view.depth, pixels, (camera.width, camera.height), seen)
    return _stretches(which, share, pixels, seen, _contrast(pixels, which, seen, image))


class EdgeSamples(NamedTuple):
    """Samples (n,) of edges: the edge, the place along it (0..1), and the point (n, 3)."""

    edge: NDArray[np.int64]
    share: Array
    points: Array


def _samples(ends: Array, pinhole: Camera) -> EdgeSamples:
    """Samples STEP_PX apart in the image on the parts of edges (n, 2, 3) inside the view frustum."""
    shares, counts = np.empty((len(ends), 2)), np.empty(len(ends), dtype=np.int64)
    total = clip_edges(ends, _intrinsics(pinhole), (pinhole.width, pinhole.height), shares, counts)
    samples = EdgeSamples(np.empty(total, dtype=np.int64), np.empty(total), np.empty((total, 3)))
    sample_edges(ends, shares, counts, *samples)
    return samples


def _pixels(points: Array, camera: Camera) -> Array:
    """Pixels (n, 2) of points (n, 3) in the camera frame."""
    if camera.distortion_model != "none":
        return camera.project(points) if len(points) else np.zeros((0, 2))
    pixels = np.empty((len(points), 2))
    project(points, _intrinsics(camera), pixels)
    return pixels


def _intrinsics(camera: Camera) -> tuple[float, float, float, float]:
    return float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)


def _contrast(pixels: Array, which: NDArray[np.int64], seen: NDArray[np.bool_], image: NDArray[np.uint8]) -> Array:
    """Difference (n,) of grey levels across the edge at each sample, 0 where it is not visible."""
    out = np.empty(len(pixels))
    find_contrasts(pixels, which, seen, np.ascontiguousarray(image), out)
    return out


def _stretches(
    which: NDArray[np.int64], share: Array, pixels: Array, seen: NDArray[np.bool_], contrast: Array
) -> Array:
    """Runs of at least two visible samples of one edge, as rows of EDGE_COLUMNS."""
    parts = np.empty((len(which) // 2, len(EDGE_COLUMNS)))
    return parts[: join_seen(which, share, pixels, seen, contrast, parts)]


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
    depth_m = sequence[frame].depth_m
    if depth_m is None:
        raise UserError(f'{sequence.folder}: was rendered without annotations = ["depth"]; render it with it')
    return depth_m


def load_edges(sequence: Sequence, frame: int) -> Array:
    """Visible edges (n, 7) of a frame, columns as EDGE_COLUMNS."""
    return read_numbers(edges_file(sequence, frame), EDGE_COLUMNS)


def as_camera(source: CameraSimulator, image: NDArray[Any]) -> NDArray[Any]:
    """Image of the pinhole cropped to the camera without distortion, whose pixels are some of the pinhole's."""
    if source.lens is None:
        return image
    column, row = (np.rint(source.lens[..., k]).astype(int) for k in (0, 1))
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)])
