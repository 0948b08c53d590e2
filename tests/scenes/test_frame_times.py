"""A flight with a constant twist: its ground truth is known at any time, so also at the stamps of frames."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import FORMAT, SAME_FRAMES_FROM, read_integers, read_numbers
from uavbench.scenes.dataset.verify import compare, write_manifest
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import BodyCamera, CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.studio import Studio
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.simulation.flight import FlightSpec
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

START = Pose(np.eye(3), np.array([-1.2, 0.0, 0.6]))
TWIST = np.array([0.05, 0.5, 0.1, 0.1, -0.2, 0.6])
"""Velocity in m/s and rates in rad/s, in the body."""
FLOWN_NS = 500_000_000
EXACT_M = 1e-8
"""Of the spline through the poses of the file, 200 a second; in 1 ms the vehicle flies 0.0005 m."""
MOUNT = Mount(pitch_deg=-20.0)
CAMERA = CameraSpec(width=96, height=72, horizontal_fov_deg=75.0)
IMU = Imu(rate_hz=1000.0, gyro_noise_rad_s_sqrt_hz=0.0, gyro_walk_rad_s2_sqrt_hz=0.0)


def true_pose(time_ns: float) -> Pose:
    """The pose world_from_body at a time."""
    return START @ Pose.exp(1e-9 * time_ns * TWIST)


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    file = tmp_path_factory.mktemp("flown") / "flown.tum"
    stamps = list(range(0, FLOWN_NS + 1, 5_000_000))
    write_tum(Trajectory.from_poses(stamps, [true_pose(t) for t in stamps]), file, "world_from_body")
    return SequenceSpec(
        name="helix",
        seed=0,
        structure=Box(),
        environment=Studio(),
        flight=FlightSpec(path=Recorded(str(file))),
        mount=MOUNT,
        camera=CAMERA,
        rate_hz=15.0,
        sensors=(IMU,),
        effects=(RollingShutter(readout_ms=20.0), MotionBlur(exposure_ms=8.0)),
        cameras=(BodyCamera(name="late", mount=MOUNT, camera=CAMERA, offset_s=0.0101),),
    )


def made(spec: SequenceSpec, folder: Path) -> Sequence:
    generate(spec, folder, content_hash="")
    return Sequence.load(folder)


@pytest.fixture(scope="module")
def sequence(spec: SequenceSpec, tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return made(spec, tmp_path_factory.mktemp("helix") / "helix")


def is_at(found: Array, time_ns: float) -> bool:
    """Whether a pose px py pz qw qx qy qz is that of the flight at a time."""
    true = true_pose(time_ns)
    aligned = found[3:7] * np.sign(found[3:7] @ true.quaternion_wxyz)
    return bool(np.abs(np.concatenate([found[:3] - true.translation, aligned - true.quaternion_wxyz])).max() < EXACT_M)


def test_the_ground_truth_of_a_frame_is_that_of_its_stamp(sequence: Sequence) -> None:
    assert sequence.stamps_ns[:4].tolist() == [0, 66_666_667, 133_333_333, 200_000_000]
    assert sequence.cameras["late"].stamps_ns[:3].tolist() == [10_100_000, 76_766_667, 143_433_333]
    for camera in (sequence, sequence.cameras["late"]):
        for stamp_ns, state in zip(camera.stamps_ns.tolist(), camera.ground_truth_table[:, 2:], strict=True):
            assert is_at(state[:7], stamp_ns), stamp_ns
            velocity = true_pose(stamp_ns).rotation @ TWIST[:3]
            assert state[7:13] == pytest.approx([*velocity, *TWIST[3:]], abs=1e-5)


def test_every_row_of_a_rolling_shutter_is_exposed_about_the_stamp(sequence: Sequence) -> None:
    rows = np.load(sequence.folder / "row_poses.npy")
    delay_ns, height = sequence.info["row_delay_ns"], CAMERA.height
    assert delay_ns == pytest.approx(20e6 / (height - 1))
    for stamp_ns, poses in zip(sequence.stamps_ns.tolist(), rows, strict=True):
        for row in (0, height - 1):
            late_ns = round((row - (height - 1) / 2) * delay_ns)
            if 0 <= stamp_ns + late_ns <= FLOWN_NS:
                assert is_at(poses[row], stamp_ns + late_ns), (stamp_ns, row)


def test_sensors_read_the_flight_at_their_own_stamps(sequence: Sequence) -> None:
    """A reading of a gyroscope stands at each of the frames that lie on a whole millisecond."""
    stamps = read_integers(sequence.folder / "imu.csv", ["stamp_ns"])[:, 0]
    assert stamps.tolist() == [1_000_000 * k for k in range(501)]
    columns = [f"{kind}{axis}_rad_s" for kind in ("w", "gyro_bias_") for axis in "xyz"]
    readings = read_numbers(sequence.folder / "imu.csv", columns)
    assert readings[:, :3] - readings[:, 3:] == pytest.approx(np.tile(TWIST[3:], (501, 1)), abs=1e-5)


def test_two_rates_have_the_same_frames_at_common_times(spec: SequenceSpec, sequence: Sequence, tmp_path: Path) -> None:
    twice = made(replace(spec, rate_hz=30.0, cameras=()), tmp_path / "twice")
    assert twice.stamps_ns[::2].tolist() == sequence.stamps_ns.tolist()
    np.testing.assert_array_equal(twice.ground_truth_table[::2, 2:], sequence.ground_truth_table[:, 2:])
    for frame in range(len(sequence)):
        assert twice.image_bytes(2 * frame) == sequence.image_bytes(frame)


def test_a_time_shift_moves_the_stamps_and_not_what_is_seen(
    spec: SequenceSpec, sequence: Sequence, tmp_path: Path
) -> None:
    clock = CameraClock(timeshift_cam_imu_s=-0.0015)
    early = made(replace(spec, clock=clock, cameras=(), sensors=()), tmp_path / "early")
    assert early.stamps_ns.tolist() == (sequence.stamps_ns + 1_500_000).tolist()
    assert early.image_bytes(1) == sequence.image_bytes(1)
    assert is_at(early.ground_truth_table[1, 2:9], sequence.stamps_ns[1])


# --- sequences of another format -----------------------------------------------------------------------------------


def of_format(number: object, sequence: Sequence, folder: Path) -> Path:
    """A copy that says to be of another format; of format 1 it says nothing."""
    shutil.copytree(sequence.folder, folder)
    info = json.loads((folder / "sequence.json").read_text())
    assert info.pop("format") == FORMAT
    (folder / "sequence.json").write_text(json.dumps(info if number == 1 else {"format": number, **info}))
    (folder / "manifest.json").unlink()
    write_manifest(folder)
    return folder


def test_an_older_sequence_says_why_its_bytes_differ(sequence: Sequence, tmp_path: Path) -> None:
    old = of_format(1, sequence, tmp_path / "old")
    assert len(Sequence.load(old)) == len(sequence)
    (problem,) = compare(old, sequence.folder).problems
    assert (
        problem.startswith(f"sequence.json: is of format 1, the other of format {FORMAT}")
        and "render it again" in problem
    )
    done = CliRunner().invoke(main, ["twin", str(old), "--out", str(tmp_path / "twin")])
    assert done.exit_code == 2 and f"is of format 1, not {FORMAT}" in done.output, done.output


def test_a_twin_is_made_of_an_older_sequence_whose_frames_are_rendered_alike(
    sequence: Sequence, tmp_path: Path
) -> None:
    """It is refused for the file of its path alone, which is asked for after the format."""
    for number, refused in ((SAME_FRAMES_FROM, "lies outside of"), (SAME_FRAMES_FROM - 1, "is of format")):
        old = of_format(number, sequence, tmp_path / str(number))
        done = CliRunner().invoke(main, ["twin", str(old), "--out", str(tmp_path / "twin")])
        assert done.exit_code == 2 and refused in done.output, done.output


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (FORMAT + 1, f"reads formats 1 to {FORMAT}; install a later one"),
        ("2", "format = '2': must be an integer"),
        (0, "format = 0"),
    ],
)
def test_a_format_that_is_not_known_is_refused(sequence: Sequence, tmp_path: Path, number: object, told: str) -> None:
    with pytest.raises(UserError, match=told):
        Sequence.load(of_format(number, sequence, tmp_path / "other"))
