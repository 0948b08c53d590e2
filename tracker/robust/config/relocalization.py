"""Tuned values of relocalization."""

from dataclasses import dataclass, field

from uavbench.tracker.robust.config.bounds import Count, Part, Positive, Ratio, Sigma, Weight


@dataclass(frozen=True)
class PoseSearchConfig:
    """Oriented chamfer search on a small image (Shotton, Blake & Cipolla 2008)."""

    truncation_px: Positive = 5.0
    """Distance in the small image at which an edge point counts as missed, and so the step of shifts, which are refined
    about the best one. Chosen on rendered seeds."""
    min_gradient_grey: Positive = 14.0
    """Weakest edge pixel of the small image, over two px. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation. Chosen on rendered seeds."""
    step_part: Ratio = 0.06
    """Step of roll (rad) and of the logarithm of the range: either moves an edge point by this part of its distance
    from the middle. Chosen on rendered seeds."""
    turn_rad: Positive = 0.1
    """Turn of the object by which wrong fits are mostly off, and good ones are looked for beside them: the outline of a
    box turned by some 0.1 rad is the right one. Measured on rendered boxes."""
    candidates: Count = 8
    """Poses kept of each viewing direction and refined of all; and those that agree with the image about as well as the
    best one and are fitted before it is believed. Chosen on rendered seeds, for time."""
    outside_score: Part = 0.3
    """Score of a point that falls outside the image. Chosen on rendered seeds."""
    clear_score: Part = 0.12
    """Difference of scores that counts: poses worse than the best so far by it are given up early, and one that was
    fitted is tried again where it scores better by it. Chosen on rendered seeds."""
    sigma_cost: Weight = 0.02
    """Score, and support, that each squared standard deviation from the guess costs. Chosen on rendered seeds."""


@dataclass(frozen=True)
class SelfSimilarityConfig:
    """Places at which the structure looks as it does at a fit: its rivals."""

    tolerance: Ratio = 0.002
    """Edges closer to each other than this part of the structure's size are in one place. Chosen on rendered bridges
    and facades."""
    share: Part = 0.6
    """Share of what is seen that a shift brings onto edges where there is a rival. Measured on bridges seen from the
    side: 0.7 to 0.9 for their panels; on boxes 0.2 to 0.6 for their sides."""
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
    near_part: Ratio = 0.15
    """Reach near a guess of roll (rad) and of the range, in parts of it. Chosen on rendered seeds."""
    near_shift_part: Ratio = 0.17
    """Reach of shifts near a guess, in parts of the image's width. Chosen on rendered seeds."""
    far_view_rad: Positive = 0.4
    """Reach of azimuth far from a guess, of elevation half of it. Chosen on rendered seeds."""
    far_range_part: Ratio = 0.25
    """Reach of the range far from a guess, in parts of it. Chosen on rendered seeds."""
    far_shift_part: Ratio = 0.3
    """Reach of shifts far from a guess, in parts of the image's width. Chosen on rendered seeds."""
    half_px: Positive = 20.0
    """Half length of search lines from poses found. Chosen on rendered seeds."""
    refit_half_px: Positive = 12.0
    """Half length of search lines when fitted again. Chosen on rendered seeds."""
    found_sigma: Sigma = 0.04
    """One standard deviation of a pose that was found, in parts of the range and in rad. Chosen on rendered seeds."""
    fitted_sigma: Sigma = 0.005
    """One standard deviation of a pose fitted once, in the same units. Chosen on rendered seeds."""
    guess_sigma: Sigma = 0.06
    """One standard deviation by which a guess of a young run may be wrong. Chosen on rendered seeds."""
    found_support: Weight = 0.3
    """Support added where e times as much weight of inliers is found. Measured on a box seen level: 0.77 of a pose
    that hid its top, 0.68 of 1.6 times as much at the true one."""
    lead: Part = 0.1
    """Support by which a fit leads those of other poses before it is believed, or takes the place of one that holds.
    Chosen on rendered seeds."""
    perturbation_part: Ratio = 0.05
    """Reach in roll (rad) and range (part) of the poses sampled about the best fit. Chosen on rendered seeds."""
    perturbation_shift_rad: Positive = 0.01
    """Their reach in shifts of the image. Chosen on rendered seeds."""
