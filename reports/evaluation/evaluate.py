"""Score any two trajectory files: the one-call form of association, alignment, ATE and RPE.

A mode is a set of defaults that repeats what a known tool does; options that are given go before it.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar, Unpack

import numpy as np

from uavbench.reports.evaluation.given import Given, found_in, name_of
from uavbench.reports.evaluation.trajectory_files import Found, mount_of
from uavbench.reports.metrics.align import Alignment, alignment
from uavbench.reports.metrics.ape import error_table, pose_error_sizes
from uavbench.reports.metrics.association import NS, Association, PosePairs, associate
from uavbench.reports.metrics.rpe import PairInterval, Unit, interval_pairs, motion_error_sizes
from uavbench.reports.metrics.sub_trajectories import KITTI_LENGTHS_M, SegmentErrors, rpg_lengths, segment_errors
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.tracker.versions import versions
from uavbench.trajectories.bags.poses import UNSAID
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from uavbench.reports.evaluation.panels import Quantity

Mode = Literal["uavbench", "evo", "tum", "kitti", "rpg"]
OWN_MODE: Mode = "uavbench"
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a comparison of two trajectories."""

    align: Alignment = "none"
    association: Association = "one-to-one"
    max_difference_s: float = 0.01
    offset_s: float = 0.0
    interval: PairInterval = field(default_factory=PairInterval)
    segments: Literal["none", "kitti", "rpg"] = "none"


MODES: dict[str, Options] = {
    "uavbench": Options(),
    "evo": Options(association="evo", interval=PairInterval(pairs_from="estimate")),
    "tum": Options(align="se3", max_difference_s=0.02, interval=PairInterval(1.0, "s", all_pairs=True)),
    "kitti": Options(segments="kitti"),
    "rpg": Options(align="yaw", association="evo", max_difference_s=0.02, segments="rpg"),
}
"""Conventions of each mode: evo 1.38 (Grupp), the TUM RGB-D scripts, the KITTI devkit, rpg_trajectory_evaluation."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of an estimate against a reference; rpe is None where the trajectory is too short for one pair interval.

    coverage: poses matched over the poses that the sparser of the two files would have over the reference's time span.
    """

    ate: dict[str, ErrorSummary]
    rpe: dict[str, ErrorSummary] | None
    coverage: float
    segments: tuple[SegmentErrors, ...]
    record: dict[str, Any]
    pairs: PosePairs

    def frames(self) -> "DataFrame":
        """One row per pair of poses, the estimate as it was aligned.

        Columns: stamp_ns, time_s since the first pair, position_error_m, rotation_error_deg, and the positions
        reference_x_m ... estimate_z_m.
        """
        return error_table(self.pairs)

    def plot(self, axes: "Axes | None" = None, quantity: "Quantity" = "position") -> "Axes":
        """Draw errors of position (m) or rotation (deg) over time (s), or both paths from above (m), on an Axes.

        Without one it is drawn on a new figure of pyplot. The Axes is returned.
        """
        from uavbench.reports.evaluation.panels import draw

        return draw(self.pairs, quantity, axes)

    def to_json(self) -> dict[str, Any]:
        """JSON object: ate, rpe, coverage, record, and segments where the mode has them."""
        value: dict[str, Any] = {
            "ate": {name: summary.to_json() for name, summary in self.ate.items()},
            "rpe": self.rpe and {name: summary.to_json() for name, summary in self.rpe.items()},
            "coverage": self.coverage,
            "record": self.record,
        }
        if self.segments:
            value["segments"] = [
                {name: s if isinstance(s, float) else ErrorSummary(**s).to_json() for name, s in asdict(each).items()}
                for each in self.segments
            ]
        return value

    def text(self) -> str:
        """The same for people, in columns."""
        record, names = self.record, ("rmse", "mean", "median", "std", "min", "max")
        lines = [
            *(
                f"{side:<11}{{file}}: {{format}}, {{poses}} poses, {{frame}}".format(**record[side])
                for side in ("reference", "estimate")
            ),
            f"pairs      {record['pairs']} ({record['association']}, within {record['max_difference_s']:g} s), "
            f"coverage {100 * self.coverage:.1f} %",
            f"alignment  {record['align']}",
            "",
            f"{'':<28}" + "".join(f"{name:>12}" for name in names) + f"{'n':>9}",
        ]
        interval = f"{record['delta']:g} {record['unit']}"
        tables = {"ATE": self.ate, f"RPE {interval}": self.rpe or {}}
        for title, summaries in tables.items():
            for name, summary in summaries.items():
                values = "".join(f"{getattr(summary, key):>12.6g}" for key in names)
                lines.append(f"{title + ' ' + name:<28}{values}{summary.n:>9}")
        for each in self.segments:
            lines.append(
                f"{each.length_m:g} m segments: {each.translation_percent.mean:.4g} %, "
                f"{each.rotation_deg_per_m.mean:.4g} deg/m (means of {each.translation_m.n})"
            )
        if self.rpe is None:
            lines.append(f"RPE: the trajectory is too short for a pair interval of {interval}")
        return "\n".join(lines) + "\n"


