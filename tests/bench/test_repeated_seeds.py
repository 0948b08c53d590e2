"""Seeds that change neither frames nor results are no replicates: tables, figures and the gate count them once."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_one_process, sketch
from tests.bench.drawn_scores import drawn, make_score, write
from tests.bench.small_suites import SMALL
from uavbench.bench.cli.main import main
from uavbench.bench.gate.decision import Margins, gate, overall
from uavbench.bench.gate.findings import to_json, to_junit, to_markdown, to_text
from uavbench.bench.gate.paired_scores import PairedValues
from uavbench.reports.comparison_figures import paired
from uavbench.reports.report import ReportInputs, write_scores
from uavbench.reports.run_folder import load_runs
from uavbench.reports.statistics.repeats import Repeats
from uavbench.reports.tables.columns import DETAILS

STILL = (
    SMALL.replace("seeds = [0, 1]", "seeds = [1, 2, 3]")
    .replace('"indoor"', '"studio"')
    .replace('{ kind = "hand-pilot", duration_s = 0.3 }', '{ kind = "hover", duration_s = 0.3 }')
)
SAME = "box: seeds 1, 2 and 3 have the same frames and results, and count as one run: keep one seed, or add what seeds"


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Folder of a suite in which nothing depends on the seed."""
    folder = tmp_path_factory.mktemp("still")
    (folder / "still.toml").write_text(STILL + 'lsd = { kind = "lsd-single" }\n')
    with pytest.MonkeyPatch.context() as patched:
        sketch(patched)
        assert in_one_process("run", folder / "still.toml", "--out", folder / "out").exit_code == 0
    return folder / "out"


def test_the_report_counts_them_once_and_says_so(still):
    summary = (still / "tables" / "summary.md").read_text()
    assert SAME in summary
    assert "One run each: no interval can be given." in summary and "n/a" not in summary.partition("\n\n")[0]
    assert SAME in (still / "index.html").read_text()
    assert len(load_runs(still)) == 6, "none is hidden"
    assert paired(load_runs(still)) == {}, "one observation has no rank"


def test_a_table_of_the_report_counts_them_as_the_report_does(still):
    """Also one with columns of the user's choice, which is made of the report's scores.json."""
    written = {path: (still / "tables" / path).read_text() for path in ("summary.md", "details.md")}
    chosen = ",".join(column.head for column in DETAILS)
    again = CliRunner().invoke(main, ["tables", str(still)]).output
    assert (
        CliRunner().invoke(main, ["tables", str(still), "--columns", chosen]).output.splitlines()[:4]
        == (written["details.md"].splitlines()[:4])
    )
    assert SAME in again and "One run each: no interval can be given." in again
    for line in written["summary.md"].splitlines()[2:4]:
        assert line.removesuffix(" |") in again


def test_a_table_of_the_report_names_the_trackers_that_are_absent(tmp_path):
    inputs = ReportInputs("A title", [], absent={"visp": "not installed"})
    write_scores(tmp_path, inputs, [replace(make_score("s0", seed, 0.01), rpe={}) for seed in range(2)])
    assert "| visp | absent |" in CliRunner().invoke(main, ["tables", str(tmp_path)]).output


def test_the_gate_counts_them_once_and_says_so(still, tmp_path):
    again = shutil.copytree(still, tmp_path / "again")
    findings = gate(again, still)
    assert overall(findings) == "inconclusive"
    assert {finding.seeds for finding in findings} == {1}
    assert "1 seed is too few, 5 are needed; repeats count once" in {finding.reason for finding in findings}
    for text in (to_text(findings), to_markdown(findings), to_junit(findings), to_json(findings, Margins())):
        assert SAME in text
    assert to_text(findings).count(SAME) == 2, "once per tracker"


@pytest.mark.usefixtures("sketched")
def test_seeds_of_a_noisy_camera_are_replicates(tmp_path):
    path = tmp_path / "noisy.toml"
    path.write_text(STILL.replace("camera =", 'effects = [{ kind = "noise" }]\ncamera ='))
    assert in_one_process("run", path, "--out", tmp_path / "out").exit_code == 0
    assert "count as one" not in (tmp_path / "out" / "tables" / "summary.md").read_text()


def with_images(scores, images):
    return [replace(s, record={**s.record, "sequence": {**s.record["sequence"], "images": images(s)}}) for s in scores]


def repeated(factor, seeds=5):
    """Scores of one flight, the same under every seed."""
    scores = [make_score("s0", seed, 0.01 * factor) for seed in range(seeds)]
    return with_images(scores, lambda score: "the same")


def test_one_flight_five_times_decides_nothing(tmp_path):
    base = write(tmp_path / "base", repeated(1.0), sequences=1)
    for name, factor in (("same", 1.0), ("worse", 1.5)):
        head = write(tmp_path / name, repeated(factor), sequences=1)
        findings = gate(head, base)
        assert overall(findings) == "inconclusive"
        assert all(finding.seeds == 1 for finding in findings)


def test_flights_that_differ_are_compared_as_before(tmp_path):
    rng = np.random.default_rng(1)
    plain = drawn(rng)
    base, head = write(tmp_path / "base", plain), write(tmp_path / "head", with_images(plain, lambda s: s.sequence))
    assert overall(gate(head, base)) == "pass"
    assert not any(finding.repeats for finding in gate(head, base))
    assert "repeats" in json.loads(to_json(gate(head, base), Margins()))["findings"][0]


def test_times_of_repeats_are_left_out():
    values = PairedValues({("box", 0): 1.0, ("box", 1): 2.0}, {("box", 0): 1.0, ("box", 1): 3.0}, {("box", 1)})
    left = values.without(Repeats({"box": ((0, 1),)}))
    assert left.base == {("box", 0): 1.0} == left.head and left.undefined == set()
    assert "seeds 0 and 1" in left.repeats
