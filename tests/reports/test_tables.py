"""Tables for papers: bold where it is the best, as wide as a page allows, compiled with TeX where there is one."""

import csv
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.drawn_scores import make_score, summary
from uavbench.bench.cli.main import main
from uavbench.reports.metrics.model_space import ModelSpace
from uavbench.reports.protocols.restarting import Replay
from uavbench.reports.scoring.crlb_ratio import ErrorOverBound
from uavbench.reports.scoring.score import PoseErrors, Score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.tables.columns import COLUMNS, DETAILS, ONE_COLUMN, TWO_COLUMNS, Column
from uavbench.reports.tables.latex import ONE_COLUMN_PT, TWO_COLUMNS_PT, latex
from uavbench.reports.tables.summary_table import Cell, Table
from uavbench.reports.tables.summary_table import summary_table as table_of_frame
from uavbench.reports.tables.writers import heads, markdown, write_summary, write_table, write_tables
from uavbench.reports.uncertainty.consistency import Consistency
from uavbench.trajectories.errors import UserError


def run(label: str, cm: float, *, seed: int = 0, sequence: str = "box", rate_hz: float = 15.0, **more: float) -> Score:
    made = make_score(sequence, seed, cm / 100, coverage=more.get("coverage", 1.0))
    tracking = replace(made.tracking, success=more.get("success", 1.0))
    errors = replace(made.ate["none"], translation_m=summary(cm / 100))
    rpe = {"1 frame": made.rpe["1 s"], "1 s": made.rpe["1 s"]}
    return replace(made, label=label, rate_hz=rate_hz, tracking=tracking, ate={"none": errors}, rpe=rpe)


def many(trackers: int = 5, sequences: int = 7, seeds: int = 5) -> list[Score]:
    rng = np.random.default_rng(0)
    return [
        run(f"a_long-name_{k}", (k + 1) * rng.uniform(90, 130), seed=seed, sequence=f"s{q}", rate_hz=rate)
        for k in range(trackers)
        for q in range(sequences)
        for seed in range(seeds)
        for rate in (15.0, 1.0)
    ]


def summary_table(scores: list[Score], columns: tuple[Column, ...] = COLUMNS) -> Table:
    return table_of_frame(score_frame(score.to_json() for score in scores), columns)


def cells(table: Table, head: str) -> dict[str, tuple[str, bool]]:
    place = [column.head for column in table.columns].index(head)
    return {name: (row[place].text, row[place].best) for name, row in table.rows}


def test_bold_is_the_best_of_its_column_and_rate_or_nothing() -> None:
    table = summary_table([
        run("lost", 1.06, success=0.2), run("good", 1.17), run("fair", 2.0),
        run("lost", 3.0, rate_hz=1.0, success=0.2), run("good", 2.5, rate_hz=1.0), run("fair", 2.6, rate_hz=1.0),
    ])  # fmt: skip
    shown = cells(table, "ATE position")
    assert not any(best for name, (_, best) in shown.items() if name.endswith("@15hz"))
    assert [name for name, (_, best) in shown.items() if best] == ["good@1hz"]
    assert "**1.17**" not in markdown(table) and r"\textbf{1.17}" not in latex(table)
    assert "**2.50**" in markdown(table) and r"\textbf{2.50}" in latex(table)


def test_a_lost_tracker_is_not_bold_beside_a_good_one_that_shows_the_same() -> None:
    shown = cells(summary_table([run("lost", 1.17, success=0.2), run("good", 1.17), run("fair", 2.0)]), "ATE position")
    assert [name for name, (_, best) in shown.items() if best] == ["good@15hz"]


def test_what_is_shown_alike_is_bold_alike() -> None:
    shown = cells(summary_table([run("a", 1.1701), run("b", 1.1699), run("c", 3.0)]), "ATE position")
    assert shown["a@15hz"] == shown["b@15hz"] == ("1.17", True)
    assert not shown["c@15hz"][1]


