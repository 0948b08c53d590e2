from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.trajectories.scene import BOX, DECK, PIER, WALL, both
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.along import FacadeRaster, GirderFollow, UndersidePass, Waypoints
from uavbench.trajectories.paths.around import Approach, FigureEight, Hover, Orbit, PierSpiral
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.paths.reference import Planned
from uavbench.trajectories.paths.registry import PATHS, PathSpec
from uavbench.trajectories.paths.smooth_motion import fly_through, progress, stop_and_go
from uavbench.trajectories.paths.timing import requested_speed
from uavbench.trajectories.pose import rotation_from_quaternion
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.simulation.summary import flown_summary, planned_summary
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum
from uavbench.trajectories.vehicle.airframes import Iris
from uavbench.trajectories.vehicle.geometric_control import Geometric
from uavbench.trajectories.vehicle.quadrotor import STEP_S

BRIDGE = both(DECK, PIER)
PLANS = [
    (Orbit(), BOX, Mount()),
    (Orbit(direction="clockwise", turns=0.5, speed_m_s=2.0), BOX, Mount()),
    (PierSpiral(), PIER, Mount()),
    (Approach(cycles=2), BOX, Mount()),
    (Hover(), BOX, Mount()),
    (FigureEight(), BOX, Mount()),
    (FacadeRaster(margin_m=1.0, to_height_m=4.0), WALL, Mount()),
    (FacadeRaster(facade_deg=180.0), WALL, Mount()),
    (GirderFollow(distance_m=3.0, height_m=5.3), DECK, Mount()),
    (GirderFollow(distance_m=3.0, height_m=5.3, side="left", overrun_m=-1.0), DECK, Mount()),
    (UndersidePass(offsets_m=(0.0,), stretch_m=(-5.0, -2.0)), BRIDGE, Mount(pitch_deg=60.0)),
    (UndersidePass(offsets_m=(-3.0, 3.0)), BRIDGE, Mount(pitch_deg=60.0)),
]


def derivative(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.gradient(values, STEP_S, axis=0))


@settings(max_examples=40)
@given(
    total=st.floats(0.01, 20.0),
    speed=st.floats(0.2, 5.0),
    acceleration=st.floats(0.1, 8.0),
)
def test_progress_keeps_its_limits_and_rests_at_its_ends(total: float, speed: float, acceleration: float) -> None:
    way = progress(total, speed, acceleration)
    assert way[0] == 0.0 and way[-1] == pytest.approx(total, rel=1e-9)
    v = np.diff(way) / STEP_S
    assert v.min() >= -1e-9 and v.max() <= speed * (1 + 1e-6)
    assert np.abs(np.diff(v)).max() / STEP_S <= acceleration * (1 + 1e-3) + 1e-6
    assert v[0] < 0.05 * speed + acceleration * STEP_S


@settings(max_examples=25)
@given(data=st.data(), stop=st.booleans())
def test_ways_through_points_keep_their_limits(data: st.DataObject, stop: bool) -> None:
    place = st.tuples(*[st.floats(-5, 5)] * 3)
    points = np.array(data.draw(st.lists(place, min_size=2, max_size=6)))
    yaws = np.array(data.draw(st.lists(st.floats(-3, 3), min_size=len(points), max_size=len(points))))
    way, turn = (stop_and_go if stop else fly_through)(points, yaws, 1.0, 0.8, 1.0)
    v = derivative(way)
    assert np.linalg.norm(v, axis=1).max() <= 1.0 + 1e-6
    assert np.linalg.norm(derivative(v), axis=1).max() <= 0.8 * 1.01
    assert np.abs(derivative(turn)).max() <= 1.0 + 1e-6
    np.testing.assert_allclose(way[[0, -1]], points[[0, -1]], atol=1e-9)
    if stop:  # it visits every point, at rest
        for point in points:
            nearest = int(np.argmin(np.linalg.norm(way - point, axis=1)))
            assert np.linalg.norm(way[nearest] - point) < 1e-6 and np.linalg.norm(v[nearest]) < 1e-3


