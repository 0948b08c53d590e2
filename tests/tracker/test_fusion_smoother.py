"""The vehicle's filter against GTSAM's batch smoother: all readings and poses of a flight at once, to convergence.

The last state of a smoother knows what a filter knows at that time, so that both agree as far as each linearizes well.
"""

import numpy as np
import pytest

from tests.tracker.flown_imu import (
    CAM_FROM_BODY,
    body_rate,
    camera_answer,
    specific_force,
    velocity,
    world_from_body,
)
from uavbench.tracker.fusion.state import STANDARD_GRAVITY_M_S2, Estimate, FusionConfig
from uavbench.tracker.fusion.vehicle_filter import VehicleFilter
from uavbench.trajectories.pose import Pose, hat, rotation_exp, rotation_log

gtsam = pytest.importorskip("gtsam", reason="gtsam is the oracle here, a development dependency")

CONFIG = FusionConfig(camera_slow_share=0.0, camera_bias_m=0.0, camera_bias_rad=0.0, gate=1 - 1e-12, history_s=10.0)
"""White errors only, which is what a factor of a pose has, and no gate."""
SECONDS, IMU_HZ, CAMERA_HZ = 3.0, 500.0, 5.0
SIGMAS = np.array([0.01, 0.012, 0.02, 0.005, 0.004, 0.006])
"""Standard deviations of a camera pose's twist, m and rad."""
START = np.repeat([0.02, 0.05, 0.01, 0.05, 0.01], 3)
"""Standard deviations of the start: position, velocity, attitude, biases of accelerometer and gyroscope."""


def ns(t):
    return round(t * 1e9)


def flight(seed):
    """Initial estimate, IMU samples (t, gyro, accel), and results of a camera by time, all with noise."""
    rng = np.random.default_rng(seed)
    off, pose = START * rng.normal(size=15), world_from_body(0.0)
    start = Estimate(
        stamp_ns=0,
        world_from_body=Pose(pose.rotation @ rotation_exp(-off[6:9]), pose.translation - off[:3]),
        velocity_m_s=velocity(0.0) - off[3:6],
        covariance=np.diag(START**2),
    )
    white = np.sqrt(IMU_HZ) * np.repeat([CONFIG.gyro_noise_rad_s_sqrt_hz, CONFIG.accel_noise_m_s2_sqrt_hz], 3)
    samples, answers = [], {}
    for k in range(round(SECONDS * IMU_HZ) + 1):
        t = k / IMU_HZ
        noise = white * rng.normal(size=6)
        samples.append((t, body_rate(t) + off[12:15] + noise[:3], specific_force(t) + off[9:12] + noise[3:]))
        if k % round(IMU_HZ / CAMERA_HZ) == 0:
            answers[t] = camera_answer(t, np.diag(SIGMAS**2), SIGMAS * rng.normal(size=6))
    return start, samples, answers


def filtered(start, samples, answers):
    """The filter's last estimate."""
    run = VehicleFilter(CONFIG, CAM_FROM_BODY, start)
    for t, gyro, accel in samples:
        run.imu(ns(t), gyro, accel)
        if t in answers:
            run.camera(ns(t), answers[t])
    assert not any(verdict.why for verdict in run.verdicts)
    return run.estimate()


def in_gtsams_order(covariance):
    """A covariance (6, 6) of translation and rotation as one of rotation and translation."""
    order = [3, 4, 5, 0, 1, 2]
    return covariance[np.ix_(order, order)]


def pose_factor(key, result):
    """The body's pose by a camera: body_measured^-1 body_true is exp(-Ad xi) for an error xi of cam_from_world."""
    body_from_cam = CAM_FROM_BODY.inverse()
    R = body_from_cam.rotation
    adjoint = np.block([[R, hat(body_from_cam.translation) @ R], [np.zeros((3, 3)), R]])
    noise = gtsam.noiseModel.Gaussian.Covariance(in_gtsams_order(adjoint @ result.covariance @ adjoint.T))
    body = result.cam_from_world.inverse() @ CAM_FROM_BODY
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(gtsam.Rot3(body.rotation), body.translation), noise)


