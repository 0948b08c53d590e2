"""Files that a model refers to (materials, buffers, textures), from the model's own folder only."""

from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from trimesh.resolvers import Resolver

from uavbench.scenes.image_files import TEXTURES, size_px
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes


class ModelFolder(Resolver):
    """The files beside a model, as trimesh asks for them.

    trimesh goes on without what it cannot get; `refused` keeps what was wrong with it, for the user.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.refused: list[str] = []

    def get(self, name: str) -> bytes:
        """Content of the file; UserError when it is missing, too large, no regular file, or out of the folder."""
        words = [name.strip(), unquote(name.strip()), name.split()[-1] if name.split() else ""]
        there = [word for word in words if self._is_there(word)]
        try:
            path = self.folder / (there or words)[0]
            data = read_bytes(path, MODEL, inside=self.folder)
            if path.suffix.lower() not in (".mtl", ".bin"):
                size_px(path, data, TEXTURES)
            return data
        except UserError as error:
            self.refused.append(f"refers to {name.strip()}: {error}; put it beside the model or export it again")
            raise

    def _is_there(self, name: str) -> bool:
        try:
            return bool(name) and (self.folder / name).is_file()
        except (OSError, ValueError):
            return False

    def keys(self) -> list[str]:
        """Names of the files in the folder."""
        return [path.name for path in self.folder.iterdir() if path.is_file()]

    def namespaced(self, namespace: str) -> NoReturn:
        """A model has one folder."""
        raise NotImplementedError(namespace)

    def write(self, name: str, data: Any) -> NoReturn:
        """Nothing is written beside a model."""
        raise NotImplementedError(name)
