"""Numbers of a tracker's config are set from a suite, and varied one at a time."""

import csv
import math
from contextlib import nullcontext
from dataclasses import replace

import pytest
from click.testing import CliRunner

from tests.bench.small_suites import small_suite
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.graph import Job, Outcome
from uavbench.bench.sensitivity.study import Change, Variant, of_no_variant, write
from uavbench.bench.sensitivity.variants import Value, changed, values_of
from uavbench.reports.run_folder import load_scores
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.shang_shen.lsd import Lsd
from uavbench.trajectories.errors import UserError

MINE = '[trackers.mine]\nkind = "robust"\n'


def test_a_suite_sets_one_value_and_the_rest_stays(tmp_path):
    more = f"{MINE}[trackers.mine.config.solver.estimator]\npatches_prior_part = 1\ncoarse_widths_px = [2.0]\n"
    mine = load_suite(small_suite(tmp_path, more)).trackers["mine"]
    assert mine.config.solver.estimator.patches_prior_part == 1.0
    assert mine == changed(
        changed(Robust(), "config.solver.estimator.patches_prior_part", 1.0),
        "config.solver.estimator.coarse_widths_px",
        (2.0,),
    )
    assert content_hash(mine) != content_hash(Robust())


@pytest.mark.parametrize(
    ("table", "line", "told"),
    [
        ("motion", "memory = 2.0", r"trackers.mine.config.motion.memory: unknown key; did you mean 'memory_s'"),
        ("motion", "memory_s = 0.0", r"trackers.mine.config.motion.memory_s: input should be greater than 0, got 0"),
        ("loss", "slow_s = 0.3", r"trackers.mine.config.loss.slow_s: unknown key"),
        ("edge", "x = 1", r"trackers.mine.config.edge: unknown key; did you mean 'edges'"),
        ("budget", "evaluations = 2.5", r"budget.evaluations: input should be a valid integer"),
        ("solver.estimator", "coarse_widths_px = [2, -1]", r"coarse_widths_px\[1\]: input should be greater than 0"),
    ],
)
def test_a_mistake_in_a_value_names_its_key(tmp_path, table, line, told):
    with pytest.raises(UserError, match=told):
        load_suite(small_suite(tmp_path, f"{MINE}[trackers.mine.config.{table}]\n{line}\n"))


def test_every_value_of_robust_is_varied_within_its_bounds(tmp_path):
    values = list(values_of(Robust()))
    assert len({value.path for value in values}) == len(values) > 30
    for value in values:
        made = [value.scaled(factor) for factor in (0.5, 2.0)]
        assert any(m is not None for m in made), value.path
        for m in made:
            if m is not None:
                table, _, key = value.path.rpartition(".")
                text = f"{MINE}[trackers.mine.{table}]\n{key} = {list(m) if isinstance(m, tuple) else m}\n"
                assert load_suite(small_suite(tmp_path, text)).trackers["mine"] == changed(Robust(), value.path, m)


def test_a_study_tables_what_changes_and_goes_on_where_it_was_ended(tmp_path, monkeypatch):
    suite, out = small_suite(tmp_path, MINE), tmp_path / "out"
    suite.write_text(suite.read_text().replace("seeds = [0, 1]", "seeds = [0]"))
    values = ("config.edges.sampling.spacing_px", "config.relocalization.similarity.share")
    command = ["sensitivity", str(suite), "--tracker", "mine", "--out", str(out), "--jobs", "1"]
    command += [word for value in values for word in ("--value", value)]
    first = CliRunner().invoke(main, command)
    assert first.exit_code == 0, first.output
    rows = list(csv.DictReader((out / "sensitivity.csv").open()))
    assert [(row["value"], row["factor"]) for row in rows] == [(v, f) for v in values for f in ("0.5", "2")]
    assert all(row["runs"] == "1" for row in rows)
    assert rows[0]["runs_changed"] == "1", "twice as many control points give another pose"
    assert [row["runs_changed"] for row in rows[2:]] == ["0", "0"], "rivals are looked for at slow rates"
    assert "No run responds to: `config.relocalization.similarity.share`." in (out / "sensitivity.md").read_text()
    table = {name: (out / name).read_bytes() for name in ("sensitivity.md", "sensitivity.csv")}
    again = CliRunner().invoke(main, command)
    assert again.exit_code == 0, again.output
    assert "0 jobs done" in again.output
    assert {name: (out / name).read_bytes() for name in table} == table
    assert len(load_scores(out)) == 5
    suite.write_text(suite.read_text().replace("duration_s = 0.3", "duration_s = 0.4"))
    monkeypatch.setattr("uavbench.bench.sensitivity.study.run_graph", interrupted)
    assert CliRunner().invoke(main, command).exit_code != 0
    with pytest.raises(UserError, match=r"made of inputs that changed.*run the suite again"):
        load_scores(out)


