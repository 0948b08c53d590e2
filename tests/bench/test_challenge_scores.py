"""Submissions are scored by the rules, whatever is wrong with them; the leaderboard ranks them."""

import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.challenge.organizer import Challenge
from uavbench.bench.challenge.scoring import score_submission
from uavbench.bench.challenge.submission import FAULTS
from uavbench.bench.cli.main import main
from uavbench.bench.external.rows import POSE_HEADER
from uavbench.reports.leaderboard.submission_score import SequenceScore, SubmissionScore
from uavbench.reports.scoring.points import hilti_score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

NAMES = ("sequence-01", "sequence-02")


def truths(folder):
    """Sequence of each name in the package."""
    of = Challenge.load(folder / "kept").sequences
    return {name: Sequence.load(folder / "kept" / "sequences" / of[name].name) for name in NAMES}


def csv_of(sequence, off_m=0.0, rows=slice(None), shift_ns=0):
    """estimates.csv with the true poses, the camera moved along its own x."""
    lines = [",".join(POSE_HEADER)]
    for frame in range(len(sequence))[rows]:
        pose = Pose(np.eye(3), np.array([off_m, 0.0, 0.0])) @ sequence.true_cam_from_world(frame)
        numbers = [*pose.translation.tolist(), *pose.quaternion_wxyz.tolist()]
        lines.append(",".join(map(str, [int(sequence.stamps_ns[frame]) + shift_ns, "ok", *numbers])))
    return "\n".join(lines) + "\n"


@pytest.fixture
def submitted(challenge, tmp_path):
    """Folder of a perfect submission."""
    folder = tmp_path / "team"
    folder.mkdir()
    for name, sequence in truths(challenge).items():
        (folder / f"{name}.csv").write_text(csv_of(sequence))
    return folder


def names_of(score):
    return [fault.split("]")[0][1:] for fault in score.faults]


@pytest.mark.parametrize(
    ("error_m", "points"),
    [(0.0, 20), (0.0049, 20), (0.005, 10), (0.0099, 10), (0.01, 6), (0.029, 6), (0.03, 5), (0.059, 5), (0.06, 3),
     (0.099, 3), (0.10, 1), (0.39, 1), (0.40, 0), (1e9, 0), (np.inf, 0), (np.nan, 0)],
)  # fmt: skip
def test_points_are_those_of_the_hilti_challenge(error_m, points):
    assert hilti_score(np.array([error_m])) == pytest.approx(5 * points)
    assert hilti_score(np.array([error_m, 0.0, np.inf, np.inf])) == pytest.approx(5 * (points + 20) / 4)


def test_the_truth_has_all_points_in_every_form(challenge, submitted, tmp_path):
    assert score_submission(challenge / "kept", submitted).score == 100.0
    forms = tmp_path / "forms"
    for name, sequence in truths(challenge).items():
        camera = Trajectory.from_poses(
            sequence.stamps_ns.tolist(), [sequence.true_cam_from_world(k).inverse() for k in range(len(sequence))]
        )
        if name == NAMES[0]:
            write_tum(camera, forms / f"{name}.tum")
            write_tum(camera, tmp_path / "folders" / name / "estimate_world_from_cam.tum", "world_from_cam")
        else:
            write_tum(sequence.ground_truth, forms / f"{name}.tum", "world_from_body")
            (tmp_path / "folders" / name).mkdir(parents=True)
            (tmp_path / "folders" / name / "estimates.csv").write_text(csv_of(sequence))
    for folder in (forms, tmp_path / "folders"):
        found = score_submission(challenge / "kept", folder)
        assert found.score == 100.0 and found.faults == () and found.name == folder.name
        assert max(each.ate_position_m for each in found.runs["run-1"].values()) < 1e-9


def test_errors_cost_points_and_every_sequence_weighs_the_same(challenge, submitted):
    sequences = truths(challenge)
    (submitted / f"{NAMES[1]}.csv").write_text(csv_of(sequences[NAMES[1]], off_m=0.02))
    found = score_submission(challenge / "kept", submitted)
    each = found.runs["run-1"]
    assert (each[NAMES[0]].points, each[NAMES[1]].points, found.score) == (100.0, 30.0, 65.0)
    assert each[NAMES[1]].ate_position_m == pytest.approx(0.02) and each[NAMES[1]].success == 1.0


