"""Cache of compiled kernels between processes, and its keys.

numba's own cache is invalidated by changes of the kernel's file alone, though the functions it calls and its constants
may be in other files. Here the folder's name is the hash of all of these, of the compiler and of the CPU; and each
kernel has its own file, so that concurrent processes do not overwrite each other's.
"""

import contextlib
import hashlib
import os
import pickle
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba.core.caching import NullCache
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from uavbench.trajectories.files.folders import temporary_folder
from uavbench.trajectories.files.temporary_names import temporary
from uavbench.trajectories.kernels.kept_imports import FILE as IMPORTS
from uavbench.trajectories.kernels.kept_imports import remembered
from uavbench.trajectories.kernels.machine_code import CachedKernel
from uavbench.trajectories.sources.dependencies import made_of
from uavbench.trajectories.sources.digests import digest, stamp
from uavbench.trajectories.sources.module_files import Find, editable, source_file
from uavbench.trajectories.sources.parsed_source import content_of

MARKER = ".uavbench-kernels"
"""Marker file of a kernel cache folder."""
KEY = re.compile(r"[0-9a-f]{32}")
NUMBAS = re.compile(r".*\.nb[ci](\.tmp\.[0-9a-f]{16})?", re.DOTALL)
"""Names of our kernels, and of numba's, in folders inside, for an external program."""
KEPT_DAYS = 30.0
"""Kernels unused for this long are removed."""
NOT_IN_CODE = {"NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS"}
"""numba's settings that do not change the code of a kernel."""
SETTINGS = Path(".numba_config.yaml")
"""File in the current folder in which numba looks for its settings."""
_imported: dict[Path, tuple[int, ...]] = {}
"""Source files of imported modules, with their stamps at import."""
_seen: dict[str, object] = {}
"""Modules by their names, whose files have been noted or skipped."""
_noted: set[str | None] = set()
"""Files of the modules that have been noted there or skipped."""
_finds: list[Find] = []
"""What finds the files of modules, of each context in which they are looked for once."""


@dataclass(frozen=True)
class KernelFiles:
    """Files of one kernel in a folder, one for each of its compiled versions."""

    folder: Path
    name: str

    def load(self, key: Any) -> Any:
        """What was kept for a key; LookupError, or whatever unpickling a damaged file raises, where there is none."""
        kept_for, kept = pickle.loads(self._file(key).read_bytes())  # noqa: S301, ours
        if kept_for != key:
            raise LookupError("kept for another version of the kernel")
        return kept

    def keep(self, key: Any, made: Any) -> None:
        """Keep a compiled version; a full or read-only disk is ignored."""
        path = self._file(key)
        with contextlib.suppress(OSError), temporary(path) as own:
            own.made.write_bytes(dumps((key, made)))  # type: ignore[no-untyped-call]
            own.made.replace(path)  # content-addressed: a file by another process is identical

    def count(self) -> int:
        """Number of compiled versions; 0 where the folder is gone."""
        with contextlib.suppress(OSError):
            return sum(path.name.startswith(f"{self.name}.") for path in self.folder.iterdir())
        return 0

    def _file(self, key: Any) -> Path:
        return self.folder / f"{self.name}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"


