"""Reports over several sequences and seeds, and over runs that failed in every way."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.reports.drawn import make_sequence, results_of, true_rows
from uavbench.reports.figures.comparison import draw_accuracy_and_coverage
from uavbench.reports.figures.distributions import draw_sweep
from uavbench.reports.figures.sweeps import sweep, swept
from uavbench.reports.report import ReportInputs, write_report
from uavbench.reports.scoring.attributes import blur_px, occlusion
from uavbench.reports.scoring.runs import ReportEntry, ScoredRun
from uavbench.reports.scoring.score import Score, score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.style import house_style
from uavbench.reports.tables.columns import COLUMNS
from uavbench.reports.tables.latex import latex
from uavbench.reports.tables.summary_table import summary_table
from uavbench.reports.tables.writers import markdown
from uavbench.scenes.dataset.annotations import EDGE_COLUMNS, edges_file
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.errors import UserError

LOST = TrackResult(status="lost")


def entry_of(results: Results, sequence: Sequence, folder: Path, label: str) -> ReportEntry:
    record = {**results.record, "label": label, "seed": int(sequence.info["seed"])}
    results = replace(results, record=record)
    results.save(folder)
    score(sequence, results).save(folder / "score.json")
    return ReportEntry(sequence.folder, folder, folder / "score.json")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sequences, two trackers of known errors, one that loses every frame, one crashed, one missing."""
    base = tmp_path_factory.mktemp("study")
    entries = []
    for name, seed in (("arc", 0), ("bend", 1)):
        sequence = make_sequence(base / "sequences" / name, 12, name=name, seed=seed)
        made = {
            "good": results_of(sequence, true_rows(sequence, 0.01)),
            "fair": results_of(sequence, true_rows(sequence, 0.04)),
            "blind": results_of(sequence, [LOST] * 12),
            "broken": results_of(sequence, true_rows(sequence)[:3]),
        }
        for label, results in made.items():
            entries.append(entry_of(results, sequence, base / "results" / name / f"{label}@15hz", label))
        absent = base / "results" / name / "absent@15hz"
        entries.append(ReportEntry(sequence.folder, absent, absent / "score.json"))
    return write_report(base / "report", ReportInputs("Failures of every kind", entries)).parent


@pytest.mark.slow
def test_failed_and_missing_runs_are_shown_as_failed(study: Path) -> None:
    scores = json.loads((study / "scores.json").read_text())["scores"]
    status = {s["label"]: s["status"] for s in scores}
    expected = {"good": "complete", "fair": "complete", "blind": "lost", "broken": "crashed", "absent": "missing"}
    assert status == expected
    page = (study / "index.html").read_text()
    assert page.index("absent, 15 Hz</strong>") < page.index("blind, 15 Hz</strong>")
    assert 'class="chip missing"' in page and 'class="chip crashed"' in page
    assert "good, 15 Hz</strong>" not in page
    rows = {row["tracker"]: row for row in csv.DictReader((study / "tables" / "summary.csv").open())}
    assert float(rows["blind@15hz"]["within 5 cm, 5 deg (%)"]) == 0
    assert float(rows["absent@15hz"]["coverage (%)"]) == 0
    assert rows["absent@15hz"]["ATE position (cm)"] == ""


def test_every_run_is_shown_beside_the_mean(tmp_path: Path) -> None:
    runs = []
    for seed, error_m in enumerate((0.01, 0.02, 0.06)):
        sequence = make_sequence(tmp_path / f"{seed}", 5, name=f"arc-{seed}", seed=seed)
        results = results_of(sequence, true_rows(sequence, error_m))
        runs.append(ScoredRun(sequence, results, score(sequence, results), 0))
    figure = Figure()
    drawn = draw_accuracy_and_coverage(runs, figure)
    each, mean, *_ = figure.axes[0].lines
    np.testing.assert_allclose(each.get_ydata(), [1.0, 2.0, 6.0], rtol=1e-9)
    np.testing.assert_allclose(mean.get_ydata(), [3.0], rtol=1e-9)
    assert drawn.rows[0][2] == 3 and drawn.rows[0][3] == pytest.approx(3.0)
    assert not any(panel.patches for panel in figure.axes)  # a bar has no honest foot on a logarithmic axis


@pytest.mark.slow
def test_ranks_and_wins_are_drawn_over_sequences(study: Path) -> None:
    ranks = {
        row["tracker"]: float(row["mean_rank"]) for row in csv.DictReader((study / "figures" / "ranks_15hz.csv").open())
    }
    assert ranks["good@15hz"] == 1 and ranks["fair@15hz"] == 2
    assert ranks["absent@15hz"] == ranks["blind@15hz"] == 4.5
    wins = list(csv.DictReader((study / "figures" / "wins_15hz.csv").open()))
    assert float(next(r["wins"] for r in wins if (r["first"], r["second"]) == ("good@15hz", "fair@15hz"))) == 1


def scored(label: str, sequence: str, seed: int, base: Score, cm: float, success: float = 1.0) -> Score:
    ate = base.ate["none"]
    moved = replace(ate, translation_m=replace(ate.translation_m, rmse=cm / 100))
    tracking = replace(base.tracking, success=success)
    return replace(base, label=label, sequence=sequence, seed=seed, ate={**base.ate, "none": moved}, tracking=tracking)


@pytest.fixture(scope="module")
def base_score(sequence: Sequence) -> Score:
    return score(sequence, results_of(sequence, true_rows(sequence, 0.01)))


