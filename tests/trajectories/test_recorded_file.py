"""A recorded flight in another unit, or whose quaternions have another order, is told and not flown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.wind.winds import Steady, Still

COUNT = 41
T = np.arange(COUNT) * 0.05
YAW = np.pi / 3 + 0.3 * np.sin(T)
POSITIONS = np.column_stack([2 + 0 * T, 0.2 * np.sin(T), 1 + 0 * T])
WXYZ = np.column_stack([np.cos(YAW / 2), 0 * T, 0 * T, np.sin(YAW / 2)])
XYZW = WXYZ[:, [1, 2, 3, 0]]


def lines(unit: float, quaternions: Array, *, between: str = " ", begin_s: float = 0.0) -> str:
    """The flight, its stamps in seconds with decimals, or as integers of the unit in parts of a second."""
    stamps = [repr(float(t)) if unit == 1 else str(round((begin_s + t) * unit)) for t in T]
    rows = zip(stamps, POSITIONS.tolist(), quaternions.tolist(), strict=True)
    return "".join(between.join([stamp, *map(repr, p), *map(repr, q)]) + "\n" for stamp, p, q in rows)


def planned(path: Path, text: str, **keys: str) -> Array:
    path.write_text(text)
    return Recorded(str(path), **keys).plan(BOX, Mount(), np.random.default_rng(0)).record  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (lines(1, XYZW), {}),
        (lines(1e9, WXYZ, between=",", begin_s=1.7e9), {}),
        (lines(1e9, WXYZ, between=","), {}),
        (lines(1e9, WXYZ), {"format": "euroc"}),
        ("# timestamp tx ty tz qw qx qy qz\n" + lines(1e9, WXYZ), {}),
    ],
    ids=["tum", "euroc", "euroc-from-0", "said", "named"],
)
def test_a_flight_in_the_units_of_its_format_is_flown(tmp_path: Path, text: str, keys: dict[str, str]) -> None:
    assert len(planned(tmp_path / "flight.txt", text, **keys)) == 1001


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            lines(1, WXYZ),
            "the vehicle is tilted by 106 degrees .median.; quaternions are w last in tum, w first in euroc",
        ),
        (lines(1e9, XYZW, between=",", begin_s=1.7e9), "tilted by 7[0-9] degrees"),
        (lines(1e9, XYZW, begin_s=1.7e9), 'its stamps are nanoseconds, .* w first: set format = "euroc" if these are'),
        (lines(1e3, XYZW, begin_s=1.7e9), "its stamps are nanoseconds, .* else write the stamps in seconds"),
        (lines(1e6, WXYZ, between=",", begin_s=1.7e9), "would be 50,000 ns apart, their stamps read as nanoseconds"),
        (lines(1e3, WXYZ, between=",", begin_s=1.7e9), "would be 50 ns apart"),
        (lines(1e3, XYZW), "50.000 s without a pose after pose 0"),
    ],
    ids=["tum-w-first", "euroc-w-last", "tum-ns", "tum-ms", "euroc-us", "euroc-ms", "tum-ms-from-0"],
)
def test_another_unit_or_order_is_told(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(UserError, match=rf"flight\.txt: .*{told}"):
        planned(tmp_path / "flight.txt", text)


def test_poses_between_which_nothing_flies_are_told(tmp_path: Path) -> None:
    """An outlier of a tracking system, and positions in millimetres."""
    row = lines(1, XYZW).splitlines()
    row[20] = row[20].replace(" 1.0 ", " 21.0 ", 1)
    with pytest.raises(UserError, match=r"flight\.txt: from pose 19 to pose 20, .* 20 m in 0\.05 s, faster than any"):
        planned(tmp_path / "flight.txt", "\n".join(row))
    table = np.column_stack([T, 1000 * POSITIONS * [1, 60, 1], XYZW]).tolist()
    with pytest.raises(
        UserError, match=r"flight\.txt: from pose 0 to pose 1, .* faster than any vehicle; write metres"
    ):
        planned(tmp_path / "flight.txt", "\n".join(" ".join(map(repr, each)) for each in table))


def test_wind_that_moves_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "flight.tum").write_text(lines(1, XYZW))
    spec = FlightSpec(path=Recorded(str(tmp_path / "flight.tum")), wind=Steady(speed_m_s=3.0))
    with pytest.raises(UserError, match=r"path recorded: a recorded motion is replayed as it is.* leave out `wind`"):
        fly(spec, Mount(), BOX, 0)
    assert fly(replace(spec, wind=Still()), Mount(), BOX, 0).status == "completed"


@pytest.mark.parametrize("pitch_deg", [0.0, -45.0, -90.0])
def test_a_camera_may_look_anywhere_below_the_horizon(tmp_path: Path, pitch_deg: float) -> None:
    """Its poses may come without the mount, which is then level."""
    found = Mount(pitch_deg=pitch_deg).cam_from_body.inverse()
    poses = [Pose.from_quaternion(q, p) @ found for q, p in zip(WXYZ, POSITIONS, strict=True)]
    seen = np.array([pose.quaternion_wxyz for pose in poses])
    assert len(planned(tmp_path / "camera.txt", lines(1, seen[:, [1, 2, 3, 0]]), frame="camera")) == 1001


def test_a_camera_that_is_mounted_upside_down_is_flown_with_its_mount(tmp_path: Path) -> None:
    turned = Mount(pitch_deg=-20.0, roll_deg=180.0)
    poses = [Pose.from_quaternion(q, p) @ turned.cam_from_body.inverse() for q, p in zip(WXYZ, POSITIONS, strict=True)]
    text = lines(1, np.array([pose.quaternion_wxyz for pose in poses])[:, [1, 2, 3, 0]])
    with pytest.raises(UserError, match=r"tilted by .* give the mount of the camera, .* upside down roll_deg = 180$"):
        planned(tmp_path / "camera.txt", text, frame="camera")
    path = Recorded(str(tmp_path / "camera.txt"), frame="camera")
    assert len(path.plan(BOX, turned, np.random.default_rng(0)).record) == 1001
