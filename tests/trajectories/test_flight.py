import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.trajectories.scene import BOX, DECK, WALL
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.along import FacadeRaster, UndersidePass
from uavbench.trajectories.paths.around import Approach, FigureEight, Hover, Orbit
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import quaternion_from_rotation, rotation_from_quaternion
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.simulation.flight import Flight, FlightSpec, fly
from uavbench.trajectories.vehicle.airframes import Crazyflie
from uavbench.trajectories.vehicle.geometric_control import Geometric
from uavbench.trajectories.vehicle.quadrotor import STEP_NS, STEP_S
from uavbench.trajectories.wind.winds import Dryden, Steady

FIELDS = [name for name in Flight.__dataclass_fields__ if name not in ("status", "crashed_ns")]
SHORT = FlightSpec(path=HandPilot(duration_s=4.0), wind=Dryden())


def digest(flight: Flight) -> str:
    return hashlib.sha256(b"".join(getattr(flight, name).tobytes() for name in FIELDS)).hexdigest()


def test_the_same_seed_gives_the_same_bytes_in_every_process() -> None:
    program = "from tests.trajectories.test_flight import *\nprint(digest(fly(SHORT, Mount(pitch_deg=-10), BOX, 7)))"
    runs = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip()
        for _ in range(2)
    ]
    assert runs[0] == runs[1] == digest(fly(SHORT, Mount(pitch_deg=-10), BOX, 7))
    assert digest(fly(SHORT, Mount(pitch_deg=-10), BOX, 8)) != runs[0]


def test_options_of_one_stream_leave_the_others_alone() -> None:
    flight = fly(SHORT, Mount(), BOX, 0)
    still = replace(SHORT, saturation_share=0.06)
    assert digest(fly(still, Mount(), BOX, 0)) == digest(flight)
    heavier = fly(replace(SHORT, airframe=Crazyflie(mass_kg=0.030)), Mount(), BOX, 0)
    assert digest(heavier) != digest(flight)
    np.testing.assert_array_equal(heavier.winds_m_s, flight.winds_m_s)


def test_stamps_are_whole_steps() -> None:
    flight = fly(SHORT, Mount(), BOX, 0)
    assert flight.stamps_ns.tolist() == [STEP_NS * k for k in range(2001)]


def test_a_longer_flight_begins_as_the_shorter_one() -> None:
    for path, longer in (
        (HandPilot(duration_s=3.0), HandPilot(duration_s=5.0)),
        (Hover(duration_s=3.0), Hover(duration_s=5.0)),
    ):
        short, long = (fly(FlightSpec(path=p, wind=Dryden()), Mount(), BOX, 2) for p in (path, longer))
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(short, name), getattr(long, name)[:1501], err_msg=name)
        few, many = (measure((Imu(), FlowDeck(), Barometer(), Gnss()), flight, BOX, 2) for flight in (short, long))
        for name, table in few.items():
            np.testing.assert_array_equal(table.values, many[name].values[: len(table.values)], err_msg=name)


def test_the_physics_need_no_graphics_whatever_the_environment_says() -> None:
    program = (
        "import os\n"
        "from uavbench.trajectories.vehicle.quadrotor import physics\n"
        "physics().MjModel.from_xml_string('<mujoco/>')\n"
        "import sys\n"
        "assert not [m for m in sys.modules if m.startswith(('OpenGL', 'pyrender', 'glfw'))]\n"
        "print(os.environ['MUJOCO_GL'])"
    )
    told = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "MUJOCO_GL": "egl"},
    )
    assert told.stdout.strip() == "egl"


def test_the_record_is_consistent_with_itself() -> None:
    """Each recorded rate is the derivative of what it is the rate of."""
    flight = fly(FlightSpec(path=FigureEight(loops=1), wind=Steady()), Mount(), BOX, 0)

    def rate(values: np.ndarray) -> np.ndarray:
        return (values[2:] - values[:-2]) / (2 * STEP_S)

    np.testing.assert_allclose(rate(flight.positions_m), flight.velocities_m_s[1:-1], atol=2e-4)
    np.testing.assert_allclose(rate(flight.velocities_m_s), flight.accelerations_m_s2[1:-1], atol=2e-2)
    np.testing.assert_allclose(
        rate(flight.angular_velocities_rad_s), flight.angular_accelerations_rad_s2[1:-1], atol=0.5
    )
    R = rotation_from_quaternion(flight.quaternions_wxyz)
    turn = quaternion_from_rotation(np.swapaxes(R[:-2], 1, 2) @ R[2:])[:, 1:] / STEP_S
    np.testing.assert_allclose(turn, flight.angular_velocities_rad_s[1:-1], atol=2e-3)
    followed = (flight.thrust_commands_n - flight.thrusts_n)[1:-1] / Crazyflie().motor_time_constant_s
    np.testing.assert_allclose(rate(flight.thrusts_n), followed, atol=0.1)
    assert not any(getattr(flight, name).flags.writeable for name in FIELDS)


def error_m(spec: FlightSpec, flight: Flight) -> np.ndarray:
    plan = spec.path.plan(BOX, Mount(), np.random.default_rng(0))
    return np.linalg.norm(flight.positions_m - plan.rows(0, len(flight), None)[:, :3], axis=1)


def test_a_six_second_figure_eight_is_tracked_to_two_centimetres() -> None:
    spec = FlightSpec(path=FigureEight(period_s=6.0))
    error = error_m(spec, fly(spec, Mount(), BOX, 0))
    assert np.sqrt((error**2).mean()) < 0.02
    assert np.ptp(spec.path.plan(BOX, Mount(), np.random.default_rng(0)).rows(0, 10000, None)[:, 0]) > 1.0


