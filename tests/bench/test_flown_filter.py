"""The filter in flight against a plain one of the tests, on the readings and answers that a flight recorded."""

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from tests.bench.test_closed_loop import Watching, box, flown
from tests.tracker.plain_filter import PlainFilter, State
from uavbench.bench.closed_loop.estimators import LEAST_BIAS_M_S2, LEAST_BIAS_RAD_S
from uavbench.bench.closed_loop.spec import FilterSpec
from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.imu import Imu

SIGMAS = np.array([0.004, 0.003, 0.006, 0.004, 0.005, 0.003])
"""Standard deviations of the tracker's errors, m and rad, all of which it claims."""
ASSUMED = FilterSpec(camera_slow_share=0.6, camera_slow_s=1.0, camera_bias_m=0.001, camera_bias_deg=0.05)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A flight around a box on poses with noise, what its tracker was given of the IMU, and the flight's folder."""
    spec = box(sensors=(Imu(gyro_bias_rad_s=0.01, accel_bias_m_s2=0.05),))
    honest = flown(spec, GroundTruth())
    true = {stamp: honest.groundtruth.pose(i) for i, stamp in enumerate(honest.results.stamps_ns.tolist())}

    def with_noise(stamp_ns):
        noise = Pose.exp(SIGMAS * np.random.default_rng(stamp_ns).normal(size=6))
        pose = noise @ spec.mount.cam_from_body @ true[stamp_ns].inverse()
        return TrackResult(status="ok", cam_from_world=pose, covariance=np.diag(SIGMAS**2))

    tracker = Watching(with_noise)
    found = flown(spec, tracker, filter=ASSUMED)
    assert not any(row[4] for row in found.innovations), "no pose is rejected"
    folder = tmp_path_factory.mktemp("flown") / "it"
    found.save(folder)
    return spec, found, tracker.seen["samples"], folder


def readings_of(folder):
    """Stamps (n,) in ns, rates and forces (n, 3) of the recorded IMU."""
    with (folder / "imu.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert list(rows[0]) == ["stamp_ns", *Imu.measured]
    stamps = np.array([int(row["stamp_ns"]) for row in rows])
    values = np.array([[float(row[column]) for column in Imu.measured] for row in rows])
    return stamps, values[:, :3], values[:, 3:]


def test_a_flight_records_the_readings_that_its_tracker_was_given_up_to_the_end(flight):
    _, found, samples, folder = flight
    stamps, rates, forces = readings_of(folder)
    given = np.concatenate([part["imu"].values for part in samples])
    np.testing.assert_array_equal(np.hstack([rates, forces])[: len(given)], given)
    assert len(given) < len(stamps)
    assert stamps[-1] >= found.path.stamps_ns[-1]


def started(spec, found):
    """The plain filter at the start of a flight; the velocity is the plan's."""
    imu, first = spec.sensors[0], found.groundtruth.pose(0)
    plan_m_s = np.diff(found.plan[:2, 1:4], axis=0)[0] / np.diff(found.plan[:2, 0])[0]
    biases = max(imu.accel_bias_m_s2, LEAST_BIAS_M_S2), max(imu.gyro_bias_rad_s, LEAST_BIAS_RAD_S)
    sigmas = [ASSUMED.start_m, ASSUMED.start_m_s, np.radians(ASSUMED.start_deg), *biases]
    P = np.diag([*np.repeat(sigmas, 3) ** 2, *np.ones(6)])
    zero = np.zeros(3)
    state = State(first.translation, plan_m_s, first.rotation, zero, zero, np.zeros(6), P)
    noises = imu.accel_noise_m_s2_sqrt_hz, imu.gyro_noise_rad_s_sqrt_hz
    walks = imu.accel_walk_m_s3_sqrt_hz, imu.gyro_walk_rad_s2_sqrt_hz
    return PlainFilter(state, *noises, *walks, ASSUMED.camera_slow_s, gate=chi2.ppf(ASSUMED.gate, 6))


def states_of(plain, spec, found, folder):
    """States of the plain filter at the stamps of the IMU's samples, each after the frames up to it."""
    stamps, rates, forces = readings_of(folder)
    bias = np.repeat([ASSUMED.camera_bias_m, np.radians(ASSUMED.camera_bias_deg)], 3)
    frames = list(zip(found.results.stamps_ns.tolist(), found.results.rows, strict=True))
    now, reading, out = 0, None, {}
    for stamp, rate, force in zip(stamps.tolist(), rates, forces, strict=True):
        while True:
            frame = frames[0][0] if frames and frames[0][0] < stamp else None
            until = stamp if frame is None else frame
            share = (until - now) / (stamp - now) if stamp > now else 1.0
            before = reading if reading is not None else (rate, force)
            there = before[0] + share * (rate - before[0]), before[1] + share * (force - before[1])
            if until > now:
                plain.propagate((before[0] + there[0]) / 2, (before[1] + there[1]) / 2, (until - now) / 1e9)
            now, reading = until, there
            if frame is None and not (frames and frames[0][0] == stamp):
                break
            row = frames.pop(0)[1]
            plain.see(row.cam_from_world.matrix, row.covariance, spec.mount.cam_from_body.matrix,
                      ASSUMED.camera_slow_share, bias)  # fmt: skip
        out[stamp] = plain.state
    return out


def test_the_filter_agrees_with_a_plain_one_on_the_sensors_of_a_flight(flight):
    spec, found, _, folder = flight
    states = states_of(started(spec, found), spec, found, folder)
    path = found.path
    rows = [i for i, stamp in enumerate(path.stamps_ns.tolist()) if stamp in states and stamp > 0]
    assert len(rows) > 30
    for i in rows:
        state = states[int(path.stamps_ns[i])]
        np.testing.assert_allclose(path.group("estimated_p_m")[i], state.p, atol=1e-5)
        np.testing.assert_allclose(path.group("estimated_v_m_s")[i], state.v, atol=5e-5)
        estimated = Rotation.from_quat(path.group("estimated_q")[i], scalar_first=True)
        assert (Rotation.from_matrix(state.R).inv() * estimated).magnitude() < 1e-5
        np.testing.assert_allclose(path.group("sigma_p_m")[i], np.sqrt(np.diag(state.P)[:3]), rtol=1e-3)
