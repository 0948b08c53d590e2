"""Figures of images: LSD segments, model edges on detected edges, projection on the next frame."""

from collections.abc import Sequence as ListOf
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.reports.figures.tracker_pictures import Image, View
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.style import TWO_COLUMNS_IN, new_figure, save_figure

PICTURES = 4


def chosen_rows(run: ScoredRun, count: int = PICTURES) -> list[int]:
    """Rows of the results, evenly spaced over the run, without the last."""
    return sorted({round(place) for place in np.linspace(0, max(len(run.results) - 2, 0), count).tolist()})


def view_of(run: ScoredRun, frame: int) -> View:
    """One frame of a run's sequence, ready to be drawn on."""
    return View.of(run.sequence.image(frame), run.sequence.camera, run.sequence.structure)


def segment_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """LSD segments of at least 15 px on selected frames, drawn and counted."""
    pictures, titles, rows = [], [], []
    for row in chosen_rows(run):
        frame = int(run.results.frames[row])
        picture, count = view_of(run, frame).segments()
        pictures.append(picture)
        titles.append(f"frame {frame}: {count} segments")
        rows.append([frame, count])
    return picture_row(pictures, titles, stem, ["frame", "segments"], rows)


def edge_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """Model edges at the estimated pose (green) on the detected edges (white)."""
    pictures, titles, rows = [], [], []
    for row in chosen_rows(run):
        frame = int(run.results.frames[row])
        pictures.append(view_of(run, frame).model_on_edges(run.results.rows[row].cam_from_world))
        titles.append(f"frame {frame}: {error_text(run, frame)}")
        rows.append(error_row(run, frame))
    return picture_row(pictures, titles, stem, ["frame", "position_m", "rotation_deg"], rows)


def next_frame_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """The model at the pose of one tracked frame (green), projected on the next one; white: ground truth there."""
    pictures, titles, rows = [], [], []
    for row in chosen_rows(run):
        if row + 1 >= len(run.results):
            continue
        now, later = int(run.results.frames[row]), int(run.results.frames[row + 1])
        estimate, ground_truth = run.results.rows[row].cam_from_world, run.sequence.true_cam_from_world(later)
        view = view_of(run, later)
        pictures.append(view.overlay(estimate, ground_truth))
        titles.append(f"pose of frame {now} on frame {later}")
        rows.append([now, later])
    return picture_row(pictures, titles, stem, ["pose_of_frame", "drawn_on_frame"], rows)


def picture_row(
    pictures: ListOf[Image], titles: ListOf[str], stem: Path, columns: ListOf[str], rows: ListOf[ListOf[Any]]
) -> list[Path]:
    """Pictures side by side over two columns, a title above each."""
    height, width = pictures[0].shape[:2]
    each_in = TWO_COLUMNS_IN / len(pictures)
    figure = new_figure(each_in * height / width + 0.22)
    figure.get_layout_engine().set(w_pad=0.015, h_pad=0.01, wspace=0, hspace=0)  # type: ignore[union-attr, call-arg]
    for panel, picture, title in zip(
        figure.subplots(1, len(pictures), squeeze=False)[0], pictures, titles, strict=True
    ):
        small = cv2.resize(picture, None, fx=(shown := min(1.0, 560 / width)), fy=shown, interpolation=cv2.INTER_AREA)
        panel.imshow(small[..., ::-1], interpolation="antialiased")
        panel.set_title(title, fontsize=7, pad=2)
        panel.axis("off")
    return save_figure(figure, stem, columns, rows)


def error_row(run: ScoredRun, frame: int) -> list[Any]:
    """Frame, position error in m, rotation error in deg; None where it is lost."""
    k = int(np.searchsorted(run.errors.frames, frame))
    known = bool(run.errors.ok[k])
    return [frame, *(float(e[k]) if known else None for e in (run.errors.translation_m, run.errors.angle_deg))]


def error_text(run: ScoredRun, frame: int) -> str:
    """`1.2 cm, 0.5°`, or `no pose`."""
    _, metres, degrees = error_row(run, frame)
    return "no pose" if metres is None else f"{100 * metres:.1f} cm, {degrees:.1f}\N{DEGREE SIGN}"
