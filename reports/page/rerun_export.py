"""Export of a run to a recording of the Rerun viewer (`.rrd`), with the extra `uavbench[rerun]`."""

import importlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.reports.figures.tracker_pictures import View
from uavbench.reports.page.overlay_animation import JPEG_QUALITY, scrubbed
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.tracker.results import evaluated_poses
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_file

CENTRE_PX = 0.5
"""Centre of the first pixel in Rerun (rerun-io/rerun#3896); here pixel centres lie at integer coordinates."""
TRUE, ESTIMATED = (255, 255, 255), (60, 220, 70)


def write_rrd(run: ScoredRun, path: Path) -> None:
    """Write structure, images, true and estimated cameras, model edges and errors of a run to an `.rrd` file.

    UserError when the extra is not installed, or an image cannot be read.
    """
    rr = _rerun()
    recording = rr.RecordingStream("uavbench", recording_id=run.slug)
    with new_file(path) as temporary:
        recording.save(str(temporary))
        _log_structure(rr, recording, run)
        for frame in scrubbed(len(run.sequence)):
            seconds = float(run.sequence.stamps_ns[frame] - run.sequence.stamps_ns[0]) / 1e9
            recording.set_time("time", duration=seconds)
            recording.set_time("frame", sequence=frame)
            _log_frame(rr, recording, run, frame)
        recording.flush()
        recording.disconnect()


def _log_structure(rr: Any, recording: Any, run: ScoredRun) -> None:
    structure, ground_truth = run.sequence.structure, evaluated_poses(run.sequence).positions_m
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    mesh = rr.Mesh3D(
        vertex_positions=structure.vertices, triangle_indices=structure.triangles, albedo_factor=(176, 150, 120)
    )
    recording.log("world/structure", mesh, static=True)
    recording.log("world/edges", rr.LineStrips3D(structure.edge_segments, colors=(90, 80, 70)), static=True)
    recording.log("world/path/ground_truth", rr.LineStrips3D([ground_truth], colors=TRUE), static=True)
    estimate = run.errors.tracked.estimate_m
    if len(estimate):
        recording.log("world/path/estimate", rr.LineStrips3D([estimate], colors=ESTIMATED), static=True)


def _log_frame(rr: Any, recording: Any, run: ScoredRun, frame: int) -> None:
    sequence = run.sequence
    camera, view = sequence.camera, View.of(sequence.image(frame), sequence.camera, sequence.structure)
    ground_truth, estimate = sequence.true_cam_from_world(frame), run.latest_pose[frame]
    K = camera.K
    K[:2, 2] += CENTRE_PX
    lens = rr.Pinhole(image_from_camera=K, resolution=[camera.width, camera.height], camera_xyz=rr.ViewCoordinates.RDF)
    for name, pose, colour in (("ground_truth", ground_truth, TRUE), ("estimate", estimate, ESTIMATED)):
        drawn = f"world/ground_truth/camera/model_{name}"
        if pose is None:
            recording.log(f"world/{name}", rr.Clear(recursive=True))
            recording.log(drawn, rr.Clear(recursive=True))
            continue
        at = pose.inverse()
        recording.log(f"world/{name}", rr.Transform3D(translation=at.translation, mat3x3=at.rotation))
        recording.log(f"world/{name}/camera", lens)
        recording.log(drawn, rr.LineStrips2D(list(view.projected(pose) + CENTRE_PX), colors=colour))
    jpeg = cv2.imencode(".jpg", view.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
    recording.log("world/ground_truth/camera", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
    row = int(np.searchsorted(run.errors.frames, frame, side="right")) - 1
    if row < 0:  # before the first frame that is scored
        return
    if run.errors.ok[row]:
        recording.log("error/position_cm", rr.Scalars(100 * float(run.errors.translation_m[row])))
        recording.log("error/rotation_deg", rr.Scalars(float(run.errors.angle_deg[row])))
    recording.log("error/success", rr.Scalars(float(run.errors.success[row])))


def _rerun() -> Any:
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise UserError(
            "writing .rrd needs the Rerun SDK, which is not installed: pip install 'uavbench[rerun]'"
        ) from None