@pytest.mark.parametrize("wind", [Steady(speed_m_s=0.0), Steady(speed_m_s=3.0)])
def test_a_hover_holds_to_a_centimetre_from_the_first_row_on(wind: Steady) -> None:
    spec = FlightSpec(path=Hover(duration_s=5.0), wind=wind)
    assert error_m(spec, fly(spec, Mount(), BOX, 0)).max() < 0.01


def test_feed_forward_is_worth_having() -> None:
    spec = FlightSpec(path=FigureEight(period_s=6.0, loops=1))
    plan = spec.path.plan(BOX, Mount(), np.random.default_rng(0))
    with_it = error_m(spec, fly(spec, Mount(), BOX, 0))

    class Blunt(FigureEight):
        def plan(self, *args: object) -> object:  # type: ignore[override]
            table = plan.table.copy()
            table[:, 6:9] = table[:, 10:] = 0.0
            return replace(plan, table=table)

    without = error_m(spec, fly(replace(spec, path=Blunt()), Mount(), BOX, 0))
    assert without.max() > 5 * with_it.max()


@pytest.mark.parametrize(
    ("spec", "obstacles", "mount", "told"),
    [
        (FlightSpec(path=FigureEight(period_s=1.5)), BOX, Mount(), r"figure-eight: t = .*unreachable speed: .* m/s"),
        (
            FlightSpec(path=Orbit(distance_m=0.05, height_m=0.2)),
            BOX,
            Mount(),
            r"orbit: t = .*to the structure, less",
        ),
        (FlightSpec(path=Hover(height_m=0.1)), BOX, Mount(), r"hover: t = 0.00 s.*to the floor, less than clearance_m"),
        (FlightSpec(path=UndersidePass(height_m=5.3)), DECK, Mount(), r"underside-pass: .*to the structure"),
        (FlightSpec(path=Hover(), wind=Steady(speed_m_s=60.0)), BOX, Mount(), "unreachable speed: 0.00 m/s"),
        (
            FlightSpec(path=Hover(distance_m=0.5)),
            BOX,
            Mount(offset_m=(0.8, 0, -0.3)),
            "camera is inside the structure",
        ),
        (FlightSpec(path=Hover(), airframe=Crazyflie(max_thrust_n=0.06)), BOX, Mount(), "its weight is 0.2648 N"),
        (FlightSpec(path=Approach(near_m=2.0, far_m=1.0)), BOX, Mount(), "near_m 2.0 must be less than far_m"),
        (FlightSpec(path=UndersidePass(stretch_m=(2.0, -2.0))), DECK, Mount(), "must be increasing"),
        (FlightSpec(path=UndersidePass(overrun_m=-7.0)), DECK, Mount(), "leaves no path"),
        (FlightSpec(path=FacadeRaster(margin_m=5.0)), WALL, Mount(), "leave no lane"),
        (FlightSpec(path=HandPilot(range_m=(0.1, 1.0))), BOX, Mount(), "hand-pilot: range_m"),
        (FlightSpec(path=HandPilot(height_m=(1.5, 2.0))), BOX, Mount(), "does not fit into 21.0 degrees"),
    ],
)
def test_flights_that_cannot_be_are_refused_by_name(
    spec: FlightSpec, obstacles: object, mount: Mount, told: str
) -> None:
    with pytest.raises(UserError, match=told):
        fly(spec, mount, obstacles, 0)  # type: ignore[arg-type]


def test_saturated_motors_are_told_with_their_share() -> None:
    stiff = Crazyflie(min_thrust_n=0.0655)  # hovers at 0.0662 N
    with pytest.raises(UserError, match=r"motors saturated [0-9.]+% of the time, more than saturation_share = 0.05"):
        fly(FlightSpec(path=Hover(), airframe=stiff, wind=Dryden(w20_m_s=4.0)), Mount(), BOX, 0)


def test_a_crash_of_a_vehicle_out_of_control_is_not_blamed_on_its_path() -> None:
    sluggish = Crazyflie(motor_time_constant_s=1.0)
    told = r"path orbit: t = .*: crash into the floor, [0-9.]+ m from its planned place; .*check the airframe \(lag"
    with pytest.raises(UserError, match=told):
        fly(FlightSpec(path=Orbit(), airframe=sluggish), Mount(), BOX, 0)


def test_a_crash_is_an_error_or_where_asked_the_end_of_the_record() -> None:
    lame = Geometric(position_1_s2=0.01, velocity_1_s=0.01, integral_1_s3=0.0, integral_limit_m_s2=0.01)
    spec = FlightSpec(path=Hover(from_deg=90.0, distance_m=6.0, height_m=0.2), control=lame)
    blown = replace(spec, wind=Steady(speed_m_s=2.0, from_deg=90.0))
    with pytest.raises(
        UserError, match=r"path hover: t = .* s, at .* m: crash into the structure, 6\.0. m from its pl"
    ):
        fly(blown, Mount(), BOX, 0)
    flight = fly(replace(blown, on_crash="record"), Mount(), BOX, 0)
    assert flight.status == "crashed" and flight.crashed_ns == flight.stamps_ns[-1] < 20_000_000_000
    assert BOX.distance(flight.positions_m[-1:])[0] < 0.07 <= BOX.distance(flight.positions_m[-2:-1])[0]
    assert fly(spec, Mount(), BOX, 0).status == "completed"
