"""The user's plug-ins of a process, told to its workers."""

import importlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavbench.bench.inputs import plugin_files
from uavbench.bench.inputs.observed.looks import watch
from uavbench.bench.inputs.plugin_kernels import keep_by_content


@dataclass(frozen=True)
class Plugins:
    """Modules of the user's plug-ins, and the files that suites name as their `input_files`.

    From its unpickling on, kernels are cached by content, also those that are compiled while a plug-in is unpickled,
    and the looks of plug-ins at files are noted.
    """

    modules: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @classmethod
    def here(cls) -> "Plugins":
        """Those of this process."""
        return cls(tuple(sorted(plugin_files.loaded)), tuple(sorted(plugin_files.declared)))

    def __reduce__(self) -> tuple[Any, ...]:
        return _arrived, (self.modules, self.files)

    def enter(self) -> None:
        """Import the modules that this process can find."""
        for module in self.modules:
            with suppress(ModuleNotFoundError):  # of another suite in the same process; a class of it needs it anyway
                importlib.import_module(module)
                plugin_files.loaded.setdefault(module, frozenset())


def _arrived(modules: tuple[str, ...], files: tuple[Path, ...]) -> Plugins:
    """The plug-ins of another process, in this one."""
    keep_by_content()
    if modules:
        watch()
    plugin_files.declared.update(files)
    return Plugins(modules, files)
