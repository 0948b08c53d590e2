"""The figure of `uavbench evaluate`: both paths, and the errors over time."""

from pathlib import Path

import numpy as np

from uavbench.reports.evaluation.panels import draw_over_time, draw_paths
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.quaternions import angle, between, norm
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.reports.style import GROUND_TRUTH, house_style, new_figure, save_figure

FIGURE = "figure of errors"


def plot_evaluation(
    pairs: PosePairs, ate: dict[str, ErrorSummary], align: str, path: Path, longest_ns: float = np.inf
) -> None:
    """Write paths from above and errors over time, 7.16 in wide, as .pdf or .png, and the numbers as .csv.

    ate: summaries of `translation_m` and `rotation_deg`; align: name of the alignment, for the legend;
    longest_ns: step between two pairs beyond which lines have a gap.
    """
    t = (pairs.stamps_ns - pairs.stamps_ns[0]) / NS
    metres = norm(pairs.estimate_m - pairs.reference_m)
    degrees = np.degrees(angle(between(pairs.reference_q, pairs.estimate_q)))
    with house_style():
        figure = new_figure(2.6)
        grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.6])
        above = figure.add_subplot(grid[:, 0])
        draw_paths(pairs, above, f"estimate, aligned: {align}", longest_ns)
        above.set_aspect("equal", adjustable="datalim")
        above.set_xlabel("x (m)")
        above.set_ylabel("y (m)")
        top = figure.add_subplot(grid[0, 1])
        below = figure.add_subplot(grid[1, 1], sharex=top)
        for panel, values, key, name in (
            (top, metres, "translation_m", "position error (m)"),
            (below, degrees, "rotation_deg", "rotation error (deg)"),
        ):
            draw_over_time(pairs, values, panel, longest_ns)
            panel.axhline(ate[key].rmse, color=GROUND_TRUTH, lw=0.7, ls=":")
            panel.set_title(f"RMSE {ate[key].rmse:.4g} (dotted)", loc="right", fontsize=7, pad=2)
            panel.set_ylabel(name)
            panel.set_ylim(bottom=0)
        top.tick_params(labelbottom=False)
        below.set_xlabel("time (s)")
        figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=2)
        rows = np.column_stack([t, pairs.reference_m, pairs.estimate_m, metres, degrees]).tolist()
        places = [f"{what}_{axis}_m" for what in ("reference", "estimate") for axis in "xyz"]
        columns = ["time_s", *places, "position_error_m", "rotation_error_deg"]
        save_figure(figure, path.with_suffix(""), columns, rows, suffixes=(path.suffix,), kind=FIGURE)
