"""Files of an external tracker's program, as far as they can be found from its command line."""

import ast
import os
import shutil
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from uavbench.bench.inputs.elsewhere import WORD, of_system, whole_paths
from uavbench.bench.inputs.file_paths import is_file
from uavbench.bench.inputs.named_files import folders_of, is_python, named_files
from uavbench.trajectories.sources.dependencies import made_of
from uavbench.trajectories.sources.module_files import among
from uavbench.trajectories.sources.parsed_source import imports_in, parsed

PYTHONS = ("python", "pypy")
"""Prefixes of the names of Python interpreters."""
SITES = ("lib/python*/site-packages", "lib/python*/dist-packages")
MAIN = "__main__.py"
"""Script that a Python interpreter runs of a folder."""
LISTS = ("*.dist-info/METADATA", "*.egg-info/PKG-INFO", "*.egg-info")
"""Patterns of the files by which an environment records its distributions and their versions."""


def command_files(command: Sequence[str], here: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Files whose change may change the behaviour of a command; here: folders from which its Python imports, too.

    These are the `run_files`; the files named in their scripts, in any language, and the libraries that a user's
    program is linked with (`named_files`); and, for a Python interpreter, the metadata of installed distributions.
    """
    found = _named(command, here)
    pythons = _pythons(command, found)
    lists = [path for at in pythons for site in sites_of(at) for name in LISTS for path in site.glob(name)]
    settings = [path.parent.parent / "pyvenv.cfg" for path in pythons]
    return tuple(sorted({*found, *filter(is_file, [*lists, *settings])}))


def editable_folders(command: Sequence[str]) -> list[Path]:
    """Folders of editable installs from which the Pythons that a command or its scripts start import."""
    pythons = _pythons(command, _named(command))
    return list(dict.fromkeys(place for path in pythons for site in sites_of(path) for place in in_place(site)))


def _named(command: Sequence[str], here: Sequence[Path] = ()) -> set[Path]:
    """The `run_files` of a command, the files whose whole paths it holds, and all files that these name."""
    find = among([*here, *_search(programs(command)), *_folders(command)])
    return named_files(run_files(command, here), find)


def _pythons(command: Sequence[str], named: set[Path]) -> list[Path]:
    """The programs of a command, and the Python interpreters among the files that it names."""
    return list(dict.fromkeys([*programs(command), *sorted(p for p in named if p.name.startswith(PYTHONS))]))


def programs(command: Sequence[str]) -> list[Path]:
    """The program of a command, and a Python interpreter among its arguments, as of `env`, both searched on PATH."""
    words = [command[0], *(word for word in command[1:] if Path(word).name.startswith(PYTHONS))]
    return [Path(found).absolute() for word in words if (found := shutil.which(word))]


def run_files(command: Sequence[str], here: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Files that a command runs or gets as arguments: those that an isolated program must be able to read.

    These are the program; the files on the command line, also within a word and in a folder that it names, as in
    `sh -c "cd /a && exec python3 b.py"`; and what the Python scripts among them, `-m` and the text of `-c` import from
    their own folder, from `here`, from PYTHONPATH, from a folder that the command names or from editable installs.
    Files that a script merely names are not included.
    """
    program, folders = programs(command), _folders(command)
    words = [Path(part) for word in command for part in {word, word.partition("=")[2]}]
    given = [*(path for path in words if path.is_absolute()), *(path for word in command for path in whole_paths(word))]
    inside = {MAIN, *(name for word in command for name in WORD.findall(word))}
    given += [folder / name for folder in folders for name in inside if not name.startswith("/")]
    files = [*program, *filter(is_file, given)]
    scripts = [path for path in files if is_python(path)]
    modules = [f"{name}{end}" for word, name in pairwise(command) if word == "-m" for end in ("", ".__main__")]
    modules += [name for word, code in pairwise(command) if word == "-c" for name in imports_in(code)]
    made = made_of(modules, scripts, among([*folders_of(*scripts), *here, *folders, *_search(program)]))
    return tuple(sorted({*files, *made.files}))


def _folders(command: Sequence[str]) -> list[Path]:
    """User's folders that a command names by whole paths: it goes there, imports from there, or runs their `MAIN`."""
    names = (Path(name) for word in command for name in WORD.findall(word) if name.startswith("/"))
    return [path for path in dict.fromkeys(names) if path.is_dir() and not of_system(path)]


def _search(program: Sequence[Path]) -> list[Path]:
    """Folders from which scripts import, besides their own: those on PYTHONPATH, and those of editable installs."""
    given = [Path(place) for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]
    return [*given, *(place for path in program for site in sites_of(path) for place in in_place(site))]


def sites_of(program: Path) -> Iterator[Path]:
    """The site-packages folders of a Python interpreter, or of the environment that contains a program."""
    root = program.parent.parent
    if program.name.startswith(PYTHONS) or is_file(root / "pyvenv.cfg"):
        for pattern in SITES:
            yield from root.glob(pattern)


def in_place(site: Path) -> Iterator[Path]:
    """Folders outside of a site-packages folder from which its distributions are imported (`pip install -e`)."""
    for path in sorted(site.glob("*.pth")):
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        yield from (folder for line in lines if (folder := site / line.strip()).is_dir() and line.strip())
    for path in sorted(site.glob("__editable__*finder.py")):
        for node in parsed(path).body:
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "MAPPING" and node.value is not None:
                yield from (Path(place).parent for place in ast.literal_eval(node.value).values())
