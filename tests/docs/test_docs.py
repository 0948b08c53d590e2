"""The docs say what is: links lead somewhere, tables are complete, configs are valid, commands exist."""

import contextlib
import re
import runpy
import shlex
import sys
import tomllib
from xml.etree import ElementTree

import click
import pytest
import yaml

from tests.docs.pages import GENERATED, PAGES, ROOT, blocks
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.external.program import External
from uavbench.bench.external.rows import FAULTS
from uavbench.bench.reference import config_values, plugins
from uavbench.bench.sensitivity.variants import values_of
from uavbench.bench.third_party.registry import THIRD_PARTY
from uavbench.tracker.images.track_images import RATE_HZ
from uavbench.tracker.robust.tracker import Robust


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        there = target.startswith("https://") or target in GENERATED or (page.parent / target).is_file()
        assert there, f"{page.name}: {target}"


def test_every_page_is_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {page.name for page in PAGES if page.stem != "index"} | GENERATED
    assert [name for name in sorted(pages) if f"({name})" not in index] == []


def test_every_page_is_in_the_navigation_of_the_site():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    shown = set(re.findall(r"[\w/-]+\.md$", text.split("\nnav:\n")[1], re.MULTILINE))
    assert shown == {page.name for page in PAGES} | {name for name in GENERATED if name.endswith(".md")}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_blocks_are_of_a_known_kind_and_none_is_left_open(page):
    text = page.read_text(encoding="utf-8")
    assert len(re.findall("^```", text, re.MULTILINE)) == 2 * len(blocks(page))
    assert {b.language for b in blocks(page)} <= {"sh", "console", "toml", "python", "text", "math"}
    assert "@" not in re.sub(r"`[^`]*`|```.*?```", "", text, flags=re.DOTALL), "a placeholder is left"


def test_every_equation_can_be_set_for_the_site():
    drawn = runpy.run_path(str(ROOT / ".ci" / "equations.py"))["drawn"]
    equations = [block.text for page in PAGES for block in blocks(page) if block.language == "math"]
    assert equations
    for tex in equations:
        paths = ElementTree.fromstring(drawn(tex)).findall(".//{http://www.w3.org/2000/svg}path")
        assert [path.get("d", "")[:1] for path in paths] == ["M"], tex
    with pytest.raises(ValueError, match="notacommand"):
        drawn(r"\notacommand{x}")


def is_of(module, folder):
    """Whether a module was imported from a folder."""
    return str(getattr(module, "__file__", None)).startswith(f"{folder}/")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_configs_and_programs_are_valid(page, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)  # of plug-ins that the page says to save
    for block in blocks(page):
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
    for block in blocks(page):
        if block.language == "toml":
            table = tomllib.loads(block.text)
            if "sequences" in table:
                load_suite(tmp_path / block.file)
                for name in [name for name, module in sys.modules.items() if is_of(module, tmp_path)]:
                    del sys.modules[name]
        if block.language == "python":
            compile(block.text, block.file, "exec")


def commands_in(text):
    """Command lines of uavbench, also as ./run, in a script."""
    for line in text.replace("\\\n", " ").splitlines():
        if not re.search(r"\b(uavbench|\./run) ", line) and not line.startswith("./run "):
            continue
        for part in re.split(r"\|\||&&|;|\|", line):
            words = [w for w in shlex.split(part, comments=True) if "=" not in w or w.startswith("-") or "/" in w]
            words = words[words.index("-") + 1 :] if words[:1] == ["-"] else words
            if words and words[0] in ("uavbench", "./run") and words[1:2] not in ([], ["demo"], ["test"]):
                yield words[1:]


def expect_valid(words):
    """The command and its options exist; nothing is done."""
    command = main.commands.get(words[0])
    assert command is not None, words
    redirected = words.index(">") if ">" in words else len(words)
    with contextlib.suppress(click.exceptions.Exit):
        command.make_context(words[0], words[1:redirected])


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_commands_and_options_exist(page):
    for block in blocks(page):
        if block.language in ("sh", "console"):
            for words in commands_in(block.text):
                expect_valid(words)


def scripts(node):
    """Every text of a recipe that a shell runs: under `run`, `script` and `before_script`."""
    if isinstance(node, list):
        for each in node:
            yield from scripts(each)
    elif isinstance(node, dict):
        for key, value in node.items():
            if key in ("run", "script", "before_script"):
                yield from [value] if isinstance(value, str) else value
            else:
                yield from scripts(value)


@pytest.mark.parametrize("recipe", sorted((ROOT / "ci-recipes").glob("*.yml")), ids=lambda p: p.stem)
def test_recipes_call_what_exists(recipe):
    """Its scripts call commands of uavbench that exist, with options that exist, and nothing of this repository's."""
    lines = [line.removeprefix("- ") for script in scripts(yaml.safe_load(recipe.read_text(encoding="utf-8")))
             for line in script.splitlines() if re.match(r"\s*uavbench ", line)]  # fmt: skip
    called = [words for line in lines for words in commands_in(line)]
    assert len(called) == len(lines) >= 1
    for words in called:
        expect_valid(words)
        given = "$SUITE" in words or any(word.startswith("out/") for word in words)
        assert given, "what a user has, not what is in this repository"
    assert "./run" not in recipe.read_text(encoding="utf-8")


def test_the_table_of_faults_is_complete():
    text = (ROOT / "docs" / "external-trackers.md").read_text(encoding="utf-8")
    section = text.split("## Faults")[1].split("##")[0]
    assert set(re.findall(r"^\| `([a-z-]+)` \|", section, re.MULTILINE)) == set(FAULTS)


def test_the_table_of_an_external_tracker_is_complete():
    text = (ROOT / "docs" / "external-trackers.md").read_text(encoding="utf-8")
    section = text.split("## The table in a suite")[1].split("## The folder")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)) == set(External.__dataclass_fields__)


def test_the_page_on_real_images_tells_the_default_rate_and_which_trackers_it_is_for():
    text = (ROOT / "docs" / "real-images.md").read_text(encoding="utf-8")
    assert f"`--rate-hz` is {RATE_HZ:g} unless given" in text
    assert re.search(rf"Third-party ones\]\(third-party\.md\), as `({'|'.join(THIRD_PARTY)})`", text)


def test_the_reference_names_every_plugin():
    text = plugins()
    for kind in ("box", "hand-pilot", "crazyflie", "noise", "lsd", "external"):
        assert f"### `{kind}`\n" in text


def test_the_reference_says_of_every_value_of_robust_where_it_comes_from():
    page, values = config_values(), [value.path for value in values_of(Robust())]
    rows = re.findall(r"^\| `(\w+)` \| .+ \| .+ \| \S.+ \|$", page, re.MULTILINE)
    assert sorted(rows) == sorted(path.rpartition(".")[2] for path in values)
    tables = set(re.findall(r"^## ([\w.]+)$", page, re.MULTILINE))
    assert tables == {path.rpartition(".")[0] for path in values}
    told = (ROOT / "docs" / "robust.md").read_text(encoding="utf-8")
    assert f"Its {len(values)} tuned values" in told
