"""A process that has imported a plug-in goes on with its code: after an edit it makes no results under the new one."""

import importlib
import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from uavbench.bench.config.plugin_models import import_plugin
from uavbench.trajectories.errors import UserError

ROOT = Path(__file__).parents[2]
PLUGIN = """
from dataclasses import dataclass
import {name}_part

@dataclass(frozen=True)
class Mine:
    gain: float = 1.0
    def start(self, structure, camera, cam_from_world, rng): ...
"""
names = (f"edited_of_test_{number}" for number in itertools.count())


@pytest.fixture
def named(tmp_path, monkeypatch):
    """Name of a plug-in's module, which imports another one."""
    monkeypatch.syspath_prepend(tmp_path)
    name = next(names)
    (tmp_path / f"{name}.py").write_text(PLUGIN.format(name=name))
    (tmp_path / f"{name}_part.py").write_text("GAIN = 1.0\n")
    importlib.invalidate_caches()
    return name


@pytest.mark.parametrize("ending", ["", "_part"])
def test_an_edited_module_is_refused_until_it_is_imported_anew_or_as_it_was(named, tmp_path, ending):
    import_plugin(f"{named}:Mine")
    assert import_plugin(f"{named}:Mine")().gain == 1.0
    source = tmp_path / f"{named}{ending}.py"
    was = source.read_text()
    source.write_text(was.replace("1.0", "2.0"))
    with pytest.raises(UserError, match=rf"'{named}:Mine': {source.name} was edited after .*; restart Python"):
        import_plugin(f"{named}:Mine")
    source.write_text(was)
    import_plugin(f"{named}:Mine")
    source.write_text(was.replace("1.0", "2.0"))
    importlib.reload(sys.modules[source.stem])
    importlib.reload(sys.modules[named])
    assert import_plugin(f"{named}:Mine")().gain == (2.0 if ending == "" else 1.0)


def run(code, folder, **variables):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    path = os.pathsep.join((str(folder), str(ROOT / "src")))
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env={**environment, "PYTHONPATH": path, **variables}, capture_output=True, text=True, cwd=folder
    )


BEFORE = """
import {name}_part
from pathlib import Path
Path("{name}_part.py").write_text("GAIN = 22.0\\n")
from uavbench.bench.config.plugin_models import import_plugin
import_plugin("{name}:Mine")
"""
WRITTEN = """
from pathlib import Path
Path("{name}_part.py").write_text("GAIN = 22.0\\n")
import {name}_part
from uavbench.bench.config.plugin_models import import_plugin
print(import_plugin("{name}:Mine")().gain)
"""


def test_a_module_that_a_script_imported_and_wrote_before_any_plugin_is_refused(named, tmp_path):
    told = run(BEFORE.format(name=named), tmp_path)
    assert f"{named}_part.py was edited after this Python had imported it" in told.stderr
    assert run(WRITTEN.format(name=named), tmp_path).stdout == "1.0\n", "written first, as by a cell of a notebook"


@pytest.mark.parametrize("by", ["cell", "standard input"])
def test_a_class_that_is_in_no_file_is_refused(tmp_path, by):
    """Its results would count as those of any other class of that name."""
    code = PLUGIN.format(name="math").replace("math_part", "math") + (
        "from uavbench.bench.config.plugin_models import import_plugin\nimport_plugin('__main__:Mine')\n"
    )
    if by == "cell":
        told = run(code, tmp_path).stderr
    else:
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
        told = subprocess.run([sys.executable], input=code, env=environment, capture_output=True, text=True).stderr
    assert told.splitlines()[-1].endswith(
        "plug-in '__main__:Mine' is in no file, by which its results could be known; save it as MODULE.py"
    )


MADE = """
from dataclasses import dataclass, make_dataclass
def start(self, structure, camera, cam_from_world, rng): ...
def local():
    @dataclass(frozen=True)
    class Local:
        start = start
    return Local
Local = local()
Elsewhere = make_dataclass("Elsewhere", [("gain", float, 1.0)], namespace={"start": start})
Elsewhere.__module__ = "types"
Other = make_dataclass("Another", [("gain", float, 1.0)], namespace={"start": start, "__module__": __name__})
Made = make_dataclass("Made", [("gain", float, 1.0)], namespace={"start": start, "__module__": __name__})
Typed = dataclass(type("Typed", (), {"__annotations__": {"gain": float}, "gain": 1.0, "start": start}))
"""


@pytest.mark.parametrize(
    ("attribute", "found"), [("Elsewhere", 0), ("Other", 0), ("Local", 0), ("Made", 1), ("Typed", 1)]
)
def test_a_class_that_is_not_where_it_says_is_refused(named, tmp_path, attribute, found):
    """Its code would be that of another module, such as `types`, and no other process could unpickle it."""
    (tmp_path / f"{named}.py").write_text(MADE)
    if attribute in ("Made", "Typed"):
        assert import_plugin(f"{named}:{attribute}").__module__ == named
        return
    with pytest.raises(UserError, match=r"where it is not.*make_dataclass"):
        import_plugin(f"{named}:{attribute}")
