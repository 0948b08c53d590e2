"""The video of a flight in closed loop: what the camera sees with what the tracker says, beside the view from outside.

The frames are rendered again, at the true poses of the flight and with every effect of its sequence: a flight keeps
none.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.eye import eye
from uavbench.bench.filming.files import MARKER, VIDEO
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.figures.space import limits
from uavbench.reports.figures.tracker_pictures import View, draw, write_text_on
from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.camera_simulator import light_of
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.world.studio import Studio
from uavbench.tracker.protocol import Image
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.pose import Array, Pose, rotation_from_quaternion
from uavbench.trajectories.trajectory import Trajectory

CODEC = "VP80"
"""It plays in every browser, and comes with OpenCV's wheels."""
OUTSIDE_PX, OUTSIDE_DEG = (640, 480), 45.0
"""Size and field of view of the view from outside."""
FROM_DEG, ABOVE_DEG = -62.0, 28.0
"""Where it looks from, as in the figures of flights."""
BACKDROP = 0.55
"""Linear light behind the structure: light lines and dark ones both show on it."""
GRID_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Widths of the grid on the floor; the smallest that makes no more than GRID_LINES lines."""
GRID_LINES = 24
ARM_PART = 0.035
"""Length of a drawn vehicle's arm, in parts of the distance to it: small ones would not be seen."""
NEAR_M = 0.05
"""Nothing nearer to the camera is drawn."""
HIDDEN_PART = 0.01
"""A point is hidden by what is nearer by more than this part of its distance."""
PLANNED, TRUE, ESTIMATED, LOST, GRID = (0, 179, 158), (17, 17, 17), (200, 90, 44), (103, 34, 232), (150, 150, 150)
"""Colours, BGR, as in the figures of flights."""


def write_video(
    spec: SequenceSpec, flight: Path, folder: Path, content_hash: str, on_step: Callable[[int, int], None]
) -> None:
    """Write VIDEO of a flight of a sequence, `flight` its folder, and MARKER, which carries the hash, into a folder.

    on_step(frames done, all) tells progress. UserError when the flight has no frames, or OpenCV cannot write the codec.
    """
    flown = Flown.load(flight)
    frames = flown.results.stamps_ns.tolist()
    if not frames:
        raise UserError(f"{flight}: the flight ended before its first frame; there is nothing to show")
    outside = Outside.of(spec, flown)
    way = Trajectory(flown.path.stamps_ns, flown.path.group("true_p_m"), flown.path.group("true_q"))
    rate_hz = float(flown.record["rate_hz"])
    height = OUTSIDE_PX[1]
    with eye(spec, build_scene(spec), way) as source, new_folder(folder, MARKER) as new:
        width = round(source.camera.width * height / source.camera.height / 2) * 2
        size = (width + OUTSIDE_PX[0], height)
        writer = cv2.VideoWriter(str(new / VIDEO), cv2.VideoWriter.fourcc(*CODEC), rate_hz, size)
        if not writer.isOpened():
            raise UserError(f"{folder}: this build of OpenCV cannot write {CODEC}; install opencv-python-headless")
        flown_blind = np.zeros((source.camera.height, source.camera.width, 3), dtype=np.uint8)
        try:
            for frame, stamp_ns in enumerate(frames):
                light = source.image(stamp_ns)
                image = flown_blind if light is None else encode(light)
                seen = cv2.resize(with_overlay(flown, frame, image), (width, height), interpolation=cv2.INTER_AREA)
                writer.write(np.hstack([seen, outside.at(frame)]))
                on_step(frame + 1, len(frames))
        finally:
            writer.release()
        write_text(new / MARKER, json.dumps({"content_hash": content_hash}) + "\n")


def with_overlay(flown: Flown, frame: int, image: Image) -> Image:
    """A frame with the structure's edges where the tracker believes them, and what it was worth."""
    result, path = flown.results.rows[frame], flown.path
    canvas = View.of(image, flown.camera, flown.structure).overlay(result.cam_from_world)
    row = row_at(flown, frame)
    error_cm = 100 * np.linalg.norm(path.group("true_p_m")[row] - path.group("planned_p_m")[row])
    words = f"{flown.record['run']}  {path.seconds[row]:.1f} s  off its path {error_cm:.1f} cm"
    estimate_cm = 100 * np.linalg.norm(path.group("true_p_m")[row] - path.group("estimated_p_m")[row])
    if np.isfinite(estimate_cm):
        words += f"  estimate {estimate_cm:.1f} cm"
    words += "" if result.status == "ok" else f"  {result.status.upper().replace('_', ' ')}"
    write_text_on(canvas, words, (255, 255, 255) if result.status == "ok" else (120, 120, 255))
    return canvas


def row_at(flown: Flown, frame: int) -> int:
    """Row of path.csv at a frame."""
    stamps = flown.path.stamps_ns
    return min(int(np.searchsorted(stamps, flown.results.stamps_ns[frame])), len(stamps) - 1)


