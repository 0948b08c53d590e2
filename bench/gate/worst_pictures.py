"""Pictures of the worst sequences: the frame with the largest error, at the baseline's pose and at the new one.

They are written beside `gate.md`, which embeds them, as does the comment that the CI recipes post on a pull request.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pillow

from uavbench.bench.gate.decision import Margins
from uavbench.bench.gate.paired_scores import Key, Measured, read_side
from uavbench.bench.runner.output_folder import WORST, WORST_MARKER
from uavbench.reports.figures.tracker_pictures import GREEN, WHITE, View, draw, write_text_on
from uavbench.reports.metrics.frame_errors import FrameErrors, frame_errors
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Image
from uavbench.tracker.results import Results
from uavbench.tracker.sound_results import sound
from uavbench.trajectories.errors import DamagedFileError, UserError
from uavbench.trajectories.files.writing import new_folder
from uavbench.trajectories.pose import Pose

MOST = 3
"""Number of sequences shown."""
WIDTH_PX, GAP_PX = 440, 4
"""Width in px of each of the two images, and of the gap; together they fit into a comment on GitHub."""
COLOURS = 128
"""Size of a picture's palette: a third of the bytes, and lines keep their colours."""
LEAST_MARGIN = 1e-3
"""Lower limit of margins when changes are ranked in units of them."""
TINY = 1e-12
LEGEND = (
    "For each, the frame with the largest position error, or one for which only the baseline has a pose. Left: the "
    "baseline's pose, right: that of these results; the model is green at this pose, and white at the true one."
)


@dataclass(frozen=True)
class Run:
    """A run with a score on both sides, and how much worse it became, in units of the margins."""

    key: Key
    base: Measured
    head: Measured
    worse: float

    @property
    def rank(self) -> tuple[float, float, Key]:
        """Sort key, worst first: by how much worse the run became, then by its error."""
        ate = self.head.errors.get("ATE", math.nan)
        return -max(self.worse, 0.0), -(ate if math.isfinite(ate) else math.inf), self.key


@dataclass(frozen=True)
class Seen:
    """Result of a run on a frame: its pose, None without one, and its errors."""

    cam_from_world: Pose | None
    metres: float
    degrees: float

    @property
    def text(self) -> str:
        """`1.20 cm, 0.50 deg`, or `no pose`."""
        return "no pose" if self.cam_from_world is None else f"{100 * self.metres:.2f} cm, {self.degrees:.2f} deg"


def write_worst(results: Path, baseline: Path, margins: Margins, out: Path) -> str:
    """Write pictures of the worst sequences into out/worst; Markdown that shows them.

    "" without pictures: for a baseline in one file, flights in closed loop, or frames that were not kept.
    """
    shown: list[str] = []
    found = _pictures(results, baseline, margins)
    first = next(found, None)
    if first is None and not (out / WORST).exists():
        return ""
    with new_folder(out / WORST, WORST_MARKER) as new:
        (new / WORST_MARKER.name).write_text(json.dumps({"made_by": "uavbench gate"}), encoding="utf-8")
        while first is not None and len(shown) < MOST:
            caption, picture = first
            name = f"{len(shown) + 1}.png"
            small = Pillow.fromarray(picture[..., ::-1]).quantize(
                COLOURS, Pillow.Quantize.FASTOCTREE, dither=Pillow.Dither.NONE
            )
            small.save(new / name, optimize=True)
            shown.append(f"{caption}\n\n![{name}: before and after]({WORST}/{name})\n")
            first = next(found, None)
    return "\n".join(["### The worst sequences\n", f"{LEGEND}\n", *shown]) if shown else ""


def _pictures(results: Path, baseline: Path, margins: Margins) -> Iterator[tuple[str, Image]]:
    """Caption and picture of each sequence that has frames and results, the worst first."""
    if baseline.is_file():
        return
    base, head = read_side(baseline), read_side(results)
    if head.is_flown:
        return
    both = [
        Run(key, base.runs[key], one, worsening(base.runs[key], one, margins))
        for key, one in head.runs.items()
        if key in base.runs
    ]
    done: set[tuple[str, int]] = set()
    for run in sorted(both, key=lambda run: run.rank):
        if run.key[1:] in done:
            continue
        try:
            yield _picture(run, results, baseline)
        except DamagedFileError:
            raise
        except (UserError, OSError):  # its frames or its poses were not kept
            continue
        done.add(run.key[1:])


