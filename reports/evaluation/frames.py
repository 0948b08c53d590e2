"""Conversion of two trajectories to the same frame, by their declared frames and the camera's mount."""

from pathlib import Path

from uavbench.reports.evaluation.trajectory_files import Found, mount_of
from uavbench.reports.metrics.align import Alignment
from uavbench.trajectories.bags.poses import UNSAID
from uavbench.trajectories.errors import UserError


def in_one_frame(reference: Found, estimate: Found, mount: Path | None, align: Alignment) -> Found:
    """The estimate in the frame of the reference; UserError where both declare frames that differ.

    The moving frames may differ where a mount is given, the fixed frames where the estimate is aligned. UserError also
    where a mount is given and one of the two does not declare its moving frame.
    """
    if mount is not None:
        _refuse_unsaid(reference, estimate)
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


def _refuse_unsaid(*files: Found) -> None:
    """UserError naming the first file without a declared moving frame, which a mount could not convert."""
    for found in files:
        if found.frame is None or _ends(found.frame)[1] == UNSAID:
            raise UserError(
                f"{found.file}: does not say whether its poses are of the body or of the camera, so that --mount "
                "cannot convert them; say it in the first line of the file, as `# frame: world_from_cam`, or leave "
                "--mount out"
            )


def _ends(frame: str) -> tuple[str, str]:
    """The fixed and the moving frame of a name such as `world_from_body`."""
    fixed, _, moving = frame.partition("_from_")
    return fixed, moving