@pytest.mark.parametrize("column", [*COLUMNS, *DETAILS], ids=lambda column: column.head)
def test_each_column_knows_which_way_is_better(column: Column) -> None:
    """Two trackers that differ in one number only: the better one is bold by the column's direction."""
    frame = score_frame(run(label, 1.0).to_json() for label in ("low", "high")).assign(**{column.key: [1.0, 2.0]})
    table = table_of_frame(frame, (column,))
    best = {name for name, (_, best) in cells(table, column.head).items() if best}
    assert best == {"min": {"low@15hz"}, "max": {"high@15hz"}, "": set()}[column.best]


def test_each_column_shows_a_number_that_scores_have() -> None:
    """Of a score with everything: as many known cells as columns, and numbers in the units of their heads."""
    size = summary(0.02)
    whole = replace(
        run("all", 2.0),
        tracking=replace(run("all", 2.0).tracking, time_to_recover_s=0.5),
        replay=Replay(dropped=0.25, age_ms=40.0, translation_m=size, rotation_deg=size, success=0.75),
        model=ModelSpace(add_m=size, mssd_m=size, mspd_px=size, edges_px=size, symmetries=1),
        consistency=Consistency(n=9, mean=6.5, low=1.0, high=9.0, inside=1.0, sharpness_m=0.03, sharpness_deg=1.0),
        bound=ErrorOverBound(n=9, median=1.5),
    )
    ((_, cells_of_all),) = summary_table([whole], (*COLUMNS, *DETAILS)).rows
    shown = {column.head: cell.mean for column, cell in zip((*COLUMNS, *DETAILS), cells_of_all, strict=True)}
    assert None not in shown.values(), shown
    expected = {
        "ATE position": 2.0, "ADD": 2.0, "edges": 0.02, "claimed sigma": 3.0, "NEES": 6.5, "error / CRLB": 1.5,
        "first failure": whole.tracking.duration_s, "in real time: frames missed": 25.0, "coverage": 100.0,
    }  # fmt: skip
    assert {head: shown[head] for head in expected} == pytest.approx(expected)


def test_one_run_and_equal_seeds_have_no_interval_and_no_star() -> None:
    same = [run(label, cm, seed=seed) for label, cm in (("a", 1.0), ("b", 2.0)) for seed in range(12)]
    for scores in (same, same[:1] * 12 + same[12:13] * 12):
        table = summary_table(scores)
        assert not any(cell.significant for _, row in table.rows for cell in row)
        for text in (markdown(table), latex(table)):
            assert not re.search(r"\[([\d.]+), \1\]", text)
            assert r"\*" not in text and "$^{*}$" not in text
    table = summary_table(same)
    assert "n/a: no interval (the values of all 12 runs are equal)" in table.caption
    assert "1.00** n/a" in markdown(table)


@pytest.mark.parametrize(("seeds", "star"), [(5, False), (6, True)])
def test_a_star_needs_as_many_runs_as_its_test(seeds: int, star: bool) -> None:
    scores = [
        run(label, cm + 0.01 * seed, seed=seed) for label, cm in (("a", 1.0), ("b", 2.0)) for seed in range(seeds)
    ]
    table = summary_table(scores)
    place = [column.head for column in COLUMNS].index("ATE position")
    assert dict(table.rows)["a@15hz"][place].significant == star
    assert ("5 independent runs at most, the test needs 6" in table.caption) != star


def test_nothing_has_a_star_beside_a_tracker_without_a_value_in_some_runs() -> None:
    """`b` has the better mean of the runs in which it is not lost: `a` cannot be said to beat it."""
    scores = [
        run(label, cm + 0.01 * seed, seed=seed)
        for label, cm in (("a", 1.0), ("b", 0.9), ("c", 2))
        for seed in range(12)
    ]
    lost = [
        replace(each, ate={"none": PoseErrors(translation_m=None, rotation_deg=None)})
        if (each.label, each.seed) == ("b", 7)
        else each
        for each in scores
    ]
    place = [column.head for column in COLUMNS].index("ATE position")
    found = {name: row[place] for name, row in summary_table(lost).rows}
    assert found["b@15hz"].text.endswith("(11/12)") and found["a@15hz"].best and not found["a@15hz"].significant
    assert "(k/n): mean over the k of n runs" in summary_table(lost).caption
    assert "(k/n)" not in summary_table(scores).caption


