"""Breakdown of success by attributes of the frames: speed, blur, occlusion, distance, contrast.

Conventions: an attribute has one value per frame, NaN where it is unknown. A breakdown divides the frames into
quantiles of the attribute and gives success and error of each.
"""

from collections.abc import Callable
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from uavbench.reports.metrics.quaternions import norm
from uavbench.reports.scoring.images import image_at
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.true_edges import edges_in_image
from uavbench.scenes.dataset.annotations import edges_file, load_edges
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Image
from uavbench.tracker.shang_shen.segments import grey
from uavbench.tracker.visible_edges import to_image
from uavbench.trajectories.pose import Array

PARTS = 4
MAX_FRAMES = 200
"""Most frames of a breakdown, evenly spaced over all sequences, with FEW of each at least."""
FEW = 4
CONTRAST_OFFSET_PX = 4.0
POINTS_PER_EDGE = 15


@dataclass(frozen=True, kw_only=True)
class Part:
    """Frames whose attribute lies in [low, high]: their number, success rate, and median position error (inf: lost)."""

    low: float
    high: float
    frames: int
    success: float
    median_m: float


def speed_m_s(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Speed (n,) of the body in m/s."""
    return norm(sequence.ground_truth_table[list(frames), 9:12])


def blur_px(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Median displacement (n,) in px of points of the visible edges during the exposure.

    From the true poses and the exposure time in the sequence's config; 0 without motion blur, NaN without a config, and
    for the last frame.
    """
    config = sequence.info.get("config")
    if not config:
        return np.full(len(frames), np.nan)
    exposure_ms = sum(e.get("exposure_ms", 0.0) for e in config.get("effects", []) if e.get("kind") == "motion-blur")
    out = np.full(len(frames), np.nan)
    for k, frame in enumerate(frames):
        if frame + 1 >= len(sequence):
            continue
        now, later = sequence.true_cam_from_world(frame), sequence.true_cam_from_world(frame + 1)
        step_ms = (int(sequence.stamps_ns[frame + 1]) - int(sequence.stamps_ns[frame])) / 1e6
        ends = edges_in_image(sequence, frame).segments_m.reshape(-1, 3)
        here, there = now.transform(ends), later.transform(ends)
        seen = (here[:, 2] > 0.01) & (there[:, 2] > 0.01)
        if seen.any():
            camera = sequence.camera
            moved = np.linalg.norm(camera.project(there[seen]) - camera.project(here[seen]), axis=1)
            out[k] = np.median(moved) * exposure_ms / step_ms
    return out


def occlusion(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Share (n,) in percent of the length of the visible model edges that other objects occlude.

    Compares the projected edges of the structure alone with the rendered annotations; NaN without annotations of edges
    (`annotations = ["edges"]`).
    """
    out = np.full(len(frames), np.nan)
    for k, frame in enumerate(frames):
        if not edges_file(sequence, frame).is_file():
            continue
        rows = load_edges(sequence, frame)
        seen_px = float(np.hypot(rows[:, 3] - rows[:, 1], rows[:, 4] - rows[:, 2]).sum())
        ends = edges_in_image(sequence, frame).segments_px
        all_px = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
        if all_px > 0:
            out[k] = np.round(100 * np.clip(1 - seen_px / all_px, 0, 1), 1)
    return out


def visible_edge_count(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Number (n,) of visible edges in the image at the true pose."""
    return np.array([float(len(edges_in_image(sequence, frame).edges)) for frame in frames])


def distance_m(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Median depth (n,) in m of the visible edges at the true pose; NaN where none is in view."""
    depths = [edges_in_image(sequence, frame).depths_m for frame in frames]
    return np.array([float(np.median(d)) if d.size else np.nan for d in depths])


def contrast(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Mean absolute difference (n,) of grey levels (0 to 255) across visible edges, CONTRAST_OFFSET_PX to each side.

    UserError when an image cannot be read.
    """
    return np.array([contrast_at(sequence, frame) for frame in frames])


@lru_cache(maxsize=4096)  # filled by the drawing of the overlay, while it has the image
def contrast_at(sequence: Sequence, frame: int) -> float:
    """Contrast of one frame in grey levels; NaN where no visible edge is long enough."""
    camera = sequence.camera
    segments = camera.undistort(edges_in_image(sequence, frame).segments_px.reshape(-1, 2)).reshape(-1, 2, 2)
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    segments, lengths = segments[lengths > 2 * CONTRAST_OFFSET_PX], lengths[lengths > 2 * CONTRAST_OFFSET_PX]
    if not len(segments):
        return float("nan")
    along = (segments[:, 1] - segments[:, 0]) / lengths[:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])[:, None] * CONTRAST_OFFSET_PX
    w = np.linspace(0.1, 0.9, POINTS_PER_EDGE)[None, :, None]
    middle = segments[:, :1] + w * (segments[:, 1:] - segments[:, :1])
    image = np.asarray(cv2.GaussianBlur(grey(image_at(sequence, frame)), (3, 3), 0), dtype=np.uint8)
    sides = [_sampled(image, to_image((middle + s * normal).reshape(-1, 2), camera)) for s in (1, -1)]
    return float(np.abs(sides[0] - sides[1]).mean())


ATTRIBUTES: dict[str, tuple[str, Callable[[Sequence, ListOf[int]], Array]]] = {
    "speed": ("m/s", speed_m_s),
    "blur": ("px", blur_px),
    "visible edges": ("", visible_edge_count),
    "occlusion": ("%", occlusion),
    "distance": ("m", distance_m),
    "contrast": ("of 255", contrast),
}
"""Name -> unit, and function of a sequence and frames that returns values (n,)."""


def breakdown(values: Array, success: Array, translation_m: Array, parts: int = PARTS) -> list[Part]:
    """Success and error of frames (n,) in quantiles of an attribute; fewer parts where values repeat.

    values: of the attribute, NaN where unknown; success: 0 or 1; translation_m: inf without a pose.
    """
    known = np.isfinite(values)
    if not known.any():
        return []
    values, success, translation_m = values[known], success[known], translation_m[known]
    borders = np.unique(np.quantile(values, np.linspace(0, 1, parts + 1)))
    index = np.clip(np.searchsorted(borders, values, side="right") - 1, 0, max(len(borders) - 2, 0))
    found = []
    for part in range(max(len(borders) - 1, 1)):
        inside = index == part
        if inside.any():
            found.append(Part(
                low=float(values[inside].min()), high=float(values[inside].max()), frames=int(inside.sum()),
                success=float(success[inside].mean()), median_m=float(np.median(translation_m[inside])),
            ))  # fmt: skip
    return found


def breakdowns(runs: ListOf[ScoredRun]) -> dict[str, dict[str, list[Part]]]:
    """Parts by attribute and name of the run, over all sequences of runs at one rate; only attributes with values."""
    names = list(dict.fromkeys(run.name for run in runs))
    looked_at = frames_looked_at(runs)
    found: dict[str, dict[str, list[Part]]] = {}
    for attribute, (_, function) in ATTRIBUTES.items():
        of_sequence: dict[int, Array] = {}
        for run in runs:
            if id(run.sequence) not in of_sequence:
                of_sequence[id(run.sequence)] = function(run.sequence, looked_at[id(run)])
        found[attribute] = {}
        for name in names:
            group = [run for run in runs if run.name == name]
            values = np.concatenate([of_sequence[id(run.sequence)] for run in group])
            rows = [np.searchsorted(run.errors.frames, looked_at[id(run)]) for run in group]
            success = np.concatenate([run.errors.success[k].astype(float) for run, k in zip(group, rows, strict=True)])
            metres = np.concatenate([run.errors.translation_m[k] for run, k in zip(group, rows, strict=True)])
            found[attribute][name] = breakdown(values, success, metres)
    return {attribute: of_run for attribute, of_run in found.items() if any(of_run.values())}


def frames_looked_at(runs: ListOf[ScoredRun]) -> dict[int, list[int]]:
    """Frames of each run, by its id, that a breakdown of these runs uses."""
    at_most = max(FEW, MAX_FRAMES // len({id(run.sequence) for run in runs}))
    frames: dict[int, list[int]] = {id(run): run.errors.frames.tolist() for run in runs}
    return {run: of_run[:: -(-len(of_run) // at_most)] for run, of_run in frames.items()}


def _sampled(image: Image, pixels: Array) -> Array:
    at = pixels.astype(np.float32).reshape(-1, 1, 2)
    values = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values.astype(np.float64)
