"""Size of a suite's sequences or flights: frames, seconds, megabytes; and path requirements that are not met."""

import json
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.open_loop import OpenLoop
from uavbench.bench.closed_loop.sensing import live
from uavbench.bench.disk_space.sequence_bytes import sequence_bytes
from uavbench.bench.inputs.content_hash import carried_hash
from uavbench.bench.runner.graph import Job, Work, fault_line
from uavbench.bench.runner.tasks import Fly, Render, Video
from uavbench.scenes.scene import confines_of, obstacles_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.sensors.registry import check_sensors
from uavbench.trajectories.sensors.sensor import check_rate
from uavbench.trajectories.simulation.flight import path_name
from uavbench.trajectories.simulation.summary import FlightSummary, planned_summary

FLOWN_ROW_BYTES, FLOWN_RATE_HZ, FLOWN_FIXED_BYTES = 370.0, 50.0, 1e4
"""Bytes of a row of path.csv, its rate, and bytes of the records of a flight, measured on the box."""
FLOWN_READING_BYTES = 130.0
"""Bytes of a reading of a flight, measured with the IMU."""
FLOWN_ENCODER_BYTES, FLOWN_MOUNT_BYTES = 73.0, 260.0
"""Bytes of a reading of a gimbal's encoders, and of its poses by row of path.csv, measured with three axes."""
FLOWN_FRAME_BYTES = 1100.0
"""Bytes of a frame in the tables of a flight, measured with `robust`; with `truth` it is a half."""
VIDEO_FRAME_BYTES = 6e4
"""Bytes of a frame of a flight's video, 1280x480, measured on the box."""
MOST_FLOWN_S = 1200.0
"""Duration of all flights that are flown to look for mistakes, s: half a minute's work; others are planned only."""


@dataclass(frozen=True)
class Extent:
    """Size of each sequence or flight of one name, one per seed, or the reason why their path cannot be planned.

    bytes: of one of them, measured on disk if one was made from the current inputs, else estimated. problem: why it
    cannot be made. unreached: what its cameras do not reach.
    """

    name: str
    seeds: int
    frames: int
    summary: FlightSummary | None
    bytes: float
    measured: bool = False
    problem: str = ""
    unreached: tuple[str, ...] = ()


def current_folders(jobs: Iterable[Job]) -> set[Path]:
    """Folders of the sequences, flights and videos that are there and were made from the current inputs."""
    return {
        job.work.folder
        for job in jobs
        if isinstance(job.work, Render | Fly | Video) and carried_hash(job.marker) == job.content_hash
    }


def extents(works: Iterable[Work], current: Collection[Path] = ()) -> list[Extent]:
    """Extent of the sequences or flights by name; those that differ only by their seed are planned and flown once.

    current: the folders that need not be made anew, whose bytes are those of all alike.
    """
    works = list(works)
    videos = {work.flight: work.folder for work in works if isinstance(work, Video)}
    by_name: dict[str, list[Render | Fly]] = {}
    for work in works:
        if isinstance(work, Render | Fly) and isinstance(work.spec, SequenceSpec):
            by_name.setdefault(_name(work), []).append(work)
    plans: dict[str, FlightSummary | str] = {}
    found = [_extent(name, alike, plans, videos, current) for name, alike in by_name.items()]
    found = [
        replace(each, problem=each.problem or _rate_problem(alike[0], each.summary))
        for each, alike in zip(found, by_name.values(), strict=True)
    ]
    flown_s = 0.0
    known: dict[str, Extent] = {}
    for k, (each, (first, *_)) in enumerate(zip(found, by_name.values(), strict=True)):
        flown_s += each.summary.duration_s if each.summary and _flown_once(first) not in known else 0.0
        if not each.problem and flown_s <= MOST_FLOWN_S:
            key = _flown_once(first)
            flown = known[key] = known.get(key) or _rehearsed(each, first)
            found[k] = replace(each, problem=flown.problem, unreached=flown.unreached)
    return found