def interrupted(*_):
    raise KeyboardInterrupt


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Runs a study of `lsd` without rendering or tracking anything."""
    failed = lambda jobs, *pool: Outcome(failed={job.name: "of this test" for job in jobs})  # noqa: E731
    monkeypatch.setattr("uavbench.bench.sensitivity.study.run_graph", failed)
    monkeypatch.setattr("uavbench.bench.sensitivity.study.of_no_variant", lambda *_: [])
    monkeypatch.setattr("uavbench.bench.sensitivity.study.local_pool", lambda workers: nullcontext(()))
    suite, out = small_suite(tmp_path, '[trackers.lsd]\nkind = "lsd"\n'), tmp_path / "out"

    def run(value="passes"):
        command = ["sensitivity", str(suite), "--tracker", "lsd", "--value", value, "--out", str(out), "--jobs", "1"]
        return CliRunner().invoke(main, command)

    return run


def test_a_table_is_that_of_the_latest_study_or_of_none(tmp_path, study, monkeypatch):
    out = tmp_path / "out"
    assert study().exit_code == 1
    assert "`passes`" in (out / "sensitivity.md").read_text()
    assert study("search_px").exit_code == 1
    assert "`search_px`" in (out / "sensitivity.md").read_text()
    assert "search_px" in (out / "sensitivity.csv").read_text()

    def ended(*_):
        raise UserError("an input was written")

    monkeypatch.setattr("uavbench.bench.sensitivity.study.refuse_touched", ended)
    assert study("passes").exit_code == 2
    assert not list(out.glob("sensitivity.*v")) and not list(out.glob("*.md")), "no table of other results"


@pytest.mark.parametrize(("begins", "traceback", "tables"), [
    ("render box-s0", True, False), ("track box-s0 default@", True, False), ("track box-s0 passes-x2@", False, False),
    ("track box-s0 passes-x2@", True, True),
])  # fmt: skip
def test_no_table_is_made_of_runs_that_failed_for_another_reason_than_the_value(
    tmp_path, study, monkeypatch, begins, traceback, tables
):
    """As on a full disk: the variants would have lost all frames, and no run have responded to any value."""

    def failed(jobs, *_):
        name = next(job.name for job in jobs if job.name.startswith(begins))
        return Outcome(failed={name: "No space left on device"}, tracebacks={name: "Traceback"} if traceback else {})

    def no_score(suite, variant, folder, done):
        return Change(variant, 1, 0, 0.0, 1.0)

    monkeypatch.setattr("uavbench.bench.sensitivity.study.of_no_variant", of_no_variant)
    monkeypatch.setattr("uavbench.bench.sensitivity.study.run_graph", failed)
    monkeypatch.setattr("uavbench.bench.sensitivity.study.change", no_score)
    done = study()
    assert done.exit_code == 1
    assert (tmp_path / "out" / "sensitivity.md").exists() == tables
    assert (f"no table: {begins}" in done.output) == (not tables), done.output


def test_a_value_with_which_a_tracker_refuses_to_start_is_a_loss_of_the_variant_alone(tmp_path):
    """`start` that raises is told as a mistake of the input; no table would ever be made."""
    jobs = [
        Job(verb="track", name=f"track box-s0 {label}@3hz", work=print, marker=tmp_path, content_hash="")
        for label in ("default", "passes-x2")
    ]
    default, variant = (job.name for job in jobs)
    start = "Own cannot be started: ValueError: passes"
    assert of_no_variant(jobs, Outcome(failed={variant: start}, mistakes={variant})) == []
    both = Outcome(failed={default: start, variant: start}, mistakes={default, variant})
    assert of_no_variant(jobs, both) == [default]


def test_the_error_of_a_variant_that_loses_all_is_not_available(tmp_path):
    (value,) = (each for each in values_of(Lsd()) if each.path == "passes")
    lost = Change(Variant(value, 0.5, 2), runs=2, runs_changed=2, success=-1.0, error_ratio=math.nan)
    half = replace(lost, variant=Variant(value, 2.0, 6), success=0.005, error_ratio=1.25)
    first, second = write(tmp_path, [half, lost]).read_text().splitlines()[2:4]
    assert first == "| `passes` | 3 | 2 | 2 of 2 | -100.0 | n/a |"
    assert second == "| `passes` | 3 | 6 | 2 of 2 | +0.5 | +25.0 |"


@pytest.mark.parametrize("name", ["sensitivity.md", "sensitivity.csv"])
def test_an_edited_table_is_refused_before_anything_runs(tmp_path, study, monkeypatch, name):
    path = tmp_path / "out" / name
    assert study().exit_code == 1
    path.write_text("notes")
    monkeypatch.setattr("uavbench.bench.sensitivity.study.run_graph", lambda *_: pytest.fail("ran"))
    again = study("search_px")
    assert again.exit_code == 2 and str(path) in again.output, again.output
    assert path.read_text() == "notes"


def test_a_second_study_in_a_folder_in_use_is_refused(tmp_path, study, monkeypatch):
    second = []
    monkeypatch.setattr(
        "uavbench.bench.sensitivity.study.run_graph",
        lambda jobs, *pool: second.append(study("search_px")) if not second else pytest.fail("two ran at once"),
    )
    study()
    assert second[0].exit_code == 2 and "another uavbench process uses it" in second[0].output


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--tracker", "mien"), "has no tracker 'mien'"),
        (("--tracker", "hold"), "has no numbers to vary"),
        (("--tracker", "mine", "--value", "config.edge"), "has no value 'config.edge'"),
    ],
)
def test_what_is_not_there_cannot_be_studied(tmp_path, options, told):
    suite = small_suite(tmp_path, MINE)
    result = CliRunner().invoke(main, ["sensitivity", str(suite), "--out", str(tmp_path / "out"), *options])
    assert result.exit_code == 2
    assert told in result.output + (result.stderr if result.stderr_bytes else "")


def test_values_that_differ_in_capitals_alone_have_runs_of_their_own():
    labels = [Variant(Value(path, 1.0, ()), 2.0, 2.0).label for path in ("k", "K", "a_b", "aB", "a.b_c")]
    assert labels == ["k-x2", "+k-x2", "a-b-x2", "a+b-x2", "a.b-c-x2"]