def broken(kind, path, sequence):
    """Break the file of a sequence; share of its frames that is left, and the fault that names it."""
    whole = path.read_text()
    if kind == "missing":
        path.unlink()
        return 0.0, "no-file"
    if kind == "half of the rows":
        path.write_text(csv_of(sequence, rows=slice(0, 3)))
        return 3 / 7, "bad-rows"
    if kind == "cut in a row":
        path.write_text(whole[:-40])
        return 6 / 7, "bad-rows"
    if kind == "of another sequence":
        path.write_text(csv_of(sequence, shift_ns=10**12))
        return 0.0, "bad-rows"
    if kind == "not finite":
        path.write_text(whole.replace(whole.splitlines()[3].split(",")[4], "nan"))
        return 6 / 7, "bad-rows"
    if kind == "no text":
        path.write_bytes(bytes(range(256)) * 4)
        return 0.0, "bad-rows"
    if kind == "huge":
        with path.open("r+b") as handle:
            handle.truncate(1 << 40)
        return 0.0, "bad-rows"
    path.unlink()
    if kind == "a link":
        path.symlink_to("/etc/passwd")
    elif kind == "behind a link":
        (path.parent.parent / "elsewhere").mkdir()
        (path.parent.parent / "elsewhere" / "estimates.csv").write_text(whole)
        path.with_suffix("").symlink_to(path.parent.parent / "elsewhere")
    elif kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a folder":
        path.mkdir()
    else:
        path = path.with_suffix(".tum")
        path.write_text("0.0 1 2 3 0 0 0 1\n" if kind == "tum of other stamps" else "a b c\n")
        if kind == "huge tum":
            os.truncate(path, 1 << 40)
        if kind == "tum of other stamps":
            path.write_text("5000.0 1 2 3 0 0 0 1\n")
            return 0.0, "no-frame"
    return 0.0, "unreadable"


KINDS = [
    *("missing", "half of the rows", "cut in a row", "of another sequence", "not finite", "no text", "huge"),
    *("a link", "behind a link", "a pipe", "a folder", "bad tum", "huge tum", "tum of other stamps"),
]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_missing_or_wrong_counts_as_failed_and_is_named(challenge, submitted, kind):
    sequence = truths(challenge)[NAMES[1]]
    left, fault = broken(kind, submitted / f"{NAMES[1]}.csv", sequence)
    found = score_submission(challenge / "kept", submitted)
    each = found.runs["run-1"][NAMES[1]]
    assert each.frames == 7 and each.coverage == pytest.approx(left) and each.points == pytest.approx(100 * left)
    assert found.score == pytest.approx((100 + 100 * left) / 2)
    assert set(names_of(found)) == {fault} and fault in FAULTS
    assert all(NAMES[1] in text and "\n" not in text for text in found.faults)


def reread(kind, sequence):
    """Rows of a CSV file with the true poses, of which one convention is mistaken."""
    lines = [",".join(POSE_HEADER)]
    for frame in range(len(sequence)):
        pose = sequence.true_cam_from_world(frame)
        pose = pose.inverse() if kind == "inverted" else pose
        position = pose.translation * (1000 if kind == "millimetres" else 1)
        quaternion = np.roll(pose.quaternion_wxyz, -1 if kind == "w last" else 0)
        numbers = [*position.tolist(), *quaternion.tolist()]
        lines.append(",".join(map(str, [int(sequence.stamps_ns[frame]), "ok", *numbers])))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("kind", "said"),
    [("inverted", "poses were inverted"), ("millimetres", "in metres"), ("w last", "read w last"), ("right", "")],
)
def test_poses_of_another_convention_are_doubted(challenge, submitted, kind, said):
    (submitted / f"{NAMES[1]}.csv").write_text(reread(kind, truths(challenge)[NAMES[1]]))
    found = score_submission(challenge / "kept", submitted)
    assert found.score == (100.0 if kind == "right" else 50.0)
    assert names_of(found) == (["doubtful"] if said else [])
    assert all(said in fault and NAMES[1] in fault for fault in found.faults)


def test_a_tum_file_with_its_quaternions_w_first_is_doubted(challenge, submitted):
    sequence = truths(challenge)[NAMES[1]]
    poses = [sequence.true_cam_from_world(frame).inverse() for frame in range(len(sequence))]
    rows = [
        [stamp / 1e9, *pose.translation.tolist(), *pose.quaternion_wxyz.tolist()]
        for stamp, pose in zip(sequence.stamps_ns.tolist(), poses, strict=True)
    ]
    (submitted / f"{NAMES[1]}.csv").unlink()
    (submitted / f"{NAMES[1]}.tum").write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
    found = score_submission(challenge / "kept", submitted)
    assert names_of(found) == ["doubtful"] and "read w first" in found.faults[0]


