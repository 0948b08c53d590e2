"""The gate: verdicts on drawn scores, its statistics against closed forms, its reports."""

import json
import shutil
import time
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_this_process
from tests.bench.drawn_scores import drawn, summary, write
from tests.bench.small_suites import small_suite
from uavbench.bench.cli.gate import share
from uavbench.bench.cli.main import main
from uavbench.bench.gate import findings
from uavbench.bench.gate.baseline import write_baseline
from uavbench.bench.gate.decision import Margins, gate, overall, share_finding
from uavbench.bench.gate.findings import HEADER, cells, percent, to_junit, to_markdown, to_text
from uavbench.bench.gate.paired_scores import PairedValues, read_side
from uavbench.reports.scoring.score import PoseErrors
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder


@pytest.fixture(autouse=True)
def jobs_in_this_process(monkeypatch):
    monkeypatch.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)


@pytest.fixture
def sides(tmp_path):
    rng = np.random.default_rng(0)

    def make(head, base=None, **size):
        base = drawn(rng, **size) if base is None else base
        return write(tmp_path / "head", head(rng) if callable(head) else head, **size), write(
            tmp_path / "base", base, **size
        )

    return make


def verdicts(findings):
    return {f.metric: f.verdict for f in findings}


def test_the_same_again_passes(sides):
    findings = gate(*sides(lambda rng: drawn(rng)))
    assert set(verdicts(findings).values()) == {"pass"}
    assert overall(findings) == "pass"


def test_a_regression_fails_with_its_size_told(sides):
    findings = gate(*sides(lambda rng: drawn(rng, factor=1.2)))
    (ate,) = [f for f in findings if f.metric == "ATE"]
    assert ate.verdict == "fail"
    assert ate.low < 0.2 < ate.high
    assert ate.low > 0.15
    assert overall(findings) == "fail"
    assert verdicts(findings)["ATE rotation"] == "pass"


def test_a_run_that_broke_by_chance_does_not_hide_what_happened_to_all_others(sides):
    size = {"sequences": 10, "seeds": 10}
    base = drawn(np.random.default_rng(1), **size)
    broke = PoseErrors(translation_m=summary(1.0), rotation_deg=summary(1.0))
    base[0] = replace(base[0], ate={"none": broke})
    findings = gate(*sides(lambda rng: drawn(rng, factor=1.05, **size), base, **size))
    assert verdicts(findings)["ATE"] != "fail"
    (typical,) = [f for f in findings if f.metric == "ATE, typical"]
    assert typical.verdict == "fail"
    assert 0.03 < typical.change < 0.06


def test_an_improvement_passes(sides):
    assert overall(gate(*sides(lambda rng: drawn(rng, factor=0.5)))) == "pass"


def test_a_margin_tolerates(sides):
    assert overall(gate(*sides(lambda rng: drawn(rng, factor=1.05)), Margins(error=0.15, resolution=0.2))) == "pass"


def test_few_seeds_are_inconclusive(sides):
    findings = gate(*sides(lambda rng: drawn(rng, factor=1.2, seeds=4), seeds=4))
    assert set(verdicts(findings).values()) == {"inconclusive"}
    assert "4 seeds are too few" in findings[0].reason


def test_a_wide_interval_is_inconclusive(sides):
    findings = gate(*sides(lambda rng: drawn(rng, spread=0.6)))
    assert verdicts(findings)["ATE"] == "inconclusive"
    assert overall(findings) == "inconclusive"


def test_missing_and_undefined_fail(sides, tmp_path):
    rng = np.random.default_rng(1)
    scores = drawn(rng)
    undefined = [replace(scores[0], ate={"none": PoseErrors(translation_m=None, rotation_deg=summary(1.0))})]
    findings = gate(*sides(undefined + scores[1:]))
    assert verdicts(findings)["ATE"] == "fail"
    assert "s0, seed 0" in next(f for f in findings if f.metric == "ATE").reason
    (tmp_path / "head" / "results" / "s1-s1" / "lsd@15hz" / "score.json").unlink()
    findings = gate(tmp_path / "head", tmp_path / "base")
    assert set(verdicts(findings).values()) == {"fail"}
    assert "results" in findings[0].reason


