"""What the tests of reports share."""

from pathlib import Path

import pytest

from tests.reports.drawn import make_sequence, track
from uavbench.reports.report import ReportInputs, write_report
from uavbench.reports.scoring.runs import ReportEntry
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.sequence import Sequence


@pytest.fixture(scope="session")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return make_sequence(tmp_path_factory.mktemp("sequences") / "arc", 45)


@pytest.fixture(scope="session")
def entries(sequence: Sequence, tmp_path_factory: pytest.TempPathFactory) -> list[ReportEntry]:
    found = []
    for kind, rate_hz in (("hold", 15), ("hold", 1), ("lsd", 15), ("lsd", 1)):
        folder = tmp_path_factory.mktemp("results") / f"{kind}@{rate_hz}hz"
        results = track(sequence, kind, rate_hz)
        results.save(folder)
        score(sequence, results).save(folder / "score.json")
        found.append(ReportEntry(sequence.folder, folder, folder / "score.json"))
    return found


@pytest.fixture(scope="session")
def report(entries: list[ReportEntry], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(
        tmp_path_factory.mktemp("report"),
        ReportInputs("A <small> & tidy report", entries),
        figures="all",
        content_hash="abc",
    ).parent
