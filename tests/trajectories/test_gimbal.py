"""The joints of a gimbal against closed forms, and its encoders against their data sheet."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.axes import GimbalAxis, PitchAxis, RollAxis, YawAxis, turned
from uavbench.trajectories.gimbal.encoder import Encoder
from uavbench.trajectories.gimbal.encoders_in_flight import GimbalEncoders
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.servo import Servo
from uavbench.trajectories.pose import Pose, quaternion_from_rotation, rotation_exp
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.record_columns import RECORD

STEP_NS, STEP_S = 2_000_000, 0.002
FAST = 5000.0
TARGET_M = np.array([2.0, -1.0, 0.3])


def flight(rotations, positions=None):
    """A flight with these rotations (n, 3, 3) of the body."""
    rows = np.zeros((len(rotations), 30))
    rows[:, RECORD["quaternions_wxyz"]] = quaternion_from_rotation(np.asarray(rotations))
    rows[:, RECORD["positions_m"]] = (0.0, 0.0, 1.0) if positions is None else positions
    values = {name: rows[:, columns] for name, columns in RECORD.items()}
    return Flight(stamps_ns=np.arange(len(rows)) * STEP_NS, **values)


def about(axis, angles):
    """Rotations (n, 3, 3) about an axis of the body."""
    return rotation_exp(np.outer(angles, np.eye(3)[axis]))


def view(motion, flown, row):
    """Elevation of the optical axis and of the image's x axis, rad, and the heading of the optical axis."""
    R = (motion(int(flown.stamps_ns[row])) @ flown.pose(row).inverse()).rotation
    return math.asin(R[2, 2]), math.asin(R[0, 2]), math.atan2(R[2, 1], R[2, 0])


def ramp_response(t, hz, damping):
    """Response at rest to the command t from t = 0 on: the integral of that to a unit step.

    Ogata, Modern Control Engineering, section 5.3, for damping below, at and above 1.
    """
    w = 2 * math.pi * hz
    t = np.maximum(t, 0.0)
    if damping < 1:
        wd = w * math.sqrt(1 - damping**2)
        decay = 2 * damping / w * np.cos(wd * t) + (2 * damping**2 - 1) / wd * np.sin(wd * t)
        return t - 2 * damping / w + np.exp(-damping * w * t) * decay
    if damping == 1:
        return t - 2 / w + np.exp(-w * t) * (t + 2 / w)
    root = math.sqrt(damping**2 - 1)
    fast, slow = w * (damping + root), w * (damping - root)
    return t + w / (2 * root) * ((1 - np.exp(-fast * t)) / fast**2 - (1 - np.exp(-slow * t)) / slow**2)


@pytest.mark.parametrize(("hz", "damping"), [(10.0, 0.7), (3.0, 0.2), (5.0, 1.0), (8.0, 2.0), (100.0, 2.0)])
def test_a_joint_answers_a_step_as_the_closed_form_does(hz, damping):
    """The step is a ramp of one period of the servo, whose response is the difference of two ramps'."""
    servo = Servo(GimbalAxis(natural_frequency_hz=hz, damping=damping, greatest_rate_deg_s=FAST), STEP_S, 0.0)
    answered = [servo.advance(0.02) for _ in range(500)]
    t = STEP_S * np.arange(1, 501)
    expected = 0.02 / STEP_S * (ramp_response(t, hz, damping) - ramp_response(t - STEP_S, hz, damping))
    np.testing.assert_allclose(answered, expected, atol=1e-12)