def test_a_hole_in_the_baseline_fails_too(sides, tmp_path):
    folders = sides(lambda rng: drawn(rng))
    (tmp_path / "base" / "results" / "s1-s1" / "lsd@15hz" / "score.json").unlink()
    findings = gate(*folders)
    assert overall(findings) == "fail"
    assert "baseline" in findings[0].reason


def test_a_damaged_score_fails_and_is_no_crash(sides, tmp_path):
    folders = sides(lambda rng: drawn(rng))
    (tmp_path / "head" / "results" / "s1-s1" / "lsd@15hz" / "score.json").write_text('{"label": NaN')
    assert overall(gate(*folders)) == "fail"


@pytest.mark.parametrize("rmse", [-1.0, 1e999])
def test_an_error_that_is_none_fails_and_is_no_crash(sides, tmp_path, rmse):
    folders = sides(lambda rng: drawn(rng))
    path = tmp_path / "head" / "results" / "s1-s1" / "lsd@15hz" / "score.json"
    score = json.loads(path.read_text())
    del score["made_by"]
    score["ate"]["none"]["translation_m"]["rmse"] = rmse
    path.write_text(json.dumps(score))
    assert overall(gate(*folders)) == "fail"


def test_lost_coverage_fails_even_where_errors_shrink(sides):
    findings = gate(*sides(lambda rng: drawn(rng, factor=0.5, coverage=0.9, status="lost")))
    assert verdicts(findings)["coverage"] == "fail"
    small = gate(*sides(lambda rng: drawn(rng, factor=0.5, coverage=0.995, status="lost")))
    assert verdicts(small)["coverage"] == "pass"


def test_one_sequence_lost_in_all_seeds_fails(sides):
    def head(rng):
        scores = drawn(rng)
        return [replace(s, tracking=replace(s.tracking, coverage=0.5)) if "s2" in s.sequence else s for s in scores]

    assert verdicts(gate(*sides(head)))["coverage"] == "fail"


def test_a_new_crash_fails_with_its_reason(sides):
    def head(rng):
        scores = drawn(rng)
        return [replace(scores[0], status="crashed", errors=("frame 3: ZeroDivisionError",)), *scores[1:]]

    findings = gate(*sides(head))
    assert verdicts(findings)["coverage"] == "fail"
    assert "ZeroDivisionError" in findings[0].reason


def test_the_same_flight_rendered_otherwise_is_refused(sides):
    def head(images):
        def seen(score):
            return replace(score, record={**score.record, "sequence": {**score.record["sequence"], "images": images}})

        return lambda rng: [seen(score) for score in drawn(rng)]

    gate(*sides(head("mesa"), base=head("mesa")(np.random.default_rng(0))))
    gate(*sides(head("mesa")))  # a score from before images were looked at
    with pytest.raises(UserError, match="images differ: another GL driver"):
        gate(*sides(head("gpu"), base=head("mesa")(np.random.default_rng(0))))


def test_runs_that_start_otherwise_are_refused(sides):
    """A coarser guess of the first pose was called a tracker that became worse."""

    def started(kind, **parameters):
        record = {"results": {"start": {"kind": kind, "parameters": parameters}}}
        return lambda rng: [replace(score, record={**score.record, **record}) for score in drawn(rng)]

    base = started("CoarseGuess", angle_deg=10.0, file="/base/init.toml")(np.random.default_rng(0))
    gate(*sides(started("CoarseGuess", angle_deg=10.0, file="/head/init.toml", more=1), base=base))
    gate(*sides(lambda rng: drawn(rng), base=base))  # a score from before starts were noted
    for other in (started("Known"), started("CoarseGuess", angle_deg=20.0)):
        with pytest.raises(UserError, match=r"starts otherwise in the baseline.*score both with the same `start`"):
            gate(*sides(other, base=base))


