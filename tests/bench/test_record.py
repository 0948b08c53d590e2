"""`uavbench gate --record`: a line for each commit, in a history of one suite and one environment."""

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_one_process
from tests.bench.drawn_scores import drawn, make_score, write
from tests.bench.small_suites import FLOWN
from uavbench.bench.cli.main import main
from uavbench.bench.gate.paired_scores import read_side
from uavbench.bench.history import record as recording
from uavbench.bench.history.environment import environment
from uavbench.reports.history.history_file import History, read_history, write_history
from uavbench.scenes.rendering import context as gl
from uavbench.trajectories.errors import UserError


def git(folder, *arguments):
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def repository(tmp_path, monkeypatch):
    folder = tmp_path / "theirs"
    folder.mkdir()
    monkeypatch.chdir(folder)
    git(folder, "init", "-q")
    (folder / "tracker.py").write_text("ERROR = 1\n")
    git(folder, "add", "tracker.py")
    git(folder, "commit", "-qm", "first")
    write(folder / "results", drawn(np.random.default_rng(0)))
    return folder


def record(*more):
    return CliRunner().invoke(main, ["gate", "results", "--record", "history.json", *more])


def commit(folder, subject):
    git(folder, "commit", "-q", "--allow-empty", "-m", subject)
    return git(folder, "rev-parse", "HEAD")


def test_a_line_for_each_commit_with_its_values_and_environment(repository):
    first = git(repository, "rev-parse", "HEAD")
    assert record().exit_code == 0
    second = commit(repository, "| <b>second</b>")
    assert record().exit_code == 0
    lines = (repository / "history.json").read_text().splitlines()
    assert [json.loads(line.strip().removesuffix(","))["commit"] for line in lines[1:-1]] == [first, second]
    history = read_history(repository / "history.json")
    assert history.suite.flights == "these" and history.commits[1].subject == "| <b>second</b>"
    assert {"numpy", "python", "cpu", "system", "uavbench"} <= history.commits[0].environment.keys()
    ate, side = history.commits[0].metrics["lsd@15hz"]["ATE"], read_side(repository / "results")
    logs = [[np.log(side.runs["lsd@15hz", f"s{i}", k].errors["ATE"]) for k in range(5)] for i in range(4)]
    assert ate.value == pytest.approx(np.exp(np.mean(logs)), rel=1e-5) and ate.low < ate.value < ate.high
    assert np.log(list(ate.runs.values())) == pytest.approx(np.array(logs), rel=1e-5)
    assert history.commits[0].metrics["lsd@15hz"]["coverage"].better == "bigger"


def test_the_same_commit_again_replaces_its_own_line(repository):
    record()
    commit(repository, "second")
    record()
    before = read_history(repository / "history.json")
    write(repository / "results", drawn(np.random.default_rng(0), factor=2.0))
    assert record("--commit", "HEAD~1").exit_code == 0
    after = read_history(repository / "history.json")
    assert [c.commit for c in after.commits] == [c.commit for c in before.commits]
    assert after.commits[1] == before.commits[1]
    old, new = (h.commits[0].metrics["lsd@15hz"]["ATE"].value for h in (before, after))
    assert new == pytest.approx(2 * old, rel=1e-5)


def test_a_commit_that_is_recorded_later_comes_before_its_descendants(repository):
    record()
    for subject in ("second", "third", "fourth"):
        commit(repository, subject)
    for ref in ("HEAD", "HEAD~2", "HEAD~1"):
        assert record("--commit", ref).exit_code == 0
    subjects = [each.subject for each in read_history(repository / "history.json").commits]
    assert subjects[1:] == ["second", "third", "fourth"]


def test_a_commit_of_another_line_or_after_one_that_is_gone_comes_last(repository):
    record()
    commit(repository, "second")
    record()
    git(repository, "checkout", "-q", "--detach", "HEAD~1")
    commit(repository, "beside")
    record()
    gone = read_history(repository / "history.json")
    lost = [replace(each, commit="0" * 40) if each.subject == "beside" else each for each in gone.commits]
    write_history(repository / "history.json", replace(gone, commits=lost))
    commit(repository, "last")
    record()
    subjects = [each.subject for each in read_history(repository / "history.json").commits]
    assert subjects[1:] == ["second", "beside", "last"]


def test_a_verdict_and_a_line_in_one_command(repository):
    write(repository / "worse", drawn(np.random.default_rng(0), factor=1.5))
    result = CliRunner().invoke(main, ["gate", "worse", "--baseline", "results", "--record", "history.json"])
    assert result.exit_code == 1 and "gate: fail" in result.output
    assert len(read_history(repository / "history.json").commits) == 1
    assert CliRunner().invoke(main, ["gate", "results"]).exit_code == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"flights": "others"}, "other flights of this suite"),
        ({"flights": "others", "name": "another"}, "of the suite 'another'"),
        ({"how": {"std_ddof": 1}}, "computed in another way"),
    ],
)
def test_a_history_of_another_suite_is_refused(repository, change, words):
    record()
    file = repository / "history.json"
    history = read_history(file)
    write_history(file, replace(history, suite=replace(history.suite, **change)))
    before = file.read_bytes()
    result = record()
    assert result.exit_code == 2 and words in result.output and "another file" in result.output
    assert file.read_bytes() == before


