"""The config of a fit as arguments of the compiled kernels."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.config.edges import (
    AppearanceConfig,
    SearchConfig,
    WeightConfig,
)
from uavbench.tracker.robust.config.solver import EstimatorConfig
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.trajectories.pose import Array


class Widths(NamedTuple):
    """Cutoffs of Tukey's biweight in px, in order, for each fit of a frame."""

    coarse: Array
    fine: Array
    last: Array


class KernelConfig(NamedTuple):
    """Values of the stages, each as returned by `kernel_values`."""

    search: SearchConfig
    appearance: AppearanceConfig
    weights: WeightConfig
    estimator: EstimatorConfig
    widths: Widths

    @classmethod
    def of(cls, config: RobustConfig) -> "KernelConfig":
        """The values of a config."""
        edges, solver, e = config.edges, config.solver, config.solver.estimator
        return cls(
            kernel_values(edges.search),
            kernel_values(edges.appearance),
            kernel_values(edges.weights),
            kernel_values(solver.estimator),
            Widths(*map(np.array, (e.coarse_widths_px, e.fine_widths_px, e.fine_widths_px[-2:]))),
        )
