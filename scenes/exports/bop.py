"""Sequences in the layout of BOP, the benchmark for 6D object pose estimation (Hodan et al. 2018)."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.shown_images import NUMBERED, STAMPS, Shown, png, write_stamps
from uavbench.scenes.rendering.pixel_kernels import fill_triangles
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array

DEPTH_SCALE = 1.0
"""Millimetres per unit of a depth image: 16 bits cover 65.5 m, the range of a sequence's own depth."""
LARGEST = 65535
"""Largest 16-bit value."""
NEAR_M = 0.01
"""Near plane of silhouettes, metres."""
CANVAS = 3
"""Ratio of the canvas for silhouettes to the image, per side, as in bop_toolkit's calc_gt_info."""
LEAST_TARGET_SHARE = 0.1
"""Visible share of the object from which a frame is a target of BOP's challenges (Hodan et al. 2018)."""


def export_bop(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """BOP layout: `models/`, and `test/000001/` with rgb, mask, depth and mask_visib (where there are any), poses.

    One object, number 1: the structure. Lengths in millimetres.
    """
    sequence = shown.sequence
    scene, models = folder / "test" / "000001", folder / "models"
    (scene / "rgb").mkdir(parents=True)
    models.mkdir()
    write_text(models / "obj_000001.ply", _ply_mm(sequence.structure.vertices, sequence.structure.triangles))
    write_text(models / "models_info.json", json.dumps({"1": _model_info(sequence)}) + "\n")
    c = shown.camera
    camera = {"cx": c.cx, "cy": c.cy, "depth_scale": DEPTH_SCALE, "fx": c.fx, "fy": c.fy} | {
        "height": c.height, "width": c.width,
    }  # fmt: skip
    write_text(folder / "camera.json", json.dumps(camera) + "\n")
    cameras, poses, infos, targets = {}, {}, {}, []
    for frame in range(len(sequence)):
        (scene / "rgb" / f"{frame:06d}.png").write_bytes(shown.png(frame))
        pose = sequence.true_cam_from_world(frame)
        R, t = pose.rotation.reshape(-1).tolist(), (1000 * pose.translation).tolist()
        K = c.K.reshape(-1).tolist()
        cameras[str(frame)] = {"cam_K": K, "depth_scale": DEPTH_SCALE, "cam_R_w2c": R, "cam_t_w2c": t}
        poses[str(frame)] = [{"cam_R_m2c": R, "cam_t_m2c": t, "obj_id": 1}]
        info = _write_images(shown, frame, scene)
        infos[str(frame)] = [info]
        if info.get("visib_fract", 1.0) >= LEAST_TARGET_SHARE and info["px_count_all"]:
            targets.append({"im_id": frame, "inst_count": 1, "obj_id": 1, "scene_id": 1})
        on_frame(frame + 1, len(sequence))
    write_stamps(scene, {f"{frame:06d}.png": stamp for frame, stamp in enumerate(sequence.stamps_ns.tolist())})
    for file, content in (("scene_camera", cameras), ("scene_gt", poses), ("scene_gt_info", infos)):
        write_text(scene / f"{file}.json", json.dumps(content, indent=1) + "\n")
    write_text(folder / "test_targets_bop19.json", json.dumps(targets, indent=1) + "\n")
    annotations = tuple(name for name in ("depth", "mask") if (sequence.folder / name).is_dir())
    return Held(files=FILES, frames={}, annotations=annotations, limits=_limits(annotations), readme="dataset_info.md")


FILES = {
    "models/": "the structure, object 1, millimetres; models_info.json: its bounds and diameter",
    "test/000001/rgb": "images by number",
    f"test/000001/{STAMPS}": "time stamp of each image",
    "test/000001/depth": f"depth along the optical axis, {DEPTH_SCALE:g} mm per unit; 0: none, or further than 65.5 m",
    "test/000001/mask": "silhouette of the model without occlusion, 255",
    "test/000001/mask_visib": "visible part of the structure, 255",
    "test/000001/scene_camera.json": "intrinsics and camera from world, millimetres, by image",
    "test/000001/scene_gt.json": "camera from model, millimetres, by image; model and world are the same frame",
    "test/000001/scene_gt_info.json": "boxes (from the centre of the first to that of the last pixel) and counts of "
    f"pixels; silhouettes on a canvas {CANVAS} times the image",
    "camera.json": "the camera without distortion, px",
    "test_targets_bop19.json": f"images in which {100 * LEAST_TARGET_SHARE:g} % of the silhouette is seen",
}


def _limits(annotations: tuple[str, ...]) -> tuple[str, ...]:
    lines = [NUMBERED]
    if "mask" not in annotations:
        lines.append(
            'Visible part: the sequence has no annotations = ["mask"], so there is no mask_visib/, and '
            "scene_gt_info.json has no bbox_visib, px_count_visib and visib_fract."
        )
    if "depth" not in annotations:
        lines.append(
            'Depth: the sequence has no annotations = ["depth"], so there is no depth/, and '
            "scene_gt_info.json has no px_count_valid."
        )
    return tuple(lines)


def _model_info(sequence: Sequence) -> dict[str, float]:
    low, high = 1000 * sequence.structure.bounds
    points = sequence.structure.vertices
    diameter = 1000 * float(np.max([np.linalg.norm(points - p, axis=1).max() for p in points]))
    info = {"diameter": diameter} | {f"min_{a}": float(low[k]) for k, a in enumerate("xyz")}
    return info | {f"size_{a}": float(high[k] - low[k]) for k, a in enumerate("xyz")}


def _ply_mm(vertices: Array, triangles: np.ndarray) -> str:
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {a}" for a in "xyz"]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in (1000 * vertices).tolist()]
    return "\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in triangles.tolist())]) + "\n"


def _write_images(shown: Shown, frame: int, scene: Path) -> dict[str, Any]:
    """Write masks and depth of a frame; its entry of scene_gt_info.json, without keys of missing annotations."""
    visible, depth = shown.mask(frame), shown.depth(frame)
    h, w = shown.camera.height, shown.camera.width
    whole = silhouette(shown.sequence, frame, shown.camera)
    inner = whole[(slice(h, 2 * h), slice(w, 2 * w))]  # a view into the canvas
    if visible is not None:
        inner |= visible  # the rendered border may extend a fraction of a pixel further
    _write_mask(scene / "mask" / f"{frame:06d}_000000.png", inner)
    box = _box(whole)
    info: dict[str, Any] = {"bbox_obj": [box[0] - w, box[1] - h, *box[2:]] if whole.any() else box}
    info["px_count_all"] = int(whole.sum())
    if depth is not None:
        units = np.rint(1000 * depth / DEPTH_SCALE)
        units[units > LARGEST] = 0  # beyond 16 bits: unknown, never wrapped
        (scene / "depth").mkdir(exist_ok=True)
        (scene / "depth" / f"{frame:06d}.png").write_bytes(png(units.astype(np.uint16)))
        info["px_count_valid"] = int((inner & (units > 0)).sum())
    if visible is not None:
        _write_mask(scene / "mask_visib" / f"{frame:06d}_000000.png", visible)
        share = int(visible.sum()) / info["px_count_all"] if info["px_count_all"] else 0.0
        info |= {"bbox_visib": _box(visible), "px_count_visib": int(visible.sum()), "visib_fract": share}
    return info


def silhouette(sequence: Sequence, frame: int, camera: Camera) -> NDArray[np.bool_]:
    """Silhouette of the model, on a canvas of CANVAS times the image, centred on it."""
    canvas = np.zeros((CANVAS * camera.height, CANVAS * camera.width), dtype=np.uint8)
    points = sequence.true_cam_from_world(frame).transform(sequence.structure.vertices)
    triangles = beyond(points[sequence.structure.triangles], NEAR_M)
    pixels = camera.project(triangles.reshape(-1, 3)).reshape(-1, 3, 2)
    fill_triangles(np.ascontiguousarray(pixels + np.array([camera.width, camera.height])), canvas)
    return canvas.astype(bool)


def beyond(triangles: Array, near_m: float) -> Array:
    """Triangles (n, 3, 3) clipped against the near plane z = near_m, as triangles."""
    ahead = (triangles[..., 2] >= near_m).sum(axis=1)
    out = [triangles[ahead == 3]]
    for triangle in triangles[(ahead > 0) & (ahead < 3)]:
        kept: list[Array] = []
        for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            if a[2] >= near_m:
                kept.append(a)
            if (a[2] >= near_m) != (b[2] >= near_m):
                kept.append(a + (near_m - a[2]) / (b[2] - a[2]) * (b - a))
        out.append(np.array([[kept[0], kept[k], kept[k + 1]] for k in range(1, len(kept) - 1)]).reshape(-1, 3, 3))
    return np.concatenate(out)


def _write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png(np.where(mask, 255, 0).astype(np.uint8)))


def _box(mask: np.ndarray) -> list[int]:
    """Bounding box x, y, width, height of a mask, from centre to centre as in bop_toolkit; -1s when it is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    return [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0]), int(rows[-1] - rows[0])]
