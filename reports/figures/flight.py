"""The flight of a sequence around its structure: path, camera frusta, and GNSS availability."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]

from uavbench.reports.figures.figure_files import Drawn, save_drawn
from uavbench.reports.figures.space import limits
from uavbench.reports.style import GROUND_TRUTH, LOSS, panel_letter
from uavbench.scenes.camera import FOLDED_PX, Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_table
from uavbench.trajectories.pose import Array, Pose

FRUSTA = 9
"""Cameras drawn along the path."""
STEPS, LONGEST_RAY = 101, 2.0
"""Pixels towards a corner of a lens's image at which a ray is looked for, and the longest ray drawn, in depths."""
FIX, NO_FIX = "#2C458C", "#E82267"
GNSS_COLUMNS = ["stamp_ns", "satellites", "pdop", "px_m", "py_m", "pz_m"]


def flight(sequence: Sequence, stem: Path) -> list[Path]:
    """Write `draw_flight` as files at a stem; their paths."""
    return save_drawn(partial(draw_flight, sequence), stem, 3.6)


def draw_flight(sequence: Sequence, figure: Figure | SubFigure) -> Drawn:
    """The flight of a sequence in 3-D, and height, speed and body rate over time; satellites with `gnss.csv`.

    UserError when `gnss.csv` is not valid.
    """
    gnss = gnss_along(sequence)
    grid = figure.add_gridspec(3, 2, width_ratios=[1.7, 1.0])
    solid: Any = figure.add_subplot(grid[:, 0], projection="3d")
    _draw_space(solid, sequence, gnss)
    top, middle, bottom = (figure.add_subplot(grid[i, 1]) for i in range(3))
    t = (sequence.stamps_ns - sequence.stamps_ns[0]) / 1e9
    ground_truth = sequence.ground_truth_table
    top.plot(t, ground_truth[:, 4], color=GROUND_TRUTH)
    top.set_ylabel("height (m)")
    middle_m = float(ground_truth[:, 4].max() + ground_truth[:, 4].min()) / 2
    half_m = max(0.55 * float(np.ptp(ground_truth[:, 4])), 0.1)
    top.set_ylim(middle_m - half_m, middle_m + half_m)
    middle.plot(t, np.linalg.norm(ground_truth[:, 9:12], axis=1), color=GROUND_TRUTH)
    middle.set_ylabel("speed (m/s)")
    if gnss is None:
        bottom.plot(t, np.degrees(np.linalg.norm(ground_truth[:, 12:15], axis=1)), color=GROUND_TRUTH)
        bottom.set_ylabel("rate (\N{DEGREE SIGN}/s)")
    else:
        bottom.step(gnss[:, 0], gnss[:, 1], where="post", color=FIX)
        bottom.set_ylabel("satellites")
        bottom.set_ylim(0, None)
        for panel in (top, middle, bottom):
            _shade(panel, gnss)
    for letter, panel in zip("abc", (top, middle, bottom), strict=True):
        panel_letter(panel, letter)
        panel.set_xlim(0, t[-1])
        panel.yaxis.set_major_locator(MaxNLocator(4, integer=panel is bottom and gnss is not None))
    top.tick_params(labelbottom=False)
    middle.tick_params(labelbottom=False)
    bottom.set_xlabel("time (s)")
    rows = [
        [s, *p, *q]
        for s, p, q in zip(t.tolist(), ground_truth[:, 2:5].tolist(), ground_truth[:, 5:9].tolist(), strict=True)
    ]
    return Drawn(columns=["t_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"], rows=rows, legend=None)


def gnss_along(sequence: Sequence) -> Array | None:
    """Time in s, satellites in view, and 1 for a fix or 0, as columns (n, 3), of `gnss.csv`; None without the file.

    UserError when the file is not valid.
    """
    path = sequence.folder / "gnss.csv"
    if not path.is_file():
        return None
    rows = read_table(path, GNSS_COLUMNS)
    start = int(sequence.stamps_ns[0])
    return np.array(
        [[(int(r["stamp_ns"]) - start) / 1e9, float(r["satellites"]), float(r["px_m"] != "")] for r in rows]
    )