def test_every_cell_has_its_interval_and_a_clear_winner_its_star(base_score: Score) -> None:
    rng = np.random.default_rng(0)
    scores = []
    for number in range(8):
        for seed in range(5):
            cm = 2 + rng.normal(0, 0.3)
            scores.append(scored("a", f"s{number}", seed, base_score, cm))
            scores.append(scored("b", f"s{number}", seed, base_score, cm + 0.5 + rng.normal(0, 0.1)))
    table = summary_table(score_frame(score.to_json() for score in scores))
    place = [c.head for c in COLUMNS].index("ATE position")
    cells = {name: row[place] for name, row in table.rows}
    assert cells["a@15hz"].best and cells["a@15hz"].significant and not cells["b@15hz"].best
    interval = cells["a@15hz"].interval
    assert interval is not None and interval.low < interval.mean < interval.high and interval.n == 40
    assert r"$^{*}$" in latex(table) and "\\*" in markdown(table) and "[" in markdown(table)


def test_a_lost_tracker_wins_no_error_column(base_score: Score) -> None:
    scores = [scored("lost", "s", 0, base_score, 0.1, success=0.1), scored("good", "s", 0, base_score, 2.0)]
    place = [c.head for c in COLUMNS].index("ATE position")
    cells = {name: row[place] for name, row in summary_table(score_frame(score.to_json() for score in scores)).rows}
    assert not cells["good@15hz"].best and not cells["lost@15hz"].best


def test_a_missing_run_must_tell_what_it_was(sequence: Sequence, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="LABEL@RATEhz"):
        write_report(
            tmp_path, ReportInputs("x", [ReportEntry(sequence.folder, tmp_path / "nothing", tmp_path / "nothing.json")])
        )


def with_config(sequence: Sequence, config: dict[str, object]) -> Sequence:
    return replace(sequence, info={**sequence.info, "config": config})


def noise(well: float, **more: object) -> dict[str, object]:
    return {"name": "x", "seed": 3, "effects": [{"kind": "noise", "full_well_e": well}], **more}


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> list[Sequence]:
    base = tmp_path_factory.mktemp("three")
    return [make_sequence(base / name, 12, name=name, seed=0) for name in ("a", "b", "c")]


def test_a_sweep_is_a_suite_whose_configs_differ_in_one_number(three: list[Sequence]) -> None:
    wells = [with_config(s, noise(w)) for s, w in zip(three, (1e3, 2e3, 4e3), strict=True)]
    found = swept(wells)
    assert found is not None
    assert found.key == "effects[0].full_well_e"
    assert found.values == {"a": 1e3, "b": 2e3, "c": 4e3}
    assert swept(three) is None
    assert swept(wells[:2]) is None
    assert swept([*wells[:2], with_config(three[2], noise(4e3, rate_hz=30.0))]) is None
    words = [with_config(s, noise(1e3, floor=f)) for s, f in zip(three, ("wood", "carpet", "stone"), strict=True)]
    assert swept(words) is None


@pytest.mark.slow
def test_the_curves_of_a_sweep_hold_the_scores(three: list[Sequence], tmp_path: Path) -> None:
    runs = []
    for sequence, offset_m in zip(three, (0.01, 0.02, 0.04), strict=True):
        swept_over = with_config(sequence, noise(100 * offset_m))
        results = results_of(swept_over, true_rows(swept_over, offset_m))
        runs.append(ScoredRun(swept_over, results, score(swept_over, results), 0))
    found = swept([run.sequence for run in runs])
    assert found is not None
    with house_style():
        ate = sweep(runs, found, "ate", tmp_path / "ate")
        success = sweep(runs, found, "success", tmp_path / "success")
    rows = list(csv.DictReader(next(p for p in ate if p.suffix == ".csv").open()))
    assert [float(row["value"]) for row in rows] == [1, 2, 4]
    assert [float(row["mean"]) for row in rows] == pytest.approx([1, 2, 4], rel=1e-6)
    assert all(float(row["mean"]) == 100 for row in csv.DictReader(success[-1].with_suffix(".csv").open()))


def test_the_interval_of_a_share_ends_at_100_percent_in_the_figure_and_its_numbers() -> None:
    found = {1.0: [np.array([share]) for share in (100.0, 100.0, 60.0, 100.0)]}
    panel = Figure().subplots()
    (row,) = draw_sweep({"lsd": found}, {"lsd": 0}, panel, swept="noise", metric="success", share=True).rows
    assert row[2:3] + row[4:5] == [90.0, 100.0] and 40 < row[3] < 60


def test_blur_is_the_motion_while_the_shutter_is_open(three: list[Sequence]) -> None:
    frames = list(range(5))
    by_ms = {ms: blur_px(with_config(three[0], {"effects": [{"kind": "motion-blur", "exposure_ms": ms}]}), frames)
             for ms in (5.0, 10.0)}  # fmt: skip
    assert (by_ms[5.0] > 0).all()
    assert by_ms[10.0] == pytest.approx(2 * by_ms[5.0])
    assert (blur_px(with_config(three[0], noise(1e3)), frames) == 0).all()
    assert np.isnan(blur_px(three[0], frames)).all()


def test_occlusion_is_what_the_renderer_did_not_see_of_the_edges(three: list[Sequence]) -> None:
    sequence = three[1]
    assert np.isnan(occlusion(sequence, [0, 1])).all()
    edges = visible_edges(sequence.structure, sequence.camera, sequence.true_cam_from_world(0)).segments_px
    for frame, share in ((0, 1.0), (1, 0.25)):
        edges_file(sequence, frame).parent.mkdir(exist_ok=True)
        lines = [f"0,{a[0]},{a[1]},{a[0] + share * (b - a)[0]},{a[1] + share * (b - a)[1]},{share},9" for a, b in edges]
        edges_file(sequence, frame).write_text("\n".join([",".join(EDGE_COLUMNS), *lines]) + "\n")
    hidden = occlusion(sequence, [0, 1, 2])
    assert hidden[0] == 0
    assert 60 < hidden[1] < 90
    assert np.isnan(hidden[2])
