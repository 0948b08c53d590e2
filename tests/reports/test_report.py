"""The report's files: exact widths, embedded fonts, the same bytes twice, numbers beside every figure."""

import csv
import hashlib
import json
import re
import shutil
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from tests.reports.drawn import track
from uavbench.reports.figures.space import SHARES, draw_error_against_distance
from uavbench.reports.page.templates import environment
from uavbench.reports.progress import Steps
from uavbench.reports.report import ReportInputs, beside, write_report
from uavbench.reports.scoring.runs import ReportEntry, ScoredRun
from uavbench.reports.scoring.score import score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.style import COLOURS, PNG_DPI, new_figure
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UNSEEN, UserError


def digests(folder: Path) -> dict[str, str]:
    files = [p for p in sorted(folder.rglob("*")) if p.is_file()]
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_every_figure_is_one_or_two_columns_wide_with_its_numbers(report: Path) -> None:
    pdfs = sorted((report / "figures").glob("*.pdf"))
    assert len(pdfs) >= 15
    for pdf in pdfs:
        width_pt = float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", pdf.read_bytes())[1])
        assert any(width_pt == pytest.approx(72 * inches, abs=1e-6) for inches in (3.5, 7.16)), pdf.name
        with Image.open(pdf.with_name(pdf.stem + ".png")) as picture:
            assert picture.width == round(width_pt / 72 * PNG_DPI)
        rows = list(csv.reader(pdf.with_name(pdf.stem + ".csv").open()))
        assert len(rows) > 1
        assert len({len(row) for row in rows}) == 1


def test_no_panel_is_empty_where_a_rate_has_no_sub_trajectories(report: Path) -> None:
    for pdf in (report / "figures").glob("distance_*.pdf"):
        over = [row for row in csv.DictReader(pdf.with_suffix(".csv").open()) if row["what"].startswith("over")]
        width_pt = float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", pdf.read_bytes())[1])
        assert (width_pt > 300) == bool(over), pdf.name


def test_lengths_that_a_rate_has_no_sub_trajectories_of_have_no_place(sequence: Sequence) -> None:
    results = track(sequence, "hold", 5)
    run = ScoredRun(sequence, results, score(sequence, results), 0)
    figure = new_figure(2.4)
    drawn = draw_error_against_distance([run], figure)
    over = {row[1] for row in drawn.rows if row[1] != "along"}
    assert 0 < len(over) < len(SHARES)
    assert [f"over {float(tick.get_text()):.2g} m" for tick in figure.axes[1].get_xticklabels()] == [
        f"over {float(what.split()[1]):.2g} m" for what in sorted(over)
    ]


def test_fonts_are_truetype_and_embedded(report: Path) -> None:
    for pdf in (report / "figures").glob("*.pdf"):
        data = pdf.read_bytes()
        streams = [data, *(_inflated(s) for s in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.S))]
        assert not any(b"/Subtype /Type3" in s for s in streams), pdf.name
        if b"/Font" in data:
            assert b"/FontFile2" in b"".join(streams), pdf.name


@pytest.mark.slow
def test_a_second_run_gives_the_same_bytes_and_tells_its_progress(
    report: Path, entries: list[ReportEntry], tmp_path: Path
) -> None:
    seen: list[tuple[int, int]] = []
    title = "A <small> & tidy report"
    again = write_report(
        tmp_path,
        ReportInputs(title, entries),
        figures="all",
        content_hash="abc",
        on_step=lambda *step: seen.append(step),
    ).parent
    assert digests(again) == digests(report)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert seen[-1][0] == seen[-1][1]


def test_what_is_looked_at_is_drawn_and_the_rest_on_demand(
    report: Path, entries: list[ReportEntry], tmp_path: Path
) -> None:
    few = write_report(tmp_path, ReportInputs("A <small> & tidy report", entries), content_hash="abc").parent
    drawn, every = (set(digests(folder / "figures")) for folder in (few, report))
    assert {"accuracy.pdf", "success.csv", "flight_arc.png", "errors_arc_15hz.pdf"} <= drawn < every
    assert {"pose_arc_lsd@15hz.pdf", "segments_arc_lsd@15hz.csv", "errors_arc_1hz.png"} <= every - drawn
    missing = len([name for name in every - drawn if name.endswith(".pdf")])
    page = (few / "index.html").read_text()
    assert f"For the other {missing} figures" in page and "--figures all" in page
    assert 'id="undrawn"' not in (report / "index.html").read_text()
    same = {name: digest for name, digest in digests(few).items() if name.startswith(("figures", "tables"))}
    assert same.items() <= digests(report).items()


def test_titles_are_escaped(report: Path) -> None:
    page = (report / "index.html").read_text()
    assert "A &lt;small&gt; &amp; tidy report" in page
    assert "A <small>" not in page