@dataclass(frozen=True, eq=False)
class Outside:
    """The view from outside: its camera, what it has seen so far, and the distance (h, w) of each pixel."""

    flown: Flown
    camera: Camera
    cam_from_world: Pose
    seen: Image
    depth_m: NDArray[np.float32]

    @classmethod
    def of(cls, spec: SequenceSpec, flown: Flown) -> "Outside":
        """The view of all of a flight."""
        path = flown.path.group("true_p_m")
        low, high = limits(flown.structure, np.vstack([path, flown.plan[:, 1:4]]))
        camera = Camera.from_field_of_view(*OUTSIDE_PX, OUTSIDE_DEG)
        pose = looking_at(low, high, camera)
        scene = build_scene(replace(spec, environment=Studio(backdrop=BACKDROP), clutter=(), effects=()))
        with scene.renderer(*OUTSIDE_PX) as renderer:
            background = encode(light_of(renderer.color(pose, camera)))
            depth_m, _ = renderer.geometry(pose, camera)
        view = cls(flown, camera, pose, background, np.where(depth_m > 0, depth_m, np.inf).astype(np.float32))
        for line in floor_grid(low, high):
            view.line(line, GRID, 1)
        view.line(flown.plan[:, 1:4], PLANNED, 2)
        return view

    def at(self, frame: int) -> Image:
        """The view at a frame, each in turn: the way flown and estimated since the one before, and the vehicle."""
        path, row = self.flown.path, row_at(self.flown, frame)
        since = row_at(self.flown, frame - 1) if frame else 0
        self.line(path.group("true_p_m")[since : row + 1], TRUE, 2)
        self.line(path.group("estimated_p_m")[since : row + 1], ESTIMATED, 1)
        if not self.flown.results.ok[frame]:
            place = self.pixels(self.flown.groundtruth.positions_m[frame : frame + 1])
            for x, y in place[np.isfinite(place).all(axis=1)].tolist():
                cv2.circle(self.seen, (round(x), round(y)), 3, LOST, -1, cv2.LINE_AA)
        canvas = self.seen.copy()
        self._draw_vehicle(canvas, row)
        ending = self.flown.record["flight"]
        words = "planned, true (black), estimated (blue)"
        if frame == len(self.flown.results) - 1:
            words = f"{ending['status']}{': ' if ending['why'] else ''}{ending['why']}"
        write_text_on(canvas, words)
        return canvas

    def pixels(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3); NaN for those that are hidden, out of view or unknown."""
        out = np.full((len(points), 2), np.nan)
        in_camera = self.cam_from_world.transform(np.nan_to_num(points, nan=np.inf))
        rows = np.flatnonzero(np.isfinite(in_camera).all(axis=1) & (in_camera[:, 2] > NEAR_M))
        pixels = self.camera.project(in_camera[rows])
        inside = ((pixels >= 0) & (pixels < np.array(OUTSIDE_PX) - 1)).all(axis=1)
        rows, pixels = rows[inside], pixels[inside]
        x, y = np.rint(pixels).astype(int).T
        seen = in_camera[rows, 2] <= self.depth_m[y, x] * (1 + HIDDEN_PART)
        out[rows[seen]] = pixels[seen]
        return out

    def line(self, points: Array, colour: tuple[int, int, int], thickness: int) -> None:
        """Draw what is not hidden of a line through points (n, 3)."""
        pixels = self.pixels(points)
        pieces = np.stack([pixels[:-1], pixels[1:]], axis=1)
        draw(self.seen, pieces[np.isfinite(pieces).all(axis=(1, 2))], colour, thickness)

    def _draw_vehicle(self, canvas: Image, row: int) -> None:
        """Four arms, and where the nose is."""
        place = self.flown.path.group("true_p_m")[row]
        R = rotation_from_quaternion(self.flown.path.group("true_q")[row])
        arm = ARM_PART * float(self.cam_from_world.transform(place[None])[0, 2])
        tips = place + arm * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1.4, 0, 0]]) / np.sqrt(2) @ R.T
        ends = self.camera.project(self.cam_from_world.transform(np.vstack([place, tips])))
        for tip in ends[1:]:
            draw(canvas, np.array([[ends[0], tip]]), TRUE, 3)
        for tip in ends[1:5]:
            cv2.circle(canvas, (round(tip[0]), round(tip[1])), 4, TRUE, 1, cv2.LINE_AA)


def looking_at(low: Array, high: Array, camera: Camera) -> Pose:
    """Camera pose from which all between two corners (3,) is in view."""
    azimuth, elevation = np.radians([FROM_DEG, ABOVE_DEG])
    ahead = -np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(ahead, right), ahead])
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    middle = (low + high) / 2
    across = (corners - middle) @ R.T
    half = np.array([camera.width / camera.fx, camera.height / camera.fy]) / 2
    back_m = float((np.abs(across[:, :2]) / half - across[:, 2:]).max())
    return Pose(R, -R @ (middle - 1.05 * back_m * ahead))


def floor_grid(low: Array, high: Array) -> list[Array]:
    """Lines (n, 3) of a grid on the floor."""
    width = next((w for w in GRID_M if np.ceil((high - low)[:2] / w).sum() <= GRID_LINES), GRID_M[-1])
    xs, ys = (np.arange(np.floor(low[k] / width), np.ceil(high[k] / width) + 1) * width for k in range(2))
    along_x = [np.column_stack([np.linspace(xs[0], xs[-1], 60), np.full(60, y), np.zeros(60)]) for y in ys]
    along_y = [np.column_stack([np.full(60, x), np.linspace(ys[0], ys[-1], 60), np.zeros(60)]) for x in xs]
    return along_x + along_y