def test_seeds_of_one_flight_are_no_sequences() -> None:
    """Four sequences of ten seeds: the sequences are what a claim over sequences rests on."""
    scores = [
        run(label, cm * (1 + 0.01 * seed), seed=seed, sequence=f"s{q}")
        for label, cm in (("a", 1.0), ("b", 2.0))
        for q in range(4)
        for seed in range(10)
    ]
    assert "4 independent runs at most" in summary_table(scores).caption


def test_columns_are_chosen_by_name(tmp_path: Path) -> None:
    table = summary_table(many(2)).select(["ATE position", "coverage"])
    assert heads(table) == ["ATE position (cm)", "coverage (%)"]
    write_tables(table, tmp_path / "x.y")
    rows = list(csv.reader((tmp_path / "x.y.csv").open()))
    assert rows[0] == ["tracker", *(f"{h}{end}" for h in heads(table) for end in ("", " low", " high"))]
    with pytest.raises(UserError, match="did you mean 'ATE position'"):
        table.select(["ATE positon"])
    with pytest.raises(UserError, match=r"\.md, \.csv or \.tex"):
        write_table(table, tmp_path / "x.docx")


def test_the_command_writes_chosen_columns_of_a_report(report: Path, tmp_path: Path) -> None:
    wanted = "within 5 cm, 5 deg,ATE position,frame p99"
    out = tmp_path / "mine.csv"
    done = CliRunner().invoke(main, ["tables", str(report), "--columns", wanted, "--out", str(out)])
    assert done.exit_code == 0, done.output
    rows = {row["tracker"]: row for row in csv.DictReader(out.open())}
    of_report = {row["tracker"]: row for row in csv.DictReader((report / "tables" / "summary.csv").open())}
    assert rows.keys() == of_report.keys()
    for name, row in rows.items():
        assert row["ATE position (cm)"] == of_report[name]["ATE position (cm)"]
    shown = CliRunner().invoke(main, ["tables", str(report)])
    assert "| frame p99 (ms) |" in shown.output and "**" in shown.output
    assert CliRunner().invoke(main, ["tables", str(report), "--columns", "ATE"]).exit_code == 2
    assert CliRunner().invoke(main, ["tables", str(tmp_path)]).exit_code == 2


def test_intervals_end_where_the_values_of_their_column_do() -> None:
    """The bootstrap of three values, widened, reaches beyond 0 and 100 %."""
    shares, errors = (0.0, 0.05, 1.0), (0.01, 0.02, 60.0)
    table = summary_table([
        run("a", cm, sequence=f"s{k}", success=share, coverage=1 - share)
        for k, (share, cm) in enumerate(zip(shares, errors, strict=True))
    ])  # fmt: skip
    ((_, row),) = table.rows
    shown = {column.head: cell.interval for column, cell in zip(table.columns, row, strict=True)}
    for head, most in (("within 5 cm, 5 deg", 100.0), ("coverage", 100.0), ("ATE position", np.inf)):
        interval = shown[head]
        assert interval is not None and 0 <= interval.low < interval.mean < interval.high <= most
    success, covered, ate = shown["within 5 cm, 5 deg"], shown["coverage"], shown["ATE position"]
    assert success is not None and covered is not None and ate is not None
    assert (success.low, covered.high, ate.low) == (0.0, 100.0, 0.0)


