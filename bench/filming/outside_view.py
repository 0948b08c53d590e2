"""View of a structure from outside, with 3-D lines drawn on it that the structure occludes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.figures.tracker_pictures import draw
from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.camera_simulator import light_of
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.world.studio import Studio
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array, Pose

VIEW_DEG = 45.0
"""Horizontal field of view."""
FROM_DEG, ABOVE_DEG = -62.0, 28.0
"""Azimuth and elevation of the viewpoint, as in the figures of flights."""
BACKDROP = 0.55
"""Linear radiance of the background, against which bright and dark lines are both visible."""
GRID_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Candidate spacings of the floor grid; the smallest with at most GRID_LINES lines is used."""
GRID_LINES = 24
GRID = (150, 150, 150)
"""Colour of the grid lines, BGR."""
NEAR_M = 0.05
"""Near clipping distance of the lines."""
HIDDEN_PART = 0.01
"""Tolerance of the occlusion test: a point is hidden by a surface nearer by more than this fraction of its depth."""


@dataclass(frozen=True, eq=False)
class OutsideView:
    """A fixed camera outside, with the image drawn so far.

    seen: image (h, w, 3) BGR, drawn on in place; depth_m: depth (h, w) of the structure, inf where there is none.
    """

    camera: Camera
    cam_from_world: Pose
    seen: Image
    depth_m: NDArray[np.float32]

    @classmethod
    def of(cls, spec: SequenceSpec, extent_m: tuple[Array, Array], size_px: tuple[int, int]) -> "OutsideView":
        """View of a spec's structure alone, on a floor grid.

        extent_m: lower and upper corner (3,) in the world of a box that is entirely in view; size_px: width, height.
        """
        low, high = extent_m
        camera = Camera.from_field_of_view(*size_px, VIEW_DEG)
        pose = looking_at(low, high, camera)
        scene = build_scene(replace(spec, environment=Studio(backdrop=BACKDROP), clutter=(), effects=()))
        with scene.renderer(*size_px) as renderer:
            background = encode(light_of(renderer.color(pose, camera)))
            depth_m, _ = renderer.geometry(pose, camera)
        view = cls(camera, pose, background, np.where(depth_m > 0, depth_m, np.inf).astype(np.float32))
        for line in floor_grid(low, high):
            view.line(line, GRID, 1)
        return view

    def pixels(self, points: Array) -> Array:
        """Pixels (n, 2) of world points (n, 3) in m; NaN for points occluded, out of view or not finite."""
        out = np.full((len(points), 2), np.nan)
        in_camera = self.cam_from_world.transform(np.nan_to_num(points, nan=np.inf))
        rows = np.flatnonzero(np.isfinite(in_camera).all(axis=1) & (in_camera[:, 2] > NEAR_M))
        pixels = self.camera.project(in_camera[rows])
        size = np.array([self.camera.width, self.camera.height])
        inside = ((pixels >= 0) & (pixels < size - 1)).all(axis=1)
        rows, pixels = rows[inside], pixels[inside]
        x, y = np.rint(pixels).astype(int).T
        seen = in_camera[rows, 2] <= self.depth_m[y, x] * (1 + HIDDEN_PART)
        out[rows[seen]] = pixels[seen]
        return out

    def line(self, points: Array, colour: tuple[int, int, int], thickness: int) -> None:
        """Draw the visible parts of a polyline through world points (n, 3) in m; colour BGR, thickness in px."""
        pixels = self.pixels(points)
        pieces = np.stack([pixels[:-1], pixels[1:]], axis=1)
        draw(self.seen, pieces[np.isfinite(pieces).all(axis=(1, 2))], colour, thickness)


def looking_at(low: Array, high: Array, camera: Camera, above_deg: float = ABOVE_DEG) -> Pose:
    """cam_from_world of a camera tilted down by above_deg, with the box between two corners (3,), in m, in view."""
    azimuth, elevation = np.radians([FROM_DEG, above_deg])
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
    """Lines (60, 3) in m of a grid on the floor z = 0 that covers the box between two corners (3,)."""
    width = next((w for w in GRID_M if np.ceil((high - low)[:2] / w).sum() <= GRID_LINES), GRID_M[-1])
    xs, ys = (np.arange(np.floor(low[k] / width), np.ceil(high[k] / width) + 1) * width for k in range(2))
    along_x = [np.column_stack([np.linspace(xs[0], xs[-1], 60), np.full(60, y), np.zeros(60)]) for y in ys]
    along_y = [np.column_stack([np.full(60, x), np.linspace(ys[0], ys[-1], 60), np.zeros(60)]) for x in xs]
    return along_x + along_y
