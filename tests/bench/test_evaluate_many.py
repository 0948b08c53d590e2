"""`uavbench evaluate` of many runs: groups, mean and spread, paired tests, bands, the page, and what it refuses."""

import csv
import json
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from scipy.spatial.transform import Rotation

from uavbench.bench.cli.main import main
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

POSES, RUNS = 120, 7
T = np.arange(POSES) / 10
WAY = np.column_stack([3 * np.cos(T / 3), 2 * np.sin(T / 3), 0.1 * T])
TURN = Rotation.from_rotvec(np.outer(T / 3, [0, 0, 1]))


def trajectory(positions, turn=TURN, shift_ns=0):
    return Trajectory(np.rint(T * 1e9).astype(np.int64) + shift_ns, positions, turn.as_quat()[:, [3, 0, 1, 2]])


def estimate(seed, sigma_m):
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.normal(0, sigma_m, (POSES, 3))) * TURN
    return trajectory(WAY + rng.normal(0, sigma_m * (1 + 0.2 * rng.random()), (POSES, 3)), turn)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A truth, and RUNS runs of trackers `a` (1 cm), `b` (3 cm) and `c` (3 cm), the first with covariances."""
    folder = tmp_path_factory.mktemp("many")
    write_tum(trajectory(WAY), folder / "gt.tum", "world_from_body")
    for k, (name, sigma_m) in enumerate((("a", 0.01), ("b", 0.03), ("c", 0.03))):
        (folder / name).mkdir()
        for run in range(RUNS):
            path = folder / name / f"run{run}.tum"
            write_tum(estimate(10 * k + run, sigma_m), path)
            if name == "a":
                row = np.zeros(21)
                row[[0, 6, 11, 15, 18, 20]] = 0.011**2
                text = "".join(
                    f"{line} {' '.join(map(repr, row.tolist()))}\n" for line in path.read_text().splitlines()
                )
                path.unlink()
                path.write_text(text)
    return folder


def call(folder, *arguments, monkeypatch):
    monkeypatch.chdir(folder)
    return CliRunner().invoke(main, ["evaluate", "gt.tum", *map(str, arguments)])


ABC = ("--group", "A=a/run*.tum", "--group", "B=b/run*.tum", "--group", "C=c/run*.tum")


@pytest.fixture
def run(made, monkeypatch):
    return lambda *arguments, folder=made: call(folder, *arguments, monkeypatch=monkeypatch)


def test_a_place_that_cannot_be_written_is_told_before_runs_are_evaluated(run, tmp_path):
    (tmp_path / "notes").write_text("mine")
    done = run(*ABC, "--out", tmp_path / "notes" / "page")
    assert done.exit_code == 2 and "notes is not a folder" in done.output
    assert "ATE" not in done.output


def test_each_run_has_the_numbers_that_it_has_alone(run):
    found = json.loads(run(*ABC, "--align", "se3", "--json").stdout)
    assert [(r["group"], r["run"]) for r in found["runs"]] == [(g, str(k)) for g in "ABC" for k in range(RUNS)]
    for each in found["runs"]:
        alone = json.loads(run(each["record"]["estimate"]["file"], "--align", "se3", "--json").stdout)
        assert {key: each[key] for key in alone} == alone
    for name, group in found["groups"].items():
        values = [r["ate"]["translation_m"]["rmse"] for r in found["runs"] if r["group"] == name]
        said = group["ate_position"]
        assert (group["runs"], said["n"]) == (RUNS, RUNS)
        assert said["mean"] == pytest.approx(np.mean(values)) and said["std"] == pytest.approx(np.std(values, ddof=1))
        assert (said["min"], said["max"]) == (min(values), max(values))
        assert said["low"] < said["mean"] < said["high"]


def test_a_tracker_that_is_better_is_found_and_equal_ones_are_not_told_apart(run):
    found = json.loads(run(*ABC, "--json").stdout)
    assert found["paired"]["how"] == f"{RUNS} runs, paired by name" and found["paired"]["runs"] == RUNS
    tests = {(t["first"], t["second"]): t for t in found["paired"]["tests"]["ate_position"]}
    assert set(tests) == {("A", "B"), ("A", "C"), ("B", "C")}
    for pair in (("A", "B"), ("A", "C")):
        assert tests[pair]["significant"] and tests[pair]["wins"] == 1.0
        assert tests[pair]["difference"]["high"] < 0
    assert not tests["B", "C"]["significant"]
    text = run(*ABC).stdout
    row = next(line for line in text.splitlines() if line.startswith("A "))
    assert "*" in row
    assert re.search(r"^A - B +ATE position +-\d\.\d+ cm .*100 %$", text, re.MULTILINE)
    assert len(re.findall(r"^[ABC] +\d ", text, re.MULTILINE)) == 3 + 3 * RUNS


@pytest.mark.usefixtures("sketched")
def test_a_tracker_that_covers_little_does_not_win(made, tmp_path, monkeypatch):
    """It is the more accurate one as long as it tracks, which is half of the way."""
    shutil.copytree(made, tmp_path / "own")
    for path in (tmp_path / "own" / "a").iterdir():
        rows = path.read_text().splitlines()[: POSES // 2]
        path.unlink()
        path.write_text("\n".join(rows) + "\n")
    text = call(tmp_path / "own", *ABC, "--out", "out", monkeypatch=monkeypatch).stdout
    assert re.search(r"^A +7 +50.0 +\d+\.\d+ \[", text, re.MULTILINE)
    table = (tmp_path / "own" / "out" / "tables" / "summary.md").read_text()
    assert "**" not in table and "less than 90% of the best coverage" in table
    assert all(t["significant"] for t in json.loads((tmp_path / "own" / "out" / "evaluation.json").read_text())
               ["paired"]["tests"]["ate_position"][:2])  # fmt: skip


def test_without_groups_all_are_runs_of_one(run, made):
    files = sorted((made / "b").iterdir())
    found = json.loads(run(*files, "--json").stdout)
    assert list(found["groups"]) == ["estimate"] and found["paired"]["tests"] == {}
    assert [r["run"] for r in found["runs"]] == [f"run{k}" for k in range(RUNS)]
    assert "one tracker" in found["paired"]["how"]


def test_the_page_its_figures_and_tables(run, made, tmp_path):
    for again in range(2):
        done = run(*ABC, "--align", "se3", "--out", tmp_path / "out")
        assert done.exit_code == 0 and str(tmp_path / "out" / "index.html") in done.stdout
        if not again:
            first = {p.name: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert {p.name: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()} == first
    page = (tmp_path / "out" / "index.html").read_text()
    for name in ("errors", "spread", "paths", "nees", "wins", "ranks"):
        with Image.open(tmp_path / "out" / "figures" / f"{name}.png") as picture:
            assert np.asarray(picture.convert("L")).std() > 5, name
        assert (tmp_path / "out" / "figures" / f"{name}.pdf").is_file() and f'src="figures/{name}.png"' in page
    for target in re.findall(r'(?:href|src)="([^"#]+)"', page):
        assert (tmp_path / "out" / target).is_file(), target
    said = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    with (tmp_path / "out" / "tables" / "runs.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [float(row["ate_position_cm"]) for row in rows] == pytest.approx(
        [100 * r["ate"]["translation_m"]["rmse"] for r in said["runs"]]
    )
    assert [bool(row["nees"]) for row in rows] == [row["tracker"] == "A" for row in rows]
    assert 4 < float(rows[0]["nees"]) < 9 and rows[0]["nees"] != rows[0]["nees_aligned"]
    with (tmp_path / "out" / "figures" / "errors.csv").open() as handle:
        bins = [row for row in csv.DictReader(handle) if row["tracker"] == "B" and row["quantity"] == "position_cm"]
    assert {row["along"] for row in bins} == {"time", "distance"}
    assert all(float(row["low"]) <= float(row["median"]) <= float(row["high"]) for row in bins)
    assert "\\midrule" in (tmp_path / "out" / "tables" / "summary.tex").read_text()


def test_names_may_be_anything(made, tmp_path, monkeypatch):
    """Neither a formula for matplotlib, nor hidden, nor markup on the page."""
    for name in ("a", "b"):
        (tmp_path / f"{name}$x^$").mkdir()
        for k in range(3):
            shutil.copy(made / name / f"run{k}.tum", tmp_path / f"{name}$x^$" / f"<b>{k}&_$y$.tum")
    shutil.copy(made / "gt.tum", tmp_path)
    groups = ("--group", "_$\\a{$=a*/*.tum", "--group", "<i>%|#=b*/*.tum", "--out", "out")
    done = call(tmp_path, *groups, monkeypatch=monkeypatch)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<i>" not in page and "<b>0&" not in page and "&lt;i&gt;%|#" in page


def test_one_run_has_a_page_too(run, made, tmp_path):
    done = run("a/run0.tum", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "figures" / "errors.png").is_file()
    assert not (tmp_path / "out" / "figures" / "wins.png").exists()


def test_what_others_wrote_is_left_alone(run, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "index.html").write_text("precious")
    done = run("a/run0.tum", "--out", tmp_path / "out")
    assert done.exit_code == 2 and "index.html" in done.output
    assert [p.name for p in (tmp_path / "out").rglob("*")] == ["index.html"]


@pytest.mark.usefixtures("sketched")
def test_straight_lines_are_named_in_text_json_and_page(made, tmp_path, monkeypatch):
    line = np.outer(T, [1.0, 0.5, 0.0])
    write_tum(trajectory(line), tmp_path / "gt.tum")
    for k in range(3):
        write_tum(trajectory(line + np.random.default_rng(k).normal(0, 0.02, line.shape)), tmp_path / f"e{k}.tum")
    arguments = ("e0.tum", "e1.tum", "e2.tum", "--align", "se3")
    text = call(tmp_path, *arguments, "--out", "out", monkeypatch=monkeypatch).stdout
    assert text.count("straight line") >= 4 and "in 3 of 3 runs" in " ".join(text.split())
    assert "smallest rotation" in " ".join(text.split())
    assert (
        "3 runs whose positions do not determine the whole alignment" in (tmp_path / "out" / "index.html").read_text()
    )
    found = json.loads(call(tmp_path, *arguments, "--json", monkeypatch=monkeypatch).stdout)
    for each in found["runs"]:
        assert each["record"]["alignment"]["undetermined"].startswith("straight line")
        assert each["ate"]["rotation_deg"]["rmse"] < 0.2  # attitudes are exact: a random rotation would show


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "name at least one estimate"),
        (("--group", "A=none*.tum"), "--group A=none*.tum: matches no file"),
        (("--group", "A=none.tum"), "--group A=none.tum: matches no file"),
        (("--group", "a/run0.tum"), "write NAME=PATTERN"),
        (("--group", "=a/run0.tum"), "write NAME=PATTERN"),
        (("--group", "A="), "write NAME=PATTERN"),
        (("a/run0.tum", "a/run0.tum"), "a/run0.tum: is given twice"),
        (("a/run0.tum", "a/../a/run0.tum"), "is given twice"),
        (("a/run0.tum", "hard.tum"), "hard.tum: is the same file as a/run0.tum"),
        (("a/run0.tum", "soft.tum"), "soft.tum: is the same file as a/run0.tum"),
        (("--group", "A=a/*", "--group", "B=*/run0.tum"), "a/run0.tum: is in the groups A and B"),
        (("a/run0.tum", "gt.tum"), "gt.tum: is the same file as the truth gt.tum"),
        (("b/run0.tum", "--group", "A=a/*.tum"), "b/run0.tum: in no group"),
        (("a/run0.tum", "late.tum"), "gt.tum against late.tum: no stamps of the two trajectories lie within"),
        (("a/run0.tum", "camera.tum"), "camera.tum world_from_cam: poses of different frames"),
        (("a/run0.tum", "b/run0.tum", "--plot", "x.pdf"), "--plot draws one estimate; give --out"),
        (("a/run0.tum", "none.tum"), "none.tum: no such file"),
        (("a/run0.tum", "bad.tum"), "bad.tum: line 2"),
    ],
)
def test_mistakes_are_named(made, tmp_path, monkeypatch, arguments, told):
    folder = tmp_path / "own"
    shutil.copytree(made, folder)
    (folder / "hard.tum").hardlink_to(folder / "a" / "run0.tum")
    (folder / "soft.tum").symlink_to(folder / "a" / "run0.tum")
    write_tum(trajectory(WAY, shift_ns=10**12), folder / "late.tum")
    write_tum(trajectory(WAY), folder / "camera.tum", "world_from_cam")
    (folder / "bad.tum").write_text("0 0 0 0 0 0 0 1\n1 0 0 x 0 0 0 1\n")
    done = call(folder, *arguments, "--out", "out", monkeypatch=monkeypatch)
    assert done.exit_code == 2 and told in done.output and "Traceback" not in done.output
    assert not (folder / "out").exists()


def test_frames_that_differ_among_the_estimates_are_refused_without_the_truth_saying_one(made, tmp_path, monkeypatch):
    for name, frame in (("gt.tum", ""), ("body.tum", "world_from_body"), ("cam.tum", "world_from_cam")):
        write_tum(trajectory(WAY + 0.01 * len(name)), tmp_path / name, frame)
    done = call(tmp_path, "body.tum", "cam.tum", monkeypatch=monkeypatch)
    assert done.exit_code == 2 and "different frames" in done.output
    assert call(tmp_path, "body.tum", "cam.tum", "--ignore-frames", monkeypatch=monkeypatch).exit_code == 0


def test_a_mount_is_refused_where_nothing_says_what_it_converts(made, tmp_path, monkeypatch):
    for name, frame in (("gt.tum", ""), ("body.tum", "world_from_body"), ("cam.tum", "world_from_cam")):
        write_tum(trajectory(WAY + 0.01 * len(name)), tmp_path / name, frame)
    (tmp_path / "sequence.json").write_text(json.dumps({"cam_from_body": np.eye(4).tolist()}))
    for estimates in (("cam.tum",), ("body.tum", "cam.tum")):
        done = call(tmp_path, *estimates, "--mount", tmp_path, monkeypatch=monkeypatch)
        assert done.exit_code == 2, done.output
        assert "gt.tum: does not declare whether its poses are of the body or of the camera" in done.output


def test_the_pairs_are_those_of_the_names(run, made, tmp_path, monkeypatch):
    """B's best run beside A's worst would be paired by order; by name they are not."""
    for name, scales in (("a", (1, 2, 3, 4, 5, 6, 7)), ("b", (7.1, 6.1, 5.1, 4.1, 3.1, 2.1, 1.1))):
        (tmp_path / name).mkdir()
        for k, scale in enumerate(scales):
            number = k if name == "a" else RUNS - 1 - k
            write_tum(trajectory(WAY + np.array([0, 0, 0.01 * scale])), tmp_path / name / f"{'zyxwvut'[number]}.tum")
    write_tum(trajectory(WAY), tmp_path / "gt.tum")
    groups = ("--group", "A=a/*.tum", "--group", "B=b/*.tum")
    found = json.loads(call(tmp_path, *groups, "--json", monkeypatch=monkeypatch).stdout)
    (test,) = found["paired"]["tests"]["ate_position"]
    assert test["wins"] == 1.0 and test["difference"]["mean"] == pytest.approx(-0.001)
