"""What is in the key of a result: everything whose change may change it."""

import base64
import hashlib
import importlib
import itertools
import os
import subprocess
import sys

import pytest

from tests.bench.small_suites import OWN_IMAGES, own_images
from uavbench.bench.config.suite import load_suite, load_tracker
from uavbench.bench.external.program import External
from uavbench.bench.inputs import plugin_files
from uavbench.bench.inputs.content_hash import content_hash, contents
from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.trajectories.errors import UserError

PLUGIN = """
from dataclasses import dataclass
{imports}

@dataclass(frozen=True)
class Mine:
    gain: float = 1.0
    def start(self, structure, camera, cam_from_world, rng): ...
"""
names = (f"plugin_of_test_{number}" for number in itertools.count())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def tracker(folder, name, more=""):
    (folder / "tracker.toml").write_text(f'kind = "{name}:Mine"\n{more}')
    importlib.invalidate_caches()
    return load_tracker(folder / "tracker.toml")


def write(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


WAYS = {
    "import": ("import {name}_a", "{name}_a.py"),
    "from": ("from {name}_a import b", "{name}_a.py"),
    "of what it imports": ("import {name}_chain", "{name}_a.py"),
    "in a function": ("def late():\n    import {name}_a", "{name}_a.py"),
    "by a computed name": ("import importlib\nimportlib.import_module('_'.join(['{name}', 'a']))", "{name}_a.py"),
    "by a name": ("def late():\n    import importlib\n    importlib.import_module('{name}_a')", "{name}_a.py"),
    "of a package": ("from {name}_p.deep import inner", "{name}_p/deep/inner.py"),
    "its package's file": ("import {name}_p.deep", "{name}_p/__init__.py"),
    "data beside it": ("WEIGHTS = '{name}.npy'", "{name}.npy"),
    "of a module by a name": (
        "def late():\n    import importlib\n    importlib.import_module('{name}_chain')",
        "{name}_a.py",
    ),
    "data in a folder": (
        "from pathlib import Path\nW = Path(__file__).parent / 'data' / '{name}.npy'",
        "data/{name}.npy",
    ),
    "data by a path": ("W = 'data/{name}.npy'", "data/{name}.npy"),
    "data above": (
        "from pathlib import Path\nW = Path(__file__).parents[1] / 'above_{name}.npy'",
        "../above_{name}.npy",
    ),
    "data of its own name": ("from pathlib import Path\nW = Path(__file__).with_suffix('.npy')", "{name}.npy"),
    "data by a pattern": (
        "from pathlib import Path\nW = [*(Path(__file__).parent / 'data').glob('*.npy')]",
        "data/{name}.npy",
    ),
    "data by an f-string": ("def of(kind):\n    return f'{{HERE}}/data/{{kind}}.npy'", "data/{name}.npy"),
    "data in a command": ("def run():\n    system('solve --with={name}.npy -v')", "{name}.npy"),
    "data named by data": ("S = '{name}.toml'", "data/{name}.npy"),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_plugin_is_all_that_it_imports(folder, way):
    name = next(names)
    imports, edited = (text.format(name=name) for text in WAYS[way])
    write(folder / f"{name}.py", PLUGIN.format(imports=imports))
    write(folder / f"{name}_a.py", "b = 1\n")
    write(folder / f"{name}_chain.py", f"from {name}_a import b\n")
    for inside in ("__init__.py", "deep/__init__.py", "deep/inner.py"):
        write(folder / f"{name}_p" / inside, "b = 1\n")
    for place in (f"{name}.npy", f"data/{name}.npy", f"../above_{name}.npy"):
        write(folder / place, "1")
    write(folder / f"{name}.toml", f'weights = "data/{name}.npy"\n')
    write(folder / f"{name}_unrelated.py", "b = 1\n")
    mine = tracker(folder, name)
    before = content_hash(mine)
    write(folder / f"{name}_unrelated.py", "b = 2\n")
    assert content_hash(mine) == before
    write(folder / edited, "b = 2\n")
    assert content_hash(mine) != before


KEYS = """
import importlib, os, sys
from pathlib import Path
from uavbench.bench.config.plugin_models import import_plugin
from uavbench.bench.inputs.content_hash import content_hash

for gain in "122":
    for name in ("this.py", "antigravity/inner.py"):
        (Path(sys.argv[1]) / name).write_text(f"GAIN = {gain}\\n")
    importlib.invalidate_caches()
    if not (child := os.fork()):  # a process that has imported none of them
        print(content_hash(import_plugin("mine:Mine")()), flush=True)
        os._exit(0)
    assert not os.waitpid(child, 0)[1]
"""
"""Prints the keys of a plug-in, each with another content of the modules that it may import, and the last one twice."""


@pytest.mark.parametrize("way", ["import this", "def late():\n    import this", "import antigravity.inner"])
def test_a_module_of_a_name_of_pythons_enters_where_it_comes_first_on_the_path(tmp_path, way):
    """As `code.py` or `profile.py` beside a plug-in, which Python imports in place of its own."""
    write(tmp_path / "mine.py", PLUGIN.format(imports=way))
    write(tmp_path / "antigravity" / "__init__.py")
    write(tmp_path / "json" / "not_a_package.txt")
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    keys = subprocess.check_output([sys.executable, "-c", KEYS, tmp_path], env=environment, text=True).split()
    assert keys[0] != keys[1] == keys[2]


def test_a_variable_that_a_plugin_names_is_in_its_key(folder, monkeypatch):
    name = next(names)
    write(folder / f"{name}.py", PLUGIN.format(imports=f"import {name}_a"))
    write(folder / f"{name}_a.py", "import os\nGAIN = os.environ.get('GAIN_OF_TEST'), __name__ == '_'\n")
    mine = tracker(folder, name)
    hashes = [content_hash(mine)]
    for value in ("1", "2"):
        monkeypatch.setenv("GAIN_OF_TEST", value)
        hashes.append(content_hash(mine))
    assert len({*hashes}) == 3
    for unrelated in ("OTHER_OF_TEST", "_", "PWD"):
        monkeypatch.setenv(unrelated, "3")
    assert content_hash(mine) == hashes[-1]


def test_a_plugin_in_a_package_is_the_whole_package(folder):
    name = next(names)
    write(folder / name / "__init__.py")
    write(folder / name / "mine.py", PLUGIN.format(imports="from . import helper"))
    write(folder / name / "helper.py", "b = 1\n")
    weights = write(folder / name / "data" / "weights.bin", "1")
    mine = tracker(folder, f"{name}.mine")
    hashes = [content_hash(mine)]
    for path in (folder / name / "helper.py", weights, folder / name / "__init__.py"):
        path.write_text("c = 3\n")
        hashes.append(content_hash(mine))
    assert len(set(hashes)) == 4
    write(folder / name / "__pycache__" / "helper.pyc", "compiled")
    assert content_hash(mine) == hashes[-1]


def test_an_installed_plugin_and_what_it_imports_count_by_version_and_content(folder, monkeypatch):
    name, other = next(names), next(names)
    for dist, files in ((name, [f"{name}/__init__.py", f"{name}/data.bin"]), (other, [f"{other}.py"])):
        write(folder / f"{dist}-1.0.dist-info" / "METADATA", f"Name: {dist}\nVersion: 1.0\n")
        write(folder / f"{dist}-1.0.dist-info" / "RECORD", "".join(f"{file},,\n" for file in files))
        for file in files:
            write(folder / file, PLUGIN.format(imports=f"import {other}") if file.endswith("__init__.py") else "1")
    monkeypatch.setattr("uavbench.trajectories.sources.module_files.INSTALLED", (folder,))
    from uavbench.trajectories.sources.module_files import editable

    plugin_files._distributions.cache_clear()
    editable.cache_clear()
    mine = tracker(folder, name)
    hashes = [content_hash(mine)]
    write(folder / name / "data.bin", "2")  # edited in place
    hashes.append(content_hash(mine))
    for dist in (name, other):
        write(folder / f"{dist}-1.0.dist-info" / "METADATA", f"Name: {dist}\nVersion: 1.1\n")
        hashes.append(content_hash(mine))
    assert len(set(hashes)) == 4
    editable.cache_clear()
    plugin_files._distributions.cache_clear()


def test_input_files_of_a_plugin_without_such_a_field(folder):
    name = next(names)
    write(folder / f"{name}.py", PLUGIN.format(imports=""))
    write(folder / "net.bin", "1")
    mine = tracker(folder, name, 'input_files = ["net.bin"]')
    before = content_hash(mine)
    assert before != content_hash(tracker(folder, name))
    write(folder / "net.bin", "2")
    assert content_hash(mine) != before
    with pytest.raises(UserError, match=r"tracker\.input_files: .*none\.bin is not a file"):
        tracker(folder, name, 'input_files = ["none.bin"]')


def test_a_plugin_that_raises_when_it_is_imported_is_named(folder):
    name = next(names)
    write(folder / f"{name}.py", "1 / 0")
    with pytest.raises(UserError, match="cannot be imported: ZeroDivisionError"):
        tracker(folder, name)


def program(path, text="#!/bin/sh\n"):
    write(path, text).chmod(0o755)
    return path


def test_a_program_on_path_counts_by_its_content(tmp_path, monkeypatch):
    found = program(tmp_path / "bin" / "mytracker")
    monkeypatch.setenv("PATH", f"{found.parent}:{os.environ['PATH']}")
    tracker = External(command=("mytracker",))
    before = content_hash(tracker)
    program(found, "#!/bin/sh\nexit 1\n")
    assert content_hash(tracker) != before
    program(tmp_path / "nearer" / "mytracker", "#!/bin/sh\nexit 2\n")
    here = content_hash(tracker)
    monkeypatch.setenv("PATH", f"{tmp_path / 'nearer'}:{os.environ['PATH']}")
    assert content_hash(tracker) != here


@pytest.mark.parametrize(
    ("command", "edited"),
    [
        (["python3", "run.py"], "helper.py"),
        (["python3", "run.py"], "package/inner.py"),
        (["python3", "run.py"], "weights.npy"),
        (["python3", "-m", "module"], "on_path/module.py"),
        (["python3", "-m", "inside"], "on_path/inside/__main__.py"),
        (["python3", "-c", "import module; module.run()"], "on_path/module.py"),
        (["./run"], "helper.py"),
        (["true", "net.bin"], "net.bin"),
        (["true", "--weights=ABOVE/net.bin"], "net.bin"),
        (["env", "A=1", "python3", "run.py"], "helper.py"),
        (["bash", "run.sh"], "run.py"),
        (["bash", "run.sh"], "helper.py"),
        (["bash", "run.sh"], "deep/inner.sh"),
        (["bash", "run.sh"], "weights.npy"),
        (["./script"], "deep/of_inner.py"),
        (["bash", "run.sh"], "package/inner.py"),
    ],
)
def test_a_command_is_its_scripts_with_what_they_import(tmp_path, monkeypatch, command, edited):
    script = "import helper\nfrom package import inner\nopen('weights.npy')\n"
    write(tmp_path / "run.py", script)
    program(tmp_path / "run", f"#!/usr/bin/env python3\n{script}")
    shell = 'cd "$(dirname "$0")"; . ./deep/inner.sh\nexec python3 "$PWD/run.py" --fast\n'
    write(tmp_path / "run.sh", shell)
    program(tmp_path / "script", f"#!/bin/sh\n{shell}")
    write(tmp_path / "deep" / "inner.sh", "python3 of_inner.py\n")
    write(tmp_path / "deep" / "of_inner.py", "")
    for name in ("helper.py", "package/__init__.py", "package/inner.py", "weights.npy", "net.bin", "other.py"):
        write(tmp_path / name, "1")
    for name in ("module.py", "inside/__init__.py", "inside/__main__.py"):
        write(tmp_path / "on_path" / name, "1")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "on_path"))
    words = ", ".join(f'"{word.replace("ABOVE", str(tmp_path))}"' for word in command)
    write(tmp_path / "tracker.toml", f'kind = "external"\ncommand = [{words}]\n')
    tracker = load_tracker(tmp_path / "tracker.toml")
    before = content_hash(tracker)
    write(tmp_path / "other.py", "2")
    assert content_hash(tracker) == before
    write(tmp_path / edited, "2")
    assert content_hash(tracker) != before