def test_other_frames_or_another_way_of_scoring_are_refused(sides):
    with pytest.raises(UserError, match="different frames"):
        gate(*sides(lambda rng: drawn(rng, frames="g")))

    def head(rng):
        return [replace(s, record={**s.record, "std_ddof": 1}) for s in drawn(rng)]

    with pytest.raises(UserError, match="std_ddof"):
        gate(*sides(head))


def test_latency_of_interleaved_runs(sides, tmp_path):
    folders = sides(lambda rng: drawn(rng))
    rows = [
        {"sequence": f"s{i}", "seed": k, "base_ms": 10.0, "head_ms": 12.0 + 0.01 * k}
        for i in range(4)
        for k in range(5)
    ]
    (tmp_path / "head" / "timing.json").write_text(json.dumps({"runs": {"lsd@15hz": rows}}))
    assert verdicts(gate(*folders))["latency"] == "fail"
    rows[0]["head_ms"] = float("nan")
    (tmp_path / "head" / "timing.json").write_text(json.dumps({"runs": {"lsd@15hz": rows}}))
    assert verdicts(gate(*folders))["latency"] == "fail"
    (tmp_path / "head" / "timing.json").write_text("[]")
    with pytest.raises(UserError, match="timing"):
        gate(*folders)


def test_latencies_are_not_compared_with_another_baseline_than_they_were_measured_with(sides, tmp_path):
    head, base = sides(lambda rng: drawn(rng))
    rows = [{"sequence": f"s{i}", "seed": k, "base_ms": 10.0, "head_ms": 12.0} for i in range(4) for k in range(5)]
    (head / "timing.json").write_text(json.dumps({"runs": {"lsd@15hz": rows}}))
    other = shutil.copytree(base, tmp_path / "other")
    assert verdicts(gate(head, base))["latency"] == "fail"
    assert "latency" not in verdicts(gate(head, other))


def test_command_and_reports(sides, tmp_path):
    head, base = sides(lambda rng: drawn(rng, factor=1.2))
    result = CliRunner().invoke(main, ["gate", str(head), "--baseline", str(base), "--margin", "5%"])
    assert result.exit_code == 1, result.output
    assert "gate: fail" in result.output
    about = json.loads((head / "gate" / "gate.json").read_text())
    assert about["verdict"] == "fail"
    assert about["margins"]["error"] == 0.05
    suite = ET.parse(head / "gate" / "gate.xml").getroot()
    assert suite.get("failures") == str(sum(f["verdict"] == "fail" for f in about["findings"]))
    failed = {case.get("name") for case in suite.iter("testcase") if case.find("failure") is not None}
    assert failed == {f["metric"] for f in about["findings"] if f["verdict"] == "fail"}
    assert "| lsd@15hz | ATE |" in (head / "gate" / "gate.md").read_text()
    assert CliRunner().invoke(main, ["gate", str(base), "--baseline", str(base)]).exit_code == 0
    for bad in ("x", "-1%", "nan"):
        assert CliRunner().invoke(main, ["gate", str(base), "--baseline", str(base), "--margin", bad]).exit_code == 2
    assert CliRunner().invoke(main, ["gate", str(tmp_path / "no"), "--baseline", str(base)]).exit_code == 2


@pytest.mark.parametrize("ending", ["baseline", "results", "record"])
def test_a_gate_without_a_verdict_leaves_none_of_an_earlier_one(sides, tmp_path, ending):
    head, base = map(str, sides(drawn))
    out = tmp_path / "ci"
    assert CliRunner().invoke(main, ["gate", head, "--baseline", base, "--out", str(out)]).exit_code == 0
    (out / "mine.md").write_text("notes")
    (tmp_path / "history.json").write_text("{}")
    again = {
        "baseline": [head, "--baseline", str(tmp_path / "gone")],
        "results": [str(tmp_path / "gone"), "--baseline", base],
        "record": [head, "--baseline", base, "--record", str(tmp_path / "history.json")],
    }[ending]
    result = CliRunner().invoke(main, ["gate", *again, "--out", str(out)])
    assert result.exit_code == 2, result.output
    assert [path.name for path in out.iterdir()] == ["mine.md"]


