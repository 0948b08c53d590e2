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
from uavbench.tracker.robust.kernel_values import kernel_type, kernel_values
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array


class Widths(NamedTuple):
    """Cutoffs of Tukey's biweight in px, in order, for each fit of a frame.

    last_px: the last one of all; trusted_px: residual up to which a match is believed; fine_half_px: half length of the
    search lines of the short search; separate_px: distance from which on edges do not disturb each other.
    """

    coarse: Array
    fine: Array
    last: Array
    last_px: float
    trusted_px: float
    fine_half_px: float
    separate_px: float

    @classmethod
    def of(cls, estimator: EstimatorConfig) -> "Widths":
        """The widths of a config."""
        fine = np.array(estimator.fine_widths_px)
        return cls(
            np.array(estimator.coarse_widths_px),
            fine,
            fine[-2:].copy(),
            estimator.last_width_px,
            estimator.trusted_px,
            estimator.fine_half_px,
            float(estimator.separate_px),
        )


class KernelConfig(NamedTuple):
    """Values of the stages, each as returned by `kernel_values`; spacing_px: distance of control points."""

    search: SearchConfig
    appearance: AppearanceConfig
    weights: WeightConfig
    estimator: EstimatorConfig
    widths: Widths
    spacing_px: float

    @classmethod
    def of(cls, config: RobustConfig) -> "KernelConfig":
        """The values of a config."""
        edges, solver = config.edges, config.solver
        return cls(
            kernel_values(edges.search),
            kernel_values(edges.appearance),
            kernel_values(edges.weights),
            kernel_values(solver.estimator),
            Widths.of(solver.estimator),
            float(edges.sampling.spacing_px),
        )


WIDTHS = named_tuple(Widths, "f1! f1! f1! f0 f0 f0 f0")
KERNEL_CONFIG = named_tuple(
    KernelConfig,
    "search appearance weights estimator widths f0",
    search=kernel_type(SearchConfig),
    appearance=kernel_type(AppearanceConfig),
    weights=kernel_type(WeightConfig),
    estimator=kernel_type(EstimatorConfig),
    widths=WIDTHS,
)