def test_a_joint_moves_no_faster_than_its_rate_and_rests_at_its_stop():
    axis = GimbalAxis(natural_frequency_hz=20.0, damping=0.5, greatest_rate_deg_s=90.0, greatest_deg=30.0)
    servo = Servo(axis, STEP_S, 0.0)
    angles = np.degrees([0.0] + [servo.advance(math.radians(80.0)) for _ in range(1000)])
    assert np.diff(angles).max() == pytest.approx(90.0 * STEP_S, rel=1e-9)
    assert np.diff(angles[100:150]) == pytest.approx(90.0 * STEP_S, rel=1e-9)
    assert angles.max() <= 30.0 + 1e-12
    assert angles[-1] == pytest.approx(30.0)
    back = np.degrees([servo.advance(0.0) for _ in range(1000)])
    assert back[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch", "pitch"])
def test_on_a_body_that_is_still_a_gimbal_holds_its_angles(axes):
    flown = flight(np.tile(turned(0.4, 0.0, 0.15), (400, 1, 1)))
    gimbal = Gimbal(axes=axes, pitch_deg=-25.0, yaw_deg=30.0 if axes == "yaw-roll-pitch" else 0.0)
    motion = gimbal.along(flown, TARGET_M)
    angles = motion.angles(flown.stamps_ns)
    np.testing.assert_allclose(angles, np.tile(angles[0], (400, 1)), atol=1e-12)
    pitch, level, heading = view(motion, flown, 399)
    assert math.degrees(pitch) == pytest.approx(-25.0)
    assert level == pytest.approx(0.0, abs=1e-12)
    if axes != "yaw-roll-pitch":
        assert heading == pytest.approx(0.4)


def test_three_axes_reach_every_attitude_on_a_tilted_body():
    rng = np.random.default_rng(3)
    for _ in range(20):
        yaw, roll, pitch = rng.uniform(-0.5, 0.5, 3)
        flown = flight(np.tile(turned(4 * yaw, roll, pitch), (2, 1, 1)))
        gimbal = Gimbal(pitch_deg=-30.0, roll_deg=10.0)
        cam_from_world = (gimbal.along(flown, TARGET_M)(0) @ flown.pose(0).inverse()).rotation
        heading = math.atan2(*turned(4 * yaw, roll, pitch)[[1, 0], 0])
        expected = turned(heading, math.radians(10.0), math.radians(-30.0))
        np.testing.assert_allclose(Mount().cam_from_body.rotation.T @ cam_from_world, expected.T, atol=1e-12)


def test_a_fixed_mount_and_a_gimbal_at_rest_on_a_level_body_see_the_same():
    flown = flight(np.tile(np.eye(3), (3, 1, 1)))
    gimbal = Gimbal(pitch_deg=-20.0, yaw_deg=40.0, offset_m=(0.1, 0.0, -0.02))
    at_rest = gimbal.at_rest
    assert at_rest == Mount(pitch_deg=-20.0, yaw_deg=40.0, offset_m=(0.1, 0.0, -0.02))
    np.testing.assert_allclose(gimbal.along(flown, TARGET_M)(0).matrix, at_rest.cam_from_body.matrix, atol=1e-12)
    assert at_rest.along(flown, TARGET_M)(123).matrix.tolist() == at_rest.cam_from_body.matrix.tolist()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_on_a_body_that_turns_steadily_the_view_lags_by_twice_the_damping_over_w(axis):
    rate = 0.3
    flown = flight(about(axis, rate * STEP_S * np.arange(1000)))
    gimbal = Gimbal(pitch_axis=PitchAxis(natural_frequency_hz=4.0), roll_axis=RollAxis(natural_frequency_hz=5.0))
    gimbal = replace(gimbal, mode="target", target_m=(1e9, 0.0, 1.0), yaw_axis=YawAxis(damping=0.4))
    pitch, level, heading = view(gimbal.along(flown, TARGET_M), flown, 999)
    hz, damping = [(5.0, 0.7), (4.0, 0.7), (10.0, 0.4)][axis]
    lag = 2 * damping / (2 * math.pi * hz) * rate
    # about x the image's x axis, to the right, sinks; about y the view sinks; about z it turns to the left
    expected = {0: (0.0, -lag, 0.0), 1: (-lag, 0.0, 0.0), 2: (0.0, 0.0, lag)}[axis]
    assert (pitch, level, heading) == pytest.approx(expected, abs=2e-5)


def test_of_a_swaying_body_the_share_remains_that_the_transfer_function_says():
    hz, damping, sway_hz, amplitude = 6.0, 0.6, 1.5, 0.02
    t = STEP_S * np.arange(4000)
    flown = flight(about(1, amplitude * np.sin(2 * math.pi * sway_hz * t)))
    motion = Gimbal(pitch_axis=PitchAxis(natural_frequency_hz=hz, damping=damping)).along(flown, TARGET_M)
    left = np.array([view(motion, flown, row)[0] for row in range(2000, 4000)])
    s, w = 2j * math.pi * sway_hz, 2 * math.pi * hz
    remaining = abs(s * (s + 2 * damping * w) / (s**2 + 2 * damping * w * s + w**2))
    assert np.abs(left).max() == pytest.approx(amplitude * remaining, rel=1e-3)


def test_with_a_pitch_axis_alone_the_image_rolls_with_the_body_and_with_two_it_does_not():
    flown = flight(np.tile(turned(0.0, 0.2, 0.0), (2, 1, 1)))
    assert view(Gimbal(axes="pitch").along(flown, TARGET_M), flown, 0)[1] == pytest.approx(-0.2)
    assert view(Gimbal(axes="roll-pitch").along(flown, TARGET_M), flown, 0)[1] == pytest.approx(0.0, abs=1e-12)


def test_two_axes_hold_level_and_pitch_on_a_body_that_is_tilted_both_ways():
    flown = flight(np.tile(turned(0.3, 0.35, -0.2), (2, 1, 1)))
    pitch, level, _ = view(Gimbal(axes="roll-pitch", pitch_deg=-25.0).along(flown, TARGET_M), flown, 0)
    assert (math.degrees(pitch), level) == (pytest.approx(-25.0), pytest.approx(0.0, abs=1e-12))


@pytest.mark.parametrize("side", [-1, 1])
def test_on_a_body_that_lies_on_its_side_the_roll_joint_is_commanded_to_a_quarter_turn(side):
    """The sine of its angle is one, or by rounding a little more."""
    for yaw in np.linspace(-3.0, 3.0, 200):
        on_its_side = flight(np.tile(turned(yaw, side * math.pi / 2, 0.0), (2, 1, 1))).pose(0)
        assert Gimbal().commands(on_its_side, TARGET_M).roll == pytest.approx(-side * math.pi / 2, abs=1e-6)


def test_a_gimbal_is_at_the_bodys_origin_unless_it_is_placed():
    assert Gimbal().at_rest.offset_m == (0.0, 0.0, 0.0)
    assert Gimbal().cam_from_body(0.0, 0.0, 0.0).translation.tolist() == [0.0, 0.0, 0.0]


def test_a_target_is_in_the_middle_of_the_image_wherever_the_body_is():
    rng = np.random.default_rng(5)
    for _ in range(10):
        flown = flight(
            np.tile(turned(*rng.uniform(-0.4, 0.4, 3)), (2, 1, 1)), rng.uniform(-0.5, 0.5, 3) + np.array([0, 0, 1])
        )
        for gimbal, target in (
            (Gimbal(mode="target", offset_m=(0.1, 0.2, 0.0)), TARGET_M),
            (Gimbal(mode="target", target_m=(-4.0, 3.0, 0.0)), np.array([-4.0, 3.0, 0.0])),
        ):
            cam_from_world = gimbal.along(flown, TARGET_M)(0) @ flown.pose(0).inverse()
            x, y, z = cam_from_world.transform(target[None])[0]
            assert (x / z, y / z) == pytest.approx((0.0, 0.0), abs=1e-12)
            assert z > 0
            assert cam_from_world.rotation[0, 2] == pytest.approx(0.0, abs=1e-12)


def test_angles_follow_from_the_rows_flown_so_far_and_are_linear_between_them():
    angles = 0.2 * np.sin(0.01 * np.arange(300))
    whole, begun = flight(about(1, angles)), flight(about(1, angles[:120]))
    stamps = whole.stamps_ns[:120]
    late, early = (Gimbal().along(each, TARGET_M) for each in (whole, begun))
    assert late.angles(stamps).tolist() == early.angles(stamps).tolist()
    row, after, between = late.angles(np.array([100, 101, 100.25]) * STEP_NS)
    np.testing.assert_allclose(between, 0.75 * row + 0.25 * after, atol=1e-15)


def test_the_yaw_axis_takes_the_shorter_way_and_stops_where_its_cables_end():
    turns = np.linspace(0.0, 4 * math.pi, 3000)
    flown = flight(about(2, turns))
    gimbal = Gimbal(mode="target", target_m=(1e6, 0.0, 1.0))
    yaw = np.degrees(gimbal.along(flown, TARGET_M).angles(flown.stamps_ns)[:, 0])
    assert yaw.min() == pytest.approx(-270.0)
    assert np.abs(np.diff(yaw)).max() <= 400.0 * STEP_S + 1e-9


@pytest.mark.parametrize(("start", "command", "end"), [(3.0, -3.0, 2 * math.pi - 3.0), (-3.0, 3.0, 3.0 - 2 * math.pi)])
def test_a_command_more_than_half_a_turn_away_is_reached_the_other_way_round(start, command, end):
    servo = Servo(YawAxis(), STEP_S, start)
    assert [servo.advance(command) for _ in range(500)][-1] == pytest.approx(end, abs=1e-9)


def still(seconds):
    return flight(np.tile(np.eye(3), (round(seconds / STEP_S) + 1, 1, 1)))


def readings(encoder, seed=0, seconds=8.0, axes="yaw-roll-pitch"):
    flown = still(seconds)
    gimbal = Gimbal(axes=axes, pitch_deg=-20.0, encoder=encoder)
    return encoder.measure(gimbal.joints, gimbal.along(flown, TARGET_M), flown, stream(seed, "gimbal", "camera"))


def test_the_noise_of_the_encoders_has_the_standard_deviation_of_the_config():
    table = readings(Encoder(rate_hz=500.0, noise_deg=0.2, resolution_deg=0.0, zero_deg=0.0))
    assert table.columns[:3] == ("yaw_rad", "roll_rad", "pitch_rad")
    errors = np.degrees(table.values[:, :3] - table.values[:, 3:])
    n = len(errors)
    assert n == 4001
    assert errors.std(axis=0) == pytest.approx(0.2, rel=4 / math.sqrt(2 * n))
    assert np.abs(errors.mean(axis=0)).max() < 4 * 0.2 / math.sqrt(n)
    neighbours = np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]
    assert abs(neighbours) < 4 / math.sqrt(n)
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 4 / math.sqrt(n)


