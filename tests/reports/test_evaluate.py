"""`evaluate_files`: any two trajectory files, every mode, and the mistakes it refuses."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.evaluation.evaluation import evaluate
from uavbench.reports.evaluation.options import MODES, Options
from uavbench.reports.metrics.rpe import PairInterval
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_euroc, write_kitti, write_tum

GOLDEN = Path(__file__).parents[1] / "golden" / "evo"
REFERENCE, ESTIMATE = GOLDEN / "A_orbit_gt.tum", GOLDEN / "A_orbit_est.tum"


def expected(kind: str, **wanted: object) -> dict:
    rows = json.loads((GOLDEN / "expected.json").read_text())["pairs"]["A_orbit"][kind]
    return next(row for row in rows if all(row[k] == v for k, v in wanted.items()))


def circle(n: int = 50, offset_m: float = 0.0) -> Trajectory:
    turn = np.linspace(0, 2, n)
    poses = [
        Pose.from_quaternion([np.cos(a / 2), 0, 0, np.sin(a / 2)], [np.cos(a) + offset_m, np.sin(a), 0]) for a in turn
    ]
    return Trajectory.from_poses((np.arange(n) * 100_000_000).tolist(), poses)


def lines(*rows: str) -> str:
    return "\n".join(rows) + "\n"


GOOD = [f"{t} {t} 0 {t * t} 0 0 0 1" for t in range(5)]


@pytest.mark.parametrize("align", ["none", "se3", "sim3"])
def test_mode_evo_equals_evo(align: str) -> None:
    found = evaluate_files(REFERENCE, ESTIMATE, mode="evo", align=align).to_json()
    for relation, key in (("translation_part", "translation_m"), ("rotation_angle_deg", "rotation_deg")):
        ape = expected("ape", sync="nearest_time", align=align, relation=relation)
        rpe = expected(
            "rpe", align=align, relation=relation, delta=1, unit="frames", all_pairs=False, pairs_from_reference=False
        )
        for name, value in ape["stats"].items():
            assert found["ate"][key][name] == pytest.approx(value, rel=1e-9)
        for name, value in rpe["stats"].items():
            assert found["rpe"][key][name] == pytest.approx(value, rel=1e-9)
    assert found["ate"]["translation_m"]["n"] == ape["n"]
    assert found["coverage"] == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize(("unit", "delta"), [("m", 1.0), ("deg", 10.0), ("rad", 0.5), ("frames", 10)])
def test_options_choose_the_stretch(unit: str, delta: float) -> None:
    names = {"m": "meters", "deg": "degrees", "rad": "radians", "frames": "frames"}
    row = expected("rpe", align="none", relation="translation_part", delta=delta, unit=names[unit], all_pairs=False,
                   pairs_from_reference=True)  # fmt: skip
    found = evaluate_files(REFERENCE, ESTIMATE, association="evo", delta=delta, unit=unit)
    assert found.rpe["translation_m"].n == row["n"]
    assert found.rpe["translation_m"].rmse == pytest.approx(row["stats"]["rmse"], rel=1e-9)


def test_the_record_tells_how(tmp_path: Path) -> None:
    found = evaluate_files(REFERENCE, ESTIMATE, align="sim3", t_offset_s=0.001, max_difference_s=0.02)
    record = json.loads(json.dumps(found.to_json()))["record"]
    assert record["align"] == "sim3"
    assert record["t_offset_s"] == 0.001
    assert record["max_difference_s"] == 0.02
    assert record["association"] == "one-to-one"
    assert record["reference"]["format"] == "tum"
    assert record["alignment"]["scale"] == pytest.approx(1.0056, abs=1e-3)
    assert "A_orbit_gt.tum: tum, 720 poses" in found.text()


def test_formats_are_guessed_and_agree(tmp_path: Path) -> None:
    trajectory, moved = circle(), circle(offset_m=0.02)
    write_euroc(
        Trajectory(trajectory.stamps_ns + 10**18, trajectory.positions_m, trajectory.quaternions_wxyz),
        tmp_path / "gt.csv",
    )
    write_kitti(moved, tmp_path / "est.txt")
    found = evaluate_files(tmp_path / "gt.csv", tmp_path / "est.txt")
    assert found.record["reference"]["format"] == "euroc"
    assert found.record["estimate"]["format"] == "kitti"
    assert found.ate["translation_m"].max == pytest.approx(0.02, abs=1e-9)
    assert found.coverage == 1.0


def test_numbers_with_underscores_are_none(tmp_path: Path) -> None:
    """Python reads 1_0 as 10."""
    write_tum(circle(3), tmp_path / "gt.tum")
    head = "stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz"
    rows = [f"{t},ok,1_0,0,0,1,0,0,0" for t in circle(3).stamps_ns]
    (tmp_path / "frames.csv").write_text(lines(head, *rows))
    with pytest.raises(UserError, match=r"frames.csv: could not convert string to float: '1_0'"):
        evaluate_files(tmp_path / "gt.tum", tmp_path / "frames.csv")


@pytest.mark.parametrize(("lost", "share"), [((1, 2), 0.5), ((2, 3), 0.67), ((1, 3), 0.34)])
def test_a_tracker_that_loses_frames_in_turn_is_no_slower_one(
    tmp_path: Path, lost: tuple[int, int], share: float
) -> None:
    truth = circle(101)
    kept = np.arange(101) % lost[1] < lost[0]
    write_tum(truth, tmp_path / "gt.tum", "world_from_cam")
    estimate = Trajectory(truth.stamps_ns[kept], truth.positions_m[kept], truth.quaternions_wxyz[kept])
    write_tum(estimate, tmp_path / "estimate_world_from_cam.tum", "world_from_cam")
    rows = ["stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz"]
    rows += [f"{t},ok,0,0,0,1,0,0,0" if ok else f"{t},lost,,,,,,," for t, ok in zip(truth.stamps_ns, kept, strict=True)]
    (tmp_path / "frames.csv").write_text(lines(*rows))
    for given in (tmp_path / "estimate_world_from_cam.tum", tmp_path, tmp_path / "frames.csv"):
        found = evaluate_files(tmp_path / "gt.tum", given)
        assert found.coverage == pytest.approx(share, abs=0.01)
        assert found.record["coverage"] == "matched poses / frames of the tracker within the reference"


def test_frames_outside_of_the_reference_are_not_expected() -> None:
    truth, asked_ns = circle(101), np.arange(-50, 200) * 100_000_000
    half = Trajectory(truth.stamps_ns[::2], truth.positions_m[::2], truth.quaternions_wxyz[::2])
    assert evaluate(truth, half, asked_ns=asked_ns).coverage == pytest.approx(51 / 101)
    assert evaluate(half, truth, asked_ns=asked_ns).coverage == 1.0


@pytest.mark.parametrize("jitter_s", [0.0, 0.2])
def test_without_its_frames_an_estimate_has_the_rate_of_its_short_steps(jitter_s: float) -> None:
    truth, rng = circle(1001), np.random.default_rng(0)
    stamps_ns = np.round((np.arange(100) + jitter_s * rng.uniform(-1, 1, 100)) * 1e9).astype(np.int64)
    kept = np.arange(100) % 3 < 2
    for rows, share in ((np.full(100, fill_value=True), 1.0), (kept, 0.67), (rng.random(100) < 0.5, 0.5)):
        estimate = Trajectory(stamps_ns[rows], np.zeros((rows.sum(), 3)), np.tile([1.0, 0, 0, 0], (rows.sum(), 1)))
        found = evaluate(truth, estimate, Options(max_difference_s=0.1))
        assert found.coverage == pytest.approx(share, abs=0.1)


@pytest.mark.parametrize("without", ["reference", "estimate", "neither"])
def test_seconds_are_those_of_the_file_with_stamps_where_the_other_has_none(tmp_path: Path, without: str) -> None:
    way = circle(50, offset_m=0.1)
    for name in ("reference", "estimate"):
        fast = Trajectory(way.stamps_ns // 2, way.positions_m, way.quaternions_wxyz)  # 20 Hz; KITTI has 10
        (write_kitti if name == without else write_tum)(fast, tmp_path / name)
    found = evaluate_files(tmp_path / "reference", tmp_path / "estimate", delta=1.0, unit="s", all_pairs=True)
    assert found.rpe["translation_m"].n == 30
    assert found.frames()["time_s"].iloc[-1] == pytest.approx(49 / 20)
    if without != "neither":
        with pytest.raises(UserError, match=r"have no stamps that an offset of 0\.1 s could shift; leave it out"):
            evaluate_files(tmp_path / "reference", tmp_path / "estimate", t_offset_s=0.1)


def test_kitti_files_of_different_lengths_are_refused(tmp_path: Path) -> None:
    write_kitti(circle(20), tmp_path / "a.txt")
    write_kitti(circle(19), tmp_path / "b.txt")
    with pytest.raises(UserError, match=r"20 poses .* 19"):
        evaluate_files(tmp_path / "a.txt", tmp_path / "b.txt")


def test_modes_with_segments_report_them() -> None:
    found = evaluate_files(REFERENCE, ESTIMATE, mode="rpg")
    assert [s.length_m for s in found.segments] == [2.43, 4.87, 7.31, 9.75, 12.19]
    assert len(found.to_json()["segments"]) == 5
    assert set(MODES) == {"uavbench", "evo", "tum", "kitti", "rpg"}


def test_kitti_mode_starts_a_segment_at_every_tenth_pose() -> None:
    n = 400
    p = np.column_stack([np.arange(n, dtype=float), np.zeros(n), np.zeros(n)])
    q = np.tile([1.0, 0, 0, 0], (n, 1))
    longer = Trajectory(np.arange(n) * 10**8, p * 1.01, q)
    found = evaluate(Trajectory(np.arange(n) * 10**8, p, q), longer, Options(segments="kitti"))
    assert [s.length_m for s in found.segments] == [100, 200, 300]
    assert found.segments[0].translation_m.n == 30
    assert found.segments[0].translation_percent.mean == pytest.approx(1.01, rel=1e-9)  # ends at the first pose beyond


def test_seconds_are_a_stretch() -> None:
    moved = evaluate(circle(), circle(offset_m=0.5), Options(interval=PairInterval(1.0, "s", all_pairs=True)))
    assert moved.rpe["translation_m"].n == 40
    assert moved.rpe["translation_m"].max == pytest.approx(0, abs=1e-12)
    assert evaluate(circle(), circle(), Options(interval=PairInterval(1.0, "s"))).rpe["translation_m"].n == 4


def test_too_short_for_a_stretch_is_told_not_hidden(tmp_path: Path) -> None:
    found = evaluate(circle(5), circle(5), Options(interval=PairInterval(100, "frames")))
    assert found.rpe is None
    assert found.to_json()["rpe"] is None


def test_the_plot_is_two_columns_wide_and_the_same_twice(tmp_path: Path) -> None:
    for name in ("one.pdf", "two.pdf", "three.png"):
        evaluate_files(REFERENCE, ESTIMATE, align="se3", plot=tmp_path / name)
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()
    assert (tmp_path / "three.png").exists() and not (tmp_path / "three.pdf").exists()
    with pytest.raises(UserError, match=r"\.pdf or \.png"):
        evaluate_files(REFERENCE, ESTIMATE, plot=tmp_path / "x.jpg")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([*GOOD[:2], GOOD[4], GOOD[3]], "line 4"),
        ([*GOOD[:3], GOOD[2]], "line 4"),
        ([*GOOD[:2], "2 nan 0 0 0 0 0 1"], "line 3"),
        ([*GOOD[:1], "1 0 0 0 0 0 0 2"], "line 2"),
        ([*GOOD[:1], "nan 0 0 0 0 0 0 1"], "line 2"),
        ([f"{t + 900} 0 0 0 0 0 0 1" for t in range(5)], "no stamps of the two trajectories lie within"),
    ],
)
def test_bad_files_are_refused_with_their_line(rows: list[str], message: str, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.tum", tmp_path / "bad.tum"
    good.write_text(lines(*GOOD))
    bad.write_text(lines(*rows))
    with pytest.raises(UserError, match=message) as told:
        evaluate_files(good, bad)
    assert "bad.tum" in str(told.value)


@pytest.mark.parametrize("align", ["se3", "sim3", "scale", "yaw"])
def test_alignment_of_what_stands_still_is_refused(align: str, tmp_path: Path) -> None:
    for name, row in (("good", GOOD), ("still", [f"{t} 1 2 3 0 0 0 1" for t in range(5)])):
        (tmp_path / name).write_text(lines(*row))
    with pytest.raises(UserError, match="undefined"):
        evaluate_files(tmp_path / "good", tmp_path / "still", align=align)


@pytest.mark.parametrize("align", ["se3", "sim3"])
def test_a_straight_line_is_named_and_aligned_in_what_it_determines(align: str, tmp_path: Path) -> None:
    (tmp_path / "line").write_text(lines(*(f"{t} {t * 0.3:.9f} {t * 0.7:.9f} {t * 0.1:.9f} 0 0 0 1" for t in range(9))))
    found = evaluate_files(tmp_path / "line", tmp_path / "line", align=align)
    assert found.ate["translation_m"].max < 1e-9 and found.ate["rotation_deg"].max < 1e-5
    said = json.loads(json.dumps(found.to_json()))["record"]["alignment"]["undetermined"]
    assert said.startswith("straight line: ") and "smallest rotation" in said and said in found.text()
    assert evaluate_files(tmp_path / "line", tmp_path / "line").ate["translation_m"].max == 0
    assert "undetermined" not in evaluate_files(REFERENCE, ESTIMATE, align=align).to_json()["record"]["alignment"]


@pytest.mark.parametrize(("options", "message"), [({"delta": 0}, "delta"), ({"delta": 1.5}, "whole number")])
def test_bad_stretches_are_refused(options: dict, message: str) -> None:
    with pytest.raises(UserError, match=message):
        evaluate_files(REFERENCE, ESTIMATE, **options)


def written(path: Path, way: Trajectory, stamp: float = 1.0, metre: float = 1.0, order: str = "xyzw") -> Path:
    """A TUM file of stamps in other seconds, positions in other metres, quaternions in another order."""
    rows = zip(way.stamps_ns.tolist(), way.positions_m.tolist(), way.quaternions_wxyz.tolist(), strict=True)
    path.write_text(
        "".join(
            " ".join(map(repr, [stamp * ns / 1e9, *(metre * v for v in p), *(q["wxyz".index(c)] for c in order)]))
            + "\n"
            for ns, p, q in rows
        )
    )
    return path


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"stamp": 1e3}, ["the stamps of the estimate span 1,000 times those"]),
        ({"stamp": 1e-3}, ["the stamps of the estimate span 1 / 1,000 of those"]),
        ({"metre": 1e3}, ["the positions of the estimate spread 1,000 times those"]),
        ({"metre": 0.01}, ["the positions of the estimate spread 1 / 100 of those"]),
        ({"order": "wxyz"}, ["the rotations of the estimate would fit if its quaternions were read w first"]),
        ({}, []),
        ({"metre": 3.0}, []),
    ],
)
def test_other_units_and_orders_are_told(tmp_path: Path, wrong: dict, told: list[str]) -> None:
    way = circle()
    found = evaluate_files(written(tmp_path / "a.tum", way), written(tmp_path / "b.tum", way, **wrong))
    said = found.to_json()["record"]["doubts"]
    assert [line[: len(wanted)] for line, wanted in zip(said, told, strict=True)] == told
    assert found.text().count("doubt: ") == len(told)
    scaled = evaluate_files(tmp_path / "a.tum", tmp_path / "b.tum", align="sim3") if "metre" in wrong else None
    assert scaled is None or not scaled.record["doubts"]


@pytest.mark.parametrize(("first_s", "align"), [(0.0, "se3"), (1000.0, "none")])
def test_another_unit_of_time_that_leaves_too_few_pairs_is_told(tmp_path: Path, first_s: float, align: str) -> None:
    way = circle()
    way = Trajectory.from_poses(
        [s + round(first_s * 1e9) for s in way.stamps_ns.tolist()], list(map(way.pose, range(len(way))))
    )
    with pytest.raises(UserError, match="the stamps of the estimate span 1,000 times those of the reference"):
        evaluate_files(written(tmp_path / "a.tum", way), written(tmp_path / "b.tum", way, stamp=1e3), align=align)


@pytest.mark.parametrize("align", ["none", "se3", "sim3", "yaw", "origin"])
def test_quaternions_in_another_order_are_told_in_another_world_too(tmp_path: Path, align: str) -> None:
    way, world = circle(), Pose.exp(np.array([1.0, 2.0, -0.5, 0.3, -0.9, 0.4]))
    moved = Trajectory.from_poses(way.stamps_ns.tolist(), [world @ way.pose(k) for k in range(len(way))])
    truth = written(tmp_path / "truth.tum", way)
    right, wrong = (
        evaluate_files(truth, written(tmp_path / f"{order}.tum", moved, order=order), align=align).record["doubts"]
        for order in ("xyzw", "wxyz")
    )
    assert len(right) == (align == "none") and all("in a world turned by 59 degrees" in line for line in right), right
    assert len(wrong) == 1 and "would fit if its quaternions were read w first" in wrong[0], wrong


@pytest.mark.parametrize("align", ["none", "origin"])
def test_inverse_poses_are_told(tmp_path: Path, align: str) -> None:
    """An estimate that maps the world to the camera is read as its inverse, whose path has another shape."""
    way = circle()
    inverse = Trajectory.from_poses(way.stamps_ns.tolist(), [way.pose(k).inverse() for k in range(len(way))])
    truth = written(tmp_path / "truth.tum", way)
    (said,) = evaluate_files(truth, written(tmp_path / "inverse.tum", inverse), align=align).record["doubts"]
    assert said.startswith("the rotations of the estimate would fit if ") and "its poses were inverted" in said


def test_a_world_of_other_axes_is_told(tmp_path: Path) -> None:
    """As motion capture with y up: all rotations are off by 90 degrees, of which nothing had been said."""
    way, y_up = circle(), Pose.exp(np.array([0.0, 0.0, 0.0, -np.pi / 2, 0.0, 0.0]))
    moved = Trajectory.from_poses(way.stamps_ns.tolist(), [y_up @ way.pose(k) for k in range(len(way))])
    truth, other = written(tmp_path / "truth.tum", moved), written(tmp_path / "estimate.tum", way)
    (said,) = evaluate_files(truth, other).record["doubts"]
    assert "in a world turned by 90 degrees: are the axes of one world others, as y up?" in said
    assert evaluate_files(truth, other, align="se3").record["doubts"] == []


def lost(way: Trajectory, rows: range, p: np.ndarray | None = None) -> Trajectory:
    """Ground truth that has in these rows the position p and no rotation, or else the pose of the first of them."""
    positions, quaternions = way.positions_m.copy(), way.quaternions_wxyz.copy()
    positions[rows] = positions[rows[0]] if p is None else p
    quaternions[rows] = quaternions[rows[0]] if p is None else (1.0, 0.0, 0.0, 0.0)
    return Trajectory(way.stamps_ns, positions, quaternions)


def test_ground_truth_whose_markers_were_lost_is_told(tmp_path: Path) -> None:
    """It had been taken as it is: errors were those of the motion capture."""
    way = circle()
    estimate, count = written(tmp_path / "estimate.tum", way), len(way)
    for rows, p, told in (
        (range(5, 9), np.zeros(3), f"the reference is at 0, 0, 0 in 4 of {count} poses, and elsewhere before, as at "),
        (range(count // 2, count), None, "the reference stays at one pose, to the last digit, in"),
        (range(5, 25), None, f"in 20 of {count} matched poses, while the estimate moves, as from"),
    ):
        said = evaluate_files(written(tmp_path / "truth.tum", lost(way, rows, p)), estimate).record["doubts"]
        assert len(said) == 1 and told in said[0] and "lose its markers? Remove these rows" in said[0], said


def test_an_estimate_that_is_at_its_origin_where_it_is_lost_is_told(tmp_path: Path) -> None:
    """Ten such rows of 400 had made 2 cm of error 42 cm."""
    way = circle()
    truth, count = written(tmp_path / "truth.tum", way), len(way)
    found = evaluate_files(truth, written(tmp_path / "lost.tum", lost(way, range(5, 9), np.zeros(3))))
    (said,) = found.record["doubts"]
    assert f"the estimate is at 0, 0, 0 in 4 of {count} poses, and elsewhere before" in said
    first = way.pose(0).inverse()
    begun = Trajectory.from_poses(way.stamps_ns.tolist(), [first @ way.pose(k) for k in range(count)])
    assert evaluate_files(truth, written(tmp_path / "begun.tum", begun), align="se3").record["doubts"] == []


def test_ground_truth_at_rest_or_at_its_origin_leaves_no_doubt(tmp_path: Path) -> None:
    way, still = circle(), range(20)
    first = way.pose(0).inverse()
    begun = Trajectory.from_poses(way.stamps_ns.tolist(), [first @ way.pose(k) for k in range(len(way))])
    resting = lost(begun, still)
    noise = np.random.default_rng(0).normal(0, 0.003, (len(way), 3))
    estimate = Trajectory(way.stamps_ns, resting.positions_m + noise, resting.quaternions_wxyz)
    truth, seen = written(tmp_path / "truth.tum", resting), written(tmp_path / "estimate.tum", estimate)
    assert evaluate_files(truth, seen).record["doubts"] == []
    held = written(tmp_path / "held.tum", lost(begun, range(len(way))))
    assert evaluate_files(truth, held).record["doubts"] == []
    assert evaluate_files(held, held).record["doubts"] == []


def test_numbers_of_frames_in_place_of_times_are_told(tmp_path: Path) -> None:
    way = circle()
    counted = Trajectory(np.arange(len(way)) * 10**9, way.positions_m, way.quaternions_wxyz)
    truth, numbers = written(tmp_path / "truth.tum", way), written(tmp_path / "numbers.tum", counted)
    for pair, whose in (((truth, numbers), "estimate"), ((numbers, truth), "reference")):
        said = evaluate_files(*pair, max_difference_s=0.01).record["doubts"]
        assert f"the stamps of the {whose} are a second apart" in said[0] and "numbers of frames?" in said[0], said
    sparse = Trajectory(counted.stamps_ns[:3], way.positions_m[:3], way.quaternions_wxyz[:3])
    told = evaluate_files(truth, written(tmp_path / "sparse.tum", sparse)).record["doubts"]
    assert not any("numbers of frames" in line for line in told)


def test_a_compressed_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.tum.gz").write_bytes(gzip.compress(written(tmp_path / "a.tum", circle()).read_bytes()))
    with pytest.raises(UserError, match=r"a\.tum\.gz: is compressed by gzip; decompress it with `gunzip`"):
        evaluate_files(tmp_path / "a.tum", tmp_path / "a.tum.gz")


@pytest.mark.parametrize(
    ("key", "value", "near"),
    [
        ("align", "SE3", "se3"),
        ("association", "evo_interpolated", "evo-interpolated"),
        ("unit", "frame", "frames"),
        ("pairs_from", "truth", ""),
        ("mode", "evo2", "evo"),
    ],
)
def test_a_value_that_an_option_does_not_have_is_named(key: str, value: str, near: str) -> None:
    with pytest.raises(UserError, match=rf"unknown {key} '{value}'.*{near}"):
        evaluate_files(REFERENCE, ESTIMATE, **{key: value})


def test_other_axes_of_the_camera_and_an_inverted_mount_are_told(tmp_path: Path) -> None:
    """All rotations are off by one of the moving axes; by a small one, as of a calibration, nothing is said."""
    way = circle()
    truth = written(tmp_path / "truth.tum", way)
    for angle, told in ((np.pi, "turned by the same 180 degrees"), (1.5, "turned by the same 86 degrees"), (0.1, "")):
        turn = Pose.exp(np.array([0.0, 0.0, 0.0, angle, 0.0, 0.0]))
        turned = Trajectory.from_poses(way.stamps_ns.tolist(), [way.pose(k) @ turn for k in range(len(way))])
        said = evaluate_files(truth, written(tmp_path / f"{angle}.tum", turned)).record["doubts"]
        assert len(said) == bool(told) and all(told in line and "--mount inverted?" in line for line in said), said


def test_an_interval_between_the_steps_of_a_trajectory_is_not_told_as_too_long() -> None:
    """Poses are 0.1 s apart: of 0.15 s there is no pair, however long the trajectory is."""
    said = evaluate_files(circle(), circle(), delta=0.15, unit="s").text()
    assert "RPE: no two matched poses are 0.15 s apart" in said
