"""Files of an external tracker's program, as far as its command line shows."""

import ast
import os
import shutil
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from uavbench.bench.inputs.elsewhere import whole_paths
from uavbench.bench.inputs.file_paths import is_file
from uavbench.bench.inputs.named_files import is_python, named_files
from uavbench.trajectories.source_files import among, made_of, parsed

PYTHONS = ("python", "pypy")
"""How the names of interpreters of Python begin."""
SITES = ("lib/python*/site-packages", "lib/python*/dist-packages")
LISTS = ("*.dist-info/METADATA", "*.egg-info/PKG-INFO", "*.egg-info")
"""Where an environment says which distributions it has, in which versions."""


def command_files(command: Sequence[str]) -> tuple[Path, ...]:
    """Files whose change may change what a command does.

    The `run_files`, and more: the files that the scripts among them name, of whatever language, and the libraries that
    a program of the user's is linked with (`named_files`); of a Python, the lists of what is installed for it.
    """
    program, run = programs(command), {*run_files(command), *(path for word in command for path in whole_paths(word))}
    found = named_files(run, among(_search(program)))
    pythons = {*program, *(path for path in found if path.name.startswith(PYTHONS))}
    lists = [path for at in pythons for site in sites_of(at) for name in LISTS for path in site.glob(name)]
    settings = [path.parent.parent / "pyvenv.cfg" for path in pythons]
    return tuple(sorted({*found, *filter(is_file, [*lists, *settings])}))


def programs(command: Sequence[str]) -> list[Path]:
    """The program of a command, and a Python that it is given as `env` is, looked for on PATH too."""
    words = [command[0], *(word for word in command[1:] if Path(word).name.startswith(PYTHONS))]
    return [Path(found).absolute() for word in words if (found := shutil.which(word))]


def run_files(command: Sequence[str]) -> tuple[Path, ...]:
    """Files that a command runs or is given: all that a program needs to see that is isolated.

    The program; the files on the command line; what Python scripts among them import, as far as it lies beside them,
    on PYTHONPATH or where an installation in place leads. Not what a script merely names: that may be anything.
    """
    program = programs(command)
    words = [Path(part) for word in command for part in {word, word.partition("=")[2]}]
    files = [*program, *(path for path in words if path.is_absolute() and is_file(path))]
    scripts = [path for path in files if is_python(path)]
    modules = [f"{name}{end}" for word, name in pairwise(command) if word == "-m" for end in ("", ".__main__")]
    made = made_of(modules, scripts, among([*(script.parent for script in scripts), *_search(program)]))
    return tuple(sorted({*files, *made.files}))


def _search(program: Sequence[Path]) -> list[Path]:
    """Folders that scripts import from beside their own: those on PYTHONPATH, and those of installations in place."""
    given = [Path(place) for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]
    return [*given, *(place for path in program for site in sites_of(path) for place in in_place(site))]


def sites_of(program: Path) -> Iterator[Path]:
    """Folders of what is installed for a program that is a Python, or lies in an environment of one."""
    root = program.parent.parent
    if program.name.startswith(PYTHONS) or is_file(root / "pyvenv.cfg"):
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