class KernelCache(NullCache):
    """Compiled versions of one kernel in a folder; unreadable or unwritable files only cost a compilation.

    place: finds the folder, None where there is none; called with the first request, because most processes that
    import a kernel never call it.
    """

    def __init__(self, name: str, place: Callable[[], Path | None]) -> None:
        self.name, self._place = name, place

    @cached_property
    def folder(self) -> Path | None:
        """The folder; None where nothing can be cached."""
        return self._place()

    @property
    def cache_path(self) -> str | None:
        """The folder, as numba asks for it."""
        return None if self.folder is None else str(self.folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel compiled for a signature; None when it is not cached or its file is broken."""
        try:
            runtime: Any = rtsys
            runtime.initialize(target_context)  # a refresh takes 0.25 s more
            kept = self._files().load((sig, target_context.codegen().magic_tuple()))
            return kept.restored(target_context)
        except Exception:  # unpickling a damaged file may raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Cache a compiled kernel; a full or read-only disk is ignored."""
        if data.library.has_dynamic_globals or any(not lifted.can_cache for lifted in data.lifted):
            return
        with contextlib.suppress(FileNotFoundError):
            self._files().keep((sig, data.codegen.magic_tuple()), CachedKernel.of(data))

    def _files(self) -> KernelFiles:
        if self.folder is None:
            raise FileNotFoundError("no folder for compiled kernels")
        return KernelFiles(self.folder, self.name)


def cache_of(function: Callable[..., Any], inner: bool = False) -> NullCache:
    """Cache of a kernel; an inner kernel cannot be called from Python.

    Nothing is cached where the kernel has no source file, or no folder is writable.
    """
    if function.__closure__:
        return NullCache()
    module = function.__module__
    note_imported(module)
    name = f"{module}.{function.__qualname__}{'.inner' if inner else ''}"
    return KernelCache(name, lambda: folder_of_module(module))


def identity(function: Callable[..., Any], inner: bool) -> int | None:
    """Number of a kernel that changes with its source and is equal in all processes; None if it cannot be cached."""
    folder = None if function.__closure__ else folder_of_module(function.__module__)
    return None if folder is None else 2 * int(folder.name, 16) + inner


@cache
def note_imported(_: str) -> None:
    """Note the stamps of all modules' source files when a module with kernels is imported.

    A kernel's code dates from its import, its key from its first use; stamps reveal a file that was edited in between.
    """
    new = {name: module for name, module in list(sys.modules.items()) if _seen.get(name, sys) is not module}
    _seen.update(new)
    files = {getattr(module, "__file__", None) for module in new.values()} - _noted
    _noted.update(files)
    for file in files:
        if isinstance(file, str) and file.endswith(".py") and editable(path := Path(file)):
            with contextlib.suppress(OSError):
                _imported[path] = stamp(path)


@cache
def folder_of_module(module: str) -> Path | None:
    """Folder of a module's kernels; None where no folder is writable, or the module has no source file."""
    try:
        files = sources_of([module])
        edited = any((now := stamp(path)) != _imported.get(path, now) for path in files)
        return None if edited else folder_of(key_of(module, files))
    except OSError:
        return None


def sources_of(modules: Iterable[str]) -> frozenset[Path]:
    """Source files of modules and of all that they import, as in `made_of`, using cached imports."""
    with remembered(folder_of):
        return made_of(modules, find=_finds[-1] if _finds else None).files


@contextlib.contextmanager
def found_once() -> Iterator[None]:
    """Context in which the file of each module is looked for once: the modules with kernels import much the same."""
    _finds.append(cache(source_file))
    try:
        yield
    finally:
        _finds.pop()


def key_of(module: str, files: frozenset[Path]) -> str:
    """Hash of a module's source files, those of all that it imports among them, of numba, LLVM, Python and the CPU.

    OSError when a source cannot be read.
    """
    if not files:
        raise FileNotFoundError(f"{module} has no source file")
    variables = sorted((k, v) for k, v in os.environ.items() if k.startswith("NUMBA_") and k not in NOT_IN_CODE)
    settings = (variables, content_of(SETTINGS))
    made_by = (numba.__version__, llvmlite.__version__, llvm.llvm_version_info, platform.python_version())
    made_for = (platform.machine(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    parts = (module, digest(files), settings, made_by, made_for)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


@cache
def folder_of(key: str) -> Path | None:
    """Folder of a key, existing or created; None where it cannot be created."""
    for home in homes():
        marker = home / key / MARKER
        with contextlib.suppress(OSError):
            if not marker.is_file():
                marker.parent.mkdir(parents=True, exist_ok=True)
                remove_old(home)
                marker.touch()
            elif os.access(marker, os.W_OK):
                os.utime(marker)
            return marker.parent
    return None


def homes() -> Iterator[Path]:
    """Candidate folders, best first: numba's setting, the user's cache, a temporary folder.

    A home that is missing is not made. numba's setting counts unless it is a folder of ours, which only the user's
    kernels of an external program are for.
    """
    given = Path(os.environ.get("NUMBA_CACHE_DIR", "")).absolute()
    if os.environ.get("NUMBA_CACHE_DIR") and not (given / MARKER).is_file():
        yield given / "uavbench-kernels"
    given_cache, home = os.environ.get("XDG_CACHE_HOME"), Path(os.path.expanduser("~"))  # noqa: PTH111, raises nothing
    user = Path(given_cache or home / ".cache")
    if user.is_absolute() and (given_cache or home.is_dir()):
        yield user / "uavbench" / "kernels"
    if own := temporary_folder():
        yield own


def remove_old(home: Path) -> None:
    """Remove our cache folders that have not been used for long."""
    oldest = time.time() - KEPT_DAYS * 86400.0
    for folder in home.iterdir():
        if not KEY.fullmatch(folder.name) or folder.is_symlink():
            continue
        with contextlib.suppress(OSError):  # a foreign folder, or removed by another process
            if (folder / MARKER).lstat().st_mtime < oldest:
                kernels = [path for path in folder.rglob("*") if NUMBAS.fullmatch(path.name)]
                for path in [*kernels, folder / IMPORTS, folder / MARKER]:
                    path.unlink(missing_ok=True)
                for path in {path.parent for path in kernels} - {folder}:
                    path.rmdir()
                folder.rmdir()