WRAPPERS = {
    "a script beside it": ("python3 tracker.py", "tracker.py"),
    "by a variable": ('exec "$HERE/tracker" "$@"', "tracker"),
    "by dirname": ('exec "$(dirname "$0")"/build/../lib/tracker', "lib/tracker"),
    "a wrapper of a wrapper": ("./second.sh", "tracker"),
    "by its whole path": ("exec {folder}/far/tracker", "far/tracker"),
    "what that imports": ("python3 main.py", "helper.py"),
    "its settings": ("./run --config=conf/settings.yaml", "conf/settings.yaml"),
    "a program on PATH": ("on-path-tracker --fast", "bin/on-path-tracker"),
}


@pytest.mark.parametrize("way", WRAPPERS)
def test_a_shell_script_is_what_it_names_too(tmp_path, monkeypatch, way):
    line, changed = WRAPPERS[way]
    texts = {"second.sh": "exec ./tracker", "main.py": "import helper", "bin/on-path-tracker": ""}
    for name in ("tracker.py", "tracker", "lib/tracker", "far/tracker", "helper.py", "conf/settings.yaml", *texts):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(texts.get(name, ""))
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    (tmp_path / "run.sh").write_text(f"#!/bin/sh\n{line.format(folder=tmp_path)}\n")
    (tmp_path / "run.sh").chmod(0o755)
    commands = [(str(tmp_path / "run.sh"),), ("sh", str(tmp_path / "run.sh"), "--fast")]
    before = [content_hash(External(command=command)) for command in commands]
    (tmp_path / "bystander.py").write_text("x")
    assert [content_hash(External(command=command)) for command in commands] == before
    (tmp_path / changed).write_text(texts.get(changed, "") + "\n# changed")
    after = [content_hash(External(command=command)) for command in commands]
    assert all(a != b for a, b in zip(before, after, strict=True))