class EvaluateOptions(TypedDict, total=False):
    """Options of `evaluate_files`; those not given are of `mode`.

    align; association and max_difference_s: how stamps are paired; t_offset_s: added to the stamps of the estimate;
    delta, unit, all_pairs, pairs_from: pair interval of the RPE; mode: conventions of a known tool;
    reference_format, estimate_format: of the two files, recognized where not given; mount: a sequence folder, whose
    mount turns the estimate into the frame that the reference declares; ignore_frames: although the two name their
    frames differently; plot: .pdf or .png file to draw into.
    """

    align: Alignment | None
    association: Association | None
    max_difference_s: float | None
    t_offset_s: float
    delta: float | None
    unit: Unit | None
    all_pairs: bool | None
    pairs_from: Literal["reference", "estimate"] | None
    mode: Mode
    reference_format: str | None
    estimate_format: str | None
    mount: str | Path | None
    ignore_frames: bool
    plot: Path | None


def evaluate_files(reference: Given, estimate: Given, **options: Unpack[EvaluateOptions]) -> Evaluation:
    """Evaluation of two trajectories: files of TUM, KITTI, EuRoC or uavbench itself, folders that hold one, or `Given`.

    A topic of a ROS 2 bag is named as `bag.mcap:/odom`, a transform as `bag.mcap:/tf:world.base_link`. Files without
    stamps (KITTI) are paired row by row. UserError for a user's mistake, and for two files that declare different
    frames, unless ignore_frames: the names differ, and the frames do not.
    """
    chosen, plot, mount = _options(options), options.get("plot"), options.get("mount")
    if plot is not None and plot.suffix not in (".pdf", ".png"):
        raise UserError(f"{plot}: a plot is written as .pdf or .png")
    if plot is not None:
        from uavbench.reports.style import refuse_foreign_figure

        refuse_foreign_figure(plot.with_suffix(""), [plot.suffix])
    with ThreadPoolExecutor(2) as pool:  # the parser of long files runs beside itself
        formats = (options.get("reference_format"), options.get("estimate_format"))
        first, second = pool.map(found_in, (reference, estimate), ("reference", "estimate"), formats)
    if not options.get("ignore_frames"):
        second = _in_one_frame(first, second, None if mount is None else Path(mount), chosen.align)
    p, q = first.trajectory, second.trajectory
    if not (first.stamped and second.stamped):
        p, q = paired_by_row(p, q, name_of(reference, "reference"), name_of(estimate, "estimate"))
    files = {"mode": options.get("mode", OWN_MODE), "reference": _about(first), "estimate": _about(second)}
    try:
        found = evaluate(p, q, chosen, files)
    except UserError as error:
        raise UserError(f"{name_of(reference, 'reference')} against {name_of(estimate, 'estimate')}: {error}") from None
    if plot is not None:
        from uavbench.reports.evaluation.figure import plot_evaluation

        plot_evaluation(found.pairs, found.ate, found.record["align"], plot)
    return found


def _options(given: EvaluateOptions) -> Options:
    """Options as given, the others of the mode; UserError for an unknown name."""
    for name in given:
        if name not in EvaluateOptions.__annotations__:
            raise unknown_name("option", name, list(EvaluateOptions.__annotations__))
    mode = given.get("mode", OWN_MODE)
    if mode not in MODES:
        raise unknown_name("mode", mode, list(MODES))
    preset = MODES[mode]
    return Options(
        align=_given(given.get("align"), preset.align),
        association=_given(given.get("association"), preset.association),
        max_difference_s=_given(given.get("max_difference_s"), preset.max_difference_s),
        offset_s=given.get("t_offset_s", 0.0),
        interval=PairInterval(
            _given(given.get("delta"), preset.interval.delta),
            _given(given.get("unit"), preset.interval.unit),
            _given(given.get("all_pairs"), preset.interval.all_pairs),
            _given(given.get("pairs_from"), preset.interval.pairs_from),
        ),
        segments=preset.segments,
    )


