"""Tuned values of texture patches."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Interval

from uavbench.tracker.robust.config.bounds import Count, NotNegative, Part, Positive


@dataclass(frozen=True)
class AlignmentConfig:
    """Alignment of a patch by Gauss-Newton (Baker & Matthews 2004)."""

    max_steps: Count = 6
    """Most Gauss-Newton steps. Chosen on rendered seeds, for time."""
    settled_texels: Positive = 0.02
    """An alignment ends with a step below this. A fifth of a patch's own error."""
    max_step_texels: Positive = 1.5
    """Longest step. Chosen on rendered seeds."""
    reach_texels: Annotated[int, Ge(1)] = 6
    """Half width of the coarse search, and farthest shift of an alignment. Chosen on rendered seeds."""
    max_coarse: Annotated[int, Ge(0)] = 6
    """Patches in a frame for which a coarse search is made. Chosen on rendered seeds, for time."""
    coarse_correlation: Part = 0.4
    """Least correlation of the coarse search from which an alignment starts. Chosen on rendered seeds."""
    min_correlation: Part = 0.85
    """Least correlation of a patch that counts as found. Chosen on rendered seeds."""
    min_contrast_grey: NotNegative = 3.0
    """Contrast below which a patch is mostly noise. Chosen on rendered seeds."""
    variance_px2: Positive = 0.1**2
    """Variance of a patch along either axis beside that of noise. Measured on rendered boxes: patches are known
    relative to each other to about 0.1 px."""
    min_area: Positive = 0.35
    """A patch is looked for while its area is at least this part of what it was. Chosen on rendered seeds."""
    max_area: Positive = 3.0
    """And at most so many times. Chosen on rendered seeds."""
    max_stretch: Positive = 2.0
    """And no texel step is longer than this, px. Chosen on rendered seeds."""
    border_px: NotNegative = 6.0
    """Patches nearer to the image's border are not looked for. Chosen on rendered seeds."""


@dataclass(frozen=True)
class PatchesConfig:
    """Selection, use and removal of patches."""

    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """Alignment in later frames."""
    max_used: Count = 32
    """Patches looked for in a frame. Chosen on rendered seeds, for time."""
    enough_found: Count = 24
    """New patches are taken when fewer than this are found. Chosen on rendered seeds."""
    enough_to_predict: Count = 8
    """With so many found at the predicted pose the edges need no wide search. Chosen on rendered seeds."""
    take_every: Count = 4
    """Frames from one search of new patches to the next while some are found. Chosen on rendered seeds, for time."""
    take_support: Part = 0.6
    """Patches are taken where the edges alone support the pose so much. Chosen on rendered seeds."""
    spots: Count = 32
    """Places in a frame where new patches are looked for. Chosen on rendered seeds, for time."""
    initial_spots: Count = 400
    """The same while there are none. Chosen on rendered seeds."""
    new: Count = 6
    """Most new patches of a frame. Chosen on rendered seeds, for time."""
    initial_new: Count = 64
    """The same while there are none. Chosen on rendered seeds."""
    spacing_px: Positive = 9.0
    """Patches lie no nearer to each other: those of 9 x 9 texels do not overlap. Measured round a box 2.5 m away:
    patches 6 px apart drift."""
    edge_margin_px: Positive = 8.0
    """Nor nearer to the edges. Chosen on rendered seeds."""
    flat_margin_px: Positive = 3.0
    """Margin around a patch that must lie on its face. Chosen on rendered seeds."""
    min_corner_grey2: Positive = 8.0
    """Least strength of a corner, (grey levels per px)^2 (Shi & Tomasi 1994). Chosen on rendered seeds."""
    min_contrast_grey: NotNegative = 4.0
    """Least contrast of a patch when it is taken. Chosen on rendered seeds."""
    min_hits: Annotated[int, Ge(1)] = 2
    """With fewer patches found new ones begin a new nuisance bias. Chosen on rendered seeds."""
    young_s: NotNegative = 1.0
    """Age at which a patch's variance is twice that of an old one: it may lie on a moving occluder. Chosen on one
    rendered seed of the suite occlusion."""
    min_age_s: Annotated[float, Interval(gt=0, le=1)] = 0.05
    """Least age of a patch. Chosen on rendered seeds."""
    max_misses: Annotated[int, Ge(0)] = 6
    """A patch missed in more frames than this is dropped. Chosen on rendered seeds."""
