"""Pictures of flights: the path flown around a structure, and the readings of a sensor along it."""

from io import BytesIO
from itertools import groupby

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from uavbench.bench.filming.outside_view import OutsideView
from uavbench.reports.style import COLOURS, house_style
from uavbench.scenes.scene import build_scene, obstacles_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.lidar import Lidar2d
from uavbench.trajectories.sensors.ranging import LaserRanging
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.sensors.sensor import Table
from uavbench.trajectories.simulation.flight import fly

POINTS, LOOKS = 400, 16
"""Points of a drawn path, and positions at which the viewing direction is drawn."""
LOOK_PART = 0.07
"""Length of a drawn viewing direction, as a fraction of the scene's extent."""
DARK, LIGHT = np.array([110.0, 60.0, 0.0]), np.array([90.0, 200.0, 255.0])
"""Colours (BGR) at the start and the end of a path."""
MARGIN = 0.06
"""Margin around structure and path, as a fraction of their extent."""
DPI = 100


def path_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR of the structure with a flight of the spec's path and the viewing directions along it."""
    obstacles = obstacles_of(spec)
    flight = fly(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
    rows = np.unique(np.linspace(0, len(flight) - 1, POINTS).astype(int))
    course = flight.positions_m[rows]
    low = np.minimum(obstacles.bounds[0], course.min(axis=0))
    high = np.maximum(obstacles.bounds[1], course.max(axis=0))
    extent = float((high - low).max())
    room = MARGIN * extent * np.array([1.0, 1.0, 0.0])
    view = OutsideView.of(spec, (low - room, high + room), (spec.camera.width, spec.camera.height))
    for k, share in enumerate(np.linspace(0, 1, len(rows) - 1)):
        view.line(course[k : k + 2], _colour(float(share)), 2)
    for share in np.linspace(0, 1, LOOKS):
        pose = flight.pose(int(rows[round(share * (len(rows) - 1))]))
        ahead = pose.rotation @ spec.mount.at_rest.cam_from_body.inverse().rotation[:, 2]
        ends = pose.translation + np.linspace(0, LOOK_PART * extent, 12)[:, None] * ahead
        view.line(ends, _colour(float(share)), 1)
    for x, y in view.pixels(course[:1]).tolist():
        if np.isfinite([x, y]).all():
            cv2.circle(view.seen, (round(x), round(y)), 5, _colour(0.0), -1, cv2.LINE_AA)
    return view.seen


def _colour(share: float) -> tuple[int, int, int]:
    """BGR colour at a fraction (0 to 1) of the path."""
    blue, green, red = (round(float(c)) for c in DARK + share * (LIGHT - DARK))
    return blue, green, red


def sensor_picture(spec: SequenceSpec) -> Image:
    """Plot (h, w, 3) BGR of the readings of the spec's only sensor: over time, a panel per unit; of a lidar one scan.

    ValueError unless the spec has exactly one sensor, and it writes one table.
    """
    (sensor,) = spec.sensors
    obstacles = build_scene(spec).obstacles if isinstance(sensor, LaserRanging) else obstacles_of(spec)
    flight = fly(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
    (table,) = measure(spec.sensors, flight, obstacles, spec.seed).values()
    with house_style():
        figure = Figure(figsize=(spec.camera.width / DPI, spec.camera.height / DPI), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        if isinstance(sensor, Lidar2d):
            _draw_turn(figure, sensor, table)
        else:
            names = [name for name in table.columns if name in getattr(sensor, "measured", table.columns)]
            _draw_over_time(figure, table, names)
        drawn = BytesIO()
        figure.savefig(drawn, format="png")
    return np.asarray(cv2.imdecode(np.frombuffer(drawn.getvalue(), np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


def _draw_turn(figure: Figure, lidar: Lidar2d, table: Table) -> None:
    """One scan of a lidar from above, in the lidar's axes, m."""
    steps = len(lidar.azimuths_rad)
    azimuths = table.column("azimuth_rad")[:steps]
    panel = figure.subplots()
    for ring, elevation_deg in enumerate(lidar.elevations_deg):
        level = table.column(f"range_{ring:02d}_m")[:steps] * np.cos(np.radians(elevation_deg))
        shade = COLOURS[0] if len(lidar.elevations_deg) == 1 else colormaps["viridis"](ring / len(lidar.elevations_deg))
        panel.plot(level * np.cos(azimuths), level * np.sin(azimuths), ".", color=shade, markersize=1.5)
    panel.plot(0, 0, "^", color="black", markersize=4)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("ahead in m")
    panel.set_ylabel("left in m")


def _draw_over_time(figure: Figure, table: Table, names: list[str]) -> None:
    """Columns of readings over time in s, a panel per unit."""
    panels = [list(group) for _, group in groupby(names, key=unit_of)]
    for panel, columns in zip(figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0], panels, strict=True):
        for k, column in enumerate(columns):
            values: Array = table.column(column)
            panel.plot(table.stamps_ns / 1e9, values, color=COLOURS[k], label=column, linewidth=0.8)
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=len(columns))
        panel.set_ylabel(unit_of(columns[0]).replace("_s2", "/s²").replace("_s", "/s"))
    panel.set_xlabel("time in s")


def unit_of(column: str) -> str:
    """Unit of a column from its name, `wx_rad_s` -> `rad_s`; "" for a name without one."""
    return column.partition("_")[2]
