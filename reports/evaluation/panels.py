"""A panel of an evaluation: an error over time, or both paths from above."""

from typing import Literal

import numpy as np
from matplotlib.axes import Axes

from uavbench.reports.metrics.ape import pose_error_sizes
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.style import GROUND_TRUTH, colour, given_axes, line
from uavbench.trajectories.errors import refuse_other

Quantity = Literal["position", "rotation", "path"]


def draw(pairs: PosePairs, quantity: Quantity, axes: Axes | None = None) -> Axes:
    """Draw a quantity of the pairs on an Axes (None: a new one) and return it; UserError for an unknown quantity."""
    refuse_other("quantity", quantity, Quantity)
    panel = given_axes(axes)
    if quantity == "path":
        panel.plot(*pairs.reference_m[:, :2].T, color=GROUND_TRUTH, lw=1.4, label="reference")
        panel.plot(*pairs.estimate_m[:, :2].T, label="estimate", **line(1))
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel("x (m)")
        panel.set_ylabel("y (m)")
        panel.legend()
        return panel
    position_m, rotation_rad = pose_error_sizes(pairs)
    values = position_m if quantity == "position" else np.degrees(rotation_rad)
    rmse = float(np.sqrt(np.mean(values**2)))
    panel.plot((pairs.stamps_ns - pairs.stamps_ns[0]) / NS, values, color=colour(1), lw=0.7)
    panel.axhline(rmse, color=GROUND_TRUTH, lw=0.7, ls=":", label=f"RMSE {rmse:.4g}")
    panel.set_xlabel("time (s)")
    panel.set_ylabel(f"{quantity} error ({'m' if quantity == 'position' else 'deg'})")
    panel.set_ylim(bottom=0)
    panel.legend()
    return panel
