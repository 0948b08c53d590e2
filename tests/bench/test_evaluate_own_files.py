"""Every trajectory that uavbench writes is an input of `uavbench evaluate`, in its own frame."""

import json
import shutil
from itertools import product

import numpy as np
import pytest
from click.testing import CliRunner
from evo.tools import file_interface

from tests.hand_made import hand_made
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.tasks import Render, Track
from uavbench.reports.evaluation.find_trajectory import find_trajectory
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import export
from uavbench.tracker.baselines.hold import Hold

SUITE = """
title = "Few"
rates_hz = [15.0]
[sequences.few]
structure = { kind = "box" }
environment = { kind = "studio" }
mount = { pitch_deg = -20.0, offset_m = [0.1, 0.0, 0.02] }
flight.path = { kind = "hand-pilot", duration_s = 0.8 }
camera = { width = 64, height = 48, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""
BODIES = (
    "sequence",
    "sequence/groundtruth.csv",
    "sequence/flight.csv",
    "results/groundtruth_world_from_body.tum",
    "euroc",
    "euroc/mav0",
    "euroc/mav0/state_groundtruth_estimate0",
    "euroc/mav0/state_groundtruth_estimate0/data.csv",
    "mcap/bag.mcap:/odom",
    "rosbag2",
)
CAMERAS = ("tum", "tum/groundtruth.txt", "kitti", "kitti/poses.txt", "mcap/bag.mcap:/tf:world.camera_optical_frame")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    (folder / "few.toml").write_text(SUITE)
    (spec,) = load_suite(folder / "few.toml").sequences
    Render(spec, folder / "sequence")("abc", lambda done, total: None)
    Track("hold", Hold(), 15.0, 0, folder / "sequence", folder / "results")("def", lambda done, total: None)
    for format in ("euroc", "tum", "kitti", "bop", "mcap", "rosbag2"):
        export(Sequence.load(folder / "sequence"), format, folder / format)
    return folder


def evaluated(*arguments):
    done = CliRunner().invoke(main, ["evaluate", *map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def refused(*arguments):
    done = CliRunner().invoke(main, ["evaluate", *map(str, arguments)])
    assert done.exit_code == 2, done.output
    return done.output


@pytest.mark.parametrize("same", [BODIES, CAMERAS], ids=["body", "camera"])
def test_files_of_one_frame_agree_whatever_their_form(made, same):
    for reference, estimate in product(same, same):
        found = evaluated(made / reference, made / estimate)
        # Rows of flight.csv lie up to 5 ms beside the images: 3 mm and 0.5 degrees of this flight.
        near = "flight.csv" in reference + estimate
        assert found["ate"]["translation_m"]["max"] < (3e-3 if near else 1e-9), (reference, estimate)
        assert found["ate"]["rotation_deg"]["max"] < (0.5 if near else 1e-5)
        assert found["record"]["reference"]["frame"] == found["record"]["estimate"]["frame"]
        assert found["ate"]["translation_m"]["n"] >= 12


@pytest.mark.parametrize(
    ("reference", "estimate"), [*product(BODIES[::3], CAMERAS), *product(CAMERAS[1::2], BODIES[::3])]
)
def test_two_frames_are_refused_and_converted_by_the_mount(made, reference, estimate):
    told = refused(made / reference, made / estimate)
    assert "world_from_body" in told and "world_from_cam" in told and "--mount SEQUENCE" in told
    for mount in (made / "sequence", made / "results"):
        found = evaluated(made / reference, made / estimate, "--mount", mount)
        assert found["ate"]["translation_m"]["max"] < 1e-9
        assert found["ate"]["rotation_deg"]["max"] < 1e-5


def test_results_say_their_frame_and_have_their_ground_truth_beside(made):
    names = {path.name for path in (made / "results").glob("*.tum")}
    assert names == {"estimate_world_from_body.tum", "groundtruth_world_from_body.tum"}
    ground_truth, estimate = (made / "results" / f"{kind}_world_from_body.tum" for kind in ("groundtruth", "estimate"))
    for path in (ground_truth, estimate):
        assert path.read_text().startswith("# frame: world_from_body\n")
        assert len(file_interface.read_tum_trajectory_file(str(path)).timestamps) == 13
    by_file = evaluated(ground_truth, estimate)
    for pair in ((made / "sequence", made / "results"), (made / "euroc", estimate)):
        assert evaluated(*pair)["ate"] == by_file["ate"]
    assert by_file["ate"]["translation_m"]["max"] > 1e-3  # hold stands still
    cameras = evaluated(made / "tum", made / "results" / "frames.csv")
    assert cameras["record"]["estimate"]["frame"] == "world_from_cam"
    assert cameras["ate"]["rotation_deg"]["max"] == pytest.approx(by_file["ate"]["rotation_deg"]["max"], abs=1e-6)


def test_a_file_that_says_no_frame_is_compared_and_told(made, tmp_path):
    text = (made / "tum" / "groundtruth.txt").read_text().splitlines()
    (tmp_path / "plain.txt").write_text("\n".join(line for line in text if not line.startswith("#")) + "\n")
    done = CliRunner().invoke(main, ["evaluate", str(made / "tum"), str(tmp_path / "plain.txt")])
    assert done.exit_code == 0
    assert "plain.txt: tum, 13 poses, frame not said" in done.output


def test_kitti_poses_without_times_are_paired_by_row(made, tmp_path):
    shutil.copy(made / "kitti" / "poses.txt", tmp_path / "poses.txt")
    assert evaluated(made / "tum", tmp_path / "poses.txt")["ate"]["translation_m"]["n"] == 13
    (tmp_path / "times.txt").write_text("0.0\n1.0\n")
    assert "has 2 times for the 13 poses" in refused(made / "tum", tmp_path / "poses.txt")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("sequence/imu.csv", "holds no poses"),
        ("sequence/frames.csv", "holds no poses"),
        ("sequence/edges.csv", "is neither tum"),
        ("sequence/model.obj", ""),
        ("sequence/sequence.json", ""),
        ("bop", "holds no trajectory of a known name"),
        ("bop/test/000001/scene_gt.json", ""),
        ("sequence/frames", "holds no trajectory of a known name"),
        ("nowhere", "no such file"),
    ],
)
def test_what_holds_no_trajectory_is_told(made, name, told):
    assert told in refused(made / "sequence", made / name)
    assert "Traceback" not in refused(made / name, made / "sequence")


@pytest.mark.parametrize("name", ["rosbag2", "rosbag2/bag", "rosbag2/bag/bag.db3:/odom", "mcap", "mcap/bag.mcap:/odom"])
def test_a_bag_is_read_in_a_folder_of_any_name(made, tmp_path, name):
    odd = tmp_path / "run #1 100%25 ?mode=memory"
    for format in ("rosbag2", "mcap"):
        shutil.copytree(made / format, odd / format)
    assert evaluated(made / "sequence", odd / name)["ate"]["translation_m"]["max"] < 1e-9


def test_times_of_kitti_poses_are_read_to_the_last_digit(made, tmp_path):
    shutil.copytree(made / "kitti", tmp_path / "kitti")
    path = tmp_path / "kitti" / "times.txt"
    times = path.read_text().split()
    path.write_text("# s\n" + "".join(f"{1403636579 + int(t.split('.')[0])}.{t.split('.')[1]}\n" for t in times))
    stamps = find_trajectory(tmp_path / "kitti").trajectory.stamps_ns
    assert (stamps - 1403636579 * 10**9).tolist() == [int(t.replace(".", "")) for t in times]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda t: ["nan", *t[1:]], "line 1: 'nan' is not a time stamp"),
        (lambda t: ["inf", *t[1:]], "line 1: the time stamp 'inf' does not fit"),
        (lambda t: [*t[:-1], "1e300"], "the time stamp '1e300' does not fit"),
        (lambda t: [t[0], t[0], *t[2:]], "line 2: its time is not later than the previous one"),
        (lambda t: t[::-1], "line 2: its time is not later"),
        (lambda t: [f"{n} 0" for n in t], "line 1 has 2 values, expected 1"),
        (lambda t: t[1:], "times for the"),
        (lambda t: [n.replace(".", "") + "000000000" for n in reversed(t)], "is it in the unit of its format"),
    ],
)
def test_bad_times_of_kitti_poses_are_told_by_their_line(made, tmp_path, change, told):
    shutil.copytree(made / "kitti", tmp_path / "kitti")
    path = tmp_path / "kitti" / "times.txt"
    path.write_text("\n".join(change(path.read_text().split())) + "\n")
    assert told in refused(made / "sequence", tmp_path / "kitti")
    assert str(path) in refused(made / "sequence", tmp_path / "kitti")


def test_a_bad_row_of_a_table_is_told_by_its_line(made, tmp_path):
    head, *rows = (made / "sequence" / "groundtruth.csv").read_text().splitlines()
    path = tmp_path / "groundtruth.csv"
    path.write_text("\n".join([head, *rows[:3], "", "# twice:", *rows[2:]]) + "\n")
    assert f"{path}: line 7: stamp is not later than the previous one" in refused(made / "sequence", path)
    cells = rows[3].split(",")
    path.write_text("\n".join([head, *rows[:3], "", ",".join([*cells[:2], "nan", *cells[3:]])]) + "\n")
    assert f"{path}: line 6: position is not finite" in refused(made / "sequence", path)


def test_a_damaged_own_file_is_told(made, tmp_path):
    lines = (made / "sequence" / "groundtruth.csv").read_text().splitlines()
    for change in (["x", *lines[1:]], [lines[0], lines[2], lines[1]], [lines[0], lines[1].replace(",", ",nan,", 1)]):
        (tmp_path / "groundtruth.csv").write_text("\n".join(change) + "\n")
        assert "groundtruth.csv" in refused(made / "sequence", tmp_path / "groundtruth.csv")
    hand_made(shutil.copytree(made / "results", tmp_path / "results"))
    path = tmp_path / "results" / "frames.csv"
    path.write_text(path.read_text().replace(",ok,", ",lost,"))
    assert "no frame has the status ok" in refused(made / "sequence", path)


def test_truth_at_100_hz_and_at_the_images_is_one(made):
    flown = evaluated(made / "sequence" / "flight.csv", made / "euroc")
    assert flown["record"]["pairs"] == len((made / "sequence" / "flight.csv").read_text().splitlines()) - 1
    assert np.isfinite(flown["ate"]["translation_m"]["rmse"])
