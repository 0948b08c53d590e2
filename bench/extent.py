"""How much a suite's sequences are: frames, seconds of flight, megabytes; and what their paths do not reach."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from bench.content import canonical
from bench.works import Render
from scenes.scene import flown_around
from scenes.spec import SequenceSpec
from trajectories.errors import UserError
from trajectories.flight import path_name
from trajectories.flight_summary import FlightSummary, planned_summary
from trajectories.sensors import FLIGHT_RATE_HZ

IMAGE_BYTES_PER_PX, NOISY_IMAGE_BYTES_PER_PX = 1.2, 1.6
"""Of a PNG of frames/, without and with sensor noise; measured at 640x480 on a box and a building, 15 % off."""
DEPTH_BYTES_PER_PX, MASK_BYTES_PER_PX, EDGES_BYTES = 0.5, 0.01, 1000.0
"""Of a frame's depth and mask (per pixel) and of its file of edges, measured on the box."""
ROW_BYTES, FLIGHT_ROW_BYTES, FIXED_BYTES = 200.0, 550.0, 0.5e6
"""Of a reading, of a row of flight.csv, and of the model, the contact sheet and the records."""
NOISY = {"Noise", "AnalogLink"}


@dataclass(frozen=True)
class Extent:
    """What a sequence will be, or why its flight cannot be planned; measured: its bytes are those on disk."""

    name: str
    frames: int
    summary: FlightSummary | None
    bytes: float
    measured: bool = False
    problem: str = ""


def extents(renders: Iterable[Render]) -> list[Extent]:
    """Extent of each rendered sequence; those that differ by their seed alone are planned once."""
    known: dict[str, Extent] = {}
    out = []
    for render in renders:
        if not isinstance(render.spec, SequenceSpec):
            continue
        key = json.dumps(canonical(replace(render.spec, name="", seed=0)), sort_keys=True)
        if key not in known:
            known[key] = _extent(render.spec)
        extent = replace(known[key], name=render.spec.name)
        on_disk = sum(path.stat().st_size for path in render.folder.rglob("*") if path.is_file())
        out.append(replace(extent, bytes=float(on_disk), measured=True) if on_disk else extent)
    return out


def table_of_extents(renders: Iterable[Render]) -> str:
    """Table of frames, seconds and megabytes by sequence, their sum, and what the paths do not reach; "" for none."""
    found = extents(renders)
    if not found:
        return ""
    lines = [f"\n{'sequence':<36} {'frames':>7} {'flight, s':>10} {'top m/s':>8} {'MB':>9}"]
    for each in found:
        seconds = f"{each.summary.duration_s:>10.1f}" if each.summary else f"{'-':>10}"
        top = each.summary.speed_planned_m_s if each.summary else None
        speed = "-" if top is None else f"{top:.2f}"
        about = "" if each.measured else " about"
        lines.append(f"{each.name:<36} {each.frames:>7} {seconds} {speed:>8} {each.bytes / 1e6:>9.1f}{about}")
    total_s = sum(each.summary.duration_s for each in found if each.summary)
    total = f"{sum(each.frames for each in found):>7} {total_s:>10.1f} {'':>8}"
    lines.append(f"{f'{len(found)} sequences':<36} {total} {sum(each.bytes for each in found) / 1e6:>9.1f}")
    told = dict.fromkeys(each.problem or (each.summary.shortfall() if each.summary else "") for each in found)
    return "\n".join([*lines, *(line for line in told if line)])


def shortfalls(markers: Iterable[Path]) -> list[str]:
    """What the flights of rendered sequences did not reach of what was asked for, by their sequence.json."""
    lines = []
    for marker in markers:
        info = json.loads(marker.read_text(encoding="utf-8"))
        if "flight" in info and (line := FlightSummary(**info["flight"]).shortfall()):
            lines.append(f"{info['name']}: {line}")
    return lines


def _extent(spec: SequenceSpec) -> Extent:
    try:
        summary = planned_summary(spec.flight, spec.mount, flown_around(spec), spec.seed)
    except UserError as error:
        return Extent(spec.name, 0, None, 0.0, problem=f"{spec.name}: path {path_name(spec.flight.path)}: {error}")
    frames = int(summary.duration_s * spec.rate_hz + 1e-9) + 1
    return Extent(spec.name, frames, summary, _bytes(spec, frames, summary.duration_s))


def _bytes(spec: SequenceSpec, frames: int, duration_s: float) -> float:
    pixels = spec.camera.width * spec.camera.height
    noisy = any(type(effect).__name__ in NOISY for effect in spec.effects)
    each = pixels * (NOISY_IMAGE_BYTES_PER_PX if noisy else IMAGE_BYTES_PER_PX)
    each += pixels * (DEPTH_BYTES_PER_PX * ("depth" in spec.truth) + MASK_BYTES_PER_PX * ("mask" in spec.truth))
    each += EDGES_BYTES * ("edges" in spec.truth)
    rows = sum(float(getattr(sensor, "rate_hz", 0.0)) for sensor in spec.sensors) * duration_s
    return FIXED_BYTES + frames * each + ROW_BYTES * rows + FLIGHT_ROW_BYTES * FLIGHT_RATE_HZ * duration_s
