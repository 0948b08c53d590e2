"""Results whose inputs were written while they were made are never handed on, whichever command made them."""

import json
import shutil
import sys
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner

import uavbench as ub
from tests.bench.conftest import in_this_process, packed
from tests.bench.drawn_scores import drawn, write
from tests.bench.small_suites import FLOWN, SMALL, small_suite
from tests.bench.test_external import HOLD, STREAM
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.gate.paired_scores import read_side
from uavbench.bench.inputs.touched_files import Stamps, touched_since
from uavbench.bench.runner import commands
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to, disowned_if_ended
from uavbench.bench.runner.graph import run_graph
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.render_suite import InProcess
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sources import digests

PLUGIN = """
from dataclasses import dataclass
from pathlib import Path
from uavbench.scenes.structures.box import Box

GIVEN = Path(__file__).parent / "given.txt"

@dataclass(frozen=True)
class Mine:
    def build(self, rng):
        if GIVEN.read_text() == "edited in the middle":
            GIVEN.write_text("as it stays")
        return Box().unpainted()
"""
BREAKS = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Breaks:
    def start(self, structure, camera, cam_from_world, rng):
        raise RuntimeError("broken")
"""
CHANGED = "changed while jobs that use it ran: given.txt; the same command does"


@pytest.fixture(autouse=True)
def _no_files_of_other_tests(monkeypatch):
    """What other tests of this process digested, and removed with their folders, is no input here."""
    monkeypatch.setattr(digests, "_digested", {})


@pytest.fixture
def in_process(monkeypatch, sketched):
    """The jobs of commands run in the process of the tests, and figures are sketched."""
    monkeypatch.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)
    monkeypatch.setattr("uavbench.bench.sensitivity.study.local_pool", in_this_process)


@pytest.fixture
def suite(tmp_path, monkeypatch):
    """File of a suite, of whose structure an input is written while it is first rendered."""
    (tmp_path / "plugin_that_writes.py").write_text(PLUGIN)
    (tmp_path / "given.txt").write_text("edited in the middle")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{':'.join(path for path in sys.path if path)}")
    path = small_suite(tmp_path, 'mine = { kind = "lsd-single" }\n')
    text = path.read_text().replace('{ kind = "box" }', '{ kind = "plugin_that_writes:Mine" }')
    path.write_text(text.replace("seeds = [0, 1]", "seeds = [770177017]"))
    yield path
    sys.modules.pop("plugin_that_writes", None)


def refused(result):
    return result.exit_code == 2 and CHANGED in result.output


def test_rendered_sequences_are_not_handed_to_a_script(suite, tmp_path):
    with pytest.raises(UserError, match=CHANGED):
        ub.render(suite, out=tmp_path / "out")
    assert len(ub.render(suite, out=tmp_path / "out")) == 1


@pytest.mark.usefixtures("in_process")
def test_a_study_writes_no_table(suite, tmp_path):
    out = tmp_path / "out"
    command = ["sensitivity", str(suite), "--tracker", "mine", "--out", str(out), "--jobs", "1"]
    assert refused(CliRunner().invoke(main, command))
    assert not (out / "sensitivity.md").exists()
    again = CliRunner().invoke(main, command)
    assert again.exit_code == 0, again.output
    assert (out / "sensitivity.md").exists()


def test_no_package_is_written(suite, tmp_path):
    def pack():
        return packed(suite, tmp_path / "participants", "--truth", tmp_path / "kept", "--private-suite")

    assert refused(pack())
    assert not (tmp_path / "participants").exists()
    assert pack().exit_code == 0


def test_an_interrupt_leaves_nothing_fresh_that_was_made_of_both_contents(suite, tmp_path):
    """With the first content again its hash would be that of a result."""
    planned = partial(plan, load_suite(suite), tmp_path / "out", "render")
    jobs = planned()
    with pytest.raises(KeyboardInterrupt), disowned_if_ended(jobs, planned):
        outcome = run_graph(jobs, InProcess())
        assert outcome.done == jobs and all(job.fresh for job in jobs)
        raise KeyboardInterrupt
    (tmp_path / "given.txt").write_text("edited in the middle")
    assert not any(job.fresh for job in planned())


@pytest.mark.usefixtures("in_process")
def test_results_that_were_disowned_are_neither_compared_nor_read(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace("seeds = [0, 1]", "seeds = [0]"))
    out = tmp_path / "out"
    assert bring_up_to("score", str(path), out, ExecutionOptions()) == 0
    assert len(ub.load_scores(out)) == 1 and not read_side(out).faults
    next(job for job in plan(load_suite(path), out) if job.verb == "score").place.disown()
    with pytest.raises(UserError, match=r"score\.json: made of inputs that changed meanwhile.*run the suite again"):
        ub.load_scores(out)
    assert ["run the suite again" in why for why in read_side(out).faults.values()] == [True]


@pytest.mark.usefixtures("in_process")
def test_scores_of_earlier_inputs_are_neither_compared_nor_read(tmp_path, monkeypatch):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    (tmp_path / "tracker_that_breaks.py").write_text(BREAKS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{':'.join(path for path in sys.path if path)}")
    good = SMALL.replace("seeds = [0, 1]", "seeds = [0]") + 'mine = { kind = "hold" }\n'
    broken = good.replace('mine = { kind = "hold" }', 'mine = { kind = "tracker_that_breaks:Breaks" }')

    def scored(text, verb="score"):
        path.write_text(text)
        return bring_up_to(verb, str(path), out, ExecutionOptions())

    def stale():
        with pytest.raises(UserError, match=r"score\.json: made of inputs that changed.*run the suite again"):
            ub.load_scores(out)
        return {run for run, _, _ in read_side(out).faults}

    smaller = good.replace("width = 160", "width = 120")
    assert scored(good) == 0 and len(ub.load_scores(out)) == 2
    assert scored(broken) != 0 and stale() == {"mine@15hz"}, "a tracker that fails since"
    assert scored(broken, "report") != 0
    assert dict(ub.load_scores(out)[["tracker", "status"]].to_numpy()) == {"hold": "complete", "mine": "missing"}
    assert [run.name for run in ub.load_runs(out)] == ["hold@15hz"]
    assert scored(good.replace('mine = { kind = "hold" }', "")) == 0
    assert [*ub.load_scores(out).tracker] == ["hold"], "the suite has it no more, though the report still tells it"
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("uavbench.bench.runner.commands.run_graph", interrupted)
        scored(smaller)
    assert stale() == {"hold@15hz", "mine@15hz"}, "of a run that was interrupted"
    assert scored(good) == 0 and len(ub.load_scores(out)) == 2 and not read_side(out).faults
    assert scored(smaller, "render") == 0
    assert stale() == {"hold@15hz", "mine@15hz"}, "of sequences that were rendered anew"
    shutil.rmtree(out / "made" / "results")
    assert scored(good, "render") == 0
    assert not read_side(out).faults, "no job made them: they are those of `compare`"


@pytest.mark.usefixtures("in_process")
def test_scores_of_earlier_inputs_are_not_read_after_a_shard_or_a_script_made_some_of_the_new_ones(tmp_path):
    """Scores of two trackers under one name were compared as those of one, and read as current."""
    path, out = tmp_path / "small.toml", tmp_path / "out"

    def scored(shard=""):
        assert bring_up_to("score", str(path), out, ExecutionOptions(shard=shard)) == 0
        return [seed for _, _, seed in read_side(out).faults]

    path.write_text(SMALL)
    assert scored() == []
    path.write_text(SMALL.replace('{ kind = "hold" }', '{ kind = "rapid" }'))
    assert scored("1/2") == [1]
    with pytest.raises(UserError, match=r"score\.json: made of inputs that changed.*run the suite again"):
        ub.load_scores(out)
    assert scored("2/2") == [] and len(ub.load_scores(out)) == 2
    assert scored("1/2") == [], "those of the other shard are of the same inputs"
    path.write_text(SMALL.replace("duration_s = 0.3", "duration_s = 0.4"))
    ub.render(path, out)
    assert [seed for _, _, seed in read_side(out).faults] == [0, 1]


@pytest.mark.usefixtures("in_process")
def test_flights_of_earlier_inputs_are_not_compared_after_the_suite_was_replayed(tmp_path):
    """`suite.json` names the flights of the suite as it is now: the gate took those from before for them."""
    path, out = tmp_path / "flown.toml", tmp_path / "out"
    path.write_text(FLOWN)
    assert bring_up_to("fly", str(path), out, ExecutionOptions()) == 0
    assert bring_up_to("render", str(path), out, ExecutionOptions()) == 0
    assert read_side(out).is_flown and not read_side(out).faults
    path.write_text(FLOWN.replace("duration_s = 0.3", "duration_s = 0.4"))
    assert bring_up_to("render", str(path), out, ExecutionOptions()) == 0
    side = read_side(out)
    assert not side.runs and {run for run, _, _ in side.faults} == {"hold@15hz", "truth@15hz"}


@pytest.mark.usefixtures("in_process")
def test_a_page_of_an_earlier_run_is_told_where_a_run_ends_without_a_report(tmp_path, capsys):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    good = SMALL.replace("seeds = [0, 1]", "seeds = [0]")
    for text, told in ((good, False), (good.replace("camera =", "mount = { yaw_deg = 180.0 }\ncamera ="), True)):
        path.write_text(text)
        code = bring_up_to("report", str(path), out, ExecutionOptions())
        said = capsys.readouterr()
        assert (code != 0, f"no report: {out / 'index.html'} is that of an earlier run" in said.err) == (told, told)
        assert (f"report: {out / 'index.html'}\n" in said.out) != told


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("verb", ["score", "render", "shard"])
def test_a_page_of_other_scores_is_told_by_commands_that_write_none(tmp_path, capsys, verb):
    """The suite loses a tracker, and then its flights change."""
    path, out = tmp_path / "small.toml", tmp_path / "out"
    both = SMALL.replace("seeds = [0, 1]", "seeds = [0]") + 'vo = { kind = "vo" }\n'
    one = both.replace('vo = { kind = "vo" }\n', "")
    longer = one.replace("duration_s = 0.3", "duration_s = 0.4")
    shard = ExecutionOptions(shard="1/1" if verb == "shard" else "")
    anew = f"no report: {out / 'index.html'} is that of an earlier run; `uavbench report {path} --out {out}` writes it"
    for text, told in ((both, False), (one, True), (longer, True)):
        path.write_text(both)
        assert bring_up_to("report", str(path), out, ExecutionOptions()) == 0
        path.write_text(text)
        capsys.readouterr()
        assert bring_up_to("report" if verb == "shard" else verb, str(path), out, shard) == 0
        assert (anew in capsys.readouterr().err) == told
        done = CliRunner().invoke(main, ["tables", str(out)])
        assert (done.exit_code != 0) == told, done.output


@pytest.mark.usefixtures("in_process")
def test_a_page_of_other_flights_is_told_by_commands_that_write_none(tmp_path, capsys):
    path, out = tmp_path / "flown.toml", tmp_path / "out"
    path.write_text(FLOWN)
    assert bring_up_to("fly", str(path), out, ExecutionOptions()) == 0
    one = FLOWN.replace('hold = { kind = "hold" }\n', "")
    later = FLOWN.replace("ms = 20.0", "ms = 30.0")
    for text, verb, shard, told in (
        (FLOWN, "fly", "1/1", False),
        (later, "render", "", True),
        (one, "fly", "1/1", True),
    ):
        path.write_text(text)
        capsys.readouterr()
        assert bring_up_to(verb, str(path), out, ExecutionOptions(shard=shard)) == 0
        assert (f"no report: {out / 'index.html'} is that of an earlier run" in capsys.readouterr().err) == told, text


def test_shards_are_submitted_all_or_run_one_by_one(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    with pytest.raises(UserError, match="--slurm 2 submits every shard: leave out --shard 1/2"):
        bring_up_to("score", str(path), tmp_path / "out", ExecutionOptions(slurm=2, shard="1/2"))
    assert not (tmp_path / "out").exists()


def interrupted(*_):
    raise KeyboardInterrupt


@pytest.mark.usefixtures("in_process")
def test_runs_that_the_suite_no_longer_has_are_not_read(tmp_path):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    for text in (SMALL + 'mine = { kind = "hold" }\n', SMALL.replace("[0, 1]", "[0]")):
        path.write_text(text)
        assert bring_up_to("score", str(path), out, ExecutionOptions()) == 0
    assert ub.load_scores(out)[["sequence", "tracker"]].to_numpy().tolist() == [["box-s0", "hold"]]
    assert [run.name for run in ub.load_runs(out)] == ["hold@15hz"]
    (out / "suite.json").unlink()
    assert len(ub.load_scores(out)) == 4, "of a folder without a description all count"


def test_scores_without_a_record_are_read(tmp_path):
    folder = write(tmp_path / "scores", drawn(np.random.default_rng(0), sequences=1, seeds=1), sequences=1, seeds=1)
    assert not read_side(folder).faults
    record = folder / "made" / "results" / "s0-s0" / "lsd@15hz" / "score.json"
    record.parent.mkdir(parents=True)
    record.write_text(json.dumps({"content_hash": "abc", "files": {}}))
    assert not read_side(folder).faults
    record.write_text(json.dumps({"content_hash": "", "files": {}}))
    assert read_side(folder).faults


@pytest.mark.parametrize("how", ["written", "removed"])
def test_files_of_earlier_suites_of_a_process_are_not_named(tmp_path, how):
    """Those of tests that ran before, four or more, were named in place of the one that had changed."""
    earlier = [tmp_path / name for name in "abcd"]
    given = tmp_path / "given.txt"
    for path in (*earlier, given):
        path.write_text(path.name)
        digests.file_digest(path)

    def keys():
        return {"job": digests.file_digest(given), "other": "x"}

    planned = keys()
    for path in earlier:
        if how == "written":
            path.write_text(path.name)
        else:
            path.unlink()
    assert not touched_since(planned, keys, planned).jobs
    given.write_text(given.name)
    found = touched_since(planned, keys, planned)
    assert (found.files, found.jobs) == ((given,), {"job"})


def test_a_file_that_was_removed_is_named(tmp_path):
    given = tmp_path / "given.txt"
    given.write_text("x")

    def keys():
        return {"job": digests.file_digest(given) if given.is_file() else ""}

    planned = keys()
    given.unlink()
    assert touched_since(planned, keys, planned).files == (given,)


def test_files_that_were_written_are_named(tmp_path):
    for name in "abcde":
        (tmp_path / name).write_text(name)
    before = Stamps.of(tmp_path.rglob("*"))
    before.expect_unchanged("so what")
    for name in "abcd":
        (tmp_path / name).write_text(name)
    with pytest.raises(UserError, match="changed while it was in use: a, b, c and 1 more; so what"):
        before.expect_unchanged("so what")


@pytest.mark.usefixtures("in_process")
def test_pages_are_marked_before_the_first_job_as_a_killed_run_marks_none(tmp_path, monkeypatch):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    path.write_text(SMALL)
    assert bring_up_to("report", str(path), out, ExecutionOptions()) == 0
    path.write_text(SMALL.replace('kind = "hold"', 'kind = "vo"'))
    seen = []

    def marked():
        return ["This page is of an earlier run" in page.read_text() for page in out.rglob("*.html")]

    def watched(*given):
        seen.extend(marked())
        return run_graph(*given)

    monkeypatch.setattr(commands, "run_graph", watched)
    assert bring_up_to("report", str(path), out, ExecutionOptions()) == 0
    assert (seen, marked()) == ([True] * 3, [False] * 3)


@pytest.mark.usefixtures("in_process")
def test_faults_of_trackers_are_told_by_commands_that_write_no_report(tmp_path, capsys):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    program = f"{HOLD}{STREAM.format(each='if count == 1: stamp += 1')}"
    (tmp_path / "program.py").write_text(program)
    mine = 'mine = { kind = "external", command = ["python3", "program.py"] }\n'
    path.write_text(SMALL.replace("seeds = [0, 1]", "seeds = [0]") + mine)
    for _ in range(2):  # the second run finds it fresh
        assert bring_up_to("score", str(path), out, ExecutionOptions()) == 0
        said = capsys.readouterr().err
        assert "crashed: track box-s0 mine@15hz counts as failed, for 1 fault: [unknown-stamp] frame 1" in said
        assert said.count("crashed:") == 1