def test_a_reading_is_a_multiple_of_the_resolution_at_most_half_of_it_off():
    step = 0.5
    table = readings(Encoder(noise_deg=0.0, resolution_deg=step, zero_deg=0.0), seconds=1.0)
    steps = np.degrees(table.values[:, :3]) / step
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    moving = flight(about(1, np.linspace(0, 0.5, 3000)))
    gimbal = Gimbal(encoder=Encoder(rate_hz=500.0, noise_deg=0.0, resolution_deg=step, zero_deg=0.0))
    motion = gimbal.along(moving, TARGET_M)
    table = gimbal.encoder.measure(("pitch",), motion, moving, stream(0, "gimbal", "camera"))
    errors = np.degrees(table.column("pitch_rad") - table.column("true_pitch_rad"))
    assert np.abs(errors).max() <= step / 2 + 1e-9
    assert errors.std() == pytest.approx(step / math.sqrt(12), rel=0.05)


def test_each_joint_has_a_zero_offset_that_is_fixed_in_flight_and_drawn_for_each_seed():
    encoder = Encoder(rate_hz=100.0, noise_deg=0.0, resolution_deg=0.0, zero_deg=0.4)
    tables = [readings(encoder, seed, seconds=0.02) for seed in range(300)]
    errors = [np.degrees(table.values[:, :3] - table.values[:, 3:]) for table in tables]
    assert max(np.ptp(each, axis=0).max() for each in errors) < 1e-9
    zeros = np.array([each[0] for each in errors])
    assert zeros.std(axis=0) == pytest.approx(0.4, rel=4 / math.sqrt(600))
    assert len(np.unique(zeros)) == zeros.size


