"""Pose error of every frame that a tracker is expected to locate.

Every expected frame counts: one that is lost, was not reached, or has a non-finite pose is a frame without a pose.
Poses are compared as `world_from_body`, in the structure's frame, without alignment.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.ape import absolute_errors
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.camera_poses import bodies, estimated_cameras
from uavbench.reports.metrics.quaternions import normalized
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results, evaluated_poses
from uavbench.tracker.run import stride
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, quaternion_from_rotation

SUCCESS_M = 0.05
SUCCESS_DEG = 5.0


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors with one row per expected frame.

    frames (n,): indices into the sequence; pairs (n): true and estimated `world_from_body`, the estimate NaN without a
    pose; ok (n,): whether there is a finite pose; translation_m, angle_deg (n,): its errors, infinite without a pose.
    """

    frames: NDArray[np.int64]
    pairs: PosePairs
    ok: NDArray[np.bool_]
    translation_m: Array
    angle_deg: Array

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def seconds(self) -> Array:
        """Time (n,) in s since the first frame."""
        return np.asarray((self.pairs.stamps_ns - self.pairs.stamps_ns[0]) / NS)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each frame (n,) is within 5 cm and 5 deg; without a pose it is not."""
        return self.within(SUCCESS_M, SUCCESS_DEG)

    def within(self, limit_m: float, limit_deg: float) -> NDArray[np.bool_]:
        """Whether each frame (n,) is within both limits; a NaN is not."""
        return (self.translation_m <= limit_m) & (self.angle_deg <= limit_deg)

    @property
    def tracked(self) -> PosePairs:
        """Pairs of the frames that have a pose."""
        kept = {name: getattr(self.pairs, name)[self.ok] for name in self.pairs.__dataclass_fields__}
        return replace(self.pairs, **kept)


def frame_errors(sequence: Sequence, results: Results) -> FrameErrors:
    """Errors of each expected frame: every k-th of the sequence, k its rate over the tracker's.

    UserError when the results are of another sequence, or contain unexpected frames.
    """
    _same_sequence(sequence, results)
    expected = np.arange(0, len(sequence), stride(sequence, float(results.record["rate_hz"])))
    rows = np.searchsorted(expected, results.frames)
    strange = (rows >= len(expected)) | (expected[np.minimum(rows, len(expected) - 1)] != results.frames)
    if strange.any():
        raise UserError(
            f"results of {_who(results)} hold frame {int(results.frames[np.argmax(strange)])}, which a run at "
            f"{results.record['rate_hz']:g} Hz does not track; track again"
        )
    positions, quaternions = estimated_bodies(results)
    ground_truth = evaluated_poses(sequence).select(expected)
    estimate_m, estimate_q = np.full((len(expected), 3), np.nan), np.full((len(expected), 4), np.nan)
    estimate_m[rows], estimate_q[rows] = positions, quaternions
    ok = np.isfinite(estimate_m).all(axis=1) & np.isfinite(estimate_q).all(axis=1)
    true_q = normalized(ground_truth.quaternions_wxyz)
    pairs = PosePairs(ground_truth.stamps_ns, ground_truth.positions_m, true_q, estimate_m, estimate_q)
    return FrameErrors(
        expected,
        pairs,
        ok,
        np.where(ok, absolute_errors(pairs, "translation_m"), np.inf),
        np.where(ok, absolute_errors(pairs, "angle_deg"), np.inf),
    )


class Bodies(NamedTuple):
    """Positions (n, 3) in m and quaternions wxyz (n, 4), NaN without a pose."""

    positions_m: Array
    quaternions_wxyz: Array


def estimated_bodies(results: Results) -> Bodies:
    """Positions (n, 3) and quaternions wxyz (n, 4) of `world_from_body` in each row, NaN without a pose."""
    R, positions = bodies(*estimated_cameras(results), results.cam_from_body)
    quaternions = np.full((len(results), 4), np.nan)
    ok = np.isfinite(positions).all(axis=1)
    quaternions[ok] = quaternion_from_rotation(R[ok])
    return Bodies(positions, quaternions)


def _same_sequence(sequence: Sequence, results: Results) -> None:
    of = results.record.get("sequence", {})
    if of.get("content_hash") != sequence.content_hash:
        raise UserError(
            f"results of {_who(results)} are of another sequence than {sequence.folder}: record.json names "
            f"{of.get('name')!r}, hash {of.get('content_hash')}; the sequence has {sequence.content_hash}; track again"
        )
    inside = results.frames < len(sequence)
    if not inside.all():
        raise UserError(
            f"results of {_who(results)} hold frame {int(results.frames.max())}, beyond the sequence's last"
        )
    wrong = results.stamps_ns != sequence.stamps_ns[results.frames]
    if wrong.any():
        raise UserError(f"results of {_who(results)}: stamp of row {int(np.argmax(wrong))} is not that of its frame")


def _who(results: Results) -> str:
    return f"{results.record.get('tracker', {}).get('kind', 'a tracker')} at {results.record.get('rate_hz', '?')} Hz"


def ended_s(seconds: Array) -> float:
    """Time at which a run with frames at these times (n,) ends: a period, their median one, after the last."""
    period = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    return float(seconds[-1]) + period
