"""Kernels of a user's plug-in with `cache=True` are those of the files as they are, wherever the plug-in runs."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uavbench.bench.external.job_folder import job_folder
from uavbench.bench.external.program import External
from uavbench.trajectories.kernels.cache import MARKER, folder_of, remove_old

ROOT = Path(__file__).parents[2]
CALLEE = """import numba

SCALE = 2.0

@numba.njit
def scaled(x):
    return SCALE * x
"""
PLUGIN = """import importlib
import json
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np

from callee_of_test import scaled

HERE = Path(__file__).parent
TABLE = np.loadtxt(HERE / "table.txt", ndmin=1)
GIVEN = np.loadtxt((HERE / "where.cfg").read_text().strip(), ndmin=1)
FOUND = importlib.import_module("found" + "_at_run_time").VALUE

@numba.njit(cache=True)
def lazy(x):
    return scaled(x) + TABLE[0] + GIVEN[0] + FOUND

@numba.njit("f8(f8)", cache=True)
def eager(x):
    return scaled(x) + FOUND + GIVEN[0]

@numba.vectorize(["f8(f8)"], cache=True)
def each(x):
    return scaled(x)

@numba.guvectorize(["f8[:], f8[:]"], "(n)->(n)", cache=True)
def whole(x, out):
    for i in range(len(x)):
        out[i] = scaled(x[i])

@dataclass(frozen=True)
class Mine:
    marker: str = ""

    def build(self, rng):
        raise NotImplementedError

    def numbers(self):
        return [lazy(3.0), eager(3.0), float(each(np.array([3.0]))[0]), float(whole(np.array([3.0]))[0])]

    def __call__(self, content_hash, on_step):
        told = {"numbers": self.numbers(), "hits": sum(lazy.stats.cache_hits.values())}
        Path(self.marker).write_text(json.dumps(told))
"""
START = """import gc
import sys
from pathlib import Path
gc.disable()  # collections take a fifth of the time of the compiler
marker = Path(sys.argv[1])
table = {"kind": "plugin_of_test:Mine", "input_files": [sys.argv[2]], "marker": str(marker)}

def read():
    from uavbench.bench.config.plugin_models import build, model_of, own_plugins
    (kind, cls), = own_plugins(table)
    errors = []
    made = build(model_of(cls, (), kind).model_validate_json(__import__("json").dumps(table)), "", errors)
    assert not errors, errors
    return made

def job(work):
    from uavbench.bench.inputs.content_hash import content_hash
    from uavbench.bench.runner.graph import Job
    return Job(verb="track", name="one", work=work, marker=marker, content_hash=content_hash(work))
"""
WAYS = {
    "worker": """
if __name__ == "__main__":
    from uavbench.bench.runner.executors import local_pool
    from uavbench.bench.runner.graph import run_graph
    with local_pool(1) as (pool, progress):
        outcome = run_graph([job(read())], pool, progress)
    assert not outcome.failed, outcome
""",
    "own process": """
from uavbench.bench.runner.graph import run_graph
from uavbench.bench.runner.render_suite import InProcess
outcome = run_graph([job(read())], InProcess())
assert not outcome.failed, outcome
""",
    "dask": """
if __name__ == "__main__":
    from uavbench.bench.runner.executors import dask_pool
    from uavbench.bench.runner.graph import run_graph
    (marker.parent / "suite.json").write_text("{}")
    with dask_pool("local", 1, marker.parent) as (pool, progress):
        outcome = run_graph([job(read())], pool, progress)
    assert not outcome.failed, outcome
""",
}
OTHERS = {
    "imported before": """
import plugin_of_test
read()("", print)
""",
    "edited": """