def test_the_same_seed_gives_the_same_readings_and_fewer_joints_those_of_the_ones_that_are_left():
    one, again, other = (readings(Encoder(), seed, seconds=0.5).values.tolist() for seed in (1, 1, 2))
    assert one == again != other
    whole, part = readings(Encoder(), seconds=0.5), readings(Encoder(), seconds=0.5, axes="roll-pitch")
    assert part.columns == ("roll_rad", "pitch_rad", "true_roll_rad", "true_pitch_rad")
    assert part.column("pitch_rad").tolist() == whole.column("pitch_rad").tolist()


def test_stamps_are_those_of_the_encoders_rate():
    assert np.diff(readings(Encoder(rate_hz=40.0), seconds=1.0).stamps_ns).tolist() == [25_000_000] * 40


def test_the_defaults_are_those_of_the_data_sheet_and_those_assumed():
    assert (Encoder().noise_deg, round(Encoder().resolution_deg, 4)) == (0.06, 0.0220)
    assert (Encoder().zero_deg, Encoder().rate_hz) == (0.1, 100.0)


def test_a_flight_of_one_period_has_two_readings_and_one_of_a_single_row_has_one():
    assert readings(Encoder(rate_hz=10.0), seconds=0.1).stamps_ns.tolist() == [0, 100_000_000]
    assert readings(Encoder(rate_hz=10.0), seconds=0.0).stamps_ns.tolist() == [0]


