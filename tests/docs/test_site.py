"""The site as `.ci/site` builds it, warnings as errors: complete, sorted by a click, searched, without any network."""

import json
import os
import re
import shutil
import subprocess
import sys
from html import unescape
from itertools import chain
from pathlib import Path

import pytest

import uavbench
from tests.docs.pages import PAGES, ROOT, blocks
from tests.reports.browser import NAMES, browser
from uavbench.bench.cli.main import main
from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.gallery.examples import options
from uavbench.bench.gallery.page import OPTIONS, SECTIONS

pytestmark = [pytest.mark.ci, pytest.mark.slow(seconds=120)]
needs_browser = pytest.mark.skipif(not any(map(shutil.which, NAMES)), reason="absent: chromium")
LARGEST_PICTURE, ALL_PICTURES = 60_000, 2_000_000
"""Bytes."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built") / "site"
    environment = {**os.environ, "UAVBENCH_BIN": str(Path(sys.executable).parent)}
    done = subprocess.run(
        [ROOT / ".ci" / "site", folder], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def text_of(site, name):
    return (site / name).read_text(encoding="utf-8")


def test_no_page_fetches_anything_from_another_host(site):
    fetched = re.compile(
        r"""<(?:script|img|iframe|link|source|video)\b[^>]*?\b(?:src|href)=["']?(?:https?:)?//[^>]*>"""
    )
    for page in site.rglob("*.html"):
        assert fetched.findall(page.read_text(encoding="utf-8")) == [], page.name
    for style in site.rglob("*.css"):
        assert re.findall(r"""(?:url\(|@import )["']?(?:https?:)?//[^)]*""", style.read_text(encoding="utf-8")) == []


def test_every_block_is_shown_as_code_and_those_to_save_with_their_file(site):
    for page in PAGES:
        html = text_of(site, f"{page.stem}.html")
        assert "```" not in html, page.name
        assert re.findall(r'<span class="filename">(.*?)</span>', html) == [b.file for b in blocks(page) if b.file]


def test_every_equation_is_drawn(site):
    for page in PAGES:
        labels = re.findall(r'class="equation" role="img" aria-label="([^"]+)"', text_of(site, f"{page.stem}.html"))
        assert [unescape(tex) for tex in labels] == [b.text.strip() for b in blocks(page) if b.language == "math"]


def test_every_plugin_that_can_be_seen_has_its_picture(site):
    shown = re.findall(r'<img alt="([^"]+)"[^>]* src="(gallery/[^"]+)"', text_of(site, "gallery.html"))
    wanted = [*(kind for protocol in SECTIONS for kind in PLUGINS[protocol][0]), *chain(*map(options, OPTIONS))]
    assert sorted(kind for kind, _ in shown) == sorted(wanted)
    sizes = [(site / source).stat().st_size for _, source in shown]
    assert max(sizes) < LARGEST_PICTURE and sum(sizes) < ALL_PICTURES


def test_commands_and_python_names_are_all_there(site):
    heads = re.findall(r"<h[1-6][^>]*>(.*?)<a class=", text_of(site, "reference/commands.html"))
    assert {f"uavbench {name}" for name in main.commands} <= {re.sub("<[^>]+>", "", head).strip() for head in heads}
    page = text_of(site, "reference/python.html")
    assert [name for name in uavbench.__all__ if name != "figures" and f'id="uavbench.{name}"' not in page] == []
    assert 'id="uavbench.reports.figures_on_axes.errors_over_time"' in page


def test_the_tutorials_show_what_their_cells_gave(site):
    for notebook in (ROOT / "examples").glob("*.ipynb"):
        page = text_of(site, f"tutorials/{notebook.stem}.html")
        assert "_files/" in page and "Traceback" not in page, notebook.stem
        assert all((site / "tutorials" / source).is_file() for source in re.findall(r'src="([^"]+_files/[^"]+)"', page))


@needs_browser
def test_the_results_sort_by_a_click(site):
    cells = "[...document.querySelectorAll('article table')[2].tBodies[0].rows].map(r => r.cells[1].textContent)"
    with browser() as page:
        page.open(site / "results.html")
        page.until("document.querySelectorAll('article table[data-sorts]').length > 3")
        page.value("document.querySelectorAll('article table')[2].tHead.rows[0].cells[1].id = 'frames'")
        frames = page.value(cells)
        page.click("#frames")
        page.until_is(cells, sorted(frames, key=int))
        page.click("#frames")
        page.until_is(cells, sorted(frames, key=int)[::-1])
        assert page.problems == []


@needs_browser
def test_the_search_finds_a_command_from_disk(site):
    with browser() as page:
        page.open(site / "index.html")
        page.until("document.querySelector('.md-search__input') !== null && typeof __md_get === 'function'")
        page.value("document.querySelector('.md-search__input').focus()")
        page.call("Input.insertText", text="closed loop")
        found = "[...document.querySelectorAll('.md-search-result__link')].map(a => a.getAttribute('href'))"
        page.until(f"{found}.some(h => h.includes('closed-loop.html'))")
        assert page.problems == []


def test_the_search_index_has_every_page(site):
    index = json.loads(text_of(site, "search/search_index.json"))
    pages = {entry["location"].partition("#")[0] for entry in index["docs"]}
    built = {str(path.relative_to(site)) for path in site.rglob("*.html")} - {"404.html"}
    assert built <= pages | {"index.html"}