def test_a_shell_line_is_the_files_that_it_names_by_whole_paths(tmp_path):
    (tmp_path / "tracker").write_text("one")
    command = ("sh", "-c", f"cd /; exec '{tmp_path / 'tracker'}' --fast")
    before = content_hash(External(command=command))
    (tmp_path / "tracker").write_text("two")
    assert content_hash(External(command=command)) != before


@pytest.mark.parametrize("place", ["bin", "lib", "elsewhere"])
def test_a_program_is_its_shared_libraries_too(tmp_path, place):
    for name in ("bin", "lib", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / place / "libtracking.so.1").write_bytes(b"one")
    (tmp_path / place / "libother.so").write_bytes(b"one")
    program = tmp_path / "bin" / "tracker"
    run_path = f"\0$ORIGIN/x:{tmp_path / 'elsewhere'}\0".encode()
    program.write_bytes(b"\x7fELF\0libtracking.so.1\0" + run_path)
    program.chmod(0o755)
    before = content_hash(External(command=(str(program),)))
    (tmp_path / place / "libother.so").write_bytes(b"two")
    assert content_hash(External(command=(str(program),))) == before
    (tmp_path / place / "libtracking.so.1").write_bytes(b"two")
    assert content_hash(External(command=(str(program),))) != before


def test_a_link_stays_the_interpreter_of_its_environment(tmp_path):
    site = tmp_path / ".venv" / "lib" / "python3.11" / "site-packages"
    metadata = write(site / "net-1.0.dist-info" / "METADATA", "1.0")
    settings = write(tmp_path / ".venv" / "pyvenv.cfg", "home = /usr/bin")
    base = program(tmp_path / "base" / "python3.11")
    source = write(tmp_path / "source" / "mine" / "core.py", "1")
    write(site / "mine.pth", f"{source.parents[1]}\n")
    link = tmp_path / ".venv" / "bin" / "python"
    link.parent.mkdir()
    link.symlink_to(base)
    write(tmp_path / "run.py", "from mine import core\n")
    write(tmp_path / "tracker.toml", 'kind = "external"\ncommand = [".venv/bin/python", "run.py"]\n')
    tracker = load_tracker(tmp_path / "tracker.toml")
    assert tracker.command == (str(link), str(tmp_path / "run.py"))
    hashes = [content_hash(tracker)]
    for path in (base, metadata, settings, source):
        path.write_text("#!/bin/sh\n# changed\n")
        hashes.append(content_hash(tracker))
    assert len(set(hashes)) == 5


