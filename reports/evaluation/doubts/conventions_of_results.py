"""Whether a tracker writes poses in another convention than cam_from_world, metres, w first, axes of OpenCV."""

from dataclasses import replace

import numpy as np

from uavbench.reports.evaluation.doubts.plausibility import (
    LENGTH_FACTORS,
    doubts_of_axes,
    doubts_of_order,
    times_told,
    unit_factor,
)
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.camera_poses import estimated_cameras, true_cameras
from uavbench.reports.metrics.frame_errors import FrameErrors
from uavbench.reports.metrics.quaternions import conjugate
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results
from uavbench.trajectories.pose import quaternion_from_rotation

USABLE = 0.5
"""Share of frames within 5 cm and 5 deg from which on poses are in the right convention."""
ASTRAY_DEG, ASTRAY_PART = 45.0, 0.5
"""Error of the initial pose in deg, and in distances from the world's origin, that no tracker has which is started
there: a convention is wrong from the first frame on, and a tracker that is lost is not."""


def doubts_of_results(sequence: Sequence, results: Results, errors: FrameErrors) -> tuple[str, ...]:
    """A sentence, or none, on poses that are far off in the way of another convention; errors: of these results."""
    if errors.success.mean() >= USABLE:
        return ()
    estimate = estimated_cameras(results)
    ok = np.isfinite(estimate.t).all(axis=1)
    if not ok.any():
        return ()
    true = true_cameras(sequence, results.frames[ok].tolist())
    true_q, estimate_q = (quaternion_from_rotation(R) for R in (true.R, estimate.R[ok]))
    pairs = PosePairs(results.stamps_ns[ok], true.t, true_q, estimate.t[ok], estimate_q)
    findings = _findings(pairs, errors)
    if not findings:
        return ()
    return (
        f"{', and '.join(findings)}: write cam_from_world, in metres, w first, with the axes of OpenCV; "
        "`uavbench check` tries a tracker",
    )


def _findings(pairs: PosePairs, errors: FrameErrors) -> list[str]:
    """What another convention would explain, in cam_from_world; else that the initial pose is not where it was given.

    A tracker that slips to another side of a symmetric structure gives poses in a world that is turned, too, but is
    right at first.
    """
    degrees, metres = float(errors.angle_deg[0]), float(errors.translation_m[0])
    away_m, range_m = (float(np.linalg.norm(each[0])) for each in (pairs.estimate_m, pairs.reference_m))
    astray = bool(errors.ok[0]) and (degrees > ASTRAY_DEG or metres > ASTRAY_PART * range_m)
    found = [doubt.finding for doubt in doubts_of_order(pairs, "none")]
    if astray and (factor := unit_factor(away_m, range_m, LENGTH_FACTORS)):
        found.append(f"the first translation is {times_told(factor)} that of the initial pose")
    if astray and not found:
        # of world_from_cam the moving axes are those of the camera
        true_q, estimate_q = conjugate(pairs.reference_q), conjugate(pairs.estimate_q)
        inverse = replace(pairs, reference_q=true_q, estimate_q=estimate_q)
        found = [doubt.finding for doubt in doubts_of_axes(inverse, "none")]
    if astray and not found:
        found = [f"the first pose is {metres:.3g} m and {degrees:.0f} degrees off, although the initial pose was given"]
    return found