def test_the_tables_tell_the_same_in_three_forms(report: Path) -> None:
    rows = list(csv.DictReader((report / "tables" / "summary.csv").open()))
    assert {row["tracker"] for row in rows} == {"hold@15hz", "hold@1hz", "lsd@15hz", "lsd@1hz"}
    markdown = (report / "tables" / "summary.md").read_text()
    latex = (report / "tables" / "summary.tex").read_text()
    assert r"\toprule" in latex and r"\bottomrule" in latex and r"\textbf{" in latex
    for row in rows:
        shown = f"{float(row['ATE position (cm)']):.2f}"
        assert shown in markdown
        assert shown in latex


def test_all_scores_stand_in_one_file(report: Path) -> None:
    scores = json.loads((report / "scores.json").read_text())["scores"]
    assert len(scores) == 4
    assert all(s["record"]["sequence"]["content_hash"] for s in scores)
    table, frame = pd.read_csv(report / "scores.csv"), score_frame(scores)
    assert list(table) == list(frame)
    numbers = list(frame.select_dtypes("number"))
    pd.testing.assert_frame_equal(table[numbers], frame[numbers], check_dtype=False, rtol=1e-12)
    assert json.loads((report / "report.json").read_text())["content_hash"] == "abc"


def test_control_characters_of_a_suite_are_visible_on_the_pages(entries: list[ReportEntry], tmp_path: Path) -> None:
    unseen = "\x1b[31m \x07 \x9b \u202e"
    inputs = ReportInputs(f"title {unseen}", entries[:1], unrendered={"a": f"why {unseen}"})
    write_report(tmp_path, inputs)
    pages = {path.name: path.read_text() for path in tmp_path.rglob("*.html")}
    assert len(pages) == 2
    for page in pages.values():
        assert not UNSEEN.search(page) and r"title \x1b[31m \x07 \x9b \u202e" in page
    assert r"why \x1b[31m \x07 \x9b \u202e" in pages["index.html"]
    link = environment().from_string('{{ ["a\x1b", "<b>"]|join(", ") }}').render()
    assert link == "a\\x1b, &lt;b&gt;"


def test_no_entry_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="at least one"):
        write_report(tmp_path, ReportInputs("nothing", []))


def test_a_missing_score_is_named(entries: list[ReportEntry], tmp_path: Path) -> None:
    entry = entries[0]
    with pytest.raises(UserError, match=r"nowhere\.json"):
        write_report(
            tmp_path, ReportInputs("x", [ReportEntry(entry.sequence, entry.results, tmp_path / "nowhere.json")])
        )


@pytest.mark.parametrize(
    ("key", "value"), [("sequence", {"name": "arc", "content_hash": "stale"}), ("association", "nearest stamp")]
)
def test_a_score_with_another_record_is_refused(
    key: str, value: object, entries: list[ReportEntry], tmp_path: Path
) -> None:
    stored = json.loads(entries[0].score.read_text())
    stored["record"][key] = value
    del stored["made_by"]
    path = tmp_path / "score.json"
    path.write_text(json.dumps(stored))
    with pytest.raises(UserError, match=rf"score\.json: its record has {key} = "):
        write_report(tmp_path, ReportInputs("x", [ReportEntry(entries[0].sequence, entries[0].results, path)]))


def test_colours_are_distinct_in_grey_and_to_the_colour_blind() -> None:
    rgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in COLOURS])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    lightness = np.sort(_lab(linear)[:, 0])
    assert np.diff(lightness).min() >= 7
    for name, matrix in DICHROMACIES.items():
        seen = _lab(np.clip(linear @ matrix.T, 0, 1))
        apart = np.linalg.norm(seen[:, None] - seen[None], axis=2) + 1e3 * np.eye(len(COLOURS))
        assert apart.min() > 15, name


DICHROMACIES = {  # Machado, Oliveira & Fernandes 2009, severity 1
    "none": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}


def _lab(linear: np.ndarray) -> np.ndarray:
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x = linear @ to_xyz.T / [0.9505, 1.0, 1.089]
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.column_stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])])


def _inflated(stream: bytes) -> bytes:
    try:
        return zlib.decompress(stream)
    except zlib.error:
        return stream


def test_an_image_that_cannot_be_read_is_told_whoever_reads_it(entries: list[ReportEntry], tmp_path: Path) -> None:
    folder = tmp_path / "sequence"
    shutil.copytree(entries[0].sequence, folder)
    image = sorted((folder / "frames").iterdir())[20]
    image.write_bytes(image.read_bytes()[:200])
    with pytest.raises(UserError, match=rf"{image.name}.*truncated"):
        write_report(tmp_path / "report", ReportInputs("x", [replace(entries[0], sequence=folder)]))
    assert not (tmp_path / "report").exists()


def test_work_beside_the_figures_ends_with_them() -> None:
    steps = Steps(None, 1)

    def endless() -> None:
        while True:
            steps()

    with pytest.raises(KeyboardInterrupt), beside(endless, steps):
        raise KeyboardInterrupt
