"""Evaluation of two trajectory files: reading, conversion to a common frame, association, alignment, ATE and RPE."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, Unpack

from uavbench.reports.evaluation.doubts.order_of_columns import doubts_of_order
from uavbench.reports.evaluation.doubts.same_sequence import doubts_of_clocks, doubts_of_sequence
from uavbench.reports.evaluation.evaluation import Evaluation, evaluate
from uavbench.reports.evaluation.find_trajectory import Found
from uavbench.reports.evaluation.frames import in_one_frame
from uavbench.reports.evaluation.options import OWN_MODE, EvaluateOptions, Options, chosen_options
from uavbench.reports.evaluation.trajectory_input import Given, found_in, name_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import given_path
from uavbench.trajectories.trajectory import Trajectory


def evaluate_files(reference: Given, estimate: Given, **options: Unpack[EvaluateOptions]) -> Evaluation:
    """Evaluation of two trajectories, each a file (TUM, KITTI, EuRoC, uavbench's own), a folder with one, or `Given`.

    A topic of a ROS 2 bag is named as `bag.mcap:/odom`, a transform as `bag.mcap:/tf:world.base_link`. Files without
    stamps (KITTI) are paired row by row. UserError for an unreadable file or an invalid option, and for two files that
    declare different frames, unless ignore_frames is set, which treats differently named frames as one.
    """
    chosen, drawn = chosen_options(options), options.get("plot")
    plot = None if drawn is None else given_path("plot", drawn)
    if plot is not None and plot.suffix not in (".pdf", ".png"):
        raise UserError(f"{plot}: a plot is written as .pdf or .png")
    if plot is not None:
        from uavbench.reports.evaluation.figure import FIGURE
        from uavbench.reports.style import refuse_foreign_figure

        refuse_foreign_figure(plot.with_suffix(""), [plot.suffix], FIGURE)
    with ThreadPoolExecutor(2) as pool:  # two long files are parsed in parallel
        formats = (options.get("reference_format"), options.get("estimate_format"))
        first, second = pool.map(found_in, (reference, estimate), ("reference", "estimate"), formats)
    sides = (Side(first, name_of(reference, "reference")), Side(second, name_of(estimate, "estimate")))
    found = evaluate_found(*sides, chosen, options)
    if plot is not None:
        from uavbench.reports.evaluation.figure import plot_evaluation

        plot_evaluation(found.pairs, found.ate, found.record["align"], plot, found.longest_step_ns)
    return found


@dataclass(frozen=True)
class Side:
    """A trajectory and its name in error messages."""

    found: Found
    name: str


def evaluate_found(reference: Side, estimate: Side, chosen: Options, options: EvaluateOptions) -> Evaluation:
    """Evaluation of two trajectories already read; options: mount, ignore_frames, and the mode for the record."""
    first, second, mount = reference.found, estimate.found, options.get("mount")
    if not options.get("ignore_frames"):
        second = in_one_frame(first, second, None if mount is None else given_path("mount", mount), chosen.align)
    p, q = first.trajectory, second.trajectory
    stamped = first.stamped and second.stamped
    if not stamped:
        if chosen.offset_s:
            raise UserError(
                f"{reference.name} against {estimate.name}: files in the KITTI format have no stamps that an offset of "
                f"{chosen.offset_s:g} s could shift; leave it out"
            )
        p, q = paired_by_row(reference, estimate)
    files = {"mode": options.get("mode") or OWN_MODE, "reference": _about(first), "estimate": _about(second)}
    try:
        asked_ns = second.asked_ns if first.stamped else None
        done = evaluate(p, q, chosen, files, second.covariances, asked_ns, stamped)
    except UserError as error:
        raise UserError(f"{reference.name} against {estimate.name}: {error}") from None
    done.record["doubts"] += doubts_of_sequence(first.file, second.file)
    formats = (options.get("reference_format"), options.get("estimate_format"))
    done.record["doubts"] += doubts_of_order(first, second, formats)
    done.record["doubts"] += doubts_of_clocks(first.clock, second.clock, chosen.offset_s)
    return done


class SameStamps(NamedTuple):
    """Trajectories of reference and estimate whose rows have the same stamps."""

    reference: Trajectory
    estimate: Trajectory


def paired_by_row(reference: Side, estimate: Side) -> SameStamps:
    """Both trajectories with the stamps of the one that has any; UserError when their lengths differ."""
    p, q = reference.found.trajectory, estimate.found.trajectory
    if len(p) != len(q):
        raise UserError(
            f"{reference.name} has {len(p)} poses and {estimate.name} has {len(q)}: files in the KITTI format have no "
            "stamps and can only be compared row by row"
        )
    stamps_ns = (q if estimate.found.stamped else p).stamps_ns
    return SameStamps(
        Trajectory(stamps_ns, p.positions_m, p.quaternions_wxyz),
        Trajectory(stamps_ns, q.positions_m, q.quaternions_wxyz),
    )


def _about(found: Found) -> dict[str, Any]:
    """Entry of a file in the record."""
    frame = found.frame or "frame not said"
    return {"file": str(found.file), "format": found.format, "poses": len(found.trajectory), "frame": frame}
