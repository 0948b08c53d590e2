"""Guarded access to the files that a model refers to (materials, buffers, textures), within its own folder."""

from functools import partial
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from trimesh.resolvers import Resolver

from uavbench.scenes.image_files import TEXTURES, refuse_damage, size_px
from uavbench.scenes.model_files.obj.colours import check_colours
from uavbench.scenes.model_files.obj.materials import TextureMap, libraries, textures_by_material, with_plain_names
from uavbench.scenes.model_files.referenced_files import found_texture, is_beside, is_there, read_library
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes

MATERIALS = "uavbench materials"
"""Name by which trimesh asks for all material libraries of an OBJ file; it reads the first one that a file names."""


class ModelFolder(Resolver):
    """trimesh resolver restricted to the folder of a model.

    trimesh ignores files that it cannot resolve; `refused` collects their error messages for the user. textures: of an
    OBJ file by the name of the material.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.refused: list[str] = []
        self.textures: dict[str, TextureMap] = {}
        self._materials = b""

    def with_materials(self, data: bytes, coloured: bool) -> bytes:
        """An OBJ file's content for trimesh, with its libraries as one, or with none where it needs no colours.

        UserError for a library that cannot be read.
        """
        texts = []
        for library in libraries(data, partial(is_beside, self.folder)) if coloured else ():
            text = read_library(self.folder, library)
            self.textures |= textures_by_material(text)
            texts.append(with_plain_names(text, partial(found_texture, self.folder, library)))
        check_colours(data, "\n".join(texts))
        self._materials = "\n".join(texts).encode()
        return f"mtllib {MATERIALS}\n".encode() + data

    def get(self, name: str) -> bytes:
        """Content of a file; UserError when it is missing, too large, not a regular file, or outside the folder."""
        if name.strip() == MATERIALS:
            return self._materials
        words = [name.strip(), unquote(name.strip()), name.split()[-1] if name.split() else ""]
        there = [word for word in words if word and is_there(self.folder / word)]
        try:
            path = self.folder / (there or words)[0]
            data = read_bytes(path, MODEL, inside=self.folder)
            if path.suffix.lower() not in (".mtl", ".bin"):
                size_px(path, data, TEXTURES)
                refuse_damage(path, data)
            return data
        except UserError as error:
            self.refused.append(f"refers to {name.strip()}: {error}; put it next to the model or export it again")
            raise

    def keys(self) -> list[str]:
        """Names of the files in the folder."""
        return [path.name for path in self.folder.iterdir() if path.is_file()]

    def namespaced(self, namespace: str) -> NoReturn:
        """Not supported: a model has one folder."""
        raise NotImplementedError(namespace)

    def write(self, name: str, data: Any) -> NoReturn:
        """Not supported: models are read only."""
        raise NotImplementedError(name)
