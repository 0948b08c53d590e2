"""Building models in IFC, read by IfcOpenShell (the optional extra `uavbench[ifc]`) in a child process."""

import importlib.util
from pathlib import Path

import numpy as np

from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes, read_json
from uavbench.trajectories.processes.reading_apart import read_apart

READER = "uavbench.scenes.model_files.ifc_reader"


def read_ifc(path: Path) -> list[Loaded]:
    """Pieces of an IFC model, one per element and material, in metres, z up.

    UserError when IfcOpenShell is missing or cannot read the file, when the geometry of an element cannot be made, or
    when the model is too large.
    """
    if importlib.util.find_spec("ifcopenshell") is None:
        raise UserError(f"{path}: reading IFC needs IfcOpenShell: pip install 'uavbench[ifc]'")
    with read_apart(READER, path, MODEL) as folder:
        listed = read_json(folder / "pieces.json")["pieces"]
        vertices = np.frombuffer(read_bytes(folder / "vertices", MODEL), dtype=np.float64).reshape(-1, 3)
        triangles = np.frombuffer(read_bytes(folder / "triangles", MODEL), dtype=np.int64).reshape(-1, 3)
    pieces = []
    for each in listed:
        tint = None if each["tint"] is None else np.array([[*each["tint"], 1.0]])
        corners, vertices = np.split(vertices, [each["vertices"]])
        faces, triangles = np.split(triangles, [each["triangles"]])
        pieces.append(Loaded(corners, faces, tint=tint, name=each["name"]))
    return pieces