MODELS = {
    "a.obj": ("mtllib my materials.mtl\n", {"my materials.mtl": "newmtl a\n  map_Kd -s 1 1 1 my brick.png\n"}),
    "b.obj": ("  MTLLIB sub/b.mtl\n", {"sub/b.mtl": "map_bump b.png\n", "sub/b.png": ""}),
    "c.gltf": (
        '{"buffers": [{"uri": "c%20d.bin"}], "images": [{"uri" : "\\u0063.png"}]}',
        {"c d.bin": "", "c.png": ""},
    ),
    "escaped.gltf": (
        '{"buffers": [{"\\u0075ri": "c%20d.bin"}], "images": [{"\\u0075\\u0072i": "c.png"}]}',
        {"c d.bin": "", "c%20d.bin": "", "c.png": ""},
    ),
    "d.ply": ("ply\nformat ascii 1.0\ncomment TextureFile d.jpg\nend_header\n", {"d.jpg": ""}),
    "e.cao": ('V1\nload("f.cao")\n', {"f.cao": 'V1\n load ( "g.cao", t=[1, 2, 3])\n', "g.cao": 'V1\nload("f.cao")\n'}),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_model_is_all_files_that_it_refers_to(tmp_path, name):
    text, parts = MODELS[name]
    write(tmp_path / name, text)
    write(tmp_path / "my brick.png", "1")
    for part, content in parts.items():
        write(tmp_path / part, content)
    model = MeshFile(path=str(tmp_path / name))
    hashes = [content_hash(model)]
    for part in [name, *parts, *(["my brick.png"] if name == "a.obj" else [])]:
        (tmp_path / part).write_text((tmp_path / part).read_text() + "\n")
        hashes.append(content_hash(model))
    assert len(set(hashes)) == len(hashes)


def test_models_that_load_each_other_in_circles_are_looked_at_once(tmp_path):
    (tmp_path / "sub").mkdir()
    for name, other in (("a", "b"), ("b", "a")):
        text = "".join(f'load("sub/../{other}.cao")\n load("./sub/../{name}.cao")\n' for _ in range(3))
        write(tmp_path / f"{name}.cao", f"V1\n{text}")
    assert {path.name for path in parts_of(tmp_path / "a.cao")} == {"a.cao", "b.cao"}


def test_a_binary_gltf_refers_by_its_first_chunk(tmp_path):
    text = b'{"buffers": [{"uri": "a.bin"}]} '
    write(tmp_path / "a.bin", "1")
    head = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text)).to_bytes(4, "little")
    (tmp_path / "a.glb").write_bytes(head + len(text).to_bytes(4, "little") + b"JSON" + text)
    before = content_hash(MeshFile(path=str(tmp_path / "a.glb")))
    write(tmp_path / "a.bin", "2")
    assert content_hash(MeshFile(path=str(tmp_path / "a.glb"))) != before


