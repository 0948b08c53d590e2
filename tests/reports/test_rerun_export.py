"""The `.rrd` export: a recording where the Rerun SDK is installed, one clear error where it is not."""

import importlib.util
from pathlib import Path

import pytest

from uavbench.reports.page.rerun_export import write_rrd
from uavbench.reports.scoring.runs import ReportEntry, open_runs
from uavbench.trajectories.errors import UserError


def test_a_recording_or_a_clear_error(entries: list[ReportEntry], tmp_path: Path) -> None:
    entry = entries[2]
    run = open_runs([ReportEntry(entry.sequence, entry.results, entry.score)])[0]
    path = tmp_path / "run.rrd"
    if importlib.util.find_spec("rerun") is None:
        with pytest.raises(UserError, match=r"pip install 'uavbench\[rerun\]'"):
            write_rrd(run, path)
        assert list(tmp_path.iterdir()) == []
    else:
        write_rrd(run, path)
        assert path.read_bytes()[:4] == b"RRF2"
