"""A small test sequence drawn without the renderer, and results on it."""

import json
from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.ground_truth_files import GROUND_TRUTH_COLUMNS
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, TrackResult
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.results import Results
from uavbench.tracker.run import make_record, stride, track_sequence
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

CAM_FROM_BODY = Pose(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros(3))
SIZE_M = np.array([0.6, 0.4, 0.5])
RATE_HZ = 15


def box() -> Structure:
    """A box of SIZE_M on the ground, centred at the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * SIZE_M
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Structure.from_mesh(corners, np.array(triangles))


def looking_at_box(seconds: float) -> Pose:
    """world_from_body at a time in s on an arc around the box, camera pointed near its middle."""
    turn = 0.35 * seconds + 0.6
    eye = np.array([1.25 * np.cos(turn), 1.25 * np.sin(turn), 0.55 + 0.08 * np.sin(1.3 * seconds)])
    forward = np.array([0.03 * np.sin(seconds), 0.0, 0.25]) - eye
    forward /= np.linalg.norm(forward)
    left = np.cross([0, 0, 1.0], forward)
    left /= np.linalg.norm(left)
    return Pose(np.column_stack([forward, left, np.cross(forward, left)]), eye)


def draw(structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Image:
    """BGR image (h, w, 3) uint8 of a convex structure, each face of one brightness, with Gaussian noise."""
    image = np.full((camera.height, camera.width, 3), (96, 92, 88), np.uint8)
    eye = cam_from_world.inverse().translation
    greys = np.linspace(70, 235, len(structure.face_normals))
    for triangle, face in zip(structure.triangles, structure.triangle_face, strict=True):
        corners = structure.vertices[triangle]
        if structure.face_normals[face] @ (corners[0] - eye) < 0:
            pixels = camera.project(cam_from_world.transform(corners))
            shade = tuple(float(greys[face] * k) for k in (0.75, 0.9, 1.0))
            cv2.fillConvexPoly(image, np.round(pixels * 16).astype(np.int32), shade, cv2.LINE_AA, 4)
    noisy = cv2.GaussianBlur(image, (3, 3), 0.7) + rng.normal(0, 2.0, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def make_sequence(folder: Path, frames: int, name: str = "arc", seed: int = 0) -> Sequence:
    """Write and load a sequence of a drawn box, 320 x 240 px at RATE_HZ; `folder` must not exist."""
    camera, structure = Camera.from_field_of_view(320, 240, 70.0), box()
    (folder / "frames").mkdir(parents=True)
    camera.save(folder / "camera.toml")
    save_structure(structure, folder)
    stamps = [i * 1_000_000_000 // RATE_HZ for i in range(frames)]
    rng = stream(seed, "noise", name)
    ground_truth, table = [], ["frame,stamp_ns,file"]
    for i, stamp in enumerate(stamps):
        world_from_body = looking_at_box(stamp / 1e9 + 10 * seed)
        file = f"frames/{i:06d}.png"
        image = draw(structure, camera, CAM_FROM_BODY @ world_from_body.inverse(), rng)
        cv2.imwrite(str(folder / file), image)
        table.append(f"{i},{stamp},{file}")
        numbers = [*world_from_body.translation.tolist(), *world_from_body.quaternion_wxyz.tolist(), *[0.0] * 9]
        ground_truth.append(",".join(map(repr, [i, stamp, *numbers])))
    (folder / "frames.csv").write_text("\n".join(table) + "\n")
    (folder / "groundtruth.csv").write_text("\n".join([",".join(GROUND_TRUTH_COLUMNS), *ground_truth]) + "\n")
    info = {
        "name": name,
        "seed": seed,
        "rate_hz": RATE_HZ,
        "cam_from_body": CAM_FROM_BODY.matrix.tolist(),
        "content_hash": f"{name}-{seed}-{frames}",
        "versions": {},
    }
    (folder / "sequence.json").write_text(json.dumps(info))
    write_manifest(folder)
    return Sequence.load(folder)


def track(sequence: Sequence, kind: str, rate_hz: float, seed: int = 0) -> Results:
    """Results of a registered tracker with its default parameters."""
    return track_sequence(TRACKERS[kind](), sequence, rate_hz=rate_hz, seed=seed)


def results_of(sequence: Sequence, rows: list[TrackResult], rate_hz: float = RATE_HZ) -> Results:
    """Results with the given rows, recorded as those of the tracker `hold`."""
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz))[: len(rows)]
    record = make_record(TRACKERS["hold"](), sequence, rate_hz=rate_hz, seed=0, errors=[])
    return Results(record, frames, sequence.stamps_ns[frames], tuple(rows))


def true_rows(sequence: Sequence, offset_m: float = 0.0) -> list[TrackResult]:
    """Rows with the true poses, translated by offset_m along the camera's x axis; 10 ms and more per frame."""
    shift = Pose(np.eye(3), np.array([offset_m, 0, 0]))
    return [
        TrackResult(status="ok", cam_from_world=shift @ sequence.true_cam_from_world(i), stage_ms={"total": 10.0 + i})
        for i in range(len(sequence))
    ]