@pytest.mark.parametrize(("path", "obstacles", "mount"), PLANS, ids=lambda v: type(v).__name__)
def test_a_plan_is_smooth_starts_at_rest_and_keeps_its_limits(
    path: PathSpec, obstacles: ObstacleMesh, mount: Mount
) -> None:
    plan = path.plan(obstacles, mount, np.random.default_rng(0))
    assert isinstance(plan, Planned)
    t = plan.table
    assert np.isfinite(t).all()
    assert np.linalg.norm(t[0, 3:6]) < 1e-3 and np.linalg.norm(t[-1, 3:6]) < 1e-3
    assert np.abs(np.diff(t[:, 6:9], axis=0)).max() / STEP_S < 60.0  # jerk, m/s^3
    if hasattr(path, "speed_m_s"):
        assert np.linalg.norm(t[:, 3:6], axis=1).max() <= (requested_speed(path) or np.inf) * (1 + 1e-6)
        assert np.linalg.norm(t[:, 6:9], axis=1).max() <= path.acceleration_m_s2 * 1.01
    resting = plan.rows(-3, 5, None)
    np.testing.assert_array_equal(resting[:3, 0:3], np.tile(t[0, 0:3], (3, 1)))
    assert not resting[:3, 3:9].any() and not resting[:3, 10:].any()


PACED = [(path, obstacles) for path, obstacles, _ in PLANS if hasattr(path, "usual_speed_m_s")]


@pytest.mark.parametrize(("path", "obstacles"), PACED, ids=lambda v: type(v).__name__)
def test_a_path_takes_the_time_that_it_is_given(path: PathSpec, obstacles: ObstacleMesh) -> None:
    """Twice and 1.2 times what it takes at its usual speed, to the step, and as fast as that needs."""
    plain = replace(path, speed_m_s=None)  # type: ignore[type-var]
    usual = plain.plan(obstacles, Mount(), np.random.default_rng(0)).table
    for factor in (1.2, 2.0):
        duration = round(factor * (len(usual) - 1)) * STEP_S
        timed = replace(plain, duration_s=duration).plan(obstacles, Mount(), np.random.default_rng(0)).table
        assert len(timed) == round(duration / STEP_S) + 1
        np.testing.assert_allclose(timed[[0, -1], :3], usual[[0, -1], :3], atol=1e-6)
        speeds = np.linalg.norm(timed[:, 3:6], axis=1)
        assert speeds[-1] < 1e-3 and speeds.max() < np.linalg.norm(usual[:, 3:6], axis=1).max()
        assert np.flatnonzero(speeds > 1e-3)[-1] > 0.98 * len(timed)  # it does not hurry and wait
        assert np.linalg.norm(timed[:, 6:9], axis=1).max() <= path.acceleration_m_s2 * 1.01


@pytest.mark.parametrize(("path", "obstacles"), PACED, ids=lambda v: type(v).__name__)
def test_a_path_takes_a_duration_or_a_speed(path: PathSpec, obstacles: ObstacleMesh) -> None:
    both = replace(path, speed_m_s=0.4, duration_s=9.0)  # type: ignore[type-var]
    with pytest.raises(UserError, match="give duration_s or speed_m_s, not both"):
        both.plan(obstacles, Mount(), np.random.default_rng(0))
    hasty = replace(path, speed_m_s=None, duration_s=0.5)  # type: ignore[type-var]
    with pytest.raises(UserError, match=r"duration_s 0.5: .* m from rest to rest take .* s or more at") as told:
        hasty.plan(obstacles, Mount(), np.random.default_rng(0))
    least_s = float(str(told.value).split(" s or more")[0].split()[-1])
    fast_enough = replace(hasty, duration_s=least_s)  # type: ignore[type-var]
    assert isinstance(fast_enough.plan(obstacles, Mount(), np.random.default_rng(0)), Planned)
    asked = replace(path, speed_m_s=path.usual_speed_m_s)  # type: ignore[type-var]
    usual = replace(path, speed_m_s=None)  # type: ignore[type-var]
    tables = [each.plan(obstacles, Mount(), np.random.default_rng(0)).table for each in (asked, usual)]
    np.testing.assert_array_equal(*tables)


