"""A panel of an evaluation: an error over time, or both paths from above."""

from typing import Literal

import numpy as np
from matplotlib.axes import Axes

from uavbench.reports.evaluation.gaps import with_gaps
from uavbench.reports.metrics.ape import pose_error_sizes
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.style import GROUND_TRUTH, colour, dots_where_alone, given_axes, line
from uavbench.trajectories.errors import refuse_other
from uavbench.trajectories.pose import Array

Quantity = Literal["position", "rotation", "path"]


def draw(pairs: PosePairs, quantity: Quantity, axes: Axes | None = None, longest_ns: float = np.inf) -> Axes:
    """Draw a quantity of the pairs on an Axes (None: a new one) and return it; UserError for an unknown quantity.

    longest_ns: step between two pairs beyond which lines have a gap.
    """
    refuse_other("quantity", quantity, Quantity)
    panel = given_axes(axes)
    if quantity == "path":
        draw_paths(pairs, panel, "estimate", longest_ns)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel("x (m)")
        panel.set_ylabel("y (m)")
        panel.legend()
        return panel
    position_m, rotation_rad = pose_error_sizes(pairs)
    values = position_m if quantity == "position" else np.degrees(rotation_rad)
    rmse = float(np.sqrt(np.mean(values**2)))
    draw_over_time(pairs, values, panel, longest_ns)
    panel.axhline(rmse, color=GROUND_TRUTH, lw=0.7, ls=":", label=f"RMSE {rmse:.4g}")
    panel.set_xlabel("time (s)")
    panel.set_ylabel(f"{quantity} error ({'m' if quantity == 'position' else 'deg'})")
    panel.set_ylim(bottom=0)
    panel.legend()
    return panel


def draw_paths(pairs: PosePairs, panel: Axes, label: str, longest_ns: float) -> None:
    """Draw reference and estimate, which has a label, from above (m), with a gap in each longer step."""
    reference_m, estimate_m = (
        with_gaps(positions_m, pairs.stamps_ns, longest_ns) for positions_m in (pairs.reference_m, pairs.estimate_m)
    )
    dots = dots_where_alone(estimate_m[:, 0])
    panel.plot(*reference_m[:, :2].T, color=GROUND_TRUTH, lw=1.4, label="reference", **dots)
    panel.plot(*estimate_m[:, :2].T, label=label, **line(1), **dots)


def draw_over_time(pairs: PosePairs, values: Array, panel: Axes, longest_ns: float) -> None:
    """Draw values (n,) of the pairs over time (s) since the first, with a gap in each longer step."""
    t = with_gaps((pairs.stamps_ns - pairs.stamps_ns[0]) / NS, pairs.stamps_ns, longest_ns)
    shown = with_gaps(values, pairs.stamps_ns, longest_ns)
    panel.plot(t, shown, color=colour(1), lw=0.7, **dots_where_alone(shown))