@pytest.mark.parametrize("change", ["tracker", "seeds", "render"])
def test_a_run_that_makes_scores_anew_leaves_no_verdict_on_earlier_ones(tmp_path, change):
    suite, out = small_suite(tmp_path), tmp_path / "out"
    text = suite.read_text()

    def call(*words):
        return CliRunner().invoke(main, [*map(str, words)])

    assert call("score", suite, "--out", out).exit_code == 0
    shutil.copytree(out, tmp_path / "base")
    assert call("gate", out, "--baseline", tmp_path / "base").exit_code == 3
    (out / "gate" / "mine.md").write_text("notes")
    pictures = sorted(path.name for path in (out / "gate" / "worst").iterdir())
    (out / "gate" / "worst" / "mine.png").write_text("a picture")
    assert pictures
    assert call("score", suite, "--out", out).exit_code == 0
    assert (out / "gate" / "gate.md").is_file(), "nothing was made anew"
    changed = {
        "tracker": (text.replace('kind = "hold"', 'kind = "vo"'), "score"),
        "seeds": (text.replace("seeds = [0, 1]", "seeds = [0]"), "score"),
        "render": (text.replace("duration_s = 0.3", "duration_s = 0.4"), "render"),
    }[change]
    assert changed[0] != text
    suite.write_text(changed[0])
    result = call(changed[1], suite, "--out", out)
    assert result.exit_code == 0, result.output
    kept = sorted(path.relative_to(out / "gate").as_posix() for path in (out / "gate").rglob("*.*"))
    assert kept == ["mine.md", "worst/mine.png"]


@pytest.mark.parametrize("anew", ["out", "base"])
def test_scores_that_are_made_anew_leave_no_verdict_on_or_by_them_elsewhere(tmp_path, anew):
    suite, out, base, ci = small_suite(tmp_path), tmp_path / "out", tmp_path / "base", tmp_path / "ci"

    def call(*words):
        return CliRunner().invoke(main, [*map(str, words)]).exit_code

    assert call("score", suite, "--out", out) == 0
    shutil.copytree(out, base)
    for place in ("plain", "edited", "copied", "replaced"):
        assert call("gate", out, "--baseline", base, "--out", ci / place) == 3
    assert call("gate", out, "--baseline", base) == 3
    (ci / "edited" / "gate.json").write_text("{}")
    shutil.copytree(ci / "copied", tmp_path / "copy")
    for folder in ("third", "fourth"):
        shutil.copytree(base, tmp_path / folder)
    assert (
        call("gate", tmp_path / "third", "--baseline", tmp_path / "fourth", "--margin", "9%", "--out", ci / "replaced")
        == 3
    )
    assert call("score", suite, "--out", tmp_path / anew) == 0
    assert len([*tmp_path.rglob("gate.md")]) == 6, "nothing was made anew"
    suite.write_text(suite.read_text().replace('kind = "hold"', 'kind = "vo"'))
    assert call("score", suite, "--out", tmp_path / anew) == 0
    kept = {path.parent.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("gate.json")}
    assert kept == {"ci/edited", "copy", "ci/replaced"}
    assert not (tmp_path / anew / "verdicts.json").exists()


def test_scores_that_are_made_anew_in_a_copy_leave_the_verdicts_on_the_folder_itself(tmp_path):
    suite, base, copy, ci = small_suite(tmp_path), tmp_path / "base", tmp_path / "copy", tmp_path / "ci"

    def call(*words):
        return CliRunner().invoke(main, [*map(str, words)]).exit_code

    assert call("score", suite, "--out", base) == 0
    assert call("gate", base, "--baseline", base, "--out", ci) == 3
    shutil.copytree(base, copy)
    suite.write_text(suite.read_text().replace('kind = "hold"', 'kind = "vo"'))
    assert call("score", suite, "--out", copy) == 0
    assert (ci / "gate.json").exists() and (base / "verdicts.json").exists()
    base.rename(tmp_path / "moved")
    assert call("score", suite, "--out", tmp_path / "moved") == 0
    assert not (ci / "gate.json").exists(), "moved, and no copy"


