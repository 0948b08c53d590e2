"""Names of files in sources, scripts and programs: which files are meant, and which are not."""

import os
import sys
from pathlib import Path

import pytest

from uavbench.bench.inputs import elsewhere, named_files
from uavbench.bench.inputs.command_files import command_files, in_place, programs, run_files, sites_of
from uavbench.bench.inputs.elsewhere import linked_with, named_anywhere, of_system, whole_paths
from uavbench.bench.inputs.named_files import is_python
from uavbench.bench.inputs.named_files import named_files as files_named_by
from uavbench.bench.inputs.plugin_files import files_of


def write(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def program(path, text="#!/bin/sh\n"):
    write(path, text).chmod(0o755)
    return path


def named_by(source, text):
    """Names, from the source's folder on, of the files that it names; without itself."""
    write(source, text)
    found = files_named_by([source]) - {source}
    return {os.path.relpath(path, source.parent) for path in found}


@pytest.mark.parametrize(
    ("name", "text", "python"),
    [
        ("a.py", "", True),
        ("a", "#!/usr/bin/env python3\n", True),
        ("a", "#!/bin/sh\npython a.py\n", False),
        ("a", "# python\n", False),
        ("a.txt", "python", False),
        ("a", "#!/bin/sh " + "x" * 300 + " python", False),
    ],
)
def test_python_is_told_by_its_ending_or_its_first_line(tmp_path, name, text, python):
    assert is_python(write(tmp_path / name, text)) is python
    assert not is_python(tmp_path / "none")
    assert not is_python(tmp_path)


NAMES = {
    "beside": ("a.bin", {"a.bin"}),
    "above": ("../b.bin", {"../b.bin"}),
    "above, without saying so": ("b.bin", {"../b.bin"}),
    "in a folder": ("data/c.bin", {"data/c.bin"}),
    "in a folder that it names": ("data and c.bin", {"data/c.bin"}),
    "a module": ("inner.deep", {"inner/deep.py"}),
    "a folder by the name of its package, and a file in it": ("inner.more and e.bin", {"inner/more/e.bin"}),
    "a folder in a folder, and a file in it": ("inner/more and e.bin", {"inner/more/e.bin"}),
    "a package": ("inner", {"inner/__init__.py", "inner/__main__.py"}),
    "the ending alone": (".npy", {"source.npy"}),
    "a pattern": ("*.bin", {"a.bin", "../b.bin"}),
    "a pattern in a folder, and its end": ("data/*.bin", {"data/c.bin", "data/d.bin", "a.bin", "../b.bin"}),
    "everything": ("* or **", set()),
    "a folder": ("data", set()),
    "nothing that is there": ("c.bin none.bin . ..", set()),
}


@pytest.mark.parametrize("kind", ["settings", "python", "script"])
@pytest.mark.parametrize("what", NAMES)
def test_a_name_counts_where_there_is_a_file_of_it(tmp_path, what, kind):
    said, found = NAMES[what]
    here = tmp_path / "here"
    for name in ("a.bin", "../b.bin", "data/c.bin", "data/d.bin", "source.npy", "inner/deep.py", "other.bin/x"):
        write(here / name, "1")
    for name in ("inner/__init__.py", "inner/__main__.py", "inner/more/e.bin"):
        write(here / name)
    name, text = {
        "settings": ("source.toml", f'a = "{said}"\n'),
        "python": ("source.py", f'A = "{said}"\n'),
        "script": ("source", f"#!/usr/bin/python3\nA = '{said}'\n"),
    }[kind]
    assert named_by(here / name, text) - {"inner/__init__.py"} == found - {"inner/__init__.py"}


@pytest.mark.parametrize("said", ['f"nets.{kind}"', '"nets." + kind', '"nets.%s" % kind', '"nets.{}".format(kind)'])
def test_modules_whose_names_are_computed_are_all_of_their_package(tmp_path, said):
    for name in ("nets/small.py", "nets/large.py", "nets/notes.txt", "other.py"):
        write(tmp_path / "here" / name)
    text = f'"""Loads what is in nets. Or none."""\nimport importlib\nNET = importlib.import_module({said})\n'
    assert named_by(tmp_path / "here" / "source.py", text) == {"nets/small.py", "nets/large.py"}
    assert named_by(tmp_path / "here" / "source.py", text.replace(said, "kind")) == set()


@pytest.mark.parametrize("said", ['f"net-{k:03d}.bin"', '"net-%03d.bin" % k', '"net-{:03d}.bin".format(k)'])
def test_names_into_which_values_are_filled_are_patterns(tmp_path, said):
    for name in ("net-001.bin", "net-002.bin", "net.bin"):
        write(tmp_path / "here" / name)
    assert named_by(tmp_path / "here" / "source.py", f"W = {said}\n") == {"net-001.bin", "net-002.bin"}


def test_names_are_followed_and_long_and_binary_files_are_data(tmp_path):
    write(tmp_path / "b.toml", 'c = "c.txt"')
    write(tmp_path / "c.txt", "d.py")
    write(tmp_path / "d.py", "import e\nF = 'f.bin'\n")
    write(tmp_path / "e.py", "")
    for name in ("f.bin", "g.bin"):
        write(tmp_path / name, "1")
    assert named_by(tmp_path / "a.toml", 'b = "b.toml"') == {"b.toml", "c.txt", "d.py", "e.py", "f.bin"}
    most = named_files.MOST_BYTES
    assert most == 1 << 20
    assert named_by(tmp_path / "full.txt", "g.bin".ljust(most)) == {"g.bin"}
    assert named_by(tmp_path / "long.txt", "g.bin".ljust(most + 1)) == set()
    for binary in (b"g.bin\0", b"g.bin \xff"):
        assert named_by(tmp_path / "data.bin", binary) == set()


def test_names_as_long_as_a_file_may_have_and_no_more_are_looked_for(tmp_path):
    longest = "n" * 251 + ".bin"
    write(tmp_path / longest, "1")
    assert named_by(tmp_path / "a.toml", f'a = "{longest}"') == {longest}
    assert all(len(word) <= 255 for word in named_files._words(write(tmp_path / "b.toml", "x" * 256 + " y"), (1,)))


def test_scripts_name_files_by_whole_paths_and_programs_on_path(tmp_path, monkeypatch):
    tool, data = program(tmp_path / "bin" / "own-tool"), write(tmp_path / "far" / "net.bin")
    monkeypatch.setenv("PATH", f"{tool.parent}:/usr/bin:/bin")
    text = f"own-tool --net={data} /usr/bin/env /none/at.all sh bin/own-tool"
    assert list(whole_paths(text)) == [data]
    assert sorted(named_anywhere(text)) == sorted([data, tool])
    assert list(named_anywhere("sh -c true")) == []
    monkeypatch.chdir(tmp_path)
    assert list(whole_paths("far/net.bin")) == []


@pytest.mark.parametrize(
    ("path", "system"),
    [("/usr/bin/env", True), ("/usr/../home/a", False), ("/home/../etc/a", True), ("/usr", False),
     ("/usrlocal/a", False), ("/opt/a", False)],
)  # fmt: skip
def test_the_systems_folders_are_its_own(path, system):
    assert of_system(Path(path)) is system


def test_a_program_is_linked_with_the_libraries_that_it_names_in_the_places_it_says(tmp_path):
    names = ("bin/libbeside.so", "lib/liblib.so.2", "run/librun.so", "far/libfar.so", "bin/plain.txt", "bin/libno.so")
    for name in (*names, "else/libbeside.so"):
        write(tmp_path / name)
    (tmp_path / "bin" / "libfolder.so").mkdir()
    said = b"".join(name.rpartition("/")[2].encode() + b"\0" for name in names[:-1]) + b"libfolder.so\0"
    run_path = b"\0$ORIGIN/../run:/usr/lib:/none\0${ORIGIN}/../far\0"
    tool = program(tmp_path / "bin" / "tool", elsewhere.ELF + said + run_path)
    assert sorted(linked_with(tool)) == sorted(tmp_path / name for name in names[:4])
    assert linked_with(program(tmp_path / "bin" / "script", said + run_path)) == ()
    assert linked_with(tmp_path / "bin" / "none") == ()
    assert linked_with(tmp_path) == ()


def test_what_a_command_runs_and_is_given_is_its_files(tmp_path, monkeypatch):
    tool, script = program(tmp_path / "bin" / "own-tool"), write(tmp_path / "run.py", "import beside, on_path\n")
    beside, on_path = write(tmp_path / "beside.py"), write(tmp_path / "more" / "on_path.py")
    data = write(tmp_path / "net.bin")
    monkeypatch.setenv("PATH", f"{tool.parent}:/usr/bin:/bin")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'more'}{os.pathsep}")
    assert programs(["own-tool", "python3", "-x"])[0] == tool
    assert [path.name for path in programs(["env", "A=1", sys.executable])] == ["env", Path(sys.executable).name]
    assert programs(["no-such-tool"]) == []
    found = run_files(["own-tool", str(script), f"--net={data}", "net.bin"])
    assert found == tuple(sorted({tool, script, beside, on_path, data}))
    whole = write(tmp_path / "whole.txt")
    assert set(command_files(["own-tool", f"cat {whole}; true"])) == {tool, whole}
    for name in ("mod/__init__.py", "mod/__main__.py", "mod/other.py"):
        write(tmp_path / "more" / name)
    of_module = run_files(["own-tool", "-m", "mod", "other"])
    assert set(of_module) == {tool, tmp_path / "more/mod/__init__.py", tmp_path / "more/mod/__main__.py"}


