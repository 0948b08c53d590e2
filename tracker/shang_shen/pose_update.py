"""Step 10, pose update: the camera pose that aligns the control points with their matches.

Only the distance along the normal of an edge is observable (the aperture problem), so PnP minimizes orthogonal
distances, by Gauss-Newton (Harris & Stennett 1990, section 3).
"""

from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera, camera_array
from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.kernels import gauss_newton
from uavbench.trajectories.pose import Array, Pose


def normal_jacobian(points_cam_m: Array, normals: Array, camera: Camera) -> Array:
    """Motion in px along the normals (n, 2) of points (n, 3) in the camera, per unit of a twist of the camera (n, 6).

    The twist xi moves the pose to exp(xi) @ cam_from_world, translation first.
    """
    x, y, z = points_cam_m.T
    # d(u, v)/d(point) of the pinhole, projected onto the normal
    gx, gy = camera.fx * normals[:, 0] / z, camera.fy * normals[:, 1] / z
    gz = -(gx * x + gy * y) / z
    return np.stack([gx, gy, gz, y * gz - z * gy, z * gx - x * gz, x * gy - y * gx], axis=1)


def prior_information(depth_m: float, sigma_part: float = 0.2, sigma_rad: float = 0.2) -> Array:
    """Weak prior information (6, 6) for directions that the edges do not constrain: sigma relative to the depth, and in
    rad.
    """
    return np.diag([1 / (sigma_part * depth_m) ** 2] * 3 + [1 / sigma_rad**2] * 3)


def least_squares(J: Array, distances: Array, prior: Array) -> Array:
    """Twist (6,) that moves the points by `distances` (n,) px along their normals, J (n, 6)."""
    return np.asarray(np.linalg.solve(J.T @ J + prior, J.T @ distances))


class UpdatedPose(NamedTuple):
    """`cam_from_world`, and the information (6, 6) of its twist."""

    cam_from_world: Pose
    information: Array


def update_pose(points: ControlPoints, distances: Array, camera: Camera, cam_from_world: Pose) -> UpdatedPose:
    """PnP on control points matched at `distances` (n,): the new pose and its information matrix (6, 6) for 1 px.

    distances: from `points.pixels`, the projection at the pose at which the points were sampled.
    """
    target = np.einsum("ij,ij->i", points.pixels, points.normals) + distances
    prior = prior_information(float(np.median(cam_from_world.transform(points.points_m)[:, 2])))
    cam = camera_array(camera.without_distortion)
    R, t = cam_from_world.rotation, cam_from_world.translation
    solved = gauss_newton(points.points_m, points.normals, target, cam, R, t, prior)
    return UpdatedPose(Pose(solved.R, solved.t), solved.information)
