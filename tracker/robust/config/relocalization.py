"""Tuned values of relocalization."""

import math
from dataclasses import dataclass, field

from uavbench.tracker.robust.config.bounds import Part, Positive, Weight

FAR_VIEW_RAD = 0.4
"""Extent of the search of azimuth far from a guess, and of elevation half as much. Limits the time of a complete
search: around one guess it takes up to 60,000,000 evaluations, as many as 24 frames of the default budget have for it.
"""
SMALL_WIDTH = 160
"""Width of the small image of the pose search, px."""


@dataclass(frozen=True)
class PoseSearchConfig:
    """Oriented chamfer search on a small image (Shotton, Blake & Cipolla 2008)."""

    truncation_px: Positive = 5.0
    """Distance in the small image at which an edge point counts as missed, and therefore the step of shifts, which are
    refined around the best one. Chosen on rendered seeds."""
    view_step_rad: Positive = 0.16
    """Step of azimuth and elevation. Chosen on rendered seeds."""

    @property
    def step_part(self) -> float:
        """Step of roll (rad) and of the logarithm of the range, which moves an edge point at the image's side by one
        step of shifts: either moves it by this fraction of its distance from the centre.
        """
        return self.truncation_px / (0.5 * SMALL_WIDTH)


@dataclass(frozen=True)
class SelfSimilarityConfig:
    """Rivals of a fit: poses at which the structure looks alike, due to repetition."""

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
    found_support: Weight = 0.3
    """Support that equals a factor of e in the weight of the inliers. Measured on a box in a level view: support 0.77
    at a pose that hid its top, 0.68 with 1.6 times the weight at the true pose."""
    lead: Part = 0.1
    """Support that makes a pose ten times as likely: the lead over fits at other poses at which a fit is accepted, or
    replaces an accepted one; and the same of scores: scoring of poses worse than the best by more is aborted, and a
    fitted pose is tried again when its score improves by more. Chosen on rendered seeds."""

    @property
    def near_part(self) -> float:
        """Extent near a guess of roll (rad), relative range, and shifts as a fraction of the image width.

        One step of viewing directions.
        """
        return self.search.view_step_rad

    @property
    def guess_sigma(self) -> float:
        """Standard deviation of the initial pose where the image does not support it, part of the range and rad.

        One step of roll and range.
        """
        return self.search.step_part

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
