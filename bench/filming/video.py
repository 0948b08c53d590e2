"""Video of a flight in closed loop: camera images with the tracker's overlay, beside a view from outside.

The frames are rendered again at the true poses of the flight with every effect of its sequence, because a flight
stores no images.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from uavbench.bench.closed_loop.eye import eye, mount_along
from uavbench.bench.filming.files import MARKER, VIDEO
from uavbench.bench.filming.outside_view import OutsideView
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.figures.space import limits
from uavbench.reports.figures.tracker_pictures import View, draw, write_text_on
from uavbench.scenes.image_files import begin_video, finish_video
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.pose import rotation_from_quaternion
from uavbench.trajectories.trajectory import Trajectory

CODEC = "VP80"
"""Codec that every browser plays and OpenCV's wheels include."""
OUTSIDE_PX = (640, 480)
"""Width and height of the view from outside."""
ARM_PART = 0.035
"""Length of a drawn vehicle's arm, as a fraction of its depth: arms of true length would be too small to see."""
PLANNED, TRUE, ESTIMATED, LOST = (0, 179, 158), (17, 17, 17), (200, 90, 44), (103, 34, 232)
"""Colours, BGR, as in the figures of flights."""


def write_video(
    spec: SequenceSpec, flight: Path, folder: Path, content_hash: str, on_step: Callable[[int, int], None]
) -> None:
    """Write VIDEO and MARKER, which holds the content hash, into a folder; `flight` is the folder of the flight.

    on_step(frames done, all) reports progress. UserError when the flight has no frames or its files cannot be read, the
    folder holds something else, or OpenCV cannot write the codec; OSError when the disk is full.
    """
    flown = Flown.load(flight)
    frames = flown.results.stamps_ns.tolist()
    if not frames:
        raise UserError(f"{flight}: the flight ended before its first frame; there are no images for a video")
    outside = Outside.of(spec, flown)
    way = Trajectory(flown.path.stamps_ns, flown.path.group("true_p_m"), flown.path.group("true_q"))
    rate_hz = float(flown.record["rate_hz"])
    height = OUTSIDE_PX[1]
    scene = build_scene(spec)
    mount = mount_along(spec, scene, way) if flown.mounts is None else flown.mounts.at
    with eye(spec, scene, way, mount) as source, new_folder(folder, MARKER) as new:
        width = round(source.camera.width * height / source.camera.height / 2) * 2
        size = (width + OUTSIDE_PX[0], height)
        with standard_error_to_nothing():  # WebM has no codec tags, of which OpenCV warns whatever the codec
            writer = begin_video(new / VIDEO, CODEC, rate_hz, size)
        flown_blind = np.zeros((source.camera.height, source.camera.width, 3), dtype=np.uint8)
        try:
            for frame, stamp_ns in enumerate(frames):
                light = source.image(stamp_ns)
                image = flown_blind if light is None else encode(light)
                overlaid = with_overlay(flown, frame, image)
                seen = np.asarray(cv2.resize(overlaid, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
                write_caption(flown, frame, seen)
                writer.write(np.hstack([seen, outside.at(frame)]))
                on_step(frame + 1, len(frames))
            finish_video(writer, new / VIDEO, len(frames))
        finally:
            writer.release()
        write_text(new / MARKER.name, json.dumps({"content_hash": content_hash}) + "\n")


@contextmanager
def standard_error_to_nothing() -> Iterator[None]:
    """Discard what this process writes to file descriptor 2 in the context, by native libraries, too."""
    sys.stderr.flush()
    kept = os.dup(2)
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def with_overlay(flown: Flown, frame: int, image: Image) -> Image:
    """A frame (h, w, 3) BGR with the edges projected at the tracker's pose; frame: index among those of the flight."""
    return View.of(image, flown.camera, flown.structure).overlay(flown.results.rows[frame].cam_from_world)


def write_caption(flown: Flown, frame: int, canvas: Image) -> None:
    """Write run, time, errors of path and estimate in cm, and status at a frame on an image (h, w, 3) BGR."""
    result, path = flown.results.rows[frame], flown.path
    row = row_at(flown, frame)
    error_cm = 100 * np.linalg.norm(path.group("true_p_m")[row] - path.group("planned_p_m")[row])
    words = f"{flown.record['run']}  {path.seconds[row]:.1f} s  off its path {error_cm:.1f} cm"
    estimate_cm = 100 * np.linalg.norm(path.group("true_p_m")[row] - path.group("estimated_p_m")[row])
    if np.isfinite(estimate_cm):
        words += f"  estimate {estimate_cm:.1f} cm"
    words += "" if result.status == "ok" else f"  {result.status.upper().replace('_', ' ')}"
    write_text_on(canvas, words, (255, 255, 255) if result.status == "ok" else (120, 120, 255))


def ending_of(flown: Flown) -> str:
    """How a flight ended, in words."""
    flight, loop = flown.record["flight"], flown.record["loop"]
    off_m = np.linalg.norm(flown.path.group("true_p_m") - flown.path.group("planned_p_m"), axis=1).max()
    if flight["status"] == "completed" and off_m > loop["corridor_m"]:
        return f"completed, but up to {off_m:.2f} m off its path"
    return f"{flight['status']}{': ' if flight['why'] else ''}{flight['why']}"


def row_at(flown: Flown, frame: int) -> int:
    """Index of the first row of path.csv at or after a frame's stamp."""
    stamps = flown.path.stamps_ns
    return min(int(np.searchsorted(stamps, flown.results.stamps_ns[frame])), len(stamps) - 1)


@dataclass(frozen=True, eq=False)
class Outside:
    """A flight seen from outside, drawn frame by frame."""

    flown: Flown
    view: OutsideView

    @classmethod
    def of(cls, spec: SequenceSpec, flown: Flown) -> "Outside":
        """The view that contains a whole flight, with the planned path drawn."""
        path = flown.path.group("true_p_m")
        extent = limits(flown.structure, np.vstack([path, flown.plan[:, 1:4]]))
        view = OutsideView.of(spec, extent, OUTSIDE_PX)
        view.line(flown.plan[:, 1:4], PLANNED, 2)
        return cls(flown, view)

    def at(self, frame: int) -> Image:
        """View (h, w, 3) BGR at a frame: paths flown and estimated so far, and the vehicle.

        Frames must be asked for in their order: each call draws the paths since the previous frame.
        """
        path, row = self.flown.path, row_at(self.flown, frame)
        since = row_at(self.flown, frame - 1) if frame else 0
        self.view.line(path.group("true_p_m")[since : row + 1], TRUE, 2)
        self.view.line(path.group("estimated_p_m")[since : row + 1], ESTIMATED, 1)
        if not self.flown.results.ok[frame]:
            place = self.view.pixels(self.flown.groundtruth.positions_m[frame : frame + 1])
            for x, y in place[np.isfinite(place).all(axis=1)].tolist():
                cv2.circle(self.view.seen, (round(x), round(y)), 3, LOST, -1, cv2.LINE_AA)
        canvas = self.view.seen.copy()
        self._draw_vehicle(canvas, row)
        last = frame == len(self.flown.results) - 1
        words = "planned (green), true (black), estimated (blue), lost (red)"
        write_text_on(canvas, ending_of(self.flown) if last else words)
        return canvas

    def _draw_vehicle(self, canvas: Image, row: int) -> None:
        """Draw the four arms, the direction of the nose, and where a camera on a gimbal looks."""
        place = self.flown.path.group("true_p_m")[row]
        R = rotation_from_quaternion(self.flown.path.group("true_q")[row])
        arm = ARM_PART * float(self.view.cam_from_world.transform(place[None])[0, 2])
        tips = place + arm * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1.4, 0, 0]]) / np.sqrt(2) @ R.T
        ends = self.view.camera.project(self.view.cam_from_world.transform(np.vstack([place, tips])))
        for tip in ends[1:]:
            draw(canvas, np.array([[ends[0], tip]]), TRUE, 3)
        if self.flown.mounts is not None:
            ahead = R @ self.flown.cam_from_body(row).rotation[2]
            sight = self.view.cam_from_world.transform(np.array([place, place + 2 * arm * ahead]))
            draw(canvas, self.view.camera.project(sight)[None], TRUE, 1)
        for tip in ends[1:5]:
            cv2.circle(canvas, (round(tip[0]), round(tip[1])), 4, TRUE, 1, cv2.LINE_AA)
