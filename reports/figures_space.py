"""Figures in space: the path from above over the structure's outline."""

from collections.abc import Sequence as ListOf
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from reports.runs import ScoredRun
from reports.style import TRUTH, line, new_figure, save_figure
from scenes.structure import Structure
from trajectories.pose import Array


def path_from_above(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """True and estimated paths of one sequence in the x-y plane, over the outline of the structure, in metres."""
    figure = new_figure(3.3, wide=False)
    panel = figure.subplots()
    truth = runs[0].sequence.truth.positions_m
    outline(panel, runs[0].sequence.structure)
    panel.plot(truth[:, 0], truth[:, 1], color=TRUTH, lw=1.6, label="truth")
    panel.plot(*truth[0, :2], marker="o", ms=4.5, color=TRUTH, mfc="white", ls="none", label="start")
    rows: list[list[Any]] = [["truth", i, *p] for i, p in enumerate(truth.tolist())]
    for run in runs:
        p = run.errors.pairs.estimate_m
        still = float(np.nanmax(np.ptp(p[run.errors.ok], axis=0))) < 0.01 if run.errors.ok.any() else True
        style = {**line(run.colour), "marker": "x" if still else "", "lw": 0.9}
        panel.plot(p[:, 0], p[:, 1], label=run.title, **style)
        rows += [[run.name, f, *q] for f, q in zip(run.errors.frames.tolist(), p.tolist(), strict=True) if q[0] == q[0]]
    view(panel, runs[0].sequence.structure, truth)
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return save_figure(figure, stem, ["run", "frame", "x_m", "y_m", "z_m"], rows)


def outline(panel: Axes, structure: Structure) -> None:
    """The structure from above: its upward faces filled, its edges drawn."""
    up = structure.face_normals[structure.triangle_face][:, 2] > 0.3
    for triangle in structure.triangles[up]:
        panel.fill(*structure.vertices[triangle][:, :2].T, color="#DDD6CB", lw=0.3, zorder=1)
    segments = list(structure.edge_segments[:, :, :2])
    panel.add_collection(LineCollection(segments, colors="#8A7F70", linewidths=0.7, zorder=1.5))


def view(panel: Axes, structure: Structure, truth: Array) -> None:
    """Limits with equal scales around the structure and the true path; what strays farther is cut."""
    low = np.minimum(structure.bounds[0], truth.min(axis=0))[:2]
    high = np.maximum(structure.bounds[1], truth.max(axis=0))[:2]
    margin = 0.12 * float((high - low).max())
    panel.set_aspect("equal")
    panel.set_xlim(low[0] - margin, high[0] + margin)
    panel.set_ylim(low[1] - margin, high[1] + margin)