@pytest.mark.parametrize("suffix", ["tex", "md"])
def test_a_table_takes_the_place_of_itself_but_of_no_edited_one(report: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"mine.{suffix}"

    def written(columns: str) -> int:
        return CliRunner().invoke(main, ["tables", str(report), "--columns", columns, "--out", str(out)]).exit_code

    assert (written("ATE position"), written("ATE rotation")) == (0, 0)
    text = out.read_text()
    assert "ATE rot" in text and "ATE pos" not in text
    out.write_text(text.replace("rot", "ROT"))
    assert written("coverage") == 2 and "ROT" in out.read_text()


def test_a_report_that_is_older_than_the_scores_gives_no_table(report: Path, tmp_path: Path) -> None:
    """`uavbench score` writes scores, but no report: its table is not theirs."""
    folder = shutil.copytree(report, tmp_path / "out")
    scores = json.loads((folder / "scores.json").read_text())["scores"]
    files = [folder / "results" / row["sequence"] / f"{row['label']}@{row['rate_hz']:g}hz/score.json" for row in scores]
    for file, row in zip(files, scores, strict=True):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({**row, "latency": {"total_ms": 1.0}}))
    assert CliRunner().invoke(main, ["tables", str(folder)]).exit_code == 0
    files[0].write_text(json.dumps({**scores[0], "tracking": {"coverage": 0.123}}))
    stale = CliRunner().invoke(main, ["tables", str(folder)])
    assert stale.exit_code == 2
    assert f"scores.json: older than {files[0]}; write it again with `uavbench report`" in stale.output
    files[0].write_text(json.dumps({**scores[0], "label": "new"}))
    assert CliRunner().invoke(main, ["tables", str(folder)]).exit_code == 2


def test_a_name_with_every_special_character_is_escaped() -> None:
    text = latex(summary_table([run(r"a_b%c&d#e$f{g}h~i^j\k<l>m", 1.0)]))
    assert r"a\_b\%c\&d\#e\$f\{g\}h\textasciitilde{}i\textasciicircum{}j\textbackslash{}k\textless{}l" in text


@pytest.mark.parametrize("name", ["[1] a", "*a", "[", "*"])
def test_no_name_is_taken_as_an_argument_of_the_row_before(name: str) -> None:
    r"""`\\` takes a star and brackets that follow it, across the end of the line, and \midrule takes brackets."""
    column = Column(head="edges", key="edges", unit="", best="", decimals=0)
    cell = Cell(mean=1.0, interval=None, known=1, runs=1, decimals=0)
    text = latex(Table("", (column,), (("first", (cell,)), (name, (cell,))), absent=(name,)))
    assert text.count(f"{{}}{name} &") == 2
    assert not re.search(r"(\\\\|rule)\s*[\[*]", text)


def test_hyphens_stay_hyphens_and_a_caption_stays_a_comment() -> None:
    cell = Cell(mean=1.0, interval=None, known=1, runs=1, decimals=0)
    column = Column(head="edges", key="edges", unit="", best="", decimals=0)
    text = latex(Table("Truth: a\nb.tum, 3 poses. End", (column,), (("a---b-c", (cell,)),)))
    assert r"a-{}-{}-b-c & 1 \\" in text
    assert text.startswith("% Truth: a b.tum, 3 poses\n% End\n% Needs")


DOCUMENT = r"""\documentclass[journal]{IEEEtran}
\usepackage{booktabs}
\newsavebox{\measured}
\begin{document}
\typeout{WIDTHS \the\columnwidth\space\the\textwidth}
%s
\end{document}
"""
MEASURED = r"""\typeout{LIMIT %s %g}
%s"""