def test_on_a_flight_of_two_rows_the_servos_step_as_long_as_its_control():
    tilted = flight([np.eye(3), turned(0.0, 0.1, 0.0)])
    whole = flight([np.eye(3), *[turned(0.0, 0.1, 0.0)] * 5])
    two, more = (Gimbal().along(each, TARGET_M).angles(tilted.stamps_ns).tolist() for each in (tilted, whole))
    assert two == more
    assert -0.01 < two[1][1] < 0.0


def test_the_measured_angles_give_the_camera_as_the_joints_that_exist_do():
    gimbal = Gimbal(axes="roll-pitch", yaw_deg=20.0, offset_m=(0.1, 0.0, 0.0))
    expected = gimbal.cam_from_body(0.0, 0.1, -0.3).matrix
    assert gimbal.cam_from_body_at(np.array([0.1, -0.3])).matrix.tolist() == expected.tolist()
    assert Pose.from_matrix(expected).inverse().translation == pytest.approx((0.1, 0.0, 0.0))


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch", "pitch"])
def test_the_twists_of_the_joints_are_the_derivative_of_the_pose_by_their_angles(axes):
    gimbal = Gimbal(axes=axes, yaw_deg=30.0, offset_m=(0.1, -0.05, 0.02))
    angles = np.array([0.7, -0.2, -0.5])[-len(gimbal.joints) :]
    for k, step in enumerate(1e-6 * np.eye(len(angles))):
        ahead, behind = gimbal.cam_from_body_at(angles + step), gimbal.cam_from_body_at(angles - step)
        difference = (ahead @ behind.inverse()).log() / 2e-6
        np.testing.assert_allclose(gimbal.twists_at(angles)[:, k], difference, atol=1e-8)


class Growing:
    """A flight of which a number of rows is flown so far."""

    def __init__(self, whole):
        self.whole, self.flown, self.stamps_ns = whole, 1, whole.stamps_ns

    def __len__(self):
        return self.flown

    def pose(self, row):
        assert row < self.flown, "a row that is not flown yet"
        return self.whole.pose(row)


def test_a_gimbal_at_rest_has_the_angles_of_its_commands_as_far_as_the_stops_allow():
    gimbal = Gimbal(pitch_deg=-15.0, roll_axis=RollAxis(least_deg=-5.0))
    motion = gimbal.along(flight(np.tile(np.eye(3), (2, 1, 1))), TARGET_M)
    tilted = motion.at_rest_on(Pose(about(0, np.radians([3.0]))[0], np.zeros(3)))
    assert np.degrees(tilted) == pytest.approx([0.0, -3.0, -15.0], abs=1e-9)
    stopped = motion.at_rest_on(Pose(about(0, np.radians([20.0]))[0], np.zeros(3)))
    assert np.degrees(stopped) == pytest.approx([0.0, -5.0, -15.0], abs=1e-9)


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch", "pitch"])
def test_frames_in_which_the_stops_keep_the_camera_from_its_target_are_counted(axes):
    """Flying up past a target 4 m ahead, the camera pitches down to it by atan(height / 4)."""
    heights = np.linspace(0.0, 4.0, 41)
    flown = flight(np.tile(np.eye(3), (41, 1, 1)), np.column_stack([np.zeros((41, 2)), heights]))
    gimbal = Gimbal(axes=axes, mode="target", target_m=(4.0, 0.0, 0.0), pitch_axis=PitchAxis(least_deg=-30.0))
    missed = int((np.degrees(np.arctan(heights / 4)) > 30.1).sum())
    told = gimbal.unreached(gimbal.along(flown, TARGET_M), flown.stamps_ns)
    assert f"pitch_axis, -30 to 60 degrees, keep it from its target in {missed} of 41 frames, by up to 15.0 " in told
    wide = replace(gimbal, pitch_axis=PitchAxis(least_deg=-45.1))
    assert wide.unreached(wide.along(flown, TARGET_M), flown.stamps_ns) == ""
    high = flown.stamps_ns[-10:]
    with pytest.raises(
        UserError, match=r"mount\.target_m: .* in 10 of 10 frames, .*; widen the stops, or move the tar"
    ):
        gimbal.unreached(gimbal.along(flown, TARGET_M), high)


