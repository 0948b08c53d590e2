"""The pages, opened from disk in headless Chromium: clicked and read."""

import json
import re
from pathlib import Path

import pytest

from tests.reports.browser import browser

CURVE = "document.querySelector('#curve').toDataURL()"


@pytest.mark.slow
def test_the_summary_sorts_and_failures_come_first(report: Path) -> None:
    with browser() as page:
        page.open(report / "index.html")
        rows = "[...document.querySelectorAll('#summary-table tbody tr')].map(r => r.dataset.run)"
        names = page.value(rows)
        assert sorted(names) == ["hold@15hz", "hold@1hz", "lsd@15hz", "lsd@1hz"]
        column = "[...document.querySelectorAll('#summary-table tbody tr')].map(r => Number(r.cells[2].dataset.v))"
        page.click("#summary-table th:nth-child(3) button")
        page.until_is(column, sorted(page.value(column), reverse=True))
        page.click("#summary-table th:nth-child(3) button")
        page.until_is("document.querySelector('#summary-table th:nth-child(3)').ariaSort", "ascending")
        page.until_is(column, sorted(page.value(column)))
        told = page.value("[...document.querySelectorAll('.failures strong')].map(e => e.textContent)")
        scores = json.loads((report / "scores.json").read_text())["scores"]
        shares = {f"{s['label']}, {s['rate_hz']:g} Hz": s["tracking"]["success"] for s in scores}
        assert told[-1] == "Baseline: hold, 1 Hz, hold, 15 Hz" or told[-1] == "Baseline: hold, 15 Hz, hold, 1 Hz"
        assert [shares[name] for name in told[:-1]] == sorted(shares[name] for name in told[:-1])
        assert {name for name, share in shares.items() if share < 1 and "hold" not in name} <= set(told)
        page.until(
            "[...document.images].filter(i => i.loading !== 'lazy').every(i => i.complete && i.naturalWidth > 0)"
        )
        page.value("[...document.images].forEach(i => { i.loading = 'eager'; })")
        page.until("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
        assert page.problems == []


@pytest.mark.slow
def test_image_overlay_and_curve_move_together(report: Path) -> None:
    with browser() as page:
        page.open(report / "index.html")
        page.click(".failures > li:last-child summary")
        page.click(".failures > li:last-child a")
        page.until("document.querySelector('#view') !== null && document.readyState === 'complete'")
        page.until("document.querySelector('#position').textContent !== ''")
        page.until_text("#state", "off target")
        pixels = "document.querySelector('#view').getContext('2d').getImageData(0, 0, 320, 240).data.join()"
        page.until("document.querySelector('#view').getContext('2d').getImageData(5, 5, 1, 1).data[0] > 60")
        page.value("document.querySelector('#run').value = '0'")
        page.value("document.querySelector('#run').dispatchEvent(new Event('change'))")
        shown, view, curve = page.text("#shown"), page.value(pixels), page.value(CURVE)
        page.value("document.querySelector('#frame').value = 30")
        page.value("document.querySelector('#frame').dispatchEvent(new Event('input'))")
        assert shown != "30"
        page.until_text("#shown", "30")
        page.until_text("#seconds", "2.00 s")
        page.until(f"{CURVE} !== {json.dumps(curve)}")
        page.until(f"{pixels} !== {json.dumps(view)}")
        held = float(page.text("#position").split()[0])
        page.value("document.querySelector('#run').value = '2'")
        page.value("document.querySelector('#run').dispatchEvent(new Event('change'))")
        page.until(f"parseFloat(document.querySelector('#position').textContent) < {held}")
        page.click("#play")
        page.until("document.querySelector('#shown').textContent !== '30'")
        page.click("#play")
        assert page.problems == []


@pytest.mark.slow
def test_the_first_screen_holds_a_picture_and_the_scores_and_nothing_is_too_wide(report: Path) -> None:
    with browser() as page:
        for width, height in ((1400, 1000), (800, 1000)):
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            page.open(report / "index.html")
            assert page.value("document.documentElement.scrollWidth") <= width
            wide = "[...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth).length"
            assert page.value(wide) == 0
            bottom = "document.querySelector('header img').getBoundingClientRect().bottom"
            assert 100 < page.value(bottom) < height
            assert page.value("document.querySelector('#summary-table').getBoundingClientRect().top") < height / 2
            folded = "document.querySelector('.failures > li:last-child').getBoundingClientRect().height"
            assert page.value(folded) < 90


@pytest.mark.slow
def test_on_a_phone_wide_figures_stay_readable_and_the_page_does_not_move_sideways(report: Path) -> None:
    with browser() as page:
        page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
        page.open(report / "index.html")
        assert page.value("document.documentElement.scrollWidth") == 390
        widths = "[...document.querySelectorAll('{}')].map(e => e.clientWidth)"
        assert max(page.value(widths.format(".figures figure"))) <= 390
        wide = page.value(widths.format(".both .pan img"))
        assert len(wide) > 3 and min(wide) >= 700


def test_no_pose_is_lost_and_a_bad_one_is_off_target(report: Path) -> None:
    page = (report / "index.html").read_text()
    assert 'chip off-target">off target' in page
    assert not re.search(r"chip lost|100\.0 % with a pose. Lost", page)


def test_pages_ask_for_nothing_from_the_network(report: Path) -> None:
    for path in [report / "index.html", *(report / "pages").glob("*.html")]:
        text = path.read_text()
        assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", text)
        assert "fetch(" not in text
        for target in re.findall(r"""(?:src|href)=["']([^"'#]+)""", text):
            assert (path.parent / target).exists(), (path, target)
