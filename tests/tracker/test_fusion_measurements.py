"""What each measurement of the filter says at the true state, what it refuses, and what the filter answers."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.flown_imu import CAM_FROM_BODY
from uavbench.tracker.fusion.measurements import CameraPose, Height, Measurement, OpticalFlow, Position
from uavbench.tracker.fusion.state import Estimate, FusionConfig
from uavbench.tracker.fusion.vehicle_filter import VehicleFilter
from uavbench.tracker.geometry_kernels import so3_exp
from uavbench.trajectories.pose import Pose

RNG = np.random.default_rng(4)
BODY = Pose(so3_exp(np.array([0.2, -0.3, 0.9])), np.array([1.0, -2.0, 1.5]))
VELOCITY, RATE = np.array([0.4, -0.7, 0.2]), np.array([0.3, -0.5, 0.8])
ARM = np.array([0.1, -0.2, 0.3])


def state(body: Pose = BODY) -> np.ndarray:
    at = Estimate.at_rest(0, body, position_m=1, attitude_rad=1).pack()
    at[3:6] = VELOCITY
    return at


def covariance(n: int) -> np.ndarray:
    A = RNG.normal(size=(n, n))
    return np.asarray(A @ A.T + np.eye(n))


def camera(P: np.ndarray) -> CameraPose:
    true = CAM_FROM_BODY @ BODY.inverse()
    return CameraPose(stamp_ns=0, cam_from_world=true, covariance=P, cam_from_body=CAM_FROM_BODY)


def position(P: np.ndarray, Q: np.ndarray | None = None, velocity: np.ndarray | None = None) -> Position:
    where = BODY.transform(ARM[None])[0]
    return Position(
        stamp_ns=0, position_m=where, covariance=P, velocity_m_s=velocity, velocity_covariance=Q, offset_m=ARM
    )


def flow(sigma: float = 0.1, range_sigma: float = 0.2) -> OpticalFlow:
    """Of the floor along the body's -z: the point that is looked at moves against the body."""
    down = -BODY.rotation[:, 2]
    distance = -BODY.translation[2] / down[2]
    v = BODY.rotation.T @ VELOCITY
    rates = np.array([v[0] / distance - RATE[1], v[1] / distance + RATE[0]])
    return OpticalFlow(
        stamp_ns=0, flow_rad_s=rates, flow_sigma_rad_s=sigma, range_m=distance, range_sigma_m=range_sigma
    )


def test_at_the_true_state_nothing_is_left_and_the_noise_is_that_which_is_claimed() -> None:
    P, Q, C = covariance(3), covariance(3), covariance(6)
    moving = VELOCITY + BODY.rotation @ np.cross(RATE, ARM)
    both = np.block([[P, np.zeros((3, 3))], [np.zeros((3, 3)), Q]])
    for measurement, noise in (
        (camera(C), C),
        (position(P), P),
        (position(P, Q, moving), both),
        (Height(stamp_ns=0, height_m=1.5, sigma_m=0.3), [[0.09]]),
        (flow(), np.diag([0.01, 0.01, 0.04])),
    ):
        found = measurement.innovation(state(), RATE)
        assert found is not None
        np.testing.assert_allclose(found.residual, 0.0, atol=1e-12)
        np.testing.assert_allclose(found.noise, noise, rtol=1e-12)
        assert found.H.shape == (len(noise), 21)


def test_measurements_of_one_stamp_have_an_order() -> None:
    kinds = (CameraPose, Position, Height, OpticalFlow)
    assert [kind.rank for kind in kinds] == [1, 2, 3, 4], "after the IMU, whose rank is 0"


@pytest.mark.parametrize(
    "made",
    [
        lambda: camera(np.zeros((6, 6))),
        lambda: camera(np.diag([1.0, 1, 1, 1, 1, -1e-9])),
        lambda: camera(np.diag([1.0, 1, 1, 1, 1, np.inf])),
        lambda: camera(1e308 * np.eye(6)),
        lambda: replace(camera(np.eye(6)), cam_from_world=Pose(np.eye(3), [np.nan, 0, 0])),
        lambda: position(np.diag([1.0, 1.0, 0.0])),
        lambda: position(np.eye(3), -np.eye(3), np.zeros(3)),
        lambda: position(np.eye(3), np.eye(3), np.array([np.nan, 0, 0])),
        lambda: position(np.eye(3), np.eye(3)),
        lambda: position(np.eye(3), None, np.zeros(3)),
        lambda: replace(position(np.eye(3)), position_m=np.array([0, np.inf, 0])),
        lambda: Height(stamp_ns=0, height_m=np.nan, sigma_m=1.0),
        lambda: Height(stamp_ns=0, height_m=1.0, sigma_m=0.0),
        lambda: flow(sigma=0.0),
        lambda: flow(range_sigma=0.0),
        lambda: replace(flow(), range_m=np.nan),
        lambda: replace(flow(), flow_rad_s=np.array([0.0, np.inf])),
    ],
)
def test_a_measurement_without_a_value_or_an_honest_covariance_is_refused(made) -> None:
    with pytest.raises(ValueError, match=r"finite|come together"):
        made()


@pytest.mark.parametrize(("tilt_deg", "height", "predicted"), [
    (59.9, 1.0, True), (60.1, 1.0, False), (0.0, 1e-9, True), (0.0, 0.0, False), (0.0, -1.0, False),
])  # fmt: skip
def test_flow_is_predicted_of_a_floor_beneath_an_upright_vehicle(tilt_deg, height, predicted) -> None:
    body = Pose(so3_exp(np.array([np.radians(tilt_deg), 0, 0])), np.array([0, 0, height]))
    assert (flow().innovation(state(body), RATE) is not None) == predicted


