"""Rigid-body poses: SE(3) as a frozen value, named `target_from_source`."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uavbench.trajectories import reproducible_math as exact

Array = NDArray[np.float64]


def read_only(values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Read-only float64 copy of `values`; ValueError when its shape is not `shape` (-1: any length)."""
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (-1, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def hat(v: Array) -> Array:
    """Skew-symmetric matrices (..., 3, 3) of vectors (..., 3): the matrix of v times u is v x u."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def rotation_exp(rotvec: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in rad (Rodrigues' formula)."""
    angle = np.asarray(exact.length(rotvec))[..., None, None]
    K = hat(rotvec)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle**2 / 6.0, exact.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - exact.cos(safe)) / safe**2)
    R: Array = np.eye(3) + a * K + b * exact.product(K, K)
    return R


def quaternion_from_rotation(R: Array) -> Array:
    """Unit quaternions wxyz (..., 4), w >= 0, of rotation matrices (..., 3, 3).

    Computed from the largest of the four squared components (Shepperd 1978), so that no branch loses precision.
    """
    m00, m11, m22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    squares = np.stack([1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22], axis=-1)
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 1, 0] + R[..., 0, 1], R[..., 2, 0] + R[..., 0, 2], R[..., 2, 1] + R[..., 1, 2]
    table = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(table, best, axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q_positive: Array = np.where(q[..., :1] < 0, -q, q)
    return q_positive


def rotation_from_quaternion(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions wxyz (..., 4); they are normalized first."""
    unit = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, x, y, z = unit[..., 0], unit[..., 1], unit[..., 2], unit[..., 3]
    R = np.empty((*w.shape, 3, 3), dtype=w.dtype)
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return R


def rotation_log(R: Array) -> Array:
    """Rotation vectors (..., 3) in rad, norm in [0, pi], of rotation matrices (..., 3, 3).

    Computed via the quaternion and atan2, with full precision near 0 and near pi.
    """
    q = quaternion_from_rotation(R)
    v = q[..., 1:]
    norm = np.linalg.norm(v, axis=-1, keepdims=True)
    angle = 2.0 * exact.arctan2(norm, q[..., :1])
    return np.where(norm > 0, v * (angle / np.where(norm > 0, norm, 1.0)), 2.0 * v)


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
        return cls(rotation_from_quaternion(read_only(quaternion_wxyz, (4,))), read_only(translation_m))

    @classmethod
    def exp(cls, twist: ArrayLike) -> Self:
        """SE(3) exponential of a twist (6,): translation part (m) first, rotation part (rad) last."""
        xi = read_only(twist, (6,))
        rho, phi = xi[:3], xi[3:]
        angle = float(exact.length(phi))
        K = hat(phi)
        K2 = exact.product(K, K)
        if angle < 1e-5:
            V = np.eye(3) + 0.5 * K + K2 / 6.0
        else:
            c, s = math.cos(angle), math.sin(angle)
            V = np.eye(3) + (1 - c) / (angle * angle) * K + (angle - s) / (angle * angle * angle) * K2
        return cls(rotation_exp(phi), exact.product(V, rho))

    def log(self) -> Array:
        """Twist (6,) with `Pose.exp(pose.log()) == pose`: translation part first, rotation part last."""
        phi = rotation_log(self.rotation)
        angle = float(exact.length(phi))
        K = hat(phi)
        K2 = exact.product(K, K)
        if angle < 1e-5:
            V_inverse = np.eye(3) - 0.5 * K + K2 / 12.0
        else:
            c = (1 - 0.5 * angle * math.sin(angle) / (1 - math.cos(angle))) / (angle * angle)
            V_inverse = np.eye(3) - 0.5 * K + c * K2
        return np.concatenate([exact.product(V_inverse, self.translation), phi])

    @property
    def matrix(self) -> Array:
        """Homogeneous (4, 4) matrix."""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
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
