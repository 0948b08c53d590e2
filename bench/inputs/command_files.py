"""Files of an external tracker's program, as far as its command line shows."""

import ast
import os
import shutil
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from uavbench.bench.inputs.named_files import linked_with, named_in_script, whole_paths
from uavbench.bench.inputs.plugin_files import is_file, named_beside
from uavbench.trajectories.source_files import among, made_of, parsed

SITES = ("lib/python*/site-packages", "lib/python*/dist-packages")
LISTS = ("*.dist-info/METADATA", "*.egg-info/PKG-INFO", "*.egg-info")
"""Where an environment says which distributions it has, in which versions."""


def command_files(command: Sequence[str]) -> tuple[Path, ...]:
    """Files whose change may change what a command does.

    The `run_files`, and more: what Python scripts among them name beside them, what scripts of other languages name,
    with what these run and name in turn, and the libraries that a program of the user's is linked with; of a Python,
    the lists of what is installed for it.
    """
    found = {*run_files(command), *(path for word in command for path in whole_paths(word))}
    waiting = [*found]
    while waiting:
        path = waiting.pop()
        named = {*named_beside(path)} if is_python(path) else {*linked_with(path), *named_in_script(path)}
        new = {*named, *(inner for each in named if is_python(each) for inner in run_files([str(each)]))} - found
        found |= new
        waiting += new
    pythons = [path for path in found if path.name.startswith("python") or path in programs(command)]
    lists = [path for at in pythons for site in sites_of(at) for name in LISTS for path in site.glob(name)]
    settings = [path.parent.parent / "pyvenv.cfg" for path in pythons]
    return tuple(sorted({*found, *filter(is_file, [*lists, *settings])}))


def programs(command: Sequence[str]) -> list[Path]:
    """The program of a command, looked for on PATH too; none where there is no such file."""
    found = shutil.which(command[0])
    return [Path(found).absolute()] if found else []


def run_files(command: Sequence[str]) -> tuple[Path, ...]:
    """Files that a command runs or is given: all that a program needs to see that is isolated.

    The program; the files on the command line; what Python scripts among them import, as far as it lies beside them,
    on PYTHONPATH or where an installation in place leads. Not what a script merely names: that may be anything.
    """
    program = programs(command)
    words = [Path(part) for word in command[bool(program) :] for part in {word, word.partition("=")[2]}]
    files = [*program, *(path for path in words if path.is_absolute() and is_file(path))]
    sites = [site for path in program for site in sites_of(path)]
    scripts = [path for path in files if is_python(path)]
    modules = [f"{name}{end}" for word, name in pairwise(command) if word == "-m" for end in ("", ".__main__")]
    search = [Path(place) for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]
    search += [place for site in sites for place in in_place(site)]
    made = made_of(modules, scripts, among([*(script.parent for script in scripts), *search]))
    return tuple(sorted({*files, *made.files}))


def is_python(path: Path) -> bool:
    """Whether a file is Python source, by its ending or its first line."""
    if path.suffix == ".py":
        return True
    try:
        with path.open("rb") as file:
            first = file.readline(256)
    except OSError:
        return False
    return first.startswith(b"#!") and b"python" in first


def sites_of(program: Path) -> Iterator[Path]:
    """Folders of what is installed for a program that is a Python, or lies in an environment of one."""
    root = program.parent.parent
    if program.name.startswith(("python", "pypy")) or is_file(root / "pyvenv.cfg"):
        for pattern in SITES:
            yield from root.glob(pattern)


def in_place(site: Path) -> Iterator[Path]:
    """Folders outside of a site's own that its distributions are imported from: those of `pip install -e`."""
    for path in sorted(site.glob("*.pth")):
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        yield from (folder for line in lines if (folder := site / line.strip()).is_dir() and line.strip())
    for path in sorted(site.glob("__editable__*finder.py")):
        for node in parsed(path).body:
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "MAPPING" and node.value is not None:
                yield from (Path(place).parent for place in ast.literal_eval(node.value).values())
