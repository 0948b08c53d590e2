"""Words, heads and limits of the exports: what they tell, what they refuse, and the rows that name columns."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from tests.reports.drawn import CAM_FROM_BODY, make_sequence
from tests.scenes.test_exports import IMU, PINHOLE, bop, rewrite
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.euroc import yaml_number
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

FLIGHT = "stamp_ns,px_m,py_m,pz_m,qw,qx,qy,qz,vx_m_s,vy_m_s,vz_m_s\n0,0,0,1,1,0,0,0,0,0,0\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("notes") / "made"
    sequence = make_sequence(folder, 2)
    (folder / "imu.csv").write_text(IMU)
    (folder / "flight.csv").write_text(FLIGHT)
    return sequence


def told(sequence: Sequence, folder: Path, format: str = "tum", **info: object) -> str:
    """What an export does not hold, of the sequence with other words in its `sequence.json`."""
    copy = folder / f"copy-{len(list(folder.iterdir()))}"
    shutil.copytree(sequence.folder, copy)
    changed = rewrite(Sequence.load(copy), **info)
    said = export(changed, format, copy.with_name(copy.name + "-out"))
    notes = json.loads((copy.with_name(copy.name + "-out") / "export.json").read_text())["not_held"]
    assert list(said) == notes
    return "\n".join(said)


@pytest.mark.parametrize("format", EXPORTS)
def test_what_a_camera_says_of_its_images_and_no_format_holds_is_told(
    made: Sequence, tmp_path: Path, format: str
) -> None:
    """Of own images the camera alone tells of a shutter: without a time of each row nothing else of it is known."""
    folder = tmp_path / "own"
    shutil.copytree(made.folder, folder)
    (folder / "flight.csv").unlink()
    plain = "\n".join(export(Sequence.load(folder), format, tmp_path / "plain"))
    assert not any(word in plain for word in ("Rolling shutter", "Response", "Masked pixels"))
    (folder / "camera.toml").unlink()
    corner = ((0.0, 0.0), (40.0, 0.0), (0.0, 30.0))
    replace(made.camera, readout_ms=-23.9, response=2.2, masked=(corner, corner)).save(folder / "camera.toml")
    said = "\n".join(export(Sequence.load(folder), format, tmp_path / "exported"))
    assert "rows are exposed 100000 ns apart, the last one first; stamps and poses are those of the middle row." in said
    assert "the images follow light by `response = 2.2`" in said
    assert "Masked pixels: 2 polygons in which the images show no scene" in said


def test_each_limit_is_told_where_it_is_there_and_only_there(made: Sequence, tmp_path: Path) -> None:
    plain = told(made, tmp_path)
    assert "Flight: accelerations, angular rates, thrusts and wind of `flight.csv` are not included." in plain
    for info, sentence in (
        ({"timeshift_cam_imu_ns": 3_000_000}, "Clock: t_imu = t_cam + 0.003 s"),
        ({"row_delay_ns": 1234.0}, "Rolling shutter: rows are exposed 1234 ns apart"),
        ({"deviation": {"scale": 0.0, "bend_m": 0.1}}, "Model: the images show the structure as built"),
        (
            {"config": {"effects": [{"kind": "lateral-colour", "red_px": 0.5, "blue_px": -0.25}]}},
            "Lens: red and blue are displaced outwards from green, by 0.5 and -0.25 px at the corner",
        ),
        ({"config": {"effects": [{"kind": "analog-link"}]}}, "Link: scan lines are shifted by the analog link"),
        (
            {"config": {"effects": [{"kind": "drops", "repeated": 0.25}]}, "rate_hz": 60.0},
            "Link: 3 frames were lost, so stamps have gaps; a repeated frame shows the image before with a new stamp "
            "(probability 0.25)",
        ),
        (
            {"config": {"effects": [{"kind": "drops"}]}, "rate_hz": 15.0},
            "Link: 0 frames were lost, so stamps have gaps; a repeated frame shows the image before with a new stamp "
            "(probability 0)",
        ),
    ):  # fmt: skip
        assert sentence not in plain
        assert sentence in told(made, tmp_path, **info)
    for info in ({"deviation": None}, {"deviation": {"scale": 0.0}}, {"config": None}, {"config": {"effects": None}}):
        assert told(made, tmp_path, **info) == plain


def test_sensors_that_are_none_are_refused(made: Sequence, tmp_path: Path) -> None:
    said = told(made, tmp_path, sensors={"imu.csv": {"kind": "imu"}})
    assert "Sensor readings: `imu.csv` (imu) is not included." in said
    assert "Sensor readings: `imu.csv` (own) is not included." in told(made, tmp_path, sensors={"imu.csv": {}})
    for bad in ([], {"imu.csv": 3}, {"../imu.csv": {}}):
        with pytest.raises(UserError):
            told(made, tmp_path, sensors=bad)


def test_what_cannot_be_exported_is_named_and_nothing_is_left(made: Sequence, tmp_path: Path) -> None:
    drops = {"config": {"effects": [{"kind": "drops"}]}, "rate_hz": "soon"}
    broken = replace(made, info={**made.info, **drops})
    with pytest.raises(UserError, match=r"has data that cannot be exported: .*; copy the folder again, or"):
        export(broken, "tum", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_only_bags_have_settings(made: Sequence, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"images and datum are for bags \(mcap, rosbag2\); the format kitti has none"):
        export(made, "kitti", tmp_path / "out", images="raw", datum=None)


def test_an_export_without_anybody_to_tell_goes_on(made: Sequence, tmp_path: Path) -> None:
    export(made, "kitti", tmp_path / "out")
    about = (tmp_path / "out" / "export.json").read_text()
    assert about.startswith('{\n "format": "kitti",\n "sequence": "arc",') and about.endswith("}\n")
    assert json.loads(about)["undistorted"] is False and json.loads(about)["frames"] == {"poses.txt": "world_from_cam"}


# EuRoC


def test_heads_of_euroc_are_those_of_the_dataset(made: Sequence, tmp_path: Path) -> None:
    """As they stand in MH_01_easy (Burri et al. 2016)."""
    export(made, "euroc", tmp_path / "out")
    heads = {path.parent.name: path.read_text().splitlines()[0] for path in (tmp_path / "out").rglob("data.csv")}
    assert heads == {
        "cam0": "#timestamp [ns],filename",
        "imu0": "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
        "state_groundtruth_estimate0": "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], "
        "q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], "
        "b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], "
        "b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]",
    }


@pytest.mark.parametrize("value", [1e-5, 1.5e-5, 1e22, -2e-7, 0.0, 3, 0.25, 123456.789])
def test_numbers_of_yaml_are_numbers_to_its_readers(value: float) -> None:
    read = yaml.safe_load(f"a: {yaml_number(value)}")["a"]
    assert isinstance(read, float) and read == value


# BOP


def close_up(made: Sequence, folder: Path, x_m: float) -> Path:
    """BOP of a sequence whose first camera is before the face at x = 0.3 m, or away from it, looking along -x."""
    shutil.copytree(made.folder, folder / "close")
    looking = Pose(np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]), np.zeros(3))
    camera = Pose(looking.rotation, -looking.rotation @ [0.3 + x_m, 0.0, 0.25])
    world_from_body = made.true_cam_from_world(0).inverse() @ CAM_FROM_BODY
    close = rewrite(Sequence.load(folder / "close"), cam_from_body=(camera @ world_from_body).matrix.tolist())
    export(replace(close, camera=PINHOLE), "bop", folder / "out")
    return folder / "out"


@pytest.mark.parametrize(("x_m", "box"), [
    (0.05, [-320, -240, 960, 720]),  # the face is 0.2 m and 0.25 m to each side: beyond three images
    (0.2, [-69, -175, 460, 588]),  # 230 and 235 px of focal length: 161 +- 230, and 118.5 +- 293.75
])  # fmt: skip
def test_bop_counts_a_silhouette_as_far_as_three_images(made: Sequence, tmp_path: Path, x_m: float, box: list) -> None:
    (info,) = bop(close_up(made, tmp_path, x_m), "scene_gt_info")["0"]
    np.testing.assert_allclose(info["bbox_obj"], box, atol=1)
    assert info["px_count_all"] == pytest.approx(box[2] * box[3], rel=0.005)


@pytest.mark.parametrize(("share", "asked"), [(0.05, False), (0.095, False), (0.105, True), (0.19, True)])
def test_a_frame_is_a_target_of_bop_where_a_tenth_is_seen(
    made: Sequence, tmp_path: Path, share: float, asked: bool
) -> None:
    folder = tmp_path / "masked"
    shutil.copytree(made.folder, folder)
    export(replace(made, camera=PINHOLE), "bop", tmp_path / "whole")
    whole = cv2.imread(str(tmp_path / "whole/test/000001/mask/000000_000000.png"), cv2.IMREAD_GRAYSCALE) > 0
    (folder / "mask").mkdir()
    for frame in range(2):
        seen = whole & (np.cumsum(whole).reshape(whole.shape) <= share * whole.sum())
        cv2.imwrite(str(folder / "mask" / f"{frame:06d}.png"), seen.astype(np.uint8))
    export(replace(Sequence.load(folder), camera=PINHOLE), "bop", tmp_path / "out")
    (info,) = bop(tmp_path / "out", "scene_gt_info")["0"]
    assert info["visib_fract"] == pytest.approx(share, abs=0.002)
    targets = json.loads((tmp_path / "out" / "test_targets_bop19.json").read_text())
    expected = {"im_id": 0, "inst_count": 1, "obj_id": 1, "scene_id": 1}
    assert (expected in targets) == asked