def frustum(camera: Camera, cam_from_world: Pose, depth_m: float) -> Array:
    """Edges (8, 2, 3) in the world, in m, of a camera's viewing frustum up to a depth in m."""
    corners = depth_m * _corner_rays(camera)
    world_from_cam = cam_from_world.inverse()
    tip, base = world_from_cam.translation, world_from_cam.transform(corners)
    return np.array([*[[tip, b] for b in base], *[[base[i], base[(i + 1) % 4]] for i in range(4)]])


def _corner_rays(camera: Camera) -> Array:
    """Rays (4, 3) in the camera frame to the corners of the image, z = 1 for a pinhole.

    Those of a lens go to the farthest pixel towards the corner that a ray in front of the camera reaches, and are no
    longer than LONGEST_RAY.
    """
    right, bottom = camera.width - 0.5, camera.height - 0.5
    at = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    if camera.distortion_model == "none":
        return camera.rays(at)
    middle = np.array([camera.cx, camera.cy])
    towards = middle + np.linspace(1, 0, STEPS)[:, None, None] * (at - middle)
    rays = camera.rays(towards.reshape(-1, 2))
    with np.errstate(all="ignore"):
        off_px = np.abs(camera.project(rays) - towards.reshape(-1, 2)).max(axis=1).reshape(-1, 4)
    farthest = rays.reshape(-1, 4, 3)[np.argmax(off_px < FOLDED_PX, axis=0), np.arange(4)]
    length = np.linalg.norm(farthest, axis=1, keepdims=True)
    return np.asarray(farthest * np.minimum(1, LONGEST_RAY / length))


def _draw_space(solid: Any, sequence: Sequence, gnss: Array | None) -> None:
    structure, p = sequence.structure, sequence.ground_truth.positions_m
    low, high = limits(structure, p)
    faces = structure.vertices[structure.triangles]
    solid.add_collection3d(Poly3DCollection(faces, facecolor="#DDD6CB", edgecolor="none", alpha=0.35))
    solid.add_collection3d(Line3DCollection(structure.edge_segments, colors="#8A7F70", linewidths=0.5))
    drop = np.column_stack([p[:, :2], np.full(len(p), low[2])])
    solid.plot(*drop.T, color=LOSS, lw=0.8)
    depth = 0.09 * float((high - low).max())
    for frame in np.linspace(0, len(p) - 1, FRUSTA).astype(int):
        lines = frustum(sequence.camera, sequence.true_cam_from_world(frame), depth)
        solid.add_collection3d(Line3DCollection(lines, colors="#735F0C", linewidths=0.5))
    if gnss is None:
        solid.plot(*p.T, color=GROUND_TRUTH, lw=1.4)
    else:
        t = (sequence.stamps_ns - sequence.stamps_ns[0]) / 1e9
        fixed = gnss[np.clip(np.searchsorted(gnss[:, 0], t, side="right") - 1, 0, None), 2] > 0
        for here, ink, label in ((fixed, FIX, "GNSS fix"), (~fixed, NO_FIX, "no GNSS fix")):
            if not here.any():
                continue
            kept = np.where((here | np.roll(here, 1))[:, None] & (np.arange(len(p)) > 0)[:, None], p, np.nan)
            solid.plot(*kept.T, color=ink, lw=1.8, label=label, linestyle="-" if label == "GNSS fix" else (0, (2, 0.8)))
        solid.legend(loc="upper left", bbox_to_anchor=(0.0, 0.95))
    solid.plot(*p[:1].T, marker="o", ms=4.5, color=GROUND_TRUTH, mfc="white", ls="none")
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(solid, f"set_{axis}lim")(a, b)
        if axis != "z":  # the label of the vertical axis would overlap the panels on the right
            getattr(solid, f"set_{axis}label")(f"{axis} (m)", labelpad=-6)
        getattr(solid, f"{axis}axis").pane.fill = False
    solid.tick_params(labelsize=6, pad=-3)
    solid.zaxis.set_major_locator(MaxNLocator(3))
    solid.text(high[0], high[1], high[2] + 0.06 * float((high - low).max()), "z (m)", ha="center")
    solid.set_box_aspect(tuple(high - low), zoom=1.2)
    solid.view_init(elev=22, azim=-62)


def _shade(panel: Axes, gnss: Array) -> None:
    """Shade the times without a fix."""
    t, lost = gnss[:, 0], gnss[:, 2] == 0
    ends = np.append(t[1:], t[-1])
    for begin, end in zip(t[lost], ends[lost], strict=True):
        panel.axvspan(begin, end, color=LOSS, lw=0, zorder=0)