def evaluate(
    reference: Trajectory, estimate: Trajectory, options: Options | None = None, files: dict[str, Any] | None = None
) -> Evaluation:
    """Evaluation of two trajectories; `files` goes into the record. UserError when they cannot be compared."""
    options = options or Options()
    pairs = associate(reference, estimate, options.association, options.max_difference_s, options.offset_s)
    raw = pairs
    found = alignment(pairs, options.align)
    if options.align != "none":
        pairs = found.apply(pairs)
    interval = options.interval
    i, j = interval_pairs(pairs, interval)
    position_m, rotation_rad = pose_error_sizes(pairs)
    motion_m, turn_rad = motion_error_sizes(pairs, i, j)
    lengths: tuple[float, ...] = ()
    if options.segments != "none":
        lengths = KITTI_LENGTHS_M if options.segments == "kitti" else rpg_lengths(pairs.reference_m)
    segments = [segment_errors(raw, m, "kitti" if options.segments == "kitti" else "rpg") for m in lengths]
    return Evaluation(
        ate={
            "translation_m": ErrorSummary.of(position_m),
            "rotation_deg": ErrorSummary.of(np.degrees(rotation_rad)),
        },
        rpe={
            "translation_m": ErrorSummary.of(motion_m),
            "rotation_deg": ErrorSummary.of(np.degrees(turn_rad)),
        }
        if len(i)
        else None,
        coverage=coverage(reference, estimate, pairs),
        segments=tuple(s for s in segments if s.translation_m.n),
        record={
            **(files or {}),
            "association": options.association,
            "max_difference_s": options.max_difference_s,
            "t_offset_s": options.offset_s,
            "pairs": len(pairs),
            "align": options.align,
            "alignment": {
                "scale": found.scale,
                "rotation": found.rotation.tolist(),
                "translation_m": found.translation.tolist(),
            },
            "delta": interval.delta,
            "unit": interval.unit,
            "all_pairs": interval.all_pairs,
            "pairs_from": interval.pairs_from,
            "std_ddof": 0,
            "coverage": "matched / poses of the sparser file over the reference's span",
            "versions": versions(),
        },
        pairs=pairs,
    )


def coverage(reference: Trajectory, estimate: Trajectory, pairs: PosePairs) -> float:
    """Share of the poses that the sparser of both files, at its median rate, would have over the reference's span."""
    span_s = float(reference.stamps_ns[-1] - reference.stamps_ns[0]) / NS
    matched = 1 + int(np.count_nonzero(np.diff(pairs.stamps_ns)))
    if len(reference) < 2 or len(estimate) < 2:
        return matched / len(reference)
    step_s = float(np.median(np.diff(estimate.stamps_ns))) / NS
    expected = min(len(reference), round(span_s / step_s) + 1)
    return min(1.0, matched / expected)


def paired_by_row(p: Trajectory, q: Trajectory, reference: str, estimate: str) -> tuple[Trajectory, Trajectory]:
    """Both trajectories with the stamps of the one that has some; UserError when their lengths differ."""
    if len(p) != len(q):
        raise UserError(
            f"{reference} has {len(p)} poses and {estimate} has {len(q)}: files in KITTI form have no stamps, so they "
            "can only be compared row by row"
        )
    return p, Trajectory(p.stamps_ns, q.positions_m, q.quaternions_wxyz)


def _in_one_frame(reference: Found, estimate: Found, mount: Path | None, align: Alignment) -> Found:
    """The estimate in the frame of the reference; UserError where both say one and they differ.

    What moves may differ where a mount is given, and what stands still where the estimate is aligned.
    """
    if reference.frame is None or estimate.frame is None:
        return estimate
    (fixed, moving), (other_fixed, other_moving) = _ends(reference.frame), _ends(estimate.frame)
    if fixed != other_fixed and UNSAID not in (fixed, other_fixed) and align in ("none", "scale"):
        raise UserError(
            f"{reference.file} says that it holds poses in {fixed}, and {estimate.file} in {other_fixed}: two frames "
            "that stand still, which cannot be compared as they are. Give --align, such as se3 or yaw; or "
            "--ignore-frames where both names mean one frame"
        )
    if moving == other_moving or UNSAID in (moving, other_moving):
        return estimate
    if mount is None or not {moving, other_moving} <= {"body", "cam"}:
        raise UserError(
            f"{reference.file} says that it holds {reference.frame}, and {estimate.file} {estimate.frame}: poses of "
            "different frames, which cannot be compared. Give files of one frame, or --mount SEQUENCE, the folder of "
            "the sequence, by whose cam_from_body the estimate is converted; or --ignore-frames where both names mean "
            "one frame"
        )
    return estimate.seen_as(f"{other_fixed}_from_{moving}", mount_of(mount))


def _ends(frame: str) -> tuple[str, str]:
    """What stands still and what moves, of `world_from_body`."""
    fixed, _, moving = frame.partition("_from_")
    return fixed, moving


def _about(found: Found) -> dict[str, Any]:
    """The record's entry of a file."""
    frame = found.frame or "frame not said"
    return {"file": str(found.file), "format": found.format, "poses": len(found.trajectory), "frame": frame}


def _given(value: T | None, default: T) -> T:
    return default if value is None else value
