import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.paths.pilot.gamepad import Gamepad
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot, Pilot
from uavbench.trajectories.paths.reference import VehicleState
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.quadrotor import STEP_S

FOCAL_PX = 502.0  # 65 degrees across 640 px


def pixels(flight: Flight, mount: Mount) -> np.ndarray:
    """Corners of the box (n, 8, 2) in a 640 x 480 image, fifteen times a second."""
    rows = range(0, len(flight), 33)
    seen = np.array([(mount.cam_from_body @ flight.pose(r).inverse()).transform(BOX.vertices) for r in rows])
    return seen[..., :2] / seen[..., 2:] * FOCAL_PX + [319.5, 239.5]


@pytest.mark.parametrize("pitch_deg", [0.0, -15.0])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_pilot_goes_well_around_the_box_and_keeps_all_of_it_in_view(seed: int, pitch_deg: float) -> None:
    mount = Mount(pitch_deg=pitch_deg)
    flight = fly(FlightSpec(), mount, BOX, seed)
    p, v = flight.positions_m, flight.velocities_m_s
    uv = pixels(flight, mount)
    inside = ((uv > 0) & (uv < [639, 479])).all(axis=(1, 2))
    assert inside.mean() > 0.99
    bearing = np.unwrap(np.arctan2(p[:, 1], p[:, 0]))
    assert abs(bearing[-1] - bearing[0]) > np.pi
    distance = np.hypot(p[:, 0], p[:, 1])
    assert distance.min() > 0.95 and distance.max() < 1.6
    assert p[:, 2].min() > 0.33 and p[:, 2].max() < 0.95
    speed = np.linalg.norm(v, axis=1)
    assert 0.08 < speed.mean() < 0.4 and speed.max() < 0.6
    # A hand is never quite on target: the camera wanders about the box, and by no more than the pilot can see.
    aim = np.degrees(np.abs(uv.mean(axis=1)[:, 0] - 319.5) / FOCAL_PX)
    assert 0.3 < aim.std() < 5.0


def test_the_record_begins_in_flight_and_not_with_a_drop() -> None:
    flight = fly(FlightSpec(), Mount(), BOX, 0)
    assert np.abs(flight.accelerations_m_s2[:50]).max() < 1.0
    assert np.abs(flight.angular_velocities_rad_s[:50, :2]).max() < 0.3
    assert np.linalg.norm(flight.velocities_m_s[0]) > 0.02


def test_a_pilot_who_believes_to_be_at_the_centre_flies_on() -> None:
    pilot = HandPilot().plan(BOX, Mount(), np.random.default_rng(0))
    assert isinstance(pilot, Pilot)
    believed = VehicleState(np.array([*pilot._stage.centre, 0.5]), np.zeros(3), 0.0)
    assert np.isfinite([pilot.rows(10 * block, 10, believed) for block in range(100)]).all()


def test_the_pilot_reacts_late() -> None:
    """Two pilots with the same hands see the vehicle in another place; their sticks differ only after the delay."""
    pilots = [HandPilot(reaction_s=0.2).plan(BOX, Mount(), np.random.default_rng(0)) for _ in range(2)]
    assert all(isinstance(pilot, Pilot) for pilot in pilots)
    start = pilots[0].rows(-pilots[0].warm_up, 1, None)[0]
    here, there = (VehicleState(start[:3] + np.array([0.0, 0.0, dz]), np.zeros(3), start[9]) for dz in (0.0, 0.3))
    differ = []
    for block in range(200):
        first = -pilots[0].warm_up + 10 * block
        moved = there if block >= 50 else here
        a, b = (pilot.rows(first, 10, seen) for pilot, seen in zip(pilots, (here, moved), strict=True))
        differ.append(not np.array_equal(a, b))
    late_s = (np.argmax(differ) - 50) * 10 * STEP_S
    assert 0.2 <= late_s <= 0.2 + 0.5 + 0.02


@settings(max_examples=200)
@given(
    command=st.tuples(*[st.floats(-1.0, 1.0)] * 4),
    dead_zone=st.floats(0.0, 0.4),
    expo=st.floats(0.0, 0.95),
)
def test_the_pilot_knows_his_pad(command: tuple[float, ...], dead_zone: float, expo: float) -> None:
    pad = Gamepad(dead_zone=dead_zone, expo=expo)
    wanted = np.array(command) * pad.tops
    np.testing.assert_allclose(pad.command(pad.deflection(wanted)), wanted, atol=1e-6)


def test_the_dead_zone_is_dead_and_full_deflection_is_the_top() -> None:
    pad = Gamepad()
    assert not pad.command(np.array([0.1, -0.1, 0.05, 0.0])).any()
    np.testing.assert_allclose(pad.command(np.array([1.0, -1.0, 1.0, 1.0])), pad.tops * [1, -1, 1, 1])


def test_sticks_move_no_faster_than_thumbs() -> None:
    pilot = HandPilot(pad=Gamepad(tremor=0.0)).plan(BOX, Mount(), np.random.default_rng(0))
    start = pilot.rows(-pilot.warm_up, 1, None)[0]
    far = VehicleState(start[:3] + np.array([3.0, 0.0, 2.0]), np.zeros(3), start[9] + 2.0)
    held = []
    for block in range(100):
        pilot.rows(-pilot.warm_up + 10 * block, 10, far)
        held.append(pilot._stick_input.copy())
    assert np.abs(np.diff(held, axis=0)).max() <= 3.0 * 10 * STEP_S + 1e-12
    assert np.abs(held).max() > 0.9
