"""Rigid-body poses: SE(3) as a frozen value, named `target_from_source`."""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike, NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.kernels.rotations import (
    fill_exponentials,
    fill_logarithms,
    fill_pose,
    fill_quaternions,
    fill_rotations,
    fill_twist,
)

Array = NDArray[np.float64]
Angle = Annotated[float, Interval(ge=-3600, le=3600)]
"""A bearing or rotation in degrees, ten turns at most: of a number with more digits before its point none is meant."""


def read_only(values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Read-only float64 copy of `values`; ValueError when its shape is not `shape` (-1: any length).

    ValueError, too, for what would be lost in the copy: masks, and imaginary parts.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError("has masked values; leave them out")
    if isinstance(values, np.ndarray) and values.dtype.kind == "c":
        raise ValueError("holds complex numbers")
    array = np.array(values, dtype=np.float64)
    if shape is not None and array.shape != shape and not _fits(array.shape, shape):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def _fits(got: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    return len(got) == len(wanted) and all(want in (-1, size) for size, want in zip(got, wanted, strict=True))


def hat(v: Array) -> Array:
    """Skew-symmetric matrices (..., 3, 3) of vectors (..., 3): the matrix of v times u is v x u."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def rotation_exp(rotvec: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in rad (Rodrigues' formula)."""
    R = np.empty((*rotvec.shape[:-1], 3, 3))
    fill_exponentials(_numbers(rotvec).reshape(-1, 3), R.reshape(-1, 3, 3))
    return R


def quaternion_from_rotation(R: Array) -> Array:
    """Unit quaternions wxyz (..., 4), w >= 0, of rotation matrices (..., 3, 3).

    Computed from the largest of the four squared components (Shepperd 1978), so that no branch loses precision.
    """
    q = np.empty((*R.shape[:-2], 4))
    fill_quaternions(_numbers(R).reshape(-1, 3, 3), q.reshape(-1, 4))
    return q


def rotation_from_quaternion(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions wxyz (..., 4); they are normalized first."""
    R = np.empty((*q.shape[:-1], 3, 3))
    fill_rotations(_numbers(q).reshape(-1, 4), R.reshape(-1, 3, 3))
    return R


def rotation_log(R: Array) -> Array:
    """Rotation vectors (..., 3) in rad, norm in [0, pi], of rotation matrices (..., 3, 3).

    Computed via the quaternion and atan2, with full precision near 0 and near pi.
    """
    phi = np.empty((*R.shape[:-2], 4))
    fill_logarithms(_numbers(R).reshape(-1, 3, 3), phi.reshape(-1, 4))
    return np.ascontiguousarray(phi[..., :3])


def _numbers(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Rigid transform `target_from_source`: p_target = rotation @ p_source + translation.

    rotation (3, 3), translation (3,) in metres; both read-only. Products read by cancellation:
    `cam_from_body @ body_from_world` is `cam_from_world`.

    >>> import numpy as np
    >>> world_from_body = Pose(np.eye(3), [1.0, 2.0, 3.0])
    >>> cam_from_body = Pose.from_quaternion([1, 0, 0, 0], [0.0, 0.0, -0.1])
    >>> cam_from_world = cam_from_body @ world_from_body.inverse()
    >>> cam_from_world.transform(np.array([[1.0, 2.0, 5.0]])).round(6).tolist()
    [[0.0, 0.0, 1.9]]
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", read_only(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", read_only(self.translation, (3,)))

    @classmethod
    def identity(cls) -> Self:
        """The identity."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def owning(cls, rotation: Array, translation: Array) -> Self:
        """Pose of new arrays (3, 3) and (3,) of numbers, which are not copied and become read-only."""
        pose = object.__new__(cls)
        for name, array in ("rotation", rotation), ("translation", translation):
            array.setflags(write=False)
            object.__setattr__(pose, name, array)
        return pose

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """Pose of a homogeneous (4, 4) matrix; ValueError unless it is a finite rigid transform (1e-6)."""
        m = read_only(matrix, (4, 4))
        R = m[:3, :3]
        rigid = np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0
        if not (np.isfinite(m).all() and rigid and np.allclose(m[3], [0, 0, 0, 1])):
            raise ValueError("not a rigid transform: rotation must be orthonormal, last row 0 0 0 1")
        return cls(R, m[:3, 3])

    @classmethod
    def from_quaternion(cls, quaternion_wxyz: ArrayLike, translation_m: ArrayLike) -> Self:
        """Pose of a quaternion wxyz (4,) and a translation (3,) in metres."""
        return cls(rotation_from_quaternion(read_only(quaternion_wxyz, (4,))), _numbers(translation_m))

    @classmethod
    def exp(cls, twist: ArrayLike) -> Self:
        """SE(3) exponential of a twist (6,): translation part (m) first, rotation part (rad) last."""
        rotation, translation = np.empty((3, 3)), np.empty(3)
        fill_pose(read_only(twist, (6,)), rotation, translation)
        return cls(rotation, translation)

    def log(self) -> Array:
        """Twist (6,) with `Pose.exp(pose.log()) == pose`: translation part first, rotation part last."""
        twist = np.empty(6)
        fill_twist(self.rotation, self.translation, twist, np.empty((3, 3)))
        return twist

    @property
    def matrix(self) -> Array:
        """Homogeneous (4, 4) matrix."""
        m = np.zeros((4, 4))
        m[:3, :3], m[:3, 3], m[3, 3] = self.rotation, self.translation, 1.0
        return m

    @property
    def quaternion_wxyz(self) -> Array:
        """Unit quaternion wxyz (4,), w >= 0."""
        return quaternion_from_rotation(self.rotation)

    def inverse(self) -> "Pose":
        """`source_from_target`."""
        return Pose(self.rotation.T, -exact.product(self.rotation.T, self.translation))

    def __matmul__(self, other: "Pose") -> "Pose":
        turned = exact.product(self.rotation, other.rotation)
        return Pose(turned, exact.product(self.rotation, other.translation) + self.translation)

    def transform(self, points: Array) -> Array:
        """Points (n, 3) of the source frame in the target frame, metres."""
        return exact.product(points, self.rotation.T) + self.translation