COMMANDS = {
    "a script in the text of a shell": ("sh", "-c", "exec python3 HERE/t.py"),
    "a script where the shell goes": ("sh", "-c", "cd HERE && exec python3 t.py"),
    "a script where a program goes": ("env", "-C", "HERE", "python3", "t.py"),
    "a module from PYTHONPATH": ("env", "PYTHONPATH=HERE", "python3", "-m", "t"),
    "a folder that Python runs": ("python3", "HERE"),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_what_a_command_runs_by_whole_paths_counts_with_its_imports(tmp_path, what):
    for name in ("t.py", "__main__.py"):
        write(tmp_path / "app" / name, "import helper\n")
    write(tmp_path / "app" / "helper.py", "NET = 'net.bin'\n")
    write(tmp_path / "app" / "net.bin")
    write(tmp_path / "app" / "other.py")
    command = [word.replace("HERE", str(tmp_path / "app")) for word in COMMANDS[what]]
    found = {path.name for path in command_files(command) if path.is_relative_to(tmp_path)}
    assert found - {"t.py", "__main__.py"} == {"helper.py", "net.bin"}
    assert found & ({"__main__.py"} if command[1:] == [str(tmp_path / "app")] else {"t.py"})


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("t.js", "const h = require('./lib/h')\n", {"lib/h.js"}),
        ("t.mjs", "import { h } from '../shared/h.mjs'\n", {"../shared/h.mjs"}),
        ("t.js", "const x = require('./lib')\n", {"lib/index.js"}),
        ("t.lua", 'local h = require("lib.h")\n', {"lib/h.lua"}),
        ("t.rb", 'require_relative "lib/h"\n', {"lib/h.rb"}),
        ("t.m", "x = h(1);\n", {"h.m"}),
        ("t.toml", "a = 'h'\n", set()),
    ],
)
def test_scripts_of_other_languages_name_modules_without_their_ending(tmp_path, name, text, found):
    here = tmp_path / "here"
    for file in ("lib/h.js", "../shared/h.mjs", "lib/index.js", "lib/h.lua", "lib/h.rb", "h.m", "h.toml"):
        write(here / file, "1")
    assert named_by(here / name, text) == found