made = read()
Path(sys.modules["callee_of_test"].__file__).write_text(sys.argv[3])
made("", print)
""",
}


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "mine"
    made.mkdir()
    texts = {"callee_of_test.py": CALLEE, "plugin_of_test.py": PLUGIN, "found_at_run_time.py": "VALUE = 0.0\n"}
    for name, text in {**texts, "table.txt": "10.0", "where.cfg": str(tmp_path / "given.txt")}.items():
        (made / name).write_text(text)
    (tmp_path / "given.txt").write_text("100.0")
    return made


def environment(folder):
    kept = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    return {
        **kept,
        "XDG_CACHE_HOME": str(folder.parent / "cache"),
        "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT / "src"))),
        "PYTHONDONTWRITEBYTECODE": "1",
    }


def ran(folder, way, *more, **variables):
    """Numbers of the plug-in's kernels, and whether `lazy` was in the cache."""
    script, out = folder.parent / "script.py", folder.parent / "out" / "told.json"
    out.parent.mkdir(exist_ok=True)
    out.unlink(missing_ok=True)
    script.write_text(START + {**WAYS, **OTHERS}[way])
    time.sleep(0.05)  # several ticks of the kernel, in which the start of a process is counted
    command = [sys.executable, str(script), str(out), str(folder.parent / "given.txt"), *more]
    done = subprocess.run(
        command, env={**environment(folder), **variables}, cwd=folder.parent, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(out.read_text())
    return told["numbers"], told["hits"]


def edit_the_callee(folder):
    (folder / "callee_of_test.py").write_text(CALLEE.replace("return SCALE", "return 2.0 * SCALE"))


def edit_what_is_read_at_run_time(folder):
    (folder / "found_at_run_time.py").write_text("VALUE = 5.0\n")
    (folder / "table.txt").write_text("20.0")


def edit_an_input(folder):
    (folder.parent / "given.txt").write_text("200.0")


def test_numbers_are_those_of_an_empty_cache_after_every_change(folder):
    read = 'import os\nVALUE = float(os.environ.get("OFFSET_OF_TEST", "0"))\n'
    (folder / "found_at_run_time.py").write_text(read)
    assert ran(folder, "own process") == ([116.0, 106.0, 6.0, 6.0], 0)
    assert ran(folder, "own process") == ([116.0, 106.0, 6.0, 6.0], 1), "kept for the next process"
    told = "a variable that its module reads"
    assert ran(folder, "own process", OFFSET_OF_TEST="5") == ([121.0, 111.0, 6.0, 6.0], 0), told
    assert ran(folder, "own process", OFFSET_OF_TEST="5")[1] == 1
    edit_the_callee(folder)
    assert ran(folder, "own process") == ([122.0, 112.0, 12.0, 12.0], 0), "a function of another file"
    edit_what_is_read_at_run_time(folder)
    told = "a module found at run time, and a file that is named"
    assert ran(folder, "own process") == ([137.0, 117.0, 12.0, 12.0], 0), told
    edit_an_input(folder)
    assert ran(folder, "own process")[0] == [237.0, 217.0, 12.0, 12.0], "a declared input file"
    assert not list(folder.glob("__pycache__/*.nb?")), "nothing beside the plug-in"
    home = folder.parent / "cache" / "uavbench" / "kernels"
    old = [path.parent for path in home.glob("*/*lazy*.nbc")]
    assert old
    for path in old:
        os.utime(path / MARKER, (0, 0))
    remove_old(home)
    assert not any(path.exists() for path in old), "unused"


@pytest.mark.parametrize("way", ["worker", pytest.param("dask", marks=[pytest.mark.ci, pytest.mark.slow])])
def test_numbers_are_kept_until_something_changes_in_a_worker_too(folder, way):
    assert ran(folder, way) == ([116.0, 106.0, 6.0, 6.0], 0)
    assert ran(folder, way) == ([116.0, 106.0, 6.0, 6.0], 1), "kept for the next process"
    for edit in (edit_the_callee, edit_what_is_read_at_run_time, edit_an_input):
        edit(folder)
    assert ran(folder, way)[0] == [237.0, 217.0, 12.0, 12.0]
    assert not list(folder.glob("__pycache__/*.nb?")), "nothing beside the plug-in"


def test_a_script_that_imports_a_plugin_before_uavbench_has_its_kernels_by_content_too(folder):
    """Except those with signatures: they are compiled by their import."""
    assert ran(folder, "imported before")[0][0] == 116.0
    (folder / "callee_of_test.py").write_text(CALLEE.replace("return SCALE", "return 2.0 * SCALE"))
    assert ran(folder, "imported before")[0][0] == 122.0


def test_nothing_is_kept_of_a_file_that_was_edited_while_its_old_text_ran(folder):
    """It is the old code, and the new text would be its key."""
    new = CALLEE.replace("return SCALE", "return 2.0 * SCALE")
    assert ran(folder, "edited", new) == ([116.0, 106.0, 6.0, 6.0], 0)
    assert ran(folder, "own process")[0] == [122.0, 112.0, 12.0, 12.0]


PROGRAM = """#!{python}
import numba
from callee_of_test import scaled

@numba.njit(cache=True)
def kernel(x):
    return scaled(x)

print(kernel(3.0), sum(kernel.stats.cache_hits.values()), flush=True)
"""


def test_an_external_program_has_the_kernels_of_its_files(folder, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder.parent / "cache"))
    folder_of.cache_clear()
    program = folder / "program.py"
    program.write_text(PROGRAM.format(python=sys.executable))
    tracker = External(command=(sys.executable, "-B", str(program)))

    def told():
        with job_folder() as guard, tracker.run(guard) as process:
            return process.line(time.monotonic() + 60.0, "at its start")

    assert [told(), told()] == ["6.0 0", "6.0 1"]
    (folder / "callee_of_test.py").write_text(CALLEE.replace("return SCALE", "return 2.0 * SCALE"))
    assert told() == "12.0 0"
    assert not list(folder.glob("__pycache__/*.nb?"))
    home = folder.parent / "cache" / "uavbench" / "kernels"
    for marker in home.glob(f"*/{MARKER}"):
        os.utime(marker, (0, 0))
    remove_old(home)
    assert not list(home.iterdir())
    folder_of.cache_clear()