def test_yaw_reaches_a_target_behind_by_either_turn_and_a_held_attitude_has_no_target():
    flown = flight(about(2, np.linspace(0.0, 6.0, 3001)))
    gimbal = Gimbal(mode="target", target_m=(5.0, 0.0, 1.0))
    told = gimbal.unreached(gimbal.along(flown, TARGET_M), flown.stamps_ns[::100])
    assert "the stops of yaw_axis, -270 to 270 degrees" in told  # its cables end after a turn and a half
    held = Gimbal()
    assert held.unreached(held.along(flown, TARGET_M), flown.stamps_ns) == ""
    few = flown.stamps_ns[:2000:100]
    assert gimbal.unreached(gimbal.along(flown, TARGET_M), few) == ""


def test_a_target_at_the_vehicle_has_no_direction():
    flown = flight(np.tile(np.eye(3), (3, 1, 1)))
    gimbal = Gimbal(mode="target", target_m=(0.3, 0.0, 1.05), offset_m=(0.3, 0.0, 0.0))
    with pytest.raises(
        UserError, match=r"mount\.target_m: frame 0: the camera is 0\.050 m from it, .*; move the target"
    ):
        gimbal.unreached(gimbal.along(flown, TARGET_M), flown.stamps_ns)


def test_encoders_that_read_once_in_a_flight_are_refused():
    Encoder(rate_hz=0.25).check(4_000_000_000)
    with pytest.raises(UserError, match=r"rate_hz 0\.25: one reading takes 4 s, and the flight 3\.9 s"):
        Encoder(rate_hz=0.25).check(3_900_000_000)


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch"])
def test_along_a_flight_in_progress_joints_and_readings_are_those_of_the_whole_one(axes):
    whole = flight(about(1, 0.3 * np.sin(np.linspace(0, 8, 400))))
    gimbal = Gimbal(axes=axes, encoder=Encoder(rate_hz=130.0))
    expected = gimbal.encoder.measure(gimbal.joints, gimbal.along(whole, TARGET_M), whole, stream(0, "gimbal"))
    growing = Growing(whole)
    encoders = GimbalEncoders(gimbal, gimbal.along(growing, TARGET_M))
    reader, joints = encoders.begin(1000, None, stream(0, "gimbal")), len(gimbal.joints)
    assert (encoders.rate_hz, encoders.measured) == (130.0, expected.columns[:joints])
    true, read = [], []
    for stamp in expected.stamps_ns.tolist():
        while whole.stamps_ns[growing.flown - 1] < stamp:
            growing.flown += 1
        read.append(reader.read(whole, np.array([stamp]))[0])
        true.append(encoders.motion.angles(np.array([stamp]))[0, -joints:])
    assert np.hstack([read, true]).tolist() == expected.values.tolist()
    assert encoders.measure(whole, None, stream(0, "gimbal")).values.tolist() == expected.values.tolist()


def test_the_noise_of_a_reading_is_that_of_the_data_sheet_and_of_its_rounding():
    encoder = Encoder(noise_deg=0.3, resolution_deg=0.6, zero_deg=0.5)
    table = readings(replace(encoder, zero_deg=0.0, rate_hz=500.0))
    errors = table.values[:, :3] - table.values[:, 3:]
    assert errors.std() == pytest.approx(encoder.white_rad, rel=0.05)
    assert encoder.zero_rad == pytest.approx(np.radians(0.5))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"pitch_deg": 70.0}, "pitch_deg 70 is beyond the stops of its axis, -130 to 60 degrees; give an angle"),
        ({"pitch_deg": -20.0, "pitch_axis": PitchAxis(least_deg=-10.0)}, "pitch_deg -20 is beyond the stops"),
        ({"roll_deg": 50.0}, "widen least_deg and greatest_deg of roll_axis"),
        ({"axes": "pitch", "roll_deg": 5.0}, "axes = 'pitch' has no roll axis"),
        ({"mode": "target", "pitch_deg": -5.0}, "mode = 'target' points the camera itself"),
        ({"target_m": (0.0, 0.0, 0.0)}, "set mode = 'target'"),
    ],
)
def test_what_a_gimbal_cannot_do_is_refused_by_name(given, told):
    with pytest.raises(UserError, match=told):
        Gimbal(**given)


def test_stops_without_a_range_and_a_rate_beyond_the_flight_are_refused_by_name():
    with pytest.raises(ValueError, match="least_deg 0 is not below greatest_deg 0"):
        GimbalAxis(least_deg=0.0, greatest_deg=0.0)
    with pytest.raises(UserError, match=r"encoder.rate_hz 0.5: one reading takes 2 s, and the flight 1 s; raise"):
        readings(Encoder(rate_hz=0.5), seconds=1.0)