def test_the_name_of_a_folder_is_not_in_the_key_of_a_model(tmp_path):
    for name in ("here", "there"):
        write(tmp_path / name / "a.obj", "v 0 0 0\n")
    here, there = (MeshFile(path=str(tmp_path / name / "a.obj")) for name in ("here", "there"))
    assert content_hash(here) == content_hash(there)


def test_what_was_written_and_nothing_names_is_not_in_the_key(folder):
    name = next(names)
    write(folder / f"{name}.py", PLUGIN.format(imports='"""Writes nothing out of order; see data."""'))
    mine = tracker(folder, name)
    before = content_hash(mine)
    for place in ("out/suite.json", "out/results/a/score.json", "data/more.csv", "run.log"):
        write(folder / place, "{}")
    assert content_hash(mine) == before


GIVEN = {
    "a setting": ("net.toml", "weights.bin"),
    "its materials": ("model.obj", "model.mtl"),
    "its texture": ("model.obj", "brick.png"),
    "of a long model": ("long.obj", "model.mtl"),
}


@pytest.mark.parametrize("key", ["net_file", "input_files"])
@pytest.mark.parametrize("what", GIVEN)
def test_what_a_file_that_a_plugin_is_given_names_enters(folder, key, what):
    name = next(names)
    given, edited = GIVEN[what]
    field = '    net_file: str = ""\n    def start'
    write(folder / f"{name}.py", PLUGIN.format(imports="").replace("    def start", field))
    write(folder / "net.toml", 'weights = "weights.bin"\n')
    write(folder / "model.obj", "mtllib model.mtl\n")
    write(folder / "long.obj", "mtllib model.mtl\n" + "v 0 0 0\n" * (1 << 18))
    write(folder / "model.mtl", "newmtl a\nmap_Kd brick.png\n")
    for data in ("weights.bin", "brick.png"):
        write(folder / data, "1")
    more = f'net_file = "{given}"\n' if key == "net_file" else f'input_files = ["{given}"]\n'
    mine = tracker(folder, name, more)
    before = content_hash(mine)
    write(folder / edited, (folder / edited).read_text() + "#\n")
    assert content_hash(mine) != before


