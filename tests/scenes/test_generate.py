import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes.camera_path import camera_path, mounted_path
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import file_hash
from uavbench.scenes.effects.exposure import MotionBlur
from uavbench.scenes.effects.image_sensor import Noise
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.simulation.flight import Flight, FlightSpec

SPEC = SequenceSpec(
    name="small",
    seed=5,
    structure=Box(),
    environment=Indoor(),
    flight=FlightSpec(path=HandPilot(duration_s=0.3)),
    camera=CameraSpec(width=160, height=120, horizontal_fov_deg=65.0),
    effects=(Noise(), MotionBlur()),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sequences") / "small"
    generate(SPEC, path, content_hash="abc")
    return path


def test_a_sequence_opens_and_its_structure_is_in_the_picture(folder: Path) -> None:
    sequence = Sequence.load(folder)
    assert len(sequence) == 5
    assert sequence.content_hash == "abc"
    assert len(sequence.structure.edges) == 12
    for frame in range(len(sequence)):
        image = sequence.image(frame)
        pixels = sequence.camera.project(sequence.true_cam_from_world(frame).transform(sequence.structure.vertices))
        assert ((pixels > 0) & (pixels < [160, 120])).all()
        assert image.std() > 20


def test_the_manifest_names_every_file(folder: Path) -> None:
    named = json.loads((folder / "manifest.json").read_text())["sha256"]
    there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} - {"manifest.json"}
    assert set(named) == there
    assert all(file_hash(folder / name) == digest for name, digest in named.items())


def test_the_same_seed_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    generate(SPEC, tmp_path / "again", content_hash="abc")
    assert (tmp_path / "again" / "manifest.json").read_bytes() == (folder / "manifest.json").read_bytes()


def test_another_seed_gives_another_sequence(folder: Path, tmp_path: Path) -> None:
    generate(replace(SPEC, seed=6), tmp_path / "other", content_hash="abc")
    for name in ("groundtruth.csv", "frames/000000.png"):
        assert (tmp_path / "other" / name).read_bytes() != (folder / name).read_bytes()


def test_a_structure_out_of_the_first_view_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    away = replace(SPEC, mount=Mount(yaw_deg=180.0))
    with pytest.raises(UserError, match=r"sequence small: frame 0: the structure fills 0.00 %"):
        generate(away, tmp_path / "away", content_hash="abc")
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_pilot_comes_through(tmp_path: Path) -> None:
    near = replace(SPEC, flight=FlightSpec(path=HandPilot(range_m=(0.1, 0.2))))
    with pytest.raises(UserError, match="range_m"):
        generate(near, tmp_path / "near", content_hash="abc")


def test_between_two_rows_the_camera_moves_with_constant_twist() -> None:
    twist = np.array([0.2, -0.1, 0.05, 0.3, -0.2, 0.1])
    poses = [Pose.identity(), Pose.exp(twist)]
    zeros, rotors = np.zeros((2, 3)), np.zeros((2, 4))
    flight = Flight(
        np.array([0, 1000]),
        np.array([p.translation for p in poses]),
        np.array([p.quaternion_wxyz for p in poses]),
        zeros, zeros, zeros, zeros, rotors, rotors, zeros,
    )  # fmt: skip
    at = camera_path(flight, Pose.identity())
    for stamp in (-500, 0, 250, 1000, 1500):
        assert at(stamp).inverse().log() == pytest.approx(stamp / 1000 * twist, abs=1e-12)


class Growing:
    """A flight in progress along x, of which so many rows are flown."""

    def __init__(self, x_m: list[float]) -> None:
        self.x_m, self.rows = x_m, 2
        self.stamps_ns = 1000 * np.arange(len(x_m), dtype=np.int64)

    def __len__(self) -> int:
        return self.rows

    def pose(self, row: int) -> Pose:
        return Pose(np.eye(3), [self.x_m[row], 0.0, 0.0])


def test_a_pose_of_the_camera_is_computed_once_until_more_of_the_flight_is_flown() -> None:
    """A frame asks for it many times; beyond the last row it is another one as soon as there is a later row."""
    flight, asked = Growing([0.0, 1.0, 5.0]), list[int]()

    def mount(stamp_ns: int) -> Pose:
        asked.append(stamp_ns)
        return Pose.identity()

    at = mounted_path(flight, mount)
    assert [at(stamp).inverse().translation[0] for stamp in (1500, 1500, 500)] == [1.5, 1.5, 0.5]
    assert asked == [1500, 500]
    flight.rows = 3
    assert at(1500).inverse().translation[0] == 3.0


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.jpg").write_text("meow")
    with pytest.raises(UserError, match=r"photos: contains .*, which uavbench did not write"):
        generate(SPEC, tmp_path / "photos", content_hash="abc")
    assert (tmp_path / "photos" / "cat.jpg").read_text() == "meow"


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, image: object) -> None:
        Path("/dev/full").write_bytes(b"x")

    monkeypatch.setattr("uavbench.scenes.filming.frames.write_image", full)
    with pytest.raises(UserError, match=r"full: cannot be written: No space left on device"):
        generate(SPEC, tmp_path / "full", content_hash="abc")
    assert list(tmp_path.iterdir()) == []
