"""Every command of the docs is run, page by page, in an empty folder with the files that the page says to save.

What pages do with the suite `tiny` is done once: a page finds it in its folder of results, and a run does the rest.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, blocks

pytestmark = [pytest.mark.ci, pytest.mark.slow(seconds=300)]
TINY = re.compile(r"uavbench (?:run|score) tiny --out (\S+)")
ENVIRONMENT = {
    **os.environ,
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "UAVBENCH_SOURCE": str(ROOT),
}


def run(text, folder):
    command = ["bash", "-euo", "pipefail", "-c", text]
    done = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Results of the suite `tiny`, from nothing, as the quick start makes them."""
    folder = tmp_path_factory.mktemp("tiny")
    run("uavbench run tiny --out out/first", folder)
    return folder / "out" / "first"


@pytest.mark.parametrize("page", [p for p in PAGES if any(b.language == "sh" for b in blocks(p))], ids=lambda p: p.stem)
def test_the_commands_of_a_page_work(page, tiny, tmp_path):
    for block in blocks(page):
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        if block.language == "sh":
            for out in TINY.findall(block.text):
                if not (tmp_path / out).exists():
                    shutil.copytree(tiny, tmp_path / out)
            run(block.text, tmp_path)
