"""Size of a suite's sequences: frames, seconds of flight, megabytes; and path requirements that are not met."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from uavbench.bench.runner.tasks import Render
from uavbench.scenes.scene import obstacles_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sensors.lidar import Lidar2d
from uavbench.trajectories.sensors.registry import FLIGHT_RATE_HZ
from uavbench.trajectories.simulation.flight import path_name
from uavbench.trajectories.simulation.summary import FlightSummary, planned_summary

IMAGE_BYTES_PER_PX, NOISY_IMAGE_BYTES_PER_PX = 1.2, 1.6
"""Bytes per pixel of a PNG of frames/, without and with sensor noise; measured at 640x480 on a box and a building,
within 15 %.
"""
DEPTH_BYTES_PER_PX, MASK_BYTES_PER_PX, EDGES_BYTES = 0.5, 0.01, 1000.0
"""Bytes of a frame's depth and mask (per pixel) and of its file of edges, measured on the box."""
FLOW_BYTES_PER_PX, NORMALS_BYTES_PER_PX = 0.5, 0.03
"""Bytes of a frame's flow with its occlusion, and of its normals, measured on the box."""
RAY_BYTES = 16.0
"""Bytes of a lidar ray, measured and true range; a step adds half as much, two stamps and the azimuth."""
ROW_BYTES, FLIGHT_ROW_BYTES, FIXED_BYTES = 200.0, 550.0, 0.5e6
"""Bytes of a reading, of a row of flight.csv, and of the model, the contact sheet and the records."""
NOISY = {"Noise", "AnalogLink"}


@dataclass(frozen=True)
class Extent:
    """Size of each sequence of one name, one per seed, or the reason why their flight cannot be planned.

    bytes: of one sequence, measured on disk if one is rendered, else estimated.
    """

    name: str
    seeds: int
    frames: int
    summary: FlightSummary | None
    bytes: float
    measured: bool = False
    problem: str = ""


def extents(renders: Iterable[Render]) -> list[Extent]:
    """Extent of the sequences by name; those that differ only by their seed are planned once."""
    by_name: dict[str, list[Render]] = {}
    for render in renders:
        if isinstance(render.spec, SequenceSpec):
            by_name.setdefault(render.spec.name.rpartition("-s")[0], []).append(render)
    return [_extent(name, alike) for name, alike in by_name.items()]


def table_of_extents(renders: Iterable[Render]) -> str:
    """Table of frames, seconds and megabytes by sequence, their sum, and unmet path requirements; "" without any."""
    found = extents(renders)
    if not found:
        return ""
    lines = [f"\n{'each sequence':<36} {'seeds':>7} {'frames':>7} {'flight, s':>10} {'top m/s':>8} {'MB':>9}"]
    for each in found:
        seconds = f"{each.summary.duration_s:.1f}" if each.summary else "-"
        top = each.summary.speed_planned_m_s if each.summary else None
        speed, about = "-" if top is None else f"{top:.2f}", "" if each.measured else " about"
        head = f"{each.name:<36} {each.seeds:>7} {each.frames:>7} {seconds:>10}"
        lines.append(f"{head} {speed:>8} {each.bytes / 1e6:>9.1f}{about}")
    seeds, frames = sum(each.seeds for each in found), sum(each.seeds * each.frames for each in found)
    total_s = sum(each.seeds * each.summary.duration_s for each in found if each.summary)
    total_mb = sum(each.seeds * each.bytes for each in found) / 1e6
    lines.append(f"{'all sequences':<36} {seeds:>7} {frames:>7} {total_s:>10.1f} {'':>8} {total_mb:>9.1f}")
    for each in found:
        if reason := each.problem or (each.summary.shortfall() if each.summary else ""):
            lines.append(f"{each.name}: {reason}")
    return "\n".join(lines)


def shortfalls(markers: Iterable[Path]) -> list[str]:
    """Path requirements that the flights of rendered sequences did not meet, from their sequence.json."""
    lines = []
    for marker in markers:
        info = json.loads(marker.read_text(encoding="utf-8"))
        if "flight" in info and (line := FlightSummary(**info["flight"]).shortfall()):
            lines.append(f"{info['name']}: {line}")
    return lines


def _extent(name: str, alike: list[Render]) -> Extent:
    spec = alike[0].spec
    assert isinstance(spec, SequenceSpec)
    try:
        summary = planned_summary(spec.flight, spec.mount.at_rest, obstacles_of(spec), spec.seed)
    except UserError as error:
        return Extent(name, len(alike), 0, None, 0.0, problem=f"path {path_name(spec.flight.path)}: {error}")
    filmed_s = max(summary.duration_s - max(spec.clock.shift_ns, 0) / 1e9, 0.0)
    frames = int(filmed_s * spec.rate_hz + 1e-9) + 1
    rendered = next((render.folder for render in alike if (render.folder / "sequence.json").is_file()), None)
    if rendered is None:
        return Extent(name, len(alike), frames, summary, _bytes(spec, frames, summary.duration_s))
    size = float(sum(path.stat().st_size for path in rendered.rglob("*") if path.is_file()))
    return Extent(name, len(alike), frames, summary, size, measured=True)


def _bytes(spec: SequenceSpec, frames: int, duration_s: float) -> float:
    cameras = (spec.camera, *(other.camera for other in spec.cameras))
    pixels = sum(camera.width * camera.height for camera in cameras)
    noisy = any(type(effect).__name__ in NOISY for effect in spec.effects)
    each = pixels * (NOISY_IMAGE_BYTES_PER_PX if noisy else IMAGE_BYTES_PER_PX)
    each += pixels * (
        DEPTH_BYTES_PER_PX * ("depth" in spec.annotations) + MASK_BYTES_PER_PX * ("mask" in spec.annotations)
    )
    each += pixels * (
        FLOW_BYTES_PER_PX * ("flow" in spec.annotations) + NORMALS_BYTES_PER_PX * ("normals" in spec.annotations)
    )
    each += EDGES_BYTES * ("edges" in spec.annotations) * len(cameras)
    readings = sum(_bytes_per_s(sensor) for sensor in spec.sensors) * duration_s
    return FIXED_BYTES + frames * each + readings + FLIGHT_ROW_BYTES * FLIGHT_RATE_HZ * duration_s


def _bytes_per_s(sensor: object) -> float:
    """Bytes per second of the readings of a body sensor."""
    if isinstance(sensor, Lidar2d):
        return RAY_BYTES * (sensor.rays_per_s + 1.5 * sensor.steps_per_s)
    return ROW_BYTES * float(getattr(sensor, "rate_hz", 0.0))