def test_the_environment_is_that_of_the_results_wherever_they_are_recorded(repository):
    """Results of another machine, and of frames of an earlier form of the suite, were told of as what is here now."""

    def made_with(path, **versions):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"versions": versions}))

    def recorded():
        assert record("--environment", "any").exit_code == 0
        return read_history(repository / "history.json").commits[-1].environment

    here, runs = recorded(), sorted((repository / "results" / "results").iterdir())
    for run in runs:
        made_with(run / "lsd@15hz" / "record.json", numpy="1.26.0", python=here["python"])
        made_with(repository / "results" / "sequences" / run.name / "sequence.json", gl="a GPU", numpy="1.25.0")
    made_with(repository / "results" / "sequences" / "gone-s0" / "sequence.json", gl="another GPU")
    made_with(runs[0] / "gone@15hz" / "record.json", numpy="1.24.0")
    assert recorded() == {**here, "numpy": "1.26.0", "gl": "a GPU"}
    made_with(runs[0] / "lsd@15hz" / "record.json", numpy="2.0.0")
    assert recorded()["numpy"] == "1.26.0, 2.0.0"


def test_the_environment_of_flights_has_the_driver_that_drew_them(tmp_path):
    (tmp_path / "flown.toml").write_text(FLOWN)
    assert in_one_process("fly", tmp_path / "flown.toml", "--out", tmp_path / "out").exit_code == 0
    assert environment(tmp_path / "out", read_side(tmp_path / "out"))["gl"] == gl.version()


def test_another_environment_is_refused_unless_it_has_a_name(repository, monkeypatch):
    record()
    before = (repository / "history.json").read_bytes()
    own = recording.environment
    monkeypatch.setattr(recording, "environment", lambda *given: {**own(*given), "cpu": "Z80", "uavbench": "9"})
    commit(repository, "elsewhere")
    refused = record()
    assert refused.exit_code == 2 and "Z80" in refused.output and "--environment NAME" in refused.output
    assert "uavbench 9" not in refused.output
    assert (repository / "history.json").read_bytes() == before
    assert record("--environment", "runners").exit_code == 0
    history = read_history(repository / "history.json")
    assert history.name == "runners" and history.commits[1].environment["cpu"] == "Z80"
    for given in ([], ["--environment", "laptops"]):
        refused = record(*given)
        assert refused.exit_code == 2 and "--environment 'runners'" in refused.output


@pytest.mark.parametrize(
    "broken",
    [b"", b"{}", b"[]", b"my notes", b"\xff", b'{"format": "uavbench history 1"}', b'{"format": ["x"]}', "cut", "twice",
     "inf", "more"],
)  # fmt: skip
def test_a_broken_history_is_named_and_left_as_it_is(repository, broken):
    record()
    file = repository / "history.json"
    whole = file.read_bytes()
    line = whole.splitlines(keepends=True)[1]
    made = {
        "cut": whole[: len(whole) // 2],
        "twice": whole.replace(line, line.rstrip() + b",\n" + line),
        "inf": whole.replace(b'"value": 1.0', b'"value": Infinity', 1),
        "more": whole.replace(b'"commits"', b'"mine": 1, "commits"', 1),
    }
    file.write_bytes(made[broken] if isinstance(broken, str) else broken)
    before = file.read_bytes()
    result = record()
    assert result.exit_code == 2 and "history.json: " in result.output and "start a new one" in result.output
    assert "Traceback" not in result.output and file.read_bytes() == before


def test_what_is_in_no_commit_and_what_has_no_score_is_not_recorded(repository):
    (repository / "tracker.py").write_text("ERROR = 2\n")
    refused = record()
    assert refused.exit_code == 2 and "tracker.py" in refused.output and "--commit" in refused.output
    assert record("--commit", "HEAD").exit_code == 0
    assert record("--commit", "gone").exit_code == 2
    (repository / "results/results/s0-s0/lsd@15hz/score.json").unlink()
    missing = record("--commit", "HEAD")
    assert missing.exit_code == 2 and "s0, seed 0" in missing.output


def test_the_history_may_be_in_the_repository(repository):
    record()
    git(repository, "add", "history.json")
    git(repository, "commit", "-qm", "history")
    assert record().exit_code == record().exit_code == 0


def test_a_crash_and_a_run_without_a_number_are_kept_as_such(repository):
    scores = drawn(np.random.default_rng(0))
    scores[0] = make_score("s0", 0, None, coverage=0.0, status="crashed", errors=("gone",))
    write(repository / "results", scores)
    assert record().exit_code == 0
    (entry,) = read_history(repository / "history.json").commits
    assert entry.crashes == {"lsd@15hz": 1}
    assert entry.metrics["lsd@15hz"]["ATE"].runs["s0"][0] is None


def test_lines_of_processes_that_record_at_once_are_all_kept(repository):
    commits = [commit(repository, f"change {k}") for k in range(6)]
    folder, file = repository / "results", repository / "history.json"
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda name: recording.record(folder, recording.Where(file, name)), commits))
    assert {c.commit for c in read_history(file).commits} == set(commits)


def test_nothing_but_a_history_is_replaced(repository):
    file = repository / "history.json"
    record()
    history = read_history(file)
    file.write_text("my notes")
    with pytest.raises(UserError, match=r"history\.json"):
        write_history(file, History(suite=history.suite, name="", environment={}, commits=[]))
    assert file.read_text() == "my notes"
