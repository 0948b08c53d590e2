"""The errors of one trajectory against another: association, alignment, ATE, RPE, coverage and NEES."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.doubts.clock_offset import Compared, doubts_of_offset
from uavbench.reports.evaluation.doubts.other_frames import doubts_of_frames
from uavbench.reports.evaluation.doubts.plausibility import doubts, doubts_of_stamps
from uavbench.reports.evaluation.doubts.unpaired_stamps import (
    LeftOut,
    doubts_of_left_out,
    doubts_of_motion,
    doubts_of_pairing,
    doubts_of_rate,
)
from uavbench.reports.evaluation.gaps import longest_step_ns, usual_step_ns
from uavbench.reports.evaluation.options import Options
from uavbench.reports.json_values import json_values
from uavbench.reports.metrics.align import Similarity, alignment
from uavbench.reports.metrics.ape import ErrorSizes, error_table, pose_error_sizes
from uavbench.reports.metrics.association import NS, PosePairs, match, one_to_one, paired
from uavbench.reports.metrics.rpe import RowPairs, interval_pairs, motion_error_sizes
from uavbench.reports.metrics.sub_trajectories import KITTI_LENGTHS_M, SegmentErrors, rpg_lengths, segment_errors
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.reports.uncertainty.consistency import DEGREES_OF_FREEDOM, Consistency
from uavbench.reports.uncertainty.pose_nees import pose_consistency
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.covariances import PoseCovariances

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from uavbench.reports.evaluation.panels import Quantity

OF_TRACKER = "matched poses / frames of the tracker within the reference"
OF_FILES = "matched poses / poses of the sparser file over the reference's span"
"""How coverage is computed, for the record: where a tracker's frames are known, and where they are not."""


@dataclass(frozen=True, kw_only=True)
class ClaimedNees:
    """Consistency of the covariances that an estimate claims, before and after alignment; None if no pair has one.

    The alignment rotates and scales the covariances with the estimate; since it is fitted to the errors, NEES tends to
    be lower afterwards.
    """

    before: Consistency | None
    after: Consistency | None

    @classmethod
    def of(cls, pairs: PosePairs, claimed: PoseCovariances, found: Similarity) -> "ClaimedNees":
        """Consistency of the unaligned pairs, and of the same pairs after the given alignment."""
        before = pose_consistency(pairs, claimed)
        moved = claimed.aligned(found.scale, found.rotation)
        return cls(before=before, after=pose_consistency(found.apply(pairs), moved))

    def lines(self) -> list[str]:
        """A text line each for before and after the alignment; a single one if the alignment changes nothing."""
        named = {"NEES": self.before, "NEES, aligned": self.after}
        if self.before == self.after:
            del named["NEES, aligned"]
        return [f"{name:<28}{_shown(found)}" for name, found in named.items()]


