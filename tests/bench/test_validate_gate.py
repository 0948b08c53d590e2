"""The gate's own trial, in small: reruns of the same code, errors made worse by a factor, a worse setting."""

import json

import pytest
from click.testing import CliRunner

from uavbench.bench.gate.validation import main
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to

pytestmark = [pytest.mark.ci, pytest.mark.slow]
SUITE = """
title = "few"
seeds = [0, 1, 2, 3, 4]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
mount = { pitch_deg = -28.0 }
environment = { kind = "indoor", floor = "carpet" }
flight.path = { kind = "hand-pilot", duration_s = 1.2, range_m = [0.85, 1.0], height_m = [0.6, 0.8] }
camera = { width = 200, height = 150, horizontal_fov_deg = 65.0 }
[trackers]
lsd = { kind = "lsd" }
"""


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("validate")
    (folder / "few.toml").write_text(SUITE)
    assert bring_up_to("render", str(folder / "few.toml"), folder / "few", ExecutionOptions(workers=1)) == 0
    return folder


def validate(folder, *more):
    arguments = [str(folder / "few"), "--suite", str(folder / "few.toml"), "--reruns", "2", "--comparisons", "20"]
    result = CliRunner().invoke(main, [*arguments, "--jobs", "1", "--out", str(folder / "out"), *more])
    return result, {p: p.stat().st_mtime_ns for p in (folder / "out" / "scores").rglob("*.json")}


def test_true_changes_and_verdicts_are_measured_and_what_is_done_is_kept(rendered):
    worse = ("--worse", "lsd.control_point_spacing_px=60.0", "--new-noise", "1.0")
    result, files = validate(rendered, *worse)
    assert result.exit_code == 0, result.output
    rows = json.loads((rendered / "out" / "validation.json").read_text())["measured"]
    assert set(rows) == {"", "lsd +5%", "lsd +10%", "lsd control_point_spacing_px=60.0"}
    for row in rows.values():
        assert row["pass"] + row["fail"] + row["inconclusive"] == pytest.approx(1.0)
    assert rows["lsd +10%"]["ATE"] == pytest.approx(0.10, abs=0.01)
    assert rows["lsd control_point_spacing_px=60.0"]["ATE"] > 0.1
    assert "| lsd +5% | +5." in (rendered / "out" / "validation.md").read_text()
    assert validate(rendered, *worse)[1] == files


@pytest.mark.parametrize("word", ["lsd.no_such=1", "other.search_px=2", "lsd.search_px=far"])
def test_a_setting_that_is_not_there_is_told(rendered, word):
    result, _ = validate(rendered, "--worse", word)
    assert result.exit_code == 1
    assert "write LABEL.PARAMETER=VALUE" in result.output