def test_what_the_model_of_a_users_structure_names_is_another_flight(folder):
    name = next(names)
    write(folder / f"{name}.py", STRUCTURE)
    write(folder / "a.obj", "mtllib a.mtl\n")
    write(folder / "a.mtl", "newmtl a\n")
    mine = importlib.import_module(name).Own(model_file=str(folder / "a.obj"))
    before = contents(mine)
    write(folder / "a.mtl", "newmtl b\n")
    assert [form[0] for form in before] == ["a.obj", "a.mtl"]
    assert contents(mine) != before


STRUCTURE = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Own:
    model_file: str = ""
    def build(self, rng): ...
"""


def test_a_name_is_looked_up_where_the_process_runs(folder, monkeypatch):
    name = next(names)
    write(folder / "code" / "deep" / f"{name}.py", PLUGIN.format(imports="NET = open('nets/net.bin')"))
    write(folder / "nets" / "net.bin", "1")
    monkeypatch.syspath_prepend(folder / "code" / "deep")
    monkeypatch.chdir(folder)
    mine = tracker(folder, name)
    before = content_hash(mine)
    write(folder / "nets" / "net.bin", "2")
    assert content_hash(mine) != before


@pytest.mark.parametrize("text", ["{far}/net.bin", "~/far/net.bin", "solve --net={far}/net.bin", "{far}/my net.bin"])
def test_a_file_that_is_named_by_its_whole_path_enters(folder, tmp_path_factory, monkeypatch, text):
    name, home = next(names), tmp_path_factory.mktemp("home")
    monkeypatch.setenv("HOME", str(home))
    for file in ("net.bin", "my net.bin"):
        write(home / "far" / file, "1")
    write(folder / f"{name}.py", PLUGIN.format(imports=f"NET = '{text.format(far=home / 'far')}'"))
    mine = tracker(folder, name)
    before = content_hash(mine)
    for file in ("net.bin", "my net.bin"):
        write(home / "far" / file, "2")
    assert content_hash(mine) != before


def test_data_beside_the_file_that_a_link_leads_to_enter(folder, tmp_path_factory):
    name, away = next(names), tmp_path_factory.mktemp("away")
    write(
        away / "mine.py",
        PLUGIN.format(imports="from pathlib import Path\nD = Path(__file__).resolve().parent / 'd.bin'"),
    )
    write(away / "d.bin", "1")
    (folder / f"{name}.py").symlink_to(away / "mine.py")
    mine = tracker(folder, name)
    before = content_hash(mine)
    write(away / "d.bin", "2")
    assert content_hash(mine) != before


def test_a_script_that_is_a_link_imports_beside_its_file(tmp_path):
    write(tmp_path / "away" / "run.py", "import helper\n")
    write(tmp_path / "away" / "helper.py", "A = 1\n")
    (tmp_path / "run.py").symlink_to(tmp_path / "away" / "run.py")
    program = External(command=("python3", str(tmp_path / "run.py")))
    before = content_hash(program)
    write(tmp_path / "away" / "helper.py", "A = 2\n")
    assert content_hash(program) != before


def installed(folder, dist, version="1.0", needs="", code="A = 1\n"):
    """A distribution of one module, as an installer leaves it."""
    write(folder / f"{dist}.py", code)
    write(folder / f"{dist}-1.0.dist-info" / "METADATA", f"Name: {dist}\nVersion: {version}\n{needs}")
    digest = base64.urlsafe_b64encode(hashlib.sha256(code.encode()).digest()).decode().rstrip("=")
    files = f"{dist}.py,sha256={digest},{len(code)}\n{dist}-1.0.dist-info/RECORD,,\n"
    write(folder / f"{dist}-1.0.dist-info" / "RECORD", files)


def test_a_distribution_is_its_files_and_what_it_requires(folder, monkeypatch):
    name, library, below, test = (next(names) for _ in range(4))
    site = folder / "site-packages"
    write(folder / f"{name}.py", PLUGIN.format(imports=f"import {library}"))
    needs = f"Requires-Dist: {below} (>=1.0)\nRequires-Dist: {test}; extra == 'test'\nRequires-Dist: no-such-thing\n"
    installed(site, library, needs=needs)
    installed(site, below)
    installed(site, test)
    monkeypatch.syspath_prepend(site)
    plugin_files._distributions.cache_clear()
    mine = tracker(folder, name)
    hashes = [content_hash(mine)]
    installed(site, test, version="2.0")  # of an extra
    assert content_hash(mine) == hashes[0]
    installed(site, library, needs=needs)  # once more
    assert content_hash(mine) == hashes[0]
    installed(site, library, needs=needs, code="A = 2\n")  # of the same version
    hashes.append(content_hash(mine))
    installed(site, below, version="2.0")
    hashes.append(content_hash(mine))
    write(site / f"{below}.py", "A = 3 # edited in place\n")
    hashes.append(content_hash(mine))
    assert len(set(hashes)) == 4
    plugin_files._distributions.cache_clear()


def test_a_folder_that_is_named_is_not_in_the_key_by_its_place(tmp_path):
    keys = []
    for place in ("here", "there"):
        own_images(write(tmp_path / place / "a.txt").parent)
        (tmp_path / place / "own.toml").write_text(OWN_IMAGES)
        keys.append(content_hash(*load_suite(tmp_path / place / "own.toml").sequences))
    assert len({*keys}) == 1


def test_python_runs_the_source_and_no_code_compiled_of_another_of_its_size_and_time(folder):
    name = next(names)
    for gain in ("1.0", "2.0"):
        source = write(folder / f"variant_{gain}.py", PLUGIN.format(imports="").replace("1.0", gain))
        os.utime(source, (1e9, 1e9))
    link, seen = folder / f"{name}.py", []
    for gain in ("1.0", "2.0"):
        link.unlink(missing_ok=True)
        link.symlink_to(folder / f"variant_{gain}.py")
        code = f"from uavbench.bench.config.plugin_models import import_plugin as i; print(i('{name}:Mine')().gain)"
        environment = {**os.environ, "PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        subprocess.run([sys.executable, "-c", f"import {name}"], env=environment, check=True) if gain == "1.0" else None
        seen.append(subprocess.check_output([sys.executable, "-c", code], env=environment, text=True).strip())
    assert seen == ["1.0", "2.0"]