def table_of_extents(found: list[Extent], what: str) -> str:
    """Table of frames, seconds and megabytes by sequence or flight, sums, and unmet requirements.

    what: `sequence` or `flight`.
    """
    lines = [f"\n{f'each {what}':<36} {'seeds':>7} {'frames':>7} {'flight, s':>10} {'top m/s':>8} {'MB':>9}"]
    for each in found:
        seconds = f"{each.summary.duration_s:.1f}" if each.summary else "-"
        top = each.summary.speed_planned_m_s if each.summary else None
        speed, about = "-" if top is None else f"{top:.2f}", "" if each.measured else " about"
        head = f"{each.name:<36} {each.seeds:>7} {each.frames:>7} {seconds:>10}"
        lines.append(f"{head} {speed:>8} {each.bytes / 1e6:>9.1f}{about}")
    seeds, frames = sum(each.seeds for each in found), sum(each.seeds * each.frames for each in found)
    total_s = sum(each.seeds * each.summary.duration_s for each in found if each.summary)
    total_mb = sum(each.seeds * each.bytes for each in found) / 1e6
    lines.append(f"{f'all {what}s':<36} {seeds:>7} {frames:>7} {total_s:>10.1f} {'':>8} {total_mb:>9.1f}")
    reasons = [(each, each.problem or (each.summary.shortfall() if each.summary else "")) for each in found]
    reasons += [(each, reason) for each in found for reason in each.unreached]
    lines += dict.fromkeys(f"{each.name.split()[0]}: {reason}" for each, reason in reasons if reason)
    return "\n".join(lines)


def problems_of_extents(found: list[Extent], what: str) -> str:
    """How many sequences or flights cannot be made, and which; "" if all can."""
    bad = list(dict.fromkeys(each.name for each in found if each.problem))
    seeds = sum(each.seeds for each in found if each.problem)
    of = sum(each.seeds for each in found)
    return f"{seeds} of {of} {what}s cannot be made: {', '.join(bad)}; the reasons are above" if bad else ""


def shortfalls(markers: Iterable[Path]) -> list[str]:
    """Path requirements that rendered flights did not meet, and doubts about recordings, from their sequence.json."""
    lines = []
    for marker in markers:
        info = json.loads(marker.read_text(encoding="utf-8"))
        if "flight" in info and (line := FlightSummary(**info["flight"]).shortfall()):
            lines.append(f"{info['name']}: {line}")
        lines += [f"{info['name']}: {what}" for what in info.get("unreached", ())]
        lines += [f"doubt: {info['name']}: {doubt}" for doubt in info.get("doubts", ())]
    return lines


def unreached_in_flights(markers: Iterable[Path]) -> list[str]:
    """What gimbals did not reach in flights in closed loop, from their record.json."""
    records = [json.loads(marker.read_text(encoding="utf-8")) for marker in markers]
    return [
        f"{each['sequence']['name']} {each['run']}: {what}" for each in records for what in each.get("unreached", ())
    ]


def _flown_once(work: Render | Fly) -> str:
    """Key of the works that one rehearsal suffices for: the frames of a gimbal on its target depend on their rate."""
    spec = work.spec
    assert isinstance(spec, SequenceSpec)
    rate = f" {work.pilot.rate_hz}" if isinstance(work, Fly) and isinstance(spec.mount, Gimbal) else ""
    return f"{spec.name}{rate}"


def _name(work: Render | Fly) -> str:
    sequence = work.spec.name.rpartition("-s")[0]
    return f"{sequence} {work.pilot.run}" if isinstance(work, Fly) else sequence


def _extent(
    name: str,
    alike: list[Render | Fly],
    plans: dict[str, FlightSummary | str],
    videos: Mapping[Path, Path],
    current: Collection[Path],
) -> Extent:
    spec = alike[0].spec
    assert isinstance(spec, SequenceSpec)
    plan = plans.get(spec.name) or _plan(spec)
    plans[spec.name] = plan
    if isinstance(plan, str):
        return Extent(name, len(alike), 0, None, 0.0, problem=plan)
    first = alike[0]
    if isinstance(first, Fly):
        plan = replace(plan, duration_s=min(plan.duration_s, first.pilot.loop.time_limit_s or math.inf))
        frames = _frames_flown(spec, plan.duration_s, first.pilot.rate_hz)
        size = _bytes_flown(spec, frames, plan.duration_s) + VIDEO_FRAME_BYTES * frames * (first.folder in videos)
    else:
        frames = _frames(plan.duration_s - max(spec.clock.shift_ns, 0) / 1e9, spec.rate_hz)
        size = sequence_bytes(spec, frames, plan.duration_s)
    written = [{work.folder, videos.get(work.folder, work.folder)} for work in alike]
    folders = next((each for each in written if each <= set(current)), None)
    if folders is None:
        return Extent(name, len(alike), frames, plan, size)
    size = float(sum(path.stat().st_size for folder in folders for path in folder.rglob("*") if path.is_file()))
    return Extent(name, len(alike), frames, plan, size, measured=True)


