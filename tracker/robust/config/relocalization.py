"""Tuned values of relocalization."""

import math
from dataclasses import dataclass, field

from uavbench.tracker.robust.config.bounds import Part, Positive, Ratio, Sigma, Weight


@dataclass(frozen=True)
class PoseSearchConfig:
    """Oriented chamfer search on a small image (Shotton, Blake & Cipolla 2008)."""

    truncation_px: Positive = 5.0
    """Distance in the small image at which an edge point counts as missed, and so the step of shifts, which are refined
    about the best one. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation. Chosen on rendered seeds."""
    step_part: Ratio = 0.06
    """Step of roll (rad) and of the logarithm of the range: either moves an edge point by this part of its distance
    from the middle. Chosen on rendered seeds."""
    clear_score: Part = 0.12
    """Difference of scores that counts: poses worse than the best so far by it are given up early, and one that was
    fitted is tried again where it scores better by it. Chosen on rendered seeds."""


@dataclass(frozen=True)
class SelfSimilarityConfig:
    """Places at which the structure looks as it does at a fit: its rivals."""

    tolerance: Ratio = 0.002
    """Edges closer to each other than this part of the structure's size are in one place. Chosen on rendered bridges
    and facades."""
    share: Part = 0.6
    """Share of what is seen that a shift brings onto edges where there is a rival. Measured on bridges seen from the
    side: 0.7 to 0.9 for their panels; on boxes 0.2 to 0.6 for their sides."""


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
    half_px: Positive = 20.0
    """Half length of search lines from poses found. Chosen on rendered seeds."""
    refit_half_px: Positive = 12.0
    """Half length of search lines when fitted again. Chosen on rendered seeds."""
    guess_sigma: Sigma = 0.06
    """One standard deviation by which a guess of a young run may be wrong, in parts of the range and in rad. Chosen on
    rendered seeds."""
    found_support: Weight = 0.3
    """Support added where e times as much weight of inliers is found. Measured on a box seen level: 0.77 of a pose
    that hid its top, 0.68 of 1.6 times as much at the true one."""
    lead: Part = 0.1
    """Support that makes a pose ten times as likely: by so much a fit leads those of other poses before it is believed,
    or takes the place of one that holds. Chosen on rendered seeds."""

    @property
    def found_sigma(self) -> float:
        """One standard deviation of a pose that was found, in parts of the range and in rad.

        The true viewing direction is at most half a step beside it: two standard deviations.
        """
        return 0.25 * self.search.view_step_rad

    @property
    def lead_of_rivals(self) -> float:
        """Support that makes a pose e times as likely: by so much a fit leads its rivals before it is believed.

        Measured on 61 frames of bridges: the true pose leads by 0.04 to 0.3.
        """
        return self.lead / math.log(10.0)

    @property
    def sigma_cost(self) -> float:
        """Score, and support, that a squared standard deviation from the guess costs: half, as in a normal prior."""
        return 0.5 * self.lead_of_rivals
