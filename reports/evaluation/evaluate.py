"""Evaluation of two trajectory files: reading, conversion to a common frame, association, alignment, ATE and RPE."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from uavbench.reports.evaluation.evaluation import Evaluation, evaluate
from uavbench.reports.evaluation.find_trajectory import Found
from uavbench.reports.evaluation.frames import in_one_frame
from uavbench.reports.evaluation.options import OWN_MODE, EvaluateOptions, Options, chosen_options
from uavbench.reports.evaluation.trajectory_input import Given, found_in, name_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory import Trajectory


def evaluate_files(reference: Given, estimate: Given, **options: Unpack[EvaluateOptions]) -> Evaluation:
    """Evaluation of two trajectories, each a file (TUM, KITTI, EuRoC, uavbench's own), a folder with one, or `Given`.

    A topic of a ROS 2 bag is named as `bag.mcap:/odom`, a transform as `bag.mcap:/tf:world.base_link`. Files without
    stamps (KITTI) are paired row by row. UserError for an unreadable file or an invalid option, and for two files that
    declare different frames, unless ignore_frames is set, which treats differently named frames as one.
    """
    chosen, plot = chosen_options(options), options.get("plot")
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

        plot_evaluation(found.pairs, found.ate, found.record["align"], plot)
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
        second = in_one_frame(first, second, None if mount is None else Path(mount), chosen.align)
    p, q = first.trajectory, second.trajectory
    if not (first.stamped and second.stamped):
        p, q = paired_by_row(p, q, reference.name, estimate.name)
    files = {"mode": options.get("mode", OWN_MODE), "reference": _about(first), "estimate": _about(second)}
    try:
        return evaluate(p, q, chosen, files, second.covariances, second.asked_ns if first.stamped else None)
    except UserError as error:
        raise UserError(f"{reference.name} against {estimate.name}: {error}") from None


def paired_by_row(p: Trajectory, q: Trajectory, reference: str, estimate: str) -> tuple[Trajectory, Trajectory]:
    """Both trajectories with the stamps of the one that has any; UserError when their lengths differ."""
    if len(p) != len(q):
        raise UserError(
            f"{reference} has {len(p)} poses and {estimate} has {len(q)}: files in the KITTI format have no stamps "
            "and can only be compared row by row"
        )
    return p, Trajectory(p.stamps_ns, q.positions_m, q.quaternions_wxyz)


def _about(found: Found) -> dict[str, Any]:
    """Entry of a file in the record."""
    frame = found.frame or "frame not said"
    return {"file": str(found.file), "format": found.format, "poses": len(found.trajectory), "frame": frame}