def compile_tex(folder: Path, body: str) -> str:
    """Log of a document of IEEEtran; the test is skipped where there is no TeX for it."""
    program = shutil.which("pdflatex")
    if not program:
        pytest.skip("pdflatex is not installed (texlive-latex-recommended, texlive-publishers)")
    for name in ("IEEEtran.cls", "booktabs.sty", "ptmr7t.tfm"):
        if not subprocess.run(["kpsewhich", name], capture_output=True, check=False).stdout:
            pytest.skip(f"TeX lacks {name} (texlive-publishers, texlive-latex-recommended, texlive-fonts-recommended)")
    (folder / "x.tex").write_text(DOCUMENT % body)
    command = [program, "-interaction=nonstopmode", "-halt-on-error", "x.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    return (folder / "x.log").read_text(errors="replace")


def test_the_tables_fit_the_columns_of_ieee(tmp_path: Path) -> None:
    scores = many()
    write_summary(replace(summary_table(scores), absent=("visp",)), tmp_path / "summary")
    write_tables(summary_table(scores, DETAILS), tmp_path / "details")
    write_table(summary_table(scores), tmp_path / "everything.tex", ONE_COLUMN_PT)
    limits = {"summary": TWO_COLUMNS_PT, "details": TWO_COLUMNS_PT, "summary_one_column": ONE_COLUMN_PT,
              "everything": ONE_COLUMN_PT}  # fmt: skip
    body = []
    for name, limit in limits.items():
        text = (tmp_path / f"{name}.tex").read_text()
        group = text[text.index("{\\fontsize") :].strip()
        start = group[: group.index("%\n") + 2]
        for tabular in re.findall(r"\\begin\{tabular\}.*?\\end\{tabular\}", text, re.S):
            body.append(
                rf"\savebox{{\measured}}{{{start}{tabular}}}}}\typeout{{TABLE {name} {limit:g} \the\wd\measured}}"
            )
        kind = "table" if limit == ONE_COLUMN_PT else "table*"
        body.append(rf"\begin{{{kind}}}\centering\input{{{name}.tex}}\caption{{x}}\end{{{kind}}}")
    log = compile_tex(tmp_path, "\n".join(body))
    assert "WIDTHS 252.0pt 516.0pt" in log
    measured = re.findall(r"TABLE (\S+) (\S+) ([\d.]+)pt", log)
    assert {name for name, _, _ in measured} == set(limits)
    for name, limit, width in measured:
        assert float(width) <= float(limit), (name, width)
    assert "Overfull" not in log
    one = [float(width) for name, _, width in measured if name == "summary_one_column"]
    assert len(one) == 1 and len([name for name, _, _ in measured if name == "summary"]) == 1
    assert len(ONE_COLUMN) < len(TWO_COLUMNS) < len(COLUMNS)


def test_a_caption_says_which_errors_are_means() -> None:
    scores = [run("a", 1.0), run("b", 2.0)]
    told = "over the frames that have a pose"
    assert f"RMSE (edges: means) {told}" in summary_table(scores).caption
    assert f"RMSE (ADD, MSSD, MSPD: means) {told}" in summary_table(scores, DETAILS).caption
    of_poses = tuple(column for column in COLUMNS if column.head in TWO_COLUMNS)
    assert f"RMSE {told}" in summary_table(scores, of_poses).caption


def test_errors_without_a_column_of_coverage_have_it_in_their_caption(tmp_path: Path) -> None:
    """A tracker that is lost where it is difficult has the lowest error of a table: its reader is told."""
    scores = [run("easy", 1.0, coverage=0.5, success=0.5), run("good", 1.2), run("fair", 2.0)]
    told = "Coverage: easy@15hz 50.0 %; all others 100.0 %."
    table = summary_table(scores)
    assert told not in table.caption  # a column has it
    for columns in (ONE_COLUMN, ("ATE position",), ("RPE 1 s", "frame p95")):
        chosen = table.select(columns)
        assert chosen.caption.endswith(f". {told}") and told in markdown(chosen) and chosen.select(columns) == chosen
    assert told in summary_table(scores, DETAILS).caption
    assert told not in table.select(TWO_COLUMNS).caption and told not in table.select(["frame p95", "failures"]).caption
    write_summary(table, tmp_path / "summary")
    assert "50.0" in (tmp_path / "summary_one_column.tex").read_text()
    equal = summary_table([run("a", 1.0), run("b", 2.0)]).select(["ATE position"])
    assert equal.caption.endswith("Coverage: a@15hz, b@15hz 100.0 %.")