@pytest.mark.parametrize(
    ("path", "obstacles"),
    [
        (Hover(duration_s=1e9), BOX), (Hover(duration_s=1e300), BOX), (HandPilot(duration_s=1e9), BOX),
        (Orbit(duration_s=1e6), BOX), (Orbit(turns=1e9), BOX), (Orbit(speed_m_s=1e-9), BOX),
        (Orbit(acceleration_m_s2=1e-12), BOX), (Approach(cycles=10**9), BOX), (FigureEight(loops=10**12), BOX),
        (FigureEight(period_s=1e9), BOX), (PierSpiral(rise_m=1e-9), PIER), (FacadeRaster(lane_spacing_m=1e-9), WALL),
        (GirderFollow(duration_s=1e5), DECK),
    ],
    ids=repr,
)  # fmt: skip
def test_a_flight_without_end_is_refused_before_it_takes_memory(path: PathSpec, obstacles: ObstacleMesh) -> None:
    with pytest.raises(UserError, match=r"at most 10,000"):
        path.plan(obstacles, Mount(), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("path", "told"),
    [
        (UndersidePass(speed_m_s=1e9), r"speed_m_s 1e\+09 and acceleration_m_s2 0\.8, for .* m: the flight would take"),
        (
            UndersidePass(acceleration_m_s2=1e-9),
            r"speed_m_s 0\.8 and acceleration_m_s2 1e-09, for .* m: the flight would",
        ),
        (
            UndersidePass(duration_s=1e9),
            r"duration_s 1e\+09 and acceleration_m_s2 0\.8, for .* m: the flight would take",
        ),
        (UndersidePass(duration_s=1e-9), r"duration_s 1e-09: .* m from rest to rest take .* s or more at 0\.8 m/s\^2"),
    ],
    ids=repr,
)
def test_the_numbers_that_make_a_flight_too_long_are_named(path: PathSpec, told: str) -> None:
    with pytest.raises(UserError, match=told):
        path.plan(DECK, Mount(), np.random.default_rng(0))