def _rate_problem(work: Render | Fly, planned: FlightSummary | None) -> str:
    """Why a rate does not fit the planned flight, or sensors do not serve the loop; "" if all do."""
    spec = work.spec
    assert isinstance(spec, SequenceSpec) and planned is not None
    flown_ns = round(1e9 * planned.duration_s)
    try:
        if isinstance(work, Fly):
            check_rate(work.pilot.rate_hz, flown_ns, "frame", "rates_hz")
            for sensor in spec.sensors:
                live(sensor)
            check_loop(work.pilot.loop, spec, planned.duration_s)
        else:
            check_rate(spec.rate_hz, flown_ns, "frame")
        check_sensors(spec.sensors, flown_ns)
        for mount in (spec.mount, *(camera.mount for camera in spec.cameras)):
            if isinstance(mount, Gimbal):
                mount.encoder.check(flown_ns)
    except UserError as error:
        return str(error).removeprefix(f"sequence {spec.name}: ")
    return ""


def _rehearsed(found: Extent, work: Render | Fly) -> Extent:
    """The extent with the mistake, if any, that flying on the true state shows."""
    spec = work.spec
    assert isinstance(spec, SequenceSpec)
    try:
        if isinstance(work, Render):
            from uavbench.scenes.shots.shots import rehearse

            return replace(found, unreached=tuple(rehearse(spec)))
        confines, obstacles = confines_of(spec), obstacles_of(spec)
        open_loop = OpenLoop.of(spec, work.pilot.rate_hz, obstacles, confines)
        return replace(found, unreached=open_loop.unreached)
    except Exception as error:
        return replace(found, problem=_problem(error).removeprefix(f"sequence {spec.name}: "))


def _frames(filmed_s: float, rate_hz: float) -> int:
    return int(max(filmed_s, 0.0) * rate_hz + 1e-9) + 1


def _frames_flown(spec: SequenceSpec, duration_s: float, rate_hz: float) -> int:
    """Frames of a flight whose exposure ends before it does."""
    exposure_ms = max((getattr(effect, "exposure_ms", 0.0) for effect in spec.effects), default=0.0)
    readout_ms = max((getattr(effect, "readout_ms", 0.0) for effect in spec.effects), default=0.0)
    return _frames(duration_s - 5e-4 * (exposure_ms + readout_ms), rate_hz)


def _bytes_flown(spec: SequenceSpec, frames: int, duration_s: float) -> float:
    readings = FLOWN_READING_BYTES * sum(float(getattr(sensor, "rate_hz", 0.0)) for sensor in spec.sensors)
    per_s = readings + FLOWN_ROW_BYTES * FLOWN_RATE_HZ
    if isinstance(spec.mount, Gimbal):
        per_s += FLOWN_ENCODER_BYTES * spec.mount.encoder.rate_hz + FLOWN_MOUNT_BYTES * FLOWN_RATE_HZ
    return FLOWN_FIXED_BYTES + FLOWN_FRAME_BYTES * frames + per_s * duration_s


def _plan(spec: SequenceSpec) -> FlightSummary | str:
    """Summary of the planned path, or why there is none."""
    try:
        obstacles = obstacles_of(spec)
    except Exception as error:
        return _problem(error)
    try:
        return planned_summary(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
    except Exception as error:
        return f"path {path_name(spec.flight.path)}: {_problem(error)}"


def _problem(error: Exception) -> str:
    """What is wrong, in the words of the job: a mistake of the user, or a fault of the user's code."""
    return str(error) if isinstance(error, UserError) else fault_line(error)
