"""What a report does once, or not at all, to be quick; and that it shows the same."""

import gc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.reports.drawn import RATE_HZ, track
from uavbench.reports.figures.logarithmic import logarithmic, plain_powers
from uavbench.reports.progress import Steps
from uavbench.reports.report import write_overlay
from uavbench.reports.scoring.attributes import breakdowns, contrast_at, frames_looked_at
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.score import score
from uavbench.reports.style import house_style
from uavbench.scenes.dataset.sequence import Sequence

LEAST_POWER, WIDEST = -4, 6


def test_the_overlay_and_the_breakdown_read_each_image_once(
    sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = track(sequence, "hold", RATE_HZ)
    run = ScoredRun(sequence, results, score(sequence, results), 0)
    alone = [contrast_at.__wrapped__(sequence, frame) for frame in range(len(sequence))]
    contrast_at.cache_clear()
    reads: list[int] = []
    read = Sequence.image
    monkeypatch.setattr(Sequence, "image", lambda self, frame: reads.append(frame) or read(self, frame))
    (tmp_path / "figures").mkdir()
    write_overlay(tmp_path, [run], set(frames_looked_at([run])[id(run)]), Steps(None, 1))
    found = breakdowns([run])["contrast"][run.name]
    assert sorted(reads) == list(range(len(sequence)))
    assert (found[0].low, found[-1].high) == (min(alone), max(alone))


@settings(max_examples=25, deadline=None)
@given(st.floats(LEAST_POWER, LEAST_POWER + WIDEST), st.floats(0.05, WIDEST), st.booleans())
def test_a_logarithmic_axis_has_the_labels_of_matplotlibs_or_plain_numbers_and_no_tick_beyond(
    low: float, width: float, upright: bool
) -> None:
    with house_style():
        ours, plain = (figure.subplots() for figure in (Figure(), Figure()))
        logarithmic(ours.yaxis if upright else ours.xaxis)
        (plain.set_yscale if upright else plain.set_xscale)("log")
        for panel in (ours, plain):
            (panel.set_ylim if upright else panel.set_xlim)(10**low, 10 ** (low + width))
        told, usual = labels(ours, upright), labels(plain, upright)
        assert {place for place, _ in told} == {place for place, _ in usual}
        for place, text in told - usual:
            assert width <= 2 and np.isclose(float(text), place, rtol=1e-5) and "e" not in text
        axis = ours.yaxis if upright else ours.xaxis
        places = axis.get_minorticklocs()
        assert any(axis.get_minor_formatter().format_ticks(places)) or not len(places)


def labels(panel: Axes, upright: bool) -> set[tuple[float, str]]:
    """Place and text of the labels in view."""
    axis = panel.yaxis if upright else panel.xaxis
    low, high = axis.get_view_interval()
    found = set()
    for which in (False, True):
        places, formatter = (
            (axis.get_minorticklocs(), axis.get_minor_formatter())
            if which
            else (axis.get_majorticklocs(), axis.get_major_formatter())
        )
        found |= {
            (float(np.round(place, 12)), text)
            for place, text in zip(places, formatter.format_ticks(places), strict=True)
            if low <= place <= high and text
        }
    return found


def test_labels_within_a_power_of_ten_are_plain_numbers() -> None:
    with house_style():
        panel = Figure().subplots()
        logarithmic(panel.xaxis)
        panel.set_xlim(1.5, 4.5)
        assert {text for _, text in labels(panel, upright=False)} == {"2", "3", "4"}
        panel.set_xlim(2e-7, 9e-7)
        assert all("10^" in text for _, text in labels(panel, upright=False)), "1e-07 is no plain number"


def test_plain_powers_are_plain_numbers() -> None:
    with house_style():
        panel = Figure().subplots()
        logarithmic(panel.yaxis)
        panel.set_ylim(0.01, 100)
        plain_powers(panel.yaxis)
        assert {text for _, text in labels(panel, upright=True)} == {"0.01", "0.1", "1", "10", "100"}
        assert not len(panel.yaxis.get_minorticklocs())


def test_the_garbage_collector_is_left_as_it_was() -> None:
    gc.unfreeze()  # of tests/conftest.py
    with house_style():
        assert gc.get_freeze_count()
        with house_style():
            pass
        assert gc.get_freeze_count(), "that of the outer one stays"
    assert not gc.get_freeze_count()
    gc.freeze()
    try:
        with house_style():
            pass
        assert gc.get_freeze_count(), "a user's own stays"
    finally:
        gc.unfreeze()
        gc.freeze()
