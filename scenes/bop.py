"""Sequences in the layout of BOP, the benchmark for 6D object pose estimation (Hodan et al. 2018)."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.frame_truth import read_depth
from scenes.images import load_image
from scenes.sequence import Sequence
from trajectories.files import write_text
from trajectories.pose import Array

DEPTH_SCALE = 0.1
"""Millimetres per unit of a depth image, for what is nearer than 6.5 m."""
FAR_DEPTH_SCALE = 2.0
"""The same for what is further away: 16 bits then reach to 131 m."""


def export_bop(sequence: Sequence, folder: Path, on_frame: Callable[[int, int], None]) -> None:
    """BOP layout: `models/`, and `test/000001/` with rgb, depth and mask (where the sequence has them) and truth.

    One object, number 1: the structure. Lengths in millimetres.
    """
    scene, models = folder / "test" / "000001", folder / "models"
    (scene / "rgb").mkdir(parents=True)
    models.mkdir()
    write_text(models / "obj_000001.ply", _ply_mm(sequence.structure.vertices, sequence.structure.triangles))
    low, high = 1000 * sequence.structure.bounds
    points = sequence.structure.vertices
    diameter = 1000 * float(np.max([np.linalg.norm(points - p, axis=1).max() for p in points]))
    info = {"diameter": diameter} | {f"min_{a}": float(low[k]) for k, a in enumerate("xyz")}
    info |= {f"size_{a}": float(high[k] - low[k]) for k, a in enumerate("xyz")}
    write_text(models / "models_info.json", json.dumps({"1": info}) + "\n")
    camera = {"cx": sequence.camera.cx, "cy": sequence.camera.cy, "depth_scale": 1.0, "fx": sequence.camera.fx,
              "fy": sequence.camera.fy, "height": sequence.camera.height, "width": sequence.camera.width}  # fmt: skip
    write_text(folder / "camera.json", json.dumps(camera) + "\n")
    cameras, poses, infos = {}, {}, {}
    for frame in range(len(sequence)):
        name = f"{frame:06d}"
        (scene / "rgb" / f"{name}.png").write_bytes(sequence.image_bytes(frame))
        scale = _bop_images(sequence, frame, scene)
        pose = sequence.true_cam_from_world(frame)
        R, t = pose.rotation.reshape(-1).tolist(), (1000 * pose.translation).tolist()
        cameras[str(frame)] = {
            "cam_K": sequence.camera.K.reshape(-1).tolist(),
            "depth_scale": scale,
            "cam_R_w2c": R,
            "cam_t_w2c": t,
        }
        poses[str(frame)] = [{"cam_R_m2c": R, "cam_t_m2c": t, "obj_id": 1}]
        infos[str(frame)] = [_bop_info(sequence, frame)]
        on_frame(frame + 1, len(sequence))
    for file, content in (("scene_camera", cameras), ("scene_gt", poses), ("scene_gt_info", infos)):
        write_text(scene / f"{file}.json", json.dumps(content, indent=1) + "\n")


def _ply_mm(vertices: Array, triangles: np.ndarray) -> str:
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {a}" for a in "xyz"]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in (1000 * vertices).tolist()]
    return "\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in triangles.tolist())]) + "\n"


def _bop_images(sequence: Sequence, frame: int, scene: Path) -> float:
    """Write depth and masks of a frame where there are any; millimetres per unit of its depth image."""
    name = f"{frame:06d}"
    shown = _mask(sequence, frame)
    if shown is not None:
        mask = 255 * shown.astype(np.uint8)
        (scene / "mask_visib").mkdir(exist_ok=True)
        cv2.imwrite(str(scene / "mask_visib" / f"{name}_000000.png"), mask)
    if not (sequence.folder / "depth" / f"{name}.png").is_file():
        return 1.0
    depth_mm = 1000 * read_depth(sequence, frame)
    scale = DEPTH_SCALE if depth_mm.max() < 65535 * DEPTH_SCALE else FAR_DEPTH_SCALE
    units = np.rint(depth_mm / scale)
    units[units > 65535] = 0  # further than 16 bits reach: unknown, never wrapped
    (scene / "depth").mkdir(exist_ok=True)
    cv2.imwrite(str(scene / "depth" / f"{name}.png"), units.astype(np.uint16))
    return scale


def _bop_info(sequence: Sequence, frame: int) -> dict[str, object]:
    """Boxes and pixel counts of the structure: projected outline, and what the mask shows of it."""
    camera, pose = sequence.camera, sequence.true_cam_from_world(frame)
    seen = np.zeros((camera.height, camera.width), dtype=np.uint8)
    points = pose.transform(sequence.structure.vertices)
    for triangle in points[sequence.structure.triangles]:
        if (triangle[:, 2] > 0.01).all():
            cv2.fillConvexPoly(seen, np.rint(camera.project(triangle)).astype(np.int32).clip(-30000, 30000), 1)
    mask = _mask(sequence, frame)
    visible = seen.astype(bool) if mask is None else mask
    total, shown = int(seen.sum()), int(visible.sum())
    return {
        "bbox_obj": _box(seen.astype(bool)),
        "bbox_visib": _box(visible),
        "px_count_all": total,
        "px_count_valid": total,
        "px_count_visib": shown,
        "visib_fract": min(1.0, shown / total) if total else 0.0,
    }


def _mask(sequence: Sequence, frame: int) -> NDArray[np.bool_] | None:
    """Where the structure is seen (h, w), None where the sequence has no masks."""
    path = sequence.folder / "mask" / f"{frame:06d}.png"
    return load_image(path, cv2.IMREAD_GRAYSCALE, inside=sequence.folder) == 1 if path.exists() else None


def _box(mask: np.ndarray) -> list[int]:
    """x, y, width, height of what is set; -1s when nothing is."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    return [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0] + 1), int(rows[-1] - rows[0] + 1)]
