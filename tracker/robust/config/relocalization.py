"""Tuned values of relocalization."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt

from uavbench.tracker.robust.config.bounds import Count, NotNegative, Part, Positive


@dataclass(frozen=True)
class PoseSearchConfig:
    """Oriented chamfer search on a small image (Shotton, Blake & Cipolla 2008)."""

    edge_points: Count = 140
    """Points spread over the model's edges. Chosen on rendered seeds."""
    truncation_px: Positive = 5.0
    """Distance in the small image at which an edge point counts as missed. Chosen on rendered seeds."""
    min_gradient_grey: Positive = 14.0
    """Weakest edge pixel of the small image, over two px. Chosen on rendered seeds."""
    min_points: Count = 12
    """With fewer points in view nothing is searched. Chosen on rendered seeds."""
    shift_step_px: Positive = 5.0
    """Step of shifts far from a guess: the truncation distance. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation far from a guess. Chosen on rendered seeds."""
    roll_step_rad: Positive = 0.12
    """Step of roll far from a guess. Chosen on rendered seeds."""
    range_step_log: Positive = 0.11
    """Step of the logarithm of the range far from a guess. Chosen on rendered seeds."""
    near_shift_px: Positive = 3.0
    """Step of shifts near a guess. Chosen on rendered seeds."""
    near_turn_rad: Positive = 0.06
    """Step of turns, and of the range as a part, near a guess. Chosen on rendered seeds."""
    near_view_rad: Positive = 0.09
    """Change of viewing direction with which near poses are tried again. Chosen on rendered seeds."""
    outside_score: Part = 0.3
    """Score of a point that falls outside the image. Chosen on rendered seeds."""
    hopeless_score: Part = 0.12
    """A pose worse than the best so far by this is given up early. Chosen on rendered seeds."""
    pattern_levels: Count = 4
    """Halvings of the steps of a pattern search (Hooke & Jeeves 1961). Chosen on rendered seeds."""
    pattern_sweeps: Count = 3
    """Most sweeps with each step. Chosen on rendered seeds."""


@dataclass(frozen=True)
class RelocalizationConfig:
    """Range of the pose search, and which of its poses are fitted and accepted."""

    search: PoseSearchConfig = field(default_factory=PoseSearchConfig)
    """The search on a small image."""
    good_support: Part = 0.6
    """With less support a pose is searched, first nearby, then farther away. Chosen on rendered seeds."""
    sure_support: Part = 0.7
    """With this support the search ends. Chosen on rendered seeds."""
    near_reach_rad: Positive = 0.15
    """Reach near a guess, in rad and parts of the range. Chosen on rendered seeds."""
    near_shift_rad: Positive = 0.22
    """Reach of the image's shift near a guess. Chosen on rendered seeds."""
    far_view_rad: Positive = 0.4
    """Reach of azimuth far from a guess, of elevation half of it. Chosen on rendered seeds."""
    far_roll_rad: Positive = 0.12
    """Reach of roll far from a guess. Chosen on rendered seeds."""
    far_range_part: Positive = 0.25
    """Reach of the range far from a guess. Chosen on rendered seeds."""
    far_shift_part: Positive = 0.3
    """Reach of shifts far from a guess, in parts of the image's width. Chosen on rendered seeds."""
    near_fits: Annotated[int, Ge(2)] = 32
    """Poses fitted of the search near a guess. Chosen on rendered seeds, for time."""
    far_fits: Count = 16
    """Poses fitted of the search far from it. Chosen on rendered seeds, for time."""
    refits: Count = 2
    """Times that the best fits are fitted again. Chosen on rendered seeds."""
    refitted: Count = 4
    """Fits that are fitted again. Chosen on rendered seeds."""
    near_half_px: Positive = 20.0
    """Half length of search lines from near poses. Chosen on rendered seeds."""
    far_half_px: Positive = 28.0
    """Half length of search lines from far poses. Chosen on rendered seeds."""
    refit_half_px: Positive = 12.0
    """Half length of search lines when fitted again. Chosen on rendered seeds."""
    found_sigma: Positive = 0.04
    """One standard deviation of a pose that was found, in parts of the range and in rad. Chosen on rendered seeds."""
    fitted_sigma: Positive = 0.005
    """One standard deviation of a pose fitted once, in the same units. Chosen on rendered seeds."""
    guess_sigma: Positive = 0.06
    """One standard deviation by which a guess of a young run may be wrong. Chosen on rendered seeds."""
    found_support: NotNegative = 0.3
    """Support added where e times as much weight of inliers is found. Measured on a box seen level: 0.77 of a pose
    that hid its top, 0.68 of 1.6 times as much at the true one."""
    distance_cost: NotNegative = 0.02
    """Support that each squared standard deviation from the guess costs. Chosen on rendered seeds."""
    perturbations: Count = 8
    """Poses sampled about each of the best fits (evolution strategy: Rechenberg 1973). Chosen on rendered seeds."""
    generations: Annotated[int, Ge(0)] = 3
    """Times that they are sampled while no fit is sure. Chosen on rendered seeds."""
    perturbation_turn_rad: Positive = 0.1
    """Their reach in turns of the object: wrong fits mostly have the right outline of a box turned by some 0.1 rad.
    Measured on rendered boxes."""
    perturbation_part: Positive = 0.05
    """Their reach in roll (rad) and range (part). Chosen on rendered seeds."""
    perturbation_shift_rad: Annotated[float, Gt(0)] = 0.01
    """Their reach in shifts of the image. Chosen on rendered seeds."""