def test_a_tum_file_with_stamps_in_nanoseconds_is_told_the_seconds_of_both(challenge, submitted):
    sequence = truths(challenge)[NAMES[1]]
    (submitted / f"{NAMES[1]}.csv").unlink()
    lines = [f"{stamp} 0 0 0 0 0 0 1\n" for stamp in sequence.stamps_ns.tolist()]
    (submitted / f"{NAMES[1]}.tum").write_text("".join(lines))
    found = score_submission(challenge / "kept", submitted)
    last = int(sequence.stamps_ns[-1])
    assert f"its stamps are 0 to {last} s, those of the frames 0 to {last / 1e9:.10g} s" in found.faults[0]


def test_a_second_row_of_a_frame_is_not_said_to_cost_it(challenge, submitted):
    path = submitted / f"{NAMES[1]}.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[1] + "\n")
    found = score_submission(challenge / "kept", submitted)
    assert found.score == 100.0 and "of several rows of a frame the first one is scored" in found.faults[0]


def test_a_score_that_another_submission_of_the_name_replaces_is_told(challenge, submitted, tmp_path):
    other = tmp_path / "other" / submitted.name
    other.mkdir(parents=True)
    (other / f"{NAMES[0]}.csv").write_text((submitted / f"{NAMES[0]}.csv").read_text())
    command = ["score-submission", str(challenge / "kept"), "--out", str(tmp_path / "score.json")]
    said = [CliRunner().invoke(main, [*command, str(folder)]).output for folder in (submitted, submitted, other)]
    assert ["replaced" in each for each in said] == [False, False, True]
    assert "replaced the score of 100.0 points" in said[2] and "submission.toml" in said[2]


def test_files_that_are_none_of_a_submission_are_named_and_not_read(challenge, submitted):
    (submitted / "virus\x1b[31m.exe").write_text("")
    (submitted / "sequence-99.csv").write_text("")
    (submitted / f"{NAMES[0]}.tum").write_text("0 0 0 0 0 0 0 1\n")
    found = score_submission(challenge / "kept", submitted)
    assert found.score == 100.0 and sorted(names_of(found)) == ["foreign-file", "foreign-file", "two-files"]
    assert not any("\x1b" in fault for fault in found.faults)


def test_the_median_of_up_to_five_runs_counts(challenge, submitted, tmp_path):
    sequences, team = truths(challenge), tmp_path / "runs"
    for number, off_m in enumerate([0.0, 0.5, 0.02, 0.3, 0.05], start=1):
        (team / f"run-{number}").mkdir(parents=True)
        for name, sequence in sequences.items():
            (team / f"run-{number}" / f"{name}.csv").write_text(csv_of(sequence, off_m=off_m))
    found = score_submission(challenge / "kept", team)
    assert [found.score_of(f"run-{k}") for k in range(1, 6)] == [100.0, 0.0, 30.0, 5.0, 25.0]
    assert found.counted == "run-5" and found.score == 25.0
    shutil.rmtree(team / "run-2")
    assert score_submission(challenge / "kept", team).score == 25.0, "of two in the middle the worse one"
    for number in (2, 6):
        (team / f"run-{number}").mkdir()
    with pytest.raises(UserError, match="has 6 runs; a submission has at most 5"):
        score_submission(challenge / "kept", team)
    (team / "run-6").rmdir()
    assert score_submission(challenge / "kept", team).score_of("run-2") == 0.0, "an empty run counts as failed"
    (team / "run-3").rename(team / "run-03")
    (team / "run-2" / "estimates.csv").write_text("")
    named = [fault for fault in score_submission(challenge / "kept", team).faults if "[foreign-file]" in fault]
    assert ["run-2/estimates.csv" in named[0], "run-03" in named[1], len(named)] == [True, True, 2]
    (team / f"{NAMES[0]}.csv").write_text("")
    with pytest.raises(UserError, match="has files next to its runs"):
        score_submission(challenge / "kept", team)


@pytest.mark.parametrize("what", ["nothing", "no folder", "no challenge", "bad name"])
def test_what_cannot_be_scored_is_a_users_mistake(challenge, submitted, what, tmp_path):
    truth = challenge / "kept"
    if what == "nothing":
        for path in submitted.iterdir():
            path.unlink()
    elif what == "no folder":
        submitted = tmp_path / "gone"
    elif what == "no challenge":
        truth = challenge / "participants"
    else:
        (submitted / "submission.toml").write_text("name = 7\n")
    done = CliRunner().invoke(main, ["score-submission", str(truth), str(submitted), "--out", str(tmp_path / "a.json")])
    assert done.exit_code == 2 and "Traceback" not in done.output
    assert done.output.startswith("uavbench: ") and not (tmp_path / "a.json").exists()


