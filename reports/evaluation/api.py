"""`uavbench.evaluate`: two trajectories in, their errors out."""

import warnings
from typing import Unpack

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.evaluation.evaluation import Evaluation
from uavbench.reports.evaluation.options import EvaluateOptions
from uavbench.reports.evaluation.trajectory_input import Given
from uavbench.trajectories.errors import one_line


def evaluate(reference: Given, estimate: Given, **options: Unpack[EvaluateOptions]) -> Evaluation:
    """Errors of an estimated trajectory against a reference: ATE, RPE, coverage, and errors pose by pose.

    reference, estimate: each a path (TUM, EuRoC, KITTI or uavbench's own file, or a folder that holds one), a
    `Trajectory`, an array (n, 8) of time in s, position x y z in m and quaternion x y z w as in a TUM file, or a
    DataFrame with the columns stamp_ns (integers) or time_s, px_m py_m pz_m, qw qx qy qz. Both hold poses of the same
    frame, `world_from_body` or `world_from_cam`; where files declare different ones, `mount` names a sequence's folder.
    align: `none`, `yaw`, `se3` or `sim3`. mode: defaults that repeat a known tool, `uavbench`, `evo`, `tum`, `kitti` or
    `rpg`; options given here override them. t_offset_s is added to the stamps of the estimate; poses are paired
    when at most max_difference_s apart. delta and unit (`frames`, `s`, `m`, ...): the pair interval of the RPE.

    Result: `.ate["translation_m"].rmse`, `.ate["rotation_deg"].median`, `.rpe` likewise (None where the trajectory is
    too short), `.coverage`, `.frames()` a DataFrame, `.plot(axes)`. UserError when the two cannot be compared. A
    likely mistake, as in a unit or the order of a quaternion, is a UserWarning, and stands in `.record["doubts"]`.

    >>> import numpy as np
    >>> t = np.arange(5.0)
    >>> still = np.zeros(5)
    >>> reference = np.column_stack([t, t, t**2, still, still, still, still, still + 1])
    >>> estimate = reference + [0, 0.1, 0, 0, 0, 0, 0, 0]
    >>> round(evaluate(reference, estimate).ate["translation_m"].rmse, 3)
    0.1
    >>> bool(evaluate(reference, estimate, align="se3").ate["translation_m"].rmse < 1e-6)
    True
    >>> list(evaluate(reference, estimate).frames())[:4]
    ['stamp_ns', 'time_s', 'position_error_m', 'rotation_error_deg']
    """
    found = evaluate_files(reference, estimate, **options)
    for doubt in found.record["doubts"]:
        warnings.warn(one_line(doubt), stacklevel=2)
    return found