def worsening(base: Measured, head: Measured, margins: Margins) -> float:
    """Largest change for the worse of a run, in margins; infinite where it crashes or lacks a number."""
    if head.crash and not base.crash:
        return math.inf
    worst = (base.coverage - head.coverage) / max(margins.coverage, LEAST_MARGIN)
    for metric, before in base.errors.items():
        now = head.errors.get(metric, math.nan)
        if math.isfinite(before):
            change = math.log((now + TINY) / (before + TINY)) if math.isfinite(now) else math.inf
            worst = max(worst, change / math.log1p(max(margins.error, LEAST_MARGIN)))
    return worst


def _picture(run: Run, results: Path, baseline: Path) -> tuple[str, Image]:
    """Caption of a run, and its worst frame with the poses of both sides; UserError when a file is missing."""
    label, name, seed = run.key
    sequence = Sequence.load(_folder(results / "sequences", name, seed))
    of_base, of_head = (
        sound(Results.load(_folder(side / "results", name, seed) / label))[0] for side in (baseline, results)
    )
    errors = frame_errors(sequence, of_base), frame_errors(sequence, of_head)
    frame = worst_frame(*errors)
    before, after = (_seen(found, each, frame) for found, each in zip((of_base, of_head), errors, strict=True))
    view = View.of(sequence.image(frame), sequence.camera, sequence.structure)
    truth = sequence.true_cam_from_world(frame)
    panels = [
        _panel(view, seen, truth, f"{word}: {seen.text}") for word, seen in (("before", before), ("after", after))
    ]
    gap = np.full((len(panels[0]), GAP_PX, 3), 255, dtype=np.uint8)
    ate = " to ".join(_centimetres(one.errors.get("ATE", math.nan)) for one in (run.base, run.head))
    coverage = " to ".join(f"{100 * one.coverage:.4g}" for one in (run.base, run.head))
    caption = (
        f"**{name}, seed {seed}**, `{label}`: ATE {ate}, coverage {coverage} %; frame {frame}: {before.text} before, "
        f"{after.text} after."
    )
    return caption, np.hstack([panels[0], gap, panels[1]])


def _folder(within: Path, name: str, seed: int) -> Path:
    """Folder of a sequence within another, with or without the seed in its name."""
    seeded = within / f"{name}-s{seed}"
    return seeded if seeded.is_dir() else within / name


def worst_frame(base: FrameErrors, head: FrameErrors) -> int:
    """The first frame for which only the baseline has a pose, else the one with the largest position error."""
    located = set(base.frames[base.ok].tolist())
    for frame in head.frames[~head.ok].tolist():
        if frame in located:
            return int(frame)
    if not len(head):
        raise UserError("no frame was to be located")
    return int(head.frames[np.argmax(np.where(head.ok, head.translation_m, -1.0))])


def _seen(results: Results, errors: FrameErrors, frame: int) -> Seen:
    k = int(np.searchsorted(errors.frames, frame))
    if k == len(errors) or errors.frames[k] != frame or not errors.ok[k]:
        return Seen(None, math.inf, math.inf)
    (row,) = np.flatnonzero(results.frames == frame)[:1]
    return Seen(results.rows[row].cam_from_world, float(errors.translation_m[k]), float(errors.angle_deg[k]))


def _panel(view: View, seen: Seen, truth: Pose, words: str) -> Image:
    """The downscaled image with the model at an estimate and at the true pose."""
    scale = WIDTH_PX / view.image.shape[1]
    canvas: Image = np.asarray(cv2.resize(view.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    draw(canvas, view.projected(truth) * scale, WHITE, 1)
    draw(canvas, view.projected(seen.cam_from_world) * scale, GREEN, 2)
    write_text_on(canvas, words)
    return canvas


def _centimetres(metres: float) -> str:
    return f"{100 * metres:.3g} cm" if math.isfinite(metres) else "none"