# The filter


def begun(**config) -> VehicleFilter:
    start = Estimate(
        stamp_ns=100, world_from_body=BODY, velocity_m_s=VELOCITY, gyro_bias_rad_s=np.array([0.1, 0.2, 0.3]),
        covariance=covariance(15),
    )  # fmt: skip
    return VehicleFilter(FusionConfig(**config), CAM_FROM_BODY, start)


def test_every_question_about_a_stamp_has_the_same_answer() -> None:
    run = begun()
    for k in range(5):
        run.imu(100 + k * 10_000_000, RATE * k, np.array([0.1 * k, 0.0, 9.8]))
    for stamp in (100, 12_000_100, 20_000_100, 40_000_100, 55_000_100):
        whole, nominal = run.estimate(stamp), run.nominal(stamp)
        np.testing.assert_array_equal(whole.world_from_body.translation, nominal.state[:3])
        np.testing.assert_array_equal(whole.world_from_body.rotation, nominal.state[6:15].reshape(3, 3))
        np.testing.assert_array_equal(whole.velocity_m_s, nominal.state[3:6])
        np.testing.assert_array_equal(whole.angular_velocity_rad_s, nominal.angular_velocity_rad_s)
        np.testing.assert_array_equal(whole.gyro_bias_rad_s, [0.1, 0.2, 0.3])
        at = min((stamp - 100) / 1e7, 4.0)
        np.testing.assert_allclose(nominal.angular_velocity_rad_s, RATE * at - [0.1, 0.2, 0.3], atol=1e-12)
        np.testing.assert_array_equal(run.covariance(stamp), whole.covariance)
        pose, P = run.predict_camera(stamp)
        true = CAM_FROM_BODY @ whole.world_from_body.inverse()
        np.testing.assert_allclose(pose.matrix, true.matrix, atol=1e-12)
        J = np.zeros((6, 15))
        for i, h in enumerate(np.eye(6) * 1e-6):
            body = whole.world_from_body
            plus, minus = (
                CAM_FROM_BODY @ Pose(body.rotation @ so3_exp(s * h[3:]), body.translation + s * h[:3]).inverse()
                for s in (1, -1)
            )
            J[:, i if i < 3 else i + 3] = (plus @ minus.inverse()).log() / 2e-6
        np.testing.assert_allclose(P, J @ whole.covariance @ J.T, rtol=1e-5, atol=1e-6)


def test_before_the_first_sample_the_start_alone_is_known() -> None:
    run = begun()
    first = run.estimate()
    assert (first.stamp_ns, first.angular_velocity_rad_s) == (100, None)
    np.testing.assert_array_equal(first.velocity_m_s, VELOCITY)
    with pytest.raises(ValueError, match="no IMU sample yet: nothing is known at 101"):
        run.estimate(101)
    with pytest.raises(ValueError, match="no IMU sample yet: no angular velocity is known at 100"):
        run.nominal(100)
    with pytest.raises(ValueError, match="99 is older than the history"):
        run.estimate(99)
    run.imu(20_000_100, RATE, np.array([0.0, 0.0, 9.8]))
    between, end = run.estimate(10_000_100), run.estimate()
    np.testing.assert_allclose(between.angular_velocity_rad_s, RATE - [0.1, 0.2, 0.3], atol=1e-12)
    turned = BODY.rotation @ so3_exp(0.01 * (RATE - [0.1, 0.2, 0.3]))
    np.testing.assert_allclose(between.world_from_body.rotation, turned, atol=1e-9)
    assert end.stamp_ns == 20_000_100


@pytest.mark.parametrize("bad", [
    (np.zeros(2), np.zeros(3)), (np.zeros(3), np.zeros(4)), (np.array([0, np.nan, 0]), np.zeros(3)),
    (np.zeros(3), np.array([np.inf, 0, 0])),
])  # fmt: skip
def test_a_sample_that_is_none_is_refused(bad) -> None:
    with pytest.raises(ValueError, match="IMU sample at 200: two finite vectors"):
        begun().imu(200, *bad)


def test_verdicts_tell_stamp_kind_and_why_in_the_order_of_stamps() -> None:
    run = begun(history_s=1.0)
    upside_down: Measurement = OpticalFlow(
        stamp_ns=20_000_100, flow_rad_s=np.zeros(2), flow_sigma_rad_s=0.1, range_m=1.0, range_sigma_m=0.1
    )
    run.take(Height(stamp_ns=30_000_100, height_m=1.5, sigma_m=0.1))
    run.take(upside_down)
    for k in range(5):
        run.imu(100 + k * 10_000_000, np.array([200.0, 0.0, 0.0]), np.array([0.0, 0.0, 9.8]))
    flow_told, height_told = run.verdicts
    assert (flow_told.stamp_ns, flow_told.kind, flow_told.d2, flow_told.dof) == (20_000_100, "OpticalFlow", None, None)
    assert flow_told.why == "the state cannot predict it"
    assert (height_told.stamp_ns, height_told.kind, height_told.dof, height_told.why) == (30_000_100, "Height", 1, "")
    for k in range(5, 130):
        run.imu(100 + k * 10_000_000, np.zeros(3), np.array([0.0, 0.0, 9.8]))
    assert run.verdicts == [flow_told, height_told], "also of what has left the history"
    run.take(Height(stamp_ns=25_000_100, height_m=1.5, sigma_m=0.1))
    assert [told.stamp_ns for told in run.verdicts] == [20_000_100, 25_000_100, 30_000_100]
    assert run.verdicts[1].why == "older than the history"
    with pytest.raises(ValueError, match=r"older than the history of 1\.0 s"):
        run.estimate(200_000_000)
    assert run.estimate(400_000_000).stamp_ns == 400_000_000
