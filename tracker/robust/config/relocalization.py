"""Tuned values of relocalization."""

import math
from dataclasses import dataclass, field

from uavbench.tracker.robust.config.bounds import Part, Positive, Ratio, Sigma, Weight


@dataclass(frozen=True)
class PoseSearchConfig:
    """Oriented chamfer search on a small image (Shotton, Blake & Cipolla 2008)."""

    truncation_px: Positive = 5.0
    """Distance in the small image at which an edge point counts as missed, and therefore the step of shifts, which are
    refined around the best one. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation. Chosen on rendered seeds."""
    step_part: Ratio = 0.06
    """Step of roll (rad) and of the logarithm of the range: either moves an edge point by this fraction of its distance
    from the centre. Chosen on rendered seeds."""
    clear_score: Part = 0.12
    """Significant difference of scores: scoring of poses worse than the best by more is aborted, and a fitted pose is
    tried again when its score improves by more. Chosen on rendered seeds."""


@dataclass(frozen=True)
class SelfSimilarityConfig:
    """Rivals of a fit: poses at which the structure looks alike, due to repetition."""

    tolerance: Ratio = 0.002
    """Distance, as a fraction of the structure's size, below which edges coincide. Chosen on rendered bridges and
    facades."""
    share: Part = 0.6
    """Least fraction of the visible edge points that a shift maps onto edges, for a rival. Measured on bridges seen
    from the side: 0.7 to 0.9 for their panels; on boxes 0.2 to 0.6 for their sides."""


@dataclass(frozen=True)
class RelocalizationConfig:
    """Extent of the pose search, and criteria for fitting and accepting its poses."""

    search: PoseSearchConfig = field(default_factory=PoseSearchConfig)
    """Search on a small image."""
    similarity: SelfSimilarityConfig = field(default_factory=SelfSimilarityConfig)
    """Self-similarity of the structure."""
    near_part: Ratio = 0.15
    """Extent of roll (rad) and relative range near a guess. Chosen on rendered seeds."""
    near_shift_part: Ratio = 0.17
    """Extent of shifts near a guess, as a fraction of the image width. Chosen on rendered seeds."""
    half_px: Positive = 20.0
    """Half length of search lines at poses from the search. Chosen on rendered seeds."""
    refit_half_px: Positive = 12.0
    """Half length of search lines when such a pose is fitted again. Chosen on rendered seeds."""
    guess_sigma: Sigma = 0.06
    """Standard deviation of the guess in the first frames of a run, as a fraction of the range and in rad. Chosen on
    rendered seeds."""
    found_support: Weight = 0.3
    """Support that equals a factor of e in the weight of the inliers. Measured on a box in a level view: support 0.77
    at a pose that hid its top, 0.68 with 1.6 times the weight at the true pose."""
    lead: Part = 0.1
    """Support that makes a pose ten times as likely: the lead over fits at other poses at which a fit is accepted, or
    replaces an accepted one. Chosen on rendered seeds."""

    @property
    def found_sigma(self) -> float:
        """Standard deviation of a pose from the search, as a fraction of the range and in rad.

        The true viewing direction is at most half a step away, which is taken as two standard deviations.
        """
        return 0.25 * self.search.view_step_rad

    @property
    def lead_of_rivals(self) -> float:
        """Support that makes a pose e times as likely: the lead over its rivals at which a fit is accepted.

        Measured on 61 frames of bridges: the true pose leads by 0.04 to 0.3.
        """
        return self.lead / math.log(10.0)

    @property
    def sigma_cost(self) -> float:
        """Cost in score and support of one squared standard deviation from the guess: half, as in a normal prior."""
        return 0.5 * self.lead_of_rivals
