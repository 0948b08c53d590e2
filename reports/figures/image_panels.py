"""Figures of images: LSD segments, model edges on detected edges, projection into the next frame."""

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
    """Row indices of the results, evenly spaced over the run, without the last."""
    return sorted({round(place) for place in np.linspace(0, max(len(run.results) - 2, 0), count).tolist()})


def view_of(run: ScoredRun, frame: int) -> View:
    """One undistorted frame of a run's sequence to draw on; UserError when its image cannot be read."""
    return View.of(run.sequence.image(frame), run.sequence.camera, run.sequence.structure)


def segment_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """Write a figure of the LSD segments of at least 15 px on selected frames; the paths of its files."""
    pictures, titles, rows = [], [], []
    for row in chosen_rows(run):
        frame = int(run.results.frames[row])
        picture, count = view_of(run, frame).segments()
        pictures.append(picture)
        titles.append(f"frame {frame}: {count} segments")
        rows.append([frame, count])
    return picture_row(pictures, titles, stem, ["frame", "segments"], rows)


def edge_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """Write a figure of the model edges at the estimated pose (green) on detected edges (white); its files."""
    pictures, titles, rows = [], [], []
    for row in chosen_rows(run):
        frame = int(run.results.frames[row])
        pictures.append(view_of(run, frame).model_on_edges(run.results.rows[row].cam_from_world))
        titles.append(f"frame {frame}: {error_text(run, frame)}")
        rows.append(error_row(run, frame))
    return picture_row(pictures, titles, stem, ["frame", "position_m", "rotation_deg"], rows)


def next_frame_pictures(run: ScoredRun, stem: Path) -> list[Path]:
    """Write a figure of the model at the pose of a frame (green) projected into the next one; its files.

    White: ground truth of the next frame.
    """
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
    """Write images (h, w, 3) BGR side by side over two columns, a title above each; the paths of the files."""
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
    """Frame, position error in m and rotation error in deg of an expected frame; None where it is lost."""
    k = int(np.searchsorted(run.errors.frames, frame))
    known = bool(run.errors.ok[k])
    return [frame, *(float(e[k]) if known else None for e in (run.errors.translation_m, run.errors.angle_deg))]


def error_text(run: ScoredRun, frame: int) -> str:
    """Errors of a frame as text, `1.2 cm, 0.5°`, or `no pose`."""
    _, metres, degrees = error_row(run, frame)
    return "no pose" if metres is None else f"{100 * metres:.1f} cm, {degrees:.1f}\N{DEGREE SIGN}"