def _shown(found: Consistency | None) -> str:
    if found is None:
        return "no matched pose claims a covariance"
    mean = "none" if found.mean is None else f"{found.mean:.4g}"
    singular = f", {found.singular} singular" if found.singular else ""
    independent = "" if found.effective is None else f", as {found.effective:.0f} independent"
    return (
        f"mean {mean} ({DEGREES_OF_FREEDOM} expected; 95 % {found.low:.3g} .. {found.high:.3g} of a consistent tracker "
        f"whose errors last as long), {100 * found.inside:.1f} % inside, n {found.n}{independent}{singular}"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionErrors:
    """Relative errors of intervals: rows (k,) of the pairs of poses at their ends, and sizes (k,)."""

    rows: RowPairs
    sizes: ErrorSizes


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of an estimate against a reference; rpe is None where the trajectory is too short for one pair interval.

    coverage: matched poses over the tracker's frames that the reference has poses for; where these are not known, over
    the number of poses that the sparser of the two trajectories would have over the reference's time span. nees:
    consistency of the estimate's covariances, if it has any. longest_step_ns: of two poses without a gap between them.
    motions: the errors that `rpe` summarizes.
    """

    ate: dict[str, ErrorSummary]
    rpe: dict[str, ErrorSummary] | None
    coverage: float
    segments: tuple[SegmentErrors, ...]
    record: dict[str, Any]
    pairs: PosePairs
    nees: "ClaimedNees | None" = None
    longest_step_ns: float = np.inf
    motions: "MotionErrors | None" = None

    def frames(self) -> "DataFrame":
        """One row per pair of poses, with the aligned estimate.

        Columns: stamp_ns, time_s since the first pair, position_error_m, rotation_error_deg, and the positions
        reference_x_m ... estimate_z_m.
        """
        return error_table(self.pairs)

    def plot(self, axes: "Axes | None" = None, quantity: "Quantity" = "position") -> "Axes":
        """Draw errors of position (m) or rotation (deg) over time (s), or both paths from above (m), on an Axes.

        Lines end where the estimate has no pose. Without an Axes a new pyplot figure is created. Returns the Axes.
        UserError for an unknown quantity.
        """
        from uavbench.reports.evaluation.panels import draw

        return draw(self.pairs, quantity, axes, self.longest_step_ns)

    def to_json(self) -> dict[str, Any]:
        """JSON object: ate, rpe, coverage, record, and segments where the mode has them."""
        value: dict[str, Any] = {
            "ate": {name: summary.to_json() for name, summary in self.ate.items()},
            "rpe": self.rpe and {name: summary.to_json() for name, summary in self.rpe.items()},
            "coverage": self.coverage,
            "record": self.record,
        }
        if self.nees:
            value["nees"] = {name: each and json_values(asdict(each)) for name, each in vars(self.nees).items()}
        if self.segments:
            value["segments"] = [
                {name: s if isinstance(s, float) else ErrorSummary(**s).to_json() for name, s in asdict(each).items()}
                for each in self.segments
            ]
        return value

    def text(self) -> str:
        """The evaluation as a text table."""
        record, names = self.record, ("rmse", "mean", "median", "std", "min", "max")
        lines = [
            *(
                f"{side:<11}{{file}}: {{format}}, {{poses}} poses, {{frame}}".format(**record[side])
                for side in ("reference", "estimate")
            ),
            f"pairs      {record['pairs']} ({record['association']}, within {record['max_difference_s']:g} s), "
            f"coverage {100 * self.coverage:.1f} %",
            *(
                [f"left out   poses of the estimate: {left}"]
                if (left := LeftOut(**record["left_out"])) != (0, 0)
                else []
            ),
            f"alignment  {record['align']}",
            *([f"           {said}"] if (said := record["alignment"].get("undetermined")) else []),
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
        if self.nees:
            lines += self.nees.lines()
        if self.rpe is None:
            lines.append(f"RPE: no two matched poses are {interval} apart, as in a trajectory that is too short for it")
        lines += [f"doubt: {doubt}" for doubt in record["doubts"]]
        return "\n".join(lines) + "\n"


def evaluate(
    reference: Trajectory,
    estimate: Trajectory,
    options: Options | None = None,
    files: dict[str, Any] | None = None,
    claimed: PoseCovariances | None = None,
    asked_ns: NDArray[np.int64] | None = None,
    stamped: bool = True,
) -> Evaluation:
    """Evaluation of two trajectories; `files` goes into the record. UserError when they cannot be compared.

    claimed: covariances of the estimate's poses. asked_ns: stamps of all frames that its tracker was given, if known.
    stamped: whether both have stamps of their own, or those of the other in the same row.
    """
    options = options or Options()
    with _doubted(reference, estimate):
        rows = match(reference, estimate, options.association, options.max_difference_s, options.offset_s)
        pairs = paired(reference, estimate, rows, options.association, options.offset_s)
        found = alignment(pairs, options.align)
    raw = pairs
    if options.align != "none":
        pairs = found.apply(pairs)
    if asked_ns is None:
        expected = expected_poses(reference, estimate)
    else:
        asked_s = asked_ns / NS + options.offset_s
        expected = len(one_to_one(reference.stamps_ns / NS, asked_s, options.max_difference_s).reference)
    told = [
        *doubts(reference, estimate, raw, options.align),
        *doubts_of_offset(Compared(reference, estimate, rows.estimate, options), stamped),
        *doubts_of_pairing(reference, estimate, rows, options),
    ]
    interval = options.interval
    i, j = interval_pairs(pairs, interval)
    position_m, rotation_rad = pose_error_sizes(pairs)
    told += doubts_of_motion(reference, estimate, rows, options, position_m)
    left = LeftOut.of(reference, estimate, rows, options)
    told = told or [
        *doubts_of_frames(raw, pairs, options.align),
        *doubts_of_rate(reference, estimate.stamps_ns if asked_ns is None else asked_ns),
        *doubts_of_left_out(left, estimate),
    ]
    sizes = motion_error_sizes(pairs, i, j)
    motion_m, turn_rad = sizes
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
        coverage=coverage(pairs, expected),
        segments=tuple(s for s in segments if s.translation_m.n),
        record={
            **(files or {}),
            "association": options.association,
            "max_difference_s": options.max_difference_s,
            "t_offset_s": options.offset_s,
            "pairs": len(pairs),
            "left_out": left._asdict(),
            "align": options.align,
            "alignment": {
                "scale": found.scale,
                "rotation": found.rotation.tolist(),
                "translation_m": found.translation.tolist(),
                **({"undetermined": found.undetermined} if found.undetermined else {}),
            },
            "delta": interval.delta,
            "unit": interval.unit,
            "all_pairs": interval.all_pairs,
            "pairs_from": interval.pairs_from,
            "std_ddof": 0,
            "coverage": OF_FILES if asked_ns is None else OF_TRACKER,
            "doubts": told,
            "versions": versions(),
        },
        pairs=pairs,
        nees=None if claimed is None else ClaimedNees.of(raw, claimed.of_rows(rows.estimate), found),
        longest_step_ns=longest_step_ns(pairs.stamps_ns, asked_ns),
        motions=MotionErrors(rows=RowPairs(i, j), sizes=sizes) if len(i) else None,
    )


@contextmanager
def _doubted(reference: Trajectory, estimate: Trajectory) -> Iterator[None]:
    """Add to a UserError that the stamps are in different units, which leaves few pairs or none, where they seem to."""
    try:
        yield
    except UserError as error:
        raise UserError("; ".join([str(error), *doubts_of_stamps(reference, estimate)])) from None


def coverage(pairs: PosePairs, expected: int) -> float:
    """Matched poses of the reference over the number expected."""
    return min(1.0, (1 + int(np.count_nonzero(np.diff(pairs.stamps_ns)))) / expected)


def expected_poses(reference: Trajectory, estimate: Trajectory) -> int:
    """Number of poses of the sparser trajectory, at its rate, over the reference's span.

    The estimate's period is that of its short steps, as the others span frames without a pose.
    """
    if len(reference) < 2 or len(estimate) < 2:
        return len(reference)
    span_s = float(reference.stamps_ns[-1] - reference.stamps_ns[0]) / NS
    return min(len(reference), round(span_s / (usual_step_ns(estimate.stamps_ns) / NS)) + 1)