def test_an_environment_says_what_is_installed_and_what_lies_elsewhere(tmp_path):
    root = tmp_path / "env"
    site = root / "lib" / "python3.11" / "site-packages"
    for name in ("a-1.dist-info/METADATA", "b.egg-info/PKG-INFO", "c.egg-info", "a-1.dist-info/RECORD", "d.py"):
        write(site / name)
    write(root / "pyvenv.cfg")
    python, tool = program(root / "bin" / "python3", ""), program(root / "bin" / "tool", "")
    (tmp_path / "source").mkdir()
    write(site / "a.pth", f"{tmp_path / 'source'}\n\nimport something\n{tmp_path / 'none'}\n")
    write(
        site / "__editable___x_finder.py",
        f"MAPPING: dict[str, str] = {{'x': {str(tmp_path / 'far' / 'x')!r}}}\nA: int\n",
    )
    assert list(sites_of(python)) == list(sites_of(tool)) == [site]
    assert list(in_place(site)) == [tmp_path / "source", tmp_path / "far"]
    assert list(sites_of(program(tmp_path / "other" / "bin" / "tool"))) == []
    lists = {site / name for name in ("a-1.dist-info/METADATA", "b.egg-info/PKG-INFO", "c.egg-info")}
    assert set(command_files([str(python)])) == {python, root / "pyvenv.cfg", *lists}


def test_a_folder_that_is_named_whole_is_its_files_but_hidden_and_compiled_ones(tmp_path):
    for name in ("b.bin", "a/c.bin", ".hidden", ".git/d", "a/__pycache__/e.pyc", "a/.f"):
        write(tmp_path / "x" / name)
    assert list(files_of(tmp_path / "x", whole=True)) == [tmp_path / "x/a/c.bin", tmp_path / "x/b.bin"]
    assert list(files_of(tmp_path / "x", whole=False)) == [tmp_path / "x"]
    assert list(files_of(tmp_path / "x" / "b.bin", whole=True)) == [tmp_path / "x" / "b.bin"]


def test_files_that_name_each_other_by_their_folder_are_found_once(tmp_path):
    write(tmp_path / "lib" / "b.txt", "../lib/a.txt")
    assert named_by(tmp_path / "lib" / "a.txt", "../lib/b.txt") == {"b.txt"}
