"""Reports over several sequences and seeds, and over runs that failed in every way."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reports.report import ReportEntry, write_report
from reports.score import Score, score
from reports.tables import COLUMNS, summary_table
from reports.tables_write import latex, markdown
from scenes.sequence import Sequence
from tests.reports.drawn import make_sequence, results_of, true_rows
from tracker.base import TrackResult
from tracker.results import Results
from trajectories.errors import UserError

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
    return write_report(base / "report", "Failures of every kind", entries).parent


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
    table = summary_table(scores)
    place = [c.head for c in COLUMNS].index("ATE position")
    cells = {name: row[place] for name, row in table.rows}
    assert cells["a@15hz"].best and cells["a@15hz"].significant and not cells["b@15hz"].best
    interval = cells["a@15hz"].interval
    assert interval is not None and interval.low < interval.mean < interval.high and interval.n == 40
    assert r"$^{*}$" in latex(table) and "\\*" in markdown(table) and "[" in markdown(table)


def test_a_lost_tracker_wins_no_error_column(base_score: Score) -> None:
    scores = [scored("lost", "s", 0, base_score, 0.1, success=0.1), scored("good", "s", 0, base_score, 2.0)]
    place = [c.head for c in COLUMNS].index("ATE position")
    cells = {name: row[place] for name, row in summary_table(scores).rows}
    assert cells["good@15hz"].best and not cells["lost@15hz"].best


def test_a_missing_run_must_tell_what_it_was(sequence: Sequence, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="LABEL@RATEhz"):
        write_report(tmp_path, "x", [ReportEntry(sequence.folder, tmp_path / "nothing", tmp_path / "nothing.json")])
