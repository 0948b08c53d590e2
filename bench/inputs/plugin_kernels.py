"""Compiled kernels of users' plug-ins (numba's `cache=True`), cached by the content of all files that they depend on.

numba's own cache is invalidated by changes of the kernel's file alone, though the functions it calls and its constants
may be in other files. Whatever determines a kernel's code has been imported when the kernel is compiled, so the name of
the folder is the hash of all user modules imported by then, with all that they import and name, and of the declared
`input_files`.

Python's own cache is invalidated by the time and size of a source, which files of one archive or repository may share
(`ln -sf variants/b.py mine.py`): users' modules are compiled each time. A process keeps what it has imported, whatever
becomes of the file: of each source the content that was read is remembered.
"""

import os
import struct
import sys
import sysconfig
import time
from collections.abc import Callable, Iterable
from functools import cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any

from numba.core.caching import Cache

from uavbench.bench.inputs.plugin_files import declared, loaded, plugins_made_of, variables_named_by
from uavbench.trajectories.files.temporary_names import start_ticks
from uavbench.trajectories.kernels.cache import KernelFiles, folder_of, key_of
from uavbench.trajectories.kernels.kept_imports import remembered
from uavbench.trajectories.sources.dependencies import made_of
from uavbench.trajectories.sources.module_files import LIBRARIES, editable, is_ours, source_file
from uavbench.trajectories.sources.parsed_source import content_of

MOST_VERSIONS = 100
"""Most compiled versions of a kernel in a folder: some argument types differ in each process and are never loaded."""
COMPILED_OF = struct.Struct("<4xIII")
"""Start of a file of compiled code: flags, time (s) and size (bytes) of its source."""
_read: dict[Path, str] = {}
"""Source of a user's module -> sha256 of the content that this process has imported."""
_load: Any = Cache.load_overload
_save: Any = Cache.save_overload
_stats: Any = SourceFileLoader.path_stats


def keep_by_content() -> None:
    """From now on in this process, numba caches the kernels of users' files by content, and Python not their code."""
    numbas: Any = Cache
    numbas.load_overload, numbas.save_overload = _load_by_content, _save_by_content
    pythons: Any = SourceFileLoader
    pythons.path_stats = _stats_unless_users


def written_since_start() -> list[str]:
    """Names of the files of users' imported modules that were written since this process started, or are gone.

    The process may run their old text.
    """
    files = {path for name in _users_modules() if (path := source_file(name))}
    return sorted(path.name for path in files if _is_newer(path))


def edited_since_import(modules: Iterable[str]) -> list[str]:
    """Names of the sources of users' modules, and of what they import, of which this process runs an earlier text."""
    imported = {source_file(name) for name in list(sys.modules)}
    files = sorted(path for path in made_of(modules).files if path in imported and not is_ours(path))
    return [path.name for path in files if _runs_another_text(path)]


def _runs_another_text(source: Path) -> bool:
    """Whether a source differs from the one imported; by Python's compiled code where that was before any plug-in."""
    now = sha256(content_of(source)).hexdigest()
    if source not in _read and not (_is_newer(source) and _compiled_of_another(source)):
        _read[source] = now
    return _read.get(source) != now


def _compiled_of_another(source: Path) -> bool:
    """Whether the code that Python compiled of a source is of another time or size."""
    start = content_of(Path(cache_from_source(source)))[: COMPILED_OF.size]
    if len(start) < COMPILED_OF.size or sys.dont_write_bytecode:
        return False
    by_content, time_s, size = COMPILED_OF.unpack(start)
    about = source.stat()
    return not by_content and (time_s, size) != (int(about.st_mtime), about.st_size)


def _load_by_content(kernel: Any, sig: Any, target_context: Any) -> Any:
    """The kernel compiled for a signature; None when it is not cached or its file is broken."""
    if not _is_users(kernel._py_func):
        return _load(kernel, sig, target_context)
    files = _files_of(kernel)
    if files is None:
        return None
    target_context.refresh()
    try:
        return kernel._impl.rebuild(target_context, files.load(kernel._index_key(sig, target_context.codegen())))
    except Exception:  # unpickling a damaged file may raise anything
        return None


def _save_by_content(kernel: Any, sig: Any, data: Any) -> None:
    """Cache a compiled kernel; a full or read-only disk is ignored."""
    if not _is_users(kernel._py_func):
        _save(kernel, sig, data)
        return
    files = _files_of(kernel)
    if files is not None and files.count() < MOST_VERSIONS and kernel._impl.check_cachable(data):
        files.keep(kernel._index_key(sig, data.codegen), kernel._impl.reduce(data))


def _stats_unless_users(loader: Any, path: str) -> Any:
    """Time and size of a source; OSError for a user's, of which Python then neither reads nor writes compiled code."""
    if editable(Path(path)) and not is_ours(Path(path)):
        _read[Path(path)] = sha256(content_of(Path(path))).hexdigest()
        raise OSError(f"{path}: compiled each time")
    return _stats(loader, path)


def _is_users(function: Callable[..., Any]) -> bool:
    path = source_file(function.__module__ or "")
    return path is not None and not is_ours(path)


def _files_of(kernel: Any) -> KernelFiles | None:
    """Files of a kernel; None where nothing can be cached."""
    function = kernel._py_func
    own = Path(function.__code__.co_filename)
    folder = _folder(function.__module__, own, _users_modules(), frozenset(loaded), frozenset(declared))
    return None if folder is None or not kernel._enabled else KernelFiles(folder, kernel._impl.filename_base)


def _users_modules() -> frozenset[str]:
    """Names of the imported modules of users, including a script's `__main__`, but not that of an installed command."""
    commands = Path(sysconfig.get_path("scripts"))
    found = {name: source_file(name) for name in list(sys.modules)}
    return frozenset(name for name, path in found.items() if path and not is_ours(path) and path.parent != commands)


@cache
def _folder(
    module: str, own: Path, modules: frozenset[str], plugins: frozenset[str], given: frozenset[Path]
) -> Path | None:
    """Folder of a module's kernels; None where a file was written since this process started.

    Whether such a file was imported before or after is unknown, as are values that were set in an interactive session.
    """
    if hasattr(sys, "ps1"):
        return None
    try:
        with remembered(folder_of):
            made = plugins_made_of({module, *modules}, {module, *plugins} & set(sys.modules))
        files = frozenset({*made.files, *given, own})
        if any(map(_is_newer, files)):
            return None
        return folder_of(key_of(f"{module} {_installed()} {variables_named_by(files)}", files))
    except OSError:
        return None


def _is_newer(path: Path) -> bool:
    """Whether a file, or a link to it, was written since this process started, or is gone."""
    try:
        return max(path.stat().st_ctime_ns, path.lstat().st_ctime_ns) >= _started_ns()
    except OSError:
        return True


@cache
def _installed() -> list[tuple[str, str]]:
    """Names of all installed distributions with their versions, as the folders of their metadata, and their records."""
    folders = {Path(place) for place in sys.path if Path(place).name in LIBRARIES}
    each = (path for folder in folders for path in folder.glob("*-info"))
    return sorted((path.name, sha256(content_of(path / "RECORD")).hexdigest()) for path in each)


@cache
def _started_ns() -> int:
    """Time at which this process started, ns since 1970; 0 where the system does not tell."""
    ticks = start_ticks(os.getpid())
    if not ticks.isdigit():
        return 0
    boot_ns = time.time_ns() - time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return boot_ns + int(ticks) * 1_000_000_000 // os.sysconf("SC_CLK_TCK")
