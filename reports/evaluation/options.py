"""Options of an evaluation: a mode is a set of defaults that reproduces a known tool; given options override it."""

from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, TypeVar

from uavbench.reports.metrics.align import Alignment
from uavbench.reports.metrics.association import Association
from uavbench.reports.metrics.rpe import PairInterval, Unit
from uavbench.trajectories.errors import UserError, refuse_other, unknown_name

Mode = Literal["uavbench", "evo", "tum", "kitti", "rpg"]
Segments = Literal["none", "kitti", "rpg"]
OWN_MODE: Mode = "uavbench"
NUMBERS, FLAGS = ("max_difference_s", "t_offset_s", "delta"), ("all_pairs", "ignore_frames")
TEXTS = ("reference_format", "estimate_format")
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the evaluation of an estimate against a reference."""

    align: Alignment = "none"
    association: Association = "one-to-one"
    max_difference_s: float = 0.01
    offset_s: float = 0.0
    interval: PairInterval = field(default_factory=PairInterval)
    segments: Segments = "none"

    def __post_init__(self) -> None:
        refuse_other("align", self.align, Alignment)
        refuse_other("association", self.association, Association)
        refuse_other("segments", self.segments, Segments)


MODES: dict[str, Options] = {
    "uavbench": Options(),
    "evo": Options(association="evo", interval=PairInterval(pairs_from="estimate")),
    "tum": Options(align="se3", max_difference_s=0.02, interval=PairInterval(1.0, "s", all_pairs=True)),
    "kitti": Options(segments="kitti"),
    "rpg": Options(align="yaw", association="evo", max_difference_s=0.02, segments="rpg"),
}
"""Conventions of each mode: evo 1.38 (Grupp), the TUM RGB-D scripts, the KITTI devkit, rpg_trajectory_evaluation."""


class EvaluateOptions(TypedDict, total=False):
    """Options of `evaluate_files`; those not given have the defaults of `mode`.

    align: alignment of the estimate; association, max_difference_s: how stamps are paired; t_offset_s: added to the
    stamps of the estimate; delta, unit, all_pairs, pairs_from: pair interval of the RPE; mode: conventions of a known
    tool; reference_format, estimate_format: formats of the two files, by default detected; mount: folder of a sequence
    whose cam_from_body converts the estimate to the frame of the reference; ignore_frames: do not compare the declared
    frames; plot: .pdf or .png file of the figure.
    """

    align: Alignment | None
    association: Association | None
    max_difference_s: float | None
    t_offset_s: float | None
    delta: float | None
    unit: Unit | None
    all_pairs: bool | None
    pairs_from: Literal["reference", "estimate"] | None
    mode: Mode | None
    reference_format: str | None
    estimate_format: str | None
    mount: str | Path | None
    ignore_frames: bool | None
    plot: str | Path | None


def chosen_options(given: EvaluateOptions) -> Options:
    """The given options, completed by the defaults of the mode; UserError for an unknown option or value."""
    for name, value in given.items():
        if name not in EvaluateOptions.__annotations__:
            raise unknown_name("option", name, list(EvaluateOptions.__annotations__))
        if value is not None and (wanted := _wanted(name, value)):
            raise UserError(f"{name} = {value!r}: must be {wanted}")
    mode = _given(given.get("mode"), OWN_MODE)
    refuse_other("mode", mode, Mode)
    preset = MODES[mode]
    return Options(
        align=_given(given.get("align"), preset.align),
        association=_given(given.get("association"), preset.association),
        max_difference_s=_given(given.get("max_difference_s"), preset.max_difference_s),
        offset_s=_given(given.get("t_offset_s"), preset.offset_s),
        interval=PairInterval(
            _given(given.get("delta"), preset.interval.delta),
            _given(given.get("unit"), preset.interval.unit),
            _given(given.get("all_pairs"), preset.interval.all_pairs),
            _given(given.get("pairs_from"), preset.interval.pairs_from),
        ),
        segments=preset.segments,
    )


def _wanted(name: str, value: Any) -> str:
    """What an option takes in place of a value of another type; "" for one of its type."""
    if name in NUMBERS and (isinstance(value, bool) or not isinstance(value, Real)):
        return f"a number, as in {name} = 0.5"
    if name in FLAGS and not isinstance(value, bool):
        return "True or False"
    return "the name of a format" if name in TEXTS and not isinstance(value, str) else ""


def _given(value: T | None, default: T) -> T:
    return default if value is None else value