def test_a_damaged_note_of_verdicts_elsewhere_is_refused_until_it_is_removed(tmp_path):
    suite, out, ci = small_suite(tmp_path), tmp_path / "out", tmp_path / "ci"

    def call(*words):
        return CliRunner().invoke(main, [*map(str, words)])

    assert call("score", suite, "--out", out).exit_code == 0
    assert call("gate", out, "--baseline", out, "--out", ci / "first").exit_code == 3
    note = out / "verdicts.json"
    note.write_text(note.read_text().replace("first", "worst"))
    suite.write_text(suite.read_text().replace('kind = "hold"', 'kind = "vo"'))
    for words in (("gate", out, "--baseline", out, "--out", ci / "second"), ("score", suite, "--out", out)):
        result = call(*words)
        assert result.exit_code == 2
        assert f"{note}: is damaged" in result.output and "remove it, and verdicts of the gate" in result.output
    assert not (ci / "second" / "gate.json").exists()
    note.unlink()
    assert call("score", suite, "--out", out).exit_code == 0
    assert call("gate", out, "--baseline", out, "--out", ci / "second").exit_code == 3


@pytest.mark.usefixtures("sketched")
def test_pages_of_a_report_are_marked_when_its_scores_are_made_anew(tmp_path):
    suite, out = small_suite(tmp_path), tmp_path / "out"
    text = suite.read_text()

    def call(verb):
        assert CliRunner().invoke(main, [verb, str(suite), "--out", str(out)]).exit_code == 0

    def marked():
        return [
            page.name for page in sorted(out.rglob("*.html")) if "This page is of an earlier run" in page.read_text()
        ]

    call("run")
    pages = [page.name for page in sorted(out.rglob("*.html"))]
    call("score")
    assert len(pages) == 3 and marked() == []
    suite.write_text(text.replace('kind = "hold"', 'kind = "vo"'))
    edited = out / "pages" / "box-s1.html"
    edited.write_text(edited.read_text() + "<!-- mine -->")
    call("score")
    assert marked() == [name for name in pages if name != edited.name]
    call("score")
    assert (out / "index.html").read_text().count("This page is of an earlier run") == 1
    edited.unlink()
    suite.write_text(text)
    call("report")
    assert marked() == []
    suite.write_text(text.replace("seeds = [0, 1]", "seeds = [0]"))
    call("render")
    assert "index.html" in marked()


def test_files_of_gates_at_the_same_time_are_of_one_verdict(sides, tmp_path, monkeypatch):
    head, base = sides(lambda rng: drawn(rng, factor=1.2))
    write = findings.write_text

    def slow(path, text, **how):
        time.sleep(0.05)
        write(path, text, **how)

    monkeypatch.setattr(findings, "write_text", slow)
    for first, second in ((0.05, 0.5), (0.5, 0.05)):
        calls = [(head, base, Margins(error=margin, resolution=0.9), tmp_path / "ci") for margin in (first, second)]
        with ThreadPoolExecutor(2) as pool:
            codes = [call.result() for call in [pool.submit(findings.pronounce, *each) for each in calls]]
        assert sorted(codes) == [0, 1]
        kept = json.loads((tmp_path / "ci" / "gate.json").read_text())["verdict"]
        assert f"uavbench gate: {kept}" in (tmp_path / "ci" / "gate.md").read_text()
        failures = ET.parse(tmp_path / "ci" / "gate.xml").getroot().get("failures")
        assert (failures == "0") == (kept == "pass")


def test_no_verdict_is_written_into_a_folder_that_is_checked_as_a_whole(sides, tmp_path):
    head, base = sides(drawn)
    baseline, sequence = tmp_path / "baseline.json", tmp_path / "box-s0"
    write_baseline(read_side(base), baseline)
    with new_folder(sequence, Marker("manifest.json", "sequence")) as new:
        (new / "manifest.json").write_text("{}")
    result = CliRunner().invoke(main, ["gate", str(head), "--baseline", str(baseline), "--out", str(sequence)])
    assert result.exit_code == 2 and "checks as a whole" in result.output
    assert [path.name for path in sequence.iterdir()] == ["manifest.json"]


