"""Keeps LD_LIBRARY_PATH as it is when OpenCV is imported.

OpenCV's loader puts a folder of its own and a colon in front of it. Where the variable is not set, that makes an empty
last entry, which is the current folder: every process started later would look for its libraries there first.
"""

import os
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

NAME = "LD_LIBRARY_PATH"


def keep_library_path() -> None:
    """Restore LD_LIBRARY_PATH after OpenCV is imported; where it already is, remove its empty entries."""
    if "cv2" in sys.modules:
        _set(os.pathsep.join(filter(None, os.environ.get(NAME, "").split(os.pathsep))))
    elif not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds OpenCV once, with a loader that restores the variable."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "cv2":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _Restoring(spec.loader)
        return spec


class _Restoring(Loader):
    """Another loader, and LD_LIBRARY_PATH as before."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        before = os.environ.get(NAME, "")
        try:
            self._loader.exec_module(module)
        finally:
            _set(before)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)


def _set(value: str) -> None:
    if value:
        os.environ[NAME] = value
    else:
        os.environ.pop(NAME, None)
