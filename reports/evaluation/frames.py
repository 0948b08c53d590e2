"""Conversion of two trajectories to a common frame, by their declared frames and the camera's mounting."""

from pathlib import Path

from uavbench.reports.evaluation.find_trajectory import Found, mount_of
from uavbench.reports.metrics.align import Alignment
from uavbench.trajectories.bags.poses import UNSAID
from uavbench.trajectories.errors import UserError


def in_one_frame(reference: Found, estimate: Found, mount: Path | None, align: Alignment) -> Found:
    """The estimate converted to the frame of the reference; UserError when they declare incompatible frames.

    The moving frames may differ if a mount is given, the fixed frames if the estimate is aligned. Poses of a further
    camera are converted by its own mount. UserError also if a mount is given and one of the two does not declare its
    moving frame, and for poses of different cameras.
    """
    if mount is not None:
        _refuse_unsaid(reference, estimate)
    if reference.frame is None or estimate.frame is None:
        return estimate
    (fixed, moving), (other_fixed, other_moving) = _ends(reference.frame), _ends(estimate.frame)
    if fixed != other_fixed and UNSAID not in (fixed, other_fixed) and align in ("none", "scale"):
        raise UserError(
            f"{reference.file} declares poses in {fixed}, and {estimate.file} in {other_fixed}: poses in different "
            "fixed frames cannot be compared without alignment. Give --align, such as se3 or yaw; or --ignore-frames "
            "if both names mean the same frame"
        )
    if moving == other_moving == "cam":
        _refuse_other_camera(reference, estimate)
    if moving == other_moving or UNSAID in (moving, other_moving):
        return estimate
    if mount is None or not {moving, other_moving} <= {"body", "cam"}:
        raise UserError(
            f"{reference.file} declares {reference.frame}, and {estimate.file} {estimate.frame}: poses of different "
            "frames cannot be compared. Give files with the same frame; or --mount SEQUENCE, the folder of the "
            "sequence whose cam_from_body converts the estimate; or --ignore-frames if both names mean the same frame"
        )
    of = estimate if other_moving == "cam" else reference
    return estimate.seen_as(f"{other_fixed}_from_{moving}", mount_of(mount, of))


def _refuse_other_camera(reference: Found, estimate: Found) -> None:
    """Raise UserError when two exports declare poses of different cameras, one beside the other on the body."""
    if None not in (reference.camera, estimate.camera) and reference.camera != estimate.camera:
        raise UserError(
            f"{reference.file} has the poses of the camera {reference.camera!r}, and {estimate.file} those of "
            f"{estimate.camera!r}: poses of different cameras cannot be compared. Export the same camera (--camera); "
            "or give --ignore-frames if it does not matter"
        )


def _refuse_unsaid(*files: Found) -> None:
    """Raise UserError naming the first file without a declared moving frame, which a mount cannot convert."""
    for found in files:
        if found.frame is None or _ends(found.frame)[1] == UNSAID:
            raise UserError(
                f"{found.file}: does not declare whether its poses are of the body or of the camera, so that --mount "
                "cannot convert them; declare it in the first line of the file, as `# frame: world_from_cam`, or omit "
                "--mount"
            )


def _ends(frame: str) -> tuple[str, str]:
    """The fixed and the moving frame of a name such as `world_from_body`."""
    fixed, _, moving = frame.partition("_from_")
    return fixed, moving