def test_a_baseline_that_is_not_there_is_told_with_how_to_make_it(sides):
    head, base = sides(drawn)
    with pytest.raises(UserError, match=r"gone\.json: no such baseline; .*--baseline .*gone\.json --update"):
        gate(head, base.parent / "gone.json")


def test_what_is_no_folder_of_results_and_a_run_without_a_score_are_told_as_that(sides, tmp_path):
    head, base = sides(drawn)
    with pytest.raises(UserError, match=r"results: has no suite\.json, as folders of `uavbench run`"):
        gate(head / "results", base)
    next(iter(sorted(head.glob("results/*/*/score.json")))).unlink()
    (why,) = read_side(head).faults.values()
    assert why.endswith("score.json: no such file")


@pytest.mark.parametrize("option", ["--margin", "--latency-margin", "--coverage-margin", "--resolution"])
@pytest.mark.parametrize("command", [["gate", ".", "--baseline", "."], ["compare", "HEAD"]])
def test_a_number_of_one_and_more_must_say_percent(option, command):
    for bad in ("5", "1", "1.0", "0x5", "inf", "1e2"):
        result = CliRunner().invoke(main, [*command, option, bad])
        assert result.exit_code == 2
        assert f"Invalid value for '{option}'" in result.output
    assert "write 5% for 5 percent, or a share below 1" in " ".join(
        CliRunner().invoke(main, [*command, option, "5"], terminal_width=200).output.replace("│", " ").split()
    )


def test_shares_are_read_with_and_without_percent():
    read = {text: share(None, None, text) for text in ("5%", "0.05", "100%", "400 %", "0", "0.99")}
    assert read == {"5%": 0.05, "0.05": 0.05, "100%": 1.0, "400 %": 4.0, "0": 0.0, "0.99": 0.99}


def test_reports_hold_whatever_a_tracker_says(sides):
    def head(rng):
        scores = drawn(rng)
        return [replace(scores[0], status="crashed", errors=("<b>\x00|&\x1b[31m",)), *scores[1:]]

    findings = gate(*sides(head))
    ET.fromstring(to_junit(findings).encode())
    assert to_text(findings)


def suite_json(folder, **changes):
    about = json.loads((folder / "suite.json").read_text())
    (folder / "suite.json").write_text(json.dumps({**about, **changes}))


@pytest.mark.parametrize("changes", [{"trackers": ["lsd", "new"]}, {"rates_hz": [15.0, 5.0]}])
def test_a_tracker_or_rate_that_only_one_side_has_is_no_pass(sides, changes):
    head, base = sides(lambda rng: drawn(rng))
    suite_json(head, **changes)
    name = "new@15hz" if "trackers" in changes else "lsd@5hz"
    (found,) = [f for f in gate(head, base) if f.run == name]
    assert (found.verdict, found.reason) == ("inconclusive", "not judged: the baseline has no such tracker or rate")
    assert overall(gate(head, base)) == "inconclusive"
    assert overall(gate(base, head)) == "fail"


def test_a_sequence_that_only_one_side_has_is_no_pass(sides, tmp_path):
    head, base = sides(lambda rng: drawn(rng))
    for folder, other in ((head, base), (base, head)):
        more = write(tmp_path / f"more-{folder.name}", drawn(np.random.default_rng(0), sequences=5), sequences=5)
        assert overall(gate(more, other)) == "fail"
        assert overall(gate(other, more)) == "fail"


def test_a_metric_that_one_side_lacks_is_no_pass(sides, tmp_path):
    _, base = sides(lambda rng: drawn(rng))
    side = read_side(base)
    for errors, verdict in (
        (lambda e: {k: v for k, v in e.items() if k != "RPE 1 s"}, "fail"),
        (lambda e: {**e, "ADD": 1.0}, "inconclusive"),
    ):
        runs = {key: replace(run, errors=errors(run.errors)) for key, run in side.runs.items()}
        write_baseline(replace(side, runs=runs), tmp_path / "baseline.json")
        assert overall(gate(base, tmp_path / "baseline.json")) == verdict


