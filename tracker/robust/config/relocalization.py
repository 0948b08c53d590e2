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
    """Step of shifts, refined about the best one: the truncation distance. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation. Chosen on rendered seeds."""
    beside_rad: Positive = 0.1
    """Change of viewing direction by which the best poses near an uncertain guess are improved. Chosen on rendered
    seeds."""
    roll_step_rad: Positive = 0.06
    """Step of roll. Chosen on rendered seeds."""
    range_step_log: Positive = 0.06
    """Step of the logarithm of the range. Chosen on rendered seeds."""
    far_step_factor: Positive = 2.0
    """Both steps are so much longer far from a guess. Chosen on rendered seeds, for time."""
    block_candidates: Count = 8
    """Poses kept of each viewing direction, and refined of all. Chosen on rendered seeds."""
    pattern_levels: Count = 3
    """Halvings of the steps of a pattern search (Hooke & Jeeves 1961). Chosen on rendered seeds."""
    pattern_sweeps: Count = 2
    """Most sweeps with each step. Chosen on rendered seeds, for time."""
    shift_cost: NotNegative = 0.02
    """Score that each squared standard deviation of a shift from the guess costs. Chosen on rendered seeds."""
    outside_score: Part = 0.3
    """Score of a point that falls outside the image. Chosen on rendered seeds."""
    hopeless_score: Part = 0.12
    """Poses worse than the best so far by this are given up early. Chosen on rendered seeds."""
    retried_score: Part = 0.12
    """A pose that was fitted is tried again where it scores better by this. Chosen on rendered seeds."""
    projection_evaluations: Count = 16
    """What projecting an edge point takes, in evaluations (see `BudgetConfig`). Measured on the same core."""
    sampling_evaluations: Count = 300
    """What finding a visible edge point takes, in evaluations. Measured on the same core."""


@dataclass(frozen=True)
class SelfSimilarityConfig:
    """Places at which the structure looks as it does at a fit: its rivals."""

    tolerance: Positive = 0.002
    """Edges closer to each other than this part of the structure's size are in one place. Chosen on rendered bridges
    and facades."""
    shifts: Count = 512
    """Shifts of the structure onto itself that are known. Measured on rendered bridges: those of a girder's stiffeners,
    short beside its chords, are among the first 300."""
    share: Part = 0.6
    """Share of what is seen that a shift brings onto edges where there is a rival. Measured on bridges seen from the
    side: 0.7 to 0.9 for their panels; on boxes 0.2 to 0.6 for their sides."""
    sigmas: Positive = 5.0
    """Standard deviations of the prediction within which there are rivals."""
    rivals: Count = 6
    """Rivals fitted at a time, the likeliest first: four neighbours and two diagonal ones of a window. For time."""
    lead: Part = 0.04
    """Support by which a fit leads its rivals before it is believed. Measured on 61 frames of bridges: the true pose
    leads by 0.04 to 0.3."""


@dataclass(frozen=True)
class RelocalizationConfig:
    """Range of the pose search, and which of its poses are fitted and accepted."""

    search: PoseSearchConfig = field(default_factory=PoseSearchConfig)
    """The search on a small image."""
    similarity: SelfSimilarityConfig = field(default_factory=SelfSimilarityConfig)
    """The places at which the structure looks as it does here."""
    good_support: Part = 0.6
    """With less support a pose is searched, first nearby, then farther away. Chosen on rendered seeds."""
    near_roll_rad: Positive = 0.15
    """Reach of roll near a guess. Chosen on rendered seeds."""
    near_range_part: Positive = 0.15
    """Reach of the range near a guess. Chosen on rendered seeds."""
    near_shift_part: Positive = 0.17
    """Reach of shifts near a guess, in parts of the image's width. Chosen on rendered seeds."""
    far_view_rad: Positive = 0.4
    """Reach of azimuth far from a guess, of elevation half of it. Chosen on rendered seeds."""
    far_roll_rad: Positive = 0.12
    """Reach of roll far from a guess. Chosen on rendered seeds."""
    far_range_part: Positive = 0.25
    """Reach of the range far from a guess. Chosen on rendered seeds."""
    far_shift_part: Positive = 0.3
    """Reach of shifts far from a guess, in parts of the image's width. Chosen on rendered seeds."""
    near_fits: Count = 8
    """Poses that agree with the image about as well as the best one are fitted before it is believed, but no more than
    this. Chosen on rendered seeds, for time."""
    most_fits: Count = 64
    """Fits after which a search ends once all places were looked at. Chosen on rendered seeds, for time."""
    half_px: Positive = 20.0
    """Half length of search lines from poses found. Chosen on rendered seeds."""
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
    lead: Part = 0.1
    """Support by which the best fit leads those of other poses before it is believed. Chosen on rendered seeds."""
    perturbations: Annotated[int, Ge(0)] = 24
    """Poses sampled about the best fit (evolution strategy: Rechenberg 1973). Chosen on rendered seeds."""
    perturbation_turn_rad: Positive = 0.1
    """Their reach in turns of the object: wrong fits mostly have the right outline of a box turned by some 0.1 rad.
    Measured on rendered boxes."""
    perturbation_part: Positive = 0.05
    """Their reach in roll (rad) and range (part). Chosen on rendered seeds."""
    perturbation_shift_rad: Annotated[float, Gt(0)] = 0.01
    """Their reach in shifts of the image. Chosen on rendered seeds."""