def test_what_no_plan_takes_into_account_is_refused(tmp_path: Path) -> None:
    both = UndersidePass(stretch_m=(-2.0, 2.0), overrun_m=1.0)
    with pytest.raises(UserError, match="overrun_m 1 has no effect: stretch_m names both ends"):
        both.plan(DECK, Mount(), np.random.default_rng(0))
    with pytest.raises(UserError, match=r"path hand-pilot: flight\.clearance_m has no effect: this path is decided in"):
        fly(FlightSpec(clearance_m=0.3), Mount(), BOX, 0)
    stamps = np.arange(5, dtype=np.int64) * 10**8
    write_tum(Trajectory(stamps, np.tile([3.0, 0, 1], (5, 1)), np.tile([1.0, 0, 0, 0], (5, 1))), tmp_path / "a.tum")
    path = Recorded(file=str(tmp_path / "a.tum"))
    for key, value in (("clearance_m", 0.3), ("saturation_share", 0.5), ("control", Geometric(position_1_s2=5.0))):
        with pytest.raises(UserError, match=rf"path recorded: flight\.{key} has no effect: a recorded motion is"):
            fly(FlightSpec(path=path, **{key: value}), Mount(), BOX, 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("height_m", [1e9, 1e300])
def test_a_plan_that_leads_out_of_the_world_is_told(height_m: float) -> None:
    with pytest.raises(UserError, match=r"path hover: t = 0\.00 s, at .* m: the plan leads farther than 100000 m from"):
        fly(FlightSpec(path=Hover(height_m=height_m, duration_s=1.0)), Mount(), BOX, 0)


def test_waypoints_and_records_without_end_are_refused_too(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("x_m,y_m,z_m,yaw_deg\n-4,0,1,0\n-3,0,1,0\n-2,0,1,0\n")
    still = Waypoints(file=str(tmp_path / "way.csv"), stop=True, dwell_s=1e9)
    stamps = np.arange(10_002, dtype=np.int64) * 10**9
    write_tum(Trajectory(stamps, np.zeros((10_002, 3)), np.tile([1.0, 0, 0, 0], (10_002, 1))), tmp_path / "long.tum")
    for path in (still, Recorded(file=str(tmp_path / "long.tum"))):
        with pytest.raises(UserError, match=r"at most 10,000"):
            path.plan(BOX, Mount(), np.random.default_rng(0))


def test_what_a_path_does_not_reach_is_told() -> None:
    spec = FlightSpec(path=Orbit(speed_m_s=1.5))
    planned = planned_summary(spec, Mount(), BOX, 0)
    assert (planned.speed_asked_m_s, planned.duration_asked_s) == (1.5, None)
    table = Orbit(speed_m_s=1.5).plan(BOX, Mount(), np.random.default_rng(0)).table
    assert planned.duration_s == pytest.approx((len(table) - 1) * STEP_S)
    assert planned.speed_planned_m_s == pytest.approx(np.linalg.norm(table[:, 3:6], axis=1).max())
    assert "path orbit: at most 0.56 of the requested 1.5 m/s, 18" in planned.shortfall()
    assert planned_summary(FlightSpec(path=Orbit(speed_m_s=0.3)), Mount(), BOX, 0).shortfall() == ""
    flight = fly(spec, Mount(), BOX, 0)
    flown = flown_summary(spec, Mount(), BOX, 0, flight)
    assert flown.duration_s == pytest.approx(planned.duration_s)
    assert flown.speed_flown_m_s == pytest.approx(np.linalg.norm(flight.velocities_m_s, axis=1).max())
    assert flown.length_m == pytest.approx(2 * np.pi * 1.25, rel=0.02)
    timed = planned_summary(FlightSpec(path=Orbit(duration_s=30.0)), Mount(), BOX, 0)
    assert (timed.speed_asked_m_s, timed.duration_asked_s, timed.duration_s) == (None, 30.0, 30.0)


@pytest.mark.parametrize(("path", "obstacles", "mount"), PLANS, ids=lambda v: type(v).__name__)
def test_a_plan_keeps_the_structure_in_view(path: PathSpec, obstacles: ObstacleMesh, mount: Mount) -> None:
    """The ray through the middle of the image, or one at most 30 degrees from it, meets the structure."""
    plan = path.plan(obstacles, mount, np.random.default_rng(0))
    rows = plan.table[::100]  # type: ignore[union-attr]
    axis = mount.cam_from_body.rotation[2]
    seen = np.zeros(len(rows), dtype=bool)
    for i, row in enumerate(rows):
        c, s = np.cos(row[9]), np.sin(row[9])
        forward = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ axis
        side = np.cross(forward, [0, 0, 1])
        side /= np.linalg.norm(side)
        up = np.cross(side, forward)
        angles = np.radians(np.linspace(-30, 30, 25))
        aside, upwards = (each.reshape(-1, 1) for each in np.tan(np.meshgrid(angles, angles, indexing="ij")))
        rays = forward + aside * side + upwards * up
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        seen[i] = np.isfinite(obstacles.ray(np.tile(row[:3], (len(rays), 1)), rays)).any()
    assert seen.mean() > 0.95, f"in view {seen.mean():.0%} of the time"


def test_the_raster_covers_the_facade_and_the_spiral_its_pier() -> None:
    path = FacadeRaster(distance_m=2.0, lane_spacing_m=1.0, from_height_m=1.0)
    raster = path.plan(WALL, Mount(), np.random.default_rng(0))
    np.testing.assert_allclose(raster.table[:, 0], 2.25, atol=1e-9)
    assert (raster.table[:, 1].min(), raster.table[:, 1].max()) == pytest.approx((-4.0, 4.0))
    assert sorted(set(np.round(raster.table[np.abs(raster.table[:, 1]) < 1e-2, 2], 6))) == [1, 2, 3, 4, 5]
    spiral = PierSpiral(rise_m=1.0).plan(PIER, Mount(), np.random.default_rng(0))
    turns = np.ptp(np.unwrap(np.arctan2(spiral.table[:, 1], spiral.table[:, 0]))) / (2 * np.pi)
    assert turns == pytest.approx(5.0, rel=1e-6)


def test_every_path_flies_on_a_vehicle_of_its_size(tmp_path: Path) -> None:
    for path, obstacles, mount in PLANS:
        if obstacles is BOX:
            continue
        shorter = replace(path, speed_m_s=2.0, acceleration_m_s2=1.5)  # type: ignore[type-var]
        flight = fly(FlightSpec(path=shorter, airframe=Iris()), mount, obstacles, 0)
        assert flight.status == "completed"
        plan = shorter.plan(obstacles, mount, np.random.default_rng(0))
        error = np.linalg.norm(flight.positions_m - plan.table[:, :3], axis=1)
        assert np.sqrt((error**2).mean()) < 0.02


def test_waypoints_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("x_m,y_m,z_m,yaw_deg\n2,0,1,180\n2,2,1,-135\n0,2,1,-90\n")
    plan = Waypoints(str(file)).plan(BOX, Mount(), np.random.default_rng(0))
    np.testing.assert_allclose(plan.table[-1, [0, 1, 2]], [0, 2, 1], atol=1e-9)
    assert plan.table[-1, 9] == pytest.approx(np.radians(270.0))  # unwrapped: it turned the short way
    cut = Waypoints(str(file), stop=False).plan(BOX, Mount(), np.random.default_rng(0))
    assert len(cut.table) < len(plan.table)
    for text, told in (
        ("x_m,y_m,z_m\n", "missing columns yaw_deg"),
        ("x_m,y_m,z_m,yaw_deg\n1,2,3,4\n", "at least two waypoints"),
        ("x_m,y_m,z_m,yaw_deg\n1,2,3,4\n\n1,2,x,4\n", "line 4: z_m = 'x' is not a number"),
        (
            "x_m,y_m,z_m,yaw_deg\n1,2,3,4\n1,0,2,5,3,0,90,0\n",
            "line 3 has 8 values, not 4; write numbers with",
        ),
        ("x_m;y_m;z_m;yaw_deg\n1;2;3;4\n", "separated by semicolons"),
        ("x_m,y_m,z_m,yaw_deg\n1,2,3,4\n\n1,2,inf,4\n", "line 4 has a value that is not finite or beyond"),
    ):
        file.write_text(text)
        with pytest.raises(UserError, match=told):
            Waypoints(str(file)).plan(BOX, Mount(), np.random.default_rng(0))
    with pytest.raises(UserError, match="no such file"):
        Waypoints(str(tmp_path / "none.csv")).plan(BOX, Mount(), np.random.default_rng(0))


def test_a_recorded_trajectory_is_flown_as_given(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stamps = 5_000_000_123 + np.arange(40) * 100_000_000
    t = np.arange(40) / 10
    positions = np.column_stack([2 + np.sin(t), np.cos(t), 1 + 0.1 * t])
    half = 0.3 * np.sin(t) / 2
    quaternions = np.column_stack([np.cos(half), 0 * t, np.sin(half) * 0.6, np.sin(half) * 0.8])
    given = Trajectory(stamps, positions, quaternions)
    write_tum(given, tmp_path / "flight.tum")
    flight = fly(FlightSpec(path=Recorded(str(tmp_path / "flight.tum"))), Mount(), BOX, 0)
    rows = np.arange(40) * 50
    np.testing.assert_allclose(flight.positions_m[rows], positions, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(flight.quaternions_wxyz[rows]), given.rotations, atol=1e-12)
    inner = slice(50, -50)
    np.testing.assert_allclose(flight.velocities_m_s[inner], derivative(flight.positions_m)[inner], atol=1e-4)
    mount = Mount(pitch_deg=-30.0, offset_m=(0.05, 0.0, 0.01))
    filmed = Trajectory.from_poses(stamps.tolist(), [given.pose(k) @ mount.cam_from_body.inverse() for k in range(40)])
    write_tum(filmed, tmp_path / "filmed.tum")
    seen = fly(FlightSpec(path=Recorded(str(tmp_path / "filmed.tum"), frame="camera")), mount, BOX, 0)
    pose = (mount.cam_from_body @ seen.pose(50).inverse()).inverse()
    np.testing.assert_allclose(pose.matrix, filmed.pose(1).matrix, atol=1e-12)
    write_tum(given, tmp_path / "said.tum", "world_from_cam")
    with pytest.raises(UserError, match=r"said\.tum: declares world_from_cam, but frame = 'body'"):
        fly(FlightSpec(path=Recorded(str(tmp_path / "said.tum"))), Mount(), BOX, 0)
    gap = given.select(np.delete(np.arange(40), slice(10, 25)))
    write_tum(gap, tmp_path / "gap.tum")
    with pytest.raises(UserError, match=r"1\.600 s without a pose after pose 9"):
        fly(FlightSpec(path=Recorded(str(tmp_path / "gap.tum"))), Mount(), BOX, 0)
    inside = Trajectory(stamps, positions * 0 + [0, 0, 0.1] + 1e-3 * rng.standard_normal((40, 3)), quaternions)
    write_tum(inside, tmp_path / "inside.tum")
    with pytest.raises(UserError, match=r"path recorded: .*crash into the structure"):
        fly(FlightSpec(path=Recorded(str(tmp_path / "inside.tum"))), Mount(), BOX, 0)


def test_the_registry_holds_what_the_plans_test() -> None:
    tested = {type(path) for path, *_ in PLANS} | {Waypoints, Recorded}
    assert {kind for name, kind in PATHS.items() if name != "hand-pilot"} == tested