def preintegration():
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(STANDARD_GRAVITY_M_S2)
    parameters.setAccelerometerCovariance(np.eye(3) * CONFIG.accel_noise_m_s2_sqrt_hz**2)
    parameters.setGyroscopeCovariance(np.eye(3) * CONFIG.gyro_noise_rad_s_sqrt_hz**2)
    parameters.setBiasAccCovariance(np.eye(3) * CONFIG.accel_walk_m_s3_sqrt_hz**2)
    parameters.setBiasOmegaCovariance(np.eye(3) * CONFIG.gyro_walk_rad_s2_sqrt_hz**2)
    parameters.setIntegrationCovariance(np.zeros((3, 3)))
    return gtsam.PreintegratedCombinedMeasurements(parameters, gtsam.imuBias.ConstantBias())


def smoothed(start, samples, answers):
    """Last state of the smoother (p, v, R, bias of force, of rate), and its covariance (15, 15) in our order."""
    X, V, B = (lambda k, c=c: gtsam.symbol(c, k) for c in "xvb")
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    body = start.world_from_body
    first = gtsam.NavState(gtsam.Pose3(gtsam.Rot3(body.rotation), body.translation), start.velocity_m_s)
    by_body = body.rotation.T @ start.covariance[:3, :3] @ body.rotation
    there = np.block([[start.covariance[6:9, 6:9], np.zeros((3, 3))], [np.zeros((3, 3)), by_body]])
    gaussian = gtsam.noiseModel.Gaussian.Covariance
    graph.add(gtsam.PriorFactorPose3(X(0), first.pose(), gaussian(there)))
    graph.add(gtsam.PriorFactorVector(V(0), first.velocity(), gaussian(start.covariance[3:6, 3:6])))
    graph.add(gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(), gaussian(start.covariance[9:, 9:])))
    k, state, since, before = 0, first, preintegration(), None

    def put():
        values.insert(X(k), state.pose())
        values.insert(V(k), state.velocity())
        values.insert(B(k), gtsam.imuBias.ConstantBias())

    put()
    for t, gyro, accel in samples:
        if before is not None:  # the mean of the readings at both ends, as the filter integrates
            since.integrateMeasurement((before[2] + accel) / 2, (before[1] + gyro) / 2, t - before[0])
        before = (t, gyro, accel)
        if t in answers:
            if t > 0:
                graph.add(gtsam.CombinedImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), since))
                state = since.predict(state, gtsam.imuBias.ConstantBias())
                k, since = k + 1, preintegration()
                put()
            graph.add(pose_factor(X(k), answers[t]))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    keys = gtsam.KeyVector([X(k), V(k), B(k)])
    joint = gtsam.Marginals(graph, found).jointMarginalCovariance(keys)
    P = np.block(
        [[joint.at(a, b) for b in keys] for a in keys]
    )  # rotation, translation in the body, velocity, biases of force and rate
    pose = found.atPose3(X(k))
    R = pose.rotation().matrix()
    T = np.zeros((15, 15))
    T[0:3, 3:6], T[3:6, 6:9], T[6:9, 0:3], T[9:15, 9:15] = R, np.eye(3), np.eye(3), np.eye(6)
    bias = found.atConstantBias(B(k))
    state = pose.translation(), found.atVector(V(k)), R, bias.accelerometer(), bias.gyroscope()
    return state, T @ P @ T.T


@pytest.mark.parametrize("seed", range(3))
def test_the_filter_ends_where_a_batch_smoother_does_and_is_as_sure_of_it(seed):
    given = flight(seed)
    ours, ((p, v, R, force_bias, rate_bias), P) = filtered(*given), smoothed(*given)
    apart = np.concatenate([
        ours.world_from_body.translation - p,
        ours.velocity_m_s - v,
        rotation_log(R.T @ ours.world_from_body.rotation),
        ours.accel_bias_m_s2 - force_bias,
        ours.gyro_bias_rad_s - rate_bias,
    ])  # fmt: skip
    sigmas, our_sigmas = np.sqrt(np.diag(P)), np.sqrt(np.diag(ours.covariance))
    # GTSAM holds the attitude over a step where the filter integrates it: 2 ms leave 6 % of a standard deviation.
    assert np.abs(apart / sigmas).max() < 0.1
    np.testing.assert_allclose(our_sigmas, sigmas, rtol=0.005)
    correlation = ours.covariance / np.outer(our_sigmas, our_sigmas)
    np.testing.assert_allclose(correlation, P / np.outer(sigmas, sigmas), atol=0.02)
