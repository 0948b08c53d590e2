"""Building models in IFC, read by IfcOpenShell (the optional extra `uavbench[ifc]`)."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.trajectories.errors import UserError

SKIPPED = ("IfcSpace", "IfcOpeningElement", "IfcAnnotation", "IfcGrid")
"""IFC classes without visible geometry."""


def read_ifc(path: Path) -> list[Loaded]:
    """Pieces of an IFC model, one per element and material, in metres, z up.

    UserError when IfcOpenShell is missing or cannot read the file.
    """
    try:
        ifcopenshell: Any = importlib.import_module("ifcopenshell")
        geom: Any = importlib.import_module("ifcopenshell.geom")
    except ImportError:
        raise UserError(f"{path}: reading IFC needs IfcOpenShell: pip install 'uavbench[ifc]'") from None
    try:
        model = ifcopenshell.open(str(path))
    except Exception as error:
        raise UserError(f"{path}: not a readable IFC file: {error}") from None
    settings = geom.settings()
    settings.set("use-world-coords", True)
    settings.set("weld-vertices", True)
    iterator = geom.iterator(settings, model)
    pieces: list[Loaded] = []
    more = iterator.initialize()
    while more:
        shape: Any = iterator.get()
        if not any(model.by_id(shape.id).is_a(kind) for kind in SKIPPED):
            pieces += _pieces(shape)
        more = iterator.next()
    return pieces


def _pieces(shape: Any) -> list[Loaded]:
    vertices = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
    triangles = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
    looks = np.array(shape.geometry.material_ids, dtype=np.int64)
    out = []
    for look in np.unique(looks):
        chosen = triangles[looks == look]
        tint = _color(shape.geometry.materials[look]) if look >= 0 else None
        out.append(Loaded(vertices, chosen, tint=tint, name=shape.name or shape.guid))
    return out


def _color(material: Any) -> np.ndarray:
    diffuse = material.diffuse
    rgb = [diffuse.r(), diffuse.g(), diffuse.b()] if hasattr(diffuse, "r") else list(diffuse)[:3]
    return np.array([[*rgb, 1.0]])