def test_the_leaderboard_ranks_what_was_scored(challenge, submitted, tmp_path):
    (submitted / "submission.toml").write_text('name = "<b>First</b>"\n')
    second = tmp_path / "second"
    second.mkdir()
    (second / f"{NAMES[0]}.csv").write_text(csv_of(truths(challenge)[NAMES[0]], off_m=0.02))
    for folder in (second, submitted):
        done = CliRunner().invoke(main, ["score-submission", str(challenge / "kept"), str(folder)])
        assert done.exit_code == 0, done.output
    assert "100.0 of 100 points" in done.output
    scores = [str(challenge / "kept" / "submissions" / f"{name}.json") for name in ("second", "team")]
    board = tmp_path / "board"
    for _ in range(2):
        done = CliRunner().invoke(main, ["leaderboard", *scores, "--out", str(board), "--title", "Spring"])
        assert done.exit_code == 0, done.output
    page = (board / "index.html").read_text()
    assert page.index("1. &lt;b&gt;First&lt;/b&gt;") < page.index("2. second") and "<b>First" not in page
    assert "[no-file] sequence-02: there is no file" in page and "<h1>Spring</h1>" in page
    rows = (board / "tables" / "leaderboard.csv").read_text().splitlines()
    assert rows[0].startswith("submission,score") and "tracker" not in (board / "index.html").read_text()
    assert [row.split(",")[0] for row in rows[1:]] == ["<b>First</b>", "second"]
    assert "15.0" in (board / "tables" / "leaderboard.md").read_text()
    for hidden in Challenge.load(challenge / "kept").sequences.values():
        assert hidden.name not in page


def drawn(name, points, challenge="c"):
    """A score on six flights."""
    rest = {"frames": 10, "success": 1.0, "coverage": 1.0, "ate_position_m": 0.01, "ate_rotation_deg": 0.1}
    run = {f"sequence-{k}": SequenceScore(flight=f"flight-{k}", points=value, **rest) for k, value in enumerate(points)}
    return SubmissionScore(name=name, challenge=challenge, runs={"run-1": run})


def test_scores_have_intervals_and_the_best_is_tested(tmp_path):
    from uavbench.reports.leaderboard.page import write_leaderboard

    high, low = drawn("high", [80, 82, 85, 88, 84, 90]), drawn("low", [20, 25, 21, 30, 22, 28])
    write_leaderboard(tmp_path / "a", [low, high], "a")
    tables = tmp_path / "a" / "tables"
    assert "submission & score" in (tables / "leaderboard.tex").read_text()
    assert (tables / "leaderboard.md").read_text().startswith("| submission | score")
    first = (tables / "leaderboard.md").read_text().splitlines()[2]
    assert first.startswith("| high | **84.8**\\* [8")
    write_leaderboard(tmp_path / "b", [drawn("one", [50, 60, 70]), drawn("two", [60, 50, 71])], "b")
    assert "\\*" not in (tmp_path / "b" / "tables" / "leaderboard.md").read_text().split("Score:")[0]
    for bad, message in (
        ([], "at least one"), ([high, high], "2 submissions are called 'high'"),
        ([high, drawn("other", [1.0], "d")], "2 challenges"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=message):
            write_leaderboard(tmp_path / "c", bad, "c")


def test_a_score_by_other_rules_is_not_replaced_and_what_to_do_is_told(tmp_path):
    path = tmp_path / "score.json"
    replace(drawn("team", [40.0]), rules="other").save(path)
    with pytest.raises(UserError, match=r"by other rules \(other\).*: move the file away, or name another one with"):
        drawn("team", [50.0]).save(path)


def test_a_score_that_was_changed_is_refused(tmp_path):
    path = tmp_path / "score.json"
    drawn("team", [40.0]).save(path)
    drawn("team", [50.0]).save(path)
    with pytest.raises(UserError, match="holds the score of 'team', not of 'other'"):
        drawn("other", [60.0]).save(path)
    assert SubmissionScore.load(path).score == 50.0
    path.write_text(path.read_text().replace("50.0", "99.0"))
    with pytest.raises(UserError, match=r"score\.json: is damaged, or was edited"):
        SubmissionScore.load(path)
    with pytest.raises(UserError, match=r"score\.json: exists and is not an unmodified file of uavbench; move it"):
        drawn("team", [60.0]).save(path)
    path.write_text("[]")
    with pytest.raises(UserError, match=r"score\.json"):
        SubmissionScore.load(path)