def test_what_compare_could_not_run_on_the_base_is_no_pass(sides):
    head, base = sides(lambda rng: drawn(rng))
    suite_json(head, not_compared={"new@15hz": "unknown to the base: UserError: unknown tracker"})
    (found,) = [f for f in gate(head, base) if f.run == "new@15hz"]
    assert found.verdict == "inconclusive" and "unknown to the base" in found.reason


def test_a_crash_on_both_sides_is_no_pass(sides):
    def broken(rng):
        return [replace(s, status="crashed", errors=("frame 0: KeyError: 'b'",)) for s in drawn(rng)]

    findings = gate(*sides(broken, base=broken(np.random.default_rng(0))))
    (found,) = [f for f in findings if f.metric == "crashes"]
    assert found.verdict == "inconclusive" and "20 runs crash on both sides" in found.reason
    assert overall(findings) == "inconclusive"


def test_a_tracker_that_throws_on_every_frame_fails(sides):
    def head(rng):
        failed = PoseErrors(translation_m=None, rotation_deg=None, undefined="no frame has a pose")
        return [
            replace(s, status="crashed", errors=("frame 0: KeyError: 'b'",), ate={"none": failed}, rpe={"1 s": failed},
                    tracking=replace(s.tracking, coverage=0.0, with_pose=0))
            for s in drawn(rng)
        ]  # fmt: skip

    findings = gate(*sides(head))
    assert set(verdicts(findings).values()) == {"fail"}
    assert "KeyError" in to_text(findings)


def shown(finding):
    """The numbers of a finding as a reader of the table has them."""
    cell = dict(zip(HEADER, cells(finding), strict=True))
    return [float(cell[name].split()[0].rstrip("%")) for name in ("baseline", "value", "change")]


@pytest.mark.parametrize("factor", [1.0, 0.98, 1.00003, 3.7])
def test_what_is_shown_belongs_together(sides, factor):
    findings = gate(*sides(lambda rng: drawn(rng, factor=factor, spread=0.4, coverage=0.97)))
    for finding in findings:
        if finding.metric.endswith("typical"):
            assert cells(finding)[2:4] == ["-", "-"]
            continue
        baseline, value, change = shown(finding)
        expected = value - baseline if finding.metric == "coverage" else value / baseline - 1
        assert change == pytest.approx(100 * expected, abs=0.012)
    assert "geometric" in to_text(findings) and "arithmetic" in to_markdown(findings)


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.0, "0%"), (-0.0, "0%"), (-1e-12, "0%"), (-2e-6, "-0.00020%"), (1e-5, "+0.0010%"), (-0.0202, "-2.02%"),
     (1.5, "+150.00%"), (float("nan"), "-")],
)  # fmt: skip
def test_a_change_is_never_minus_zero(share, text):
    assert percent(share) == text


def test_the_same_folders_give_the_same_findings(sides):
    folders = sides(lambda rng: drawn(rng))
    first, second = gate(*folders), gate(*folders)
    assert [repr(finding) for finding in first] == [repr(finding) for finding in second]  # no nan equals itself


@pytest.mark.parametrize(("sequences", "told"), [(1, False), (2, True), (4, True), (5, False)])
def test_bounds_of_few_sequences_are_told_to_be_too_narrow(sides, sequences, told):
    """One sequence has Student's t; with five a bootstrap is about as wide as it says."""
    findings = gate(*sides(lambda rng: drawn(rng, sequences=sequences), sequences=sequences))
    for text in (to_text(findings), to_markdown(findings), to_junit(findings)):
        assert (f"over {sequences} sequences, which tell little" in text) == told


@pytest.mark.parametrize("gained", [False, True])
def test_bounds_of_a_loss_of_coverage_are_shares(gained):
    """All is lost, or gained, on one sequence of two: a bootstrap reaches further than a loss can."""
    full, half = (
        {(name, seed): share for name, share in zip("ab", of, strict=True) for seed in range(5)}
        for of in ((1.0, 1.0), (0.0, 1.0))
    )
    found = share_finding("lsd", "coverage", PairedValues(*((half, full) if gained else (full, half))), 0.01)
    assert -1.0 <= found.low <= found.change <= found.high <= 1.0
