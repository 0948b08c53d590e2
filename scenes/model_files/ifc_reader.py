"""Program that reads an IFC model from its standard input, and writes its pieces into its working directory.

pieces.json lists them: name, tint (null without one), numbers of vertices and triangles. Their vertices (float64, m, z
up) and triangles (int64, of the piece's own vertices) follow each other in the files `vertices` and `triangles`.
IfcOpenShell is C++, which a hostile file can crash: see `uavbench.trajectories.processes.reading_apart`.
"""

import importlib
import json
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uavbench.scenes.model_files.face_limits import MOST_TRIANGLES
from uavbench.scenes.model_files.mesh_checks import MOST_NODES, closedness
from uavbench.trajectories.files.reading import json_value
from uavbench.trajectories.processes.reading_apart import refuse

INPUT = Path("/dev/stdin")
LAST_LINE, LAST_BYTES = b"END-ISO-10303-21;", 4096
"""Last line of a STEP file, and the bytes at the end of a file within which it must be."""
UNSEEN = (
    "IfcSpace", "IfcSpatialZone", "IfcExternalSpatialElement", "IfcVirtualElement", "IfcOpeningElement",
    "IfcVoidingFeature", "IfcAnnotation", "IfcGrid", "IfcStructuralItem", "IfcStructuralActivity",
)  # fmt: skip
"""IFC classes without visible geometry: spaces, cuts, drawings, models of structural analysis."""
BODY = ("Body", "Facetation", "Tessellation")
"""Identifiers of representations that are surfaces or solids; others are axes, plans, boxes."""
SHOWN = 5
"""Elements that an error lists."""
REMEDY = "repair or remove them in your modelling program"
LONGEST_NAME = 80


def main() -> None:
    """Read the model; `refuse` it when it is damaged, too large, or when the geometry of an element cannot be made."""
    ifcopenshell: Any = importlib.import_module("ifcopenshell")
    geom: Any = importlib.import_module("ifcopenshell.geom")
    ifcopenshell.ifcopenshell_wrapper.set_log_format_json()
    with INPUT.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - LAST_BYTES))
        if LAST_LINE not in file.read():
            refuse("not a readable IFC file: it is truncated; export or copy it again")
    try:
        model = ifcopenshell.open(str(INPUT))
    except MemoryError:
        raise
    except Exception as error:
        refuse(f"not a readable IFC file: {error}")
    if wrong := first_error(ifcopenshell.get_log()):
        refuse(f"not a readable IFC file: {wrong}; export it again")
    expected = [element for element in model.by_type("IfcProduct") if is_visible(element)]
    made = write_pieces(model, geom)
    if lost := [element for element in expected if element.id() not in made]:
        shown = ", ".join(f"{each.is_a()} {(each.Name or each.GlobalId)[:LONGEST_NAME]!r}" for each in lost[:SHOWN])
        more = f" and {len(lost) - SHOWN} more" if len(lost) > SHOWN else ""
        refuse(f"the geometry of {len(lost)} of {len(expected)} elements cannot be made: {shown}{more}; {REMEDY}")
    if wrong := first_error(ifcopenshell.get_log()):
        refuse(f"a part of its geometry cannot be made: {wrong}; {REMEDY}")


def is_visible(element: Any) -> bool:
    """Whether an element has a representation from which visible geometry is made."""
    if any(element.is_a(kind) for kind in UNSEEN) or element.Representation is None:
        return False
    parts = element.Representation.Representations
    return any((part.RepresentationIdentifier or BODY[0]) in BODY for part in parts)


def beside_body(element: Any) -> set[str]:
    """Identifiers of representations that are not what is seen of an element: the room kept free about it, its box."""
    return {part.RepresentationIdentifier or BODY[0] for part in element.Representation.Representations} - {*BODY}


def write_pieces(model: Any, geom: Any) -> set[int]:
    """Write the files; the numbers of the elements whose geometry could be made."""
    settings = geom.settings()
    settings.set("use-world-coords", True)
    settings.set("weld-vertices", True)
    iterator = geom.iterator(settings, model)
    listed: list[dict[str, Any]] = []
    made, total = set[int](), 0
    with Path("vertices").open("wb") as vertices, Path("triangles").open("wb") as triangles:
        more = iterator.initialize()
        while more:
            shape = iterator.get()
            element = model.by_id(shape.id)
            is_beside_body = is_visible(element) and shape.context in beside_body(element)
            if not is_beside_body:
                made.add(shape.id)
            if not is_beside_body and not any(element.is_a(kind) for kind in UNSEEN):
                total += len(shape.geometry.faces) // 3
                if total > MOST_TRIANGLES:
                    refuse(f"it has more than {MOST_TRIANGLES:,} triangles; simplify the model to its planar faces")
                for tint, corners, faces in pieces_of(shape):
                    corners.tofile(vertices)
                    faces.tofile(triangles)
                    name = (shape.name or shape.guid)[:LONGEST_NAME]
                    listed.append({"name": name, "tint": tint, "vertices": len(corners), "triangles": len(faces)})
                if len(listed) > MOST_NODES:
                    refuse(f"it has more than {MOST_NODES:,} pieces; join its elements in your modelling program")
            more = iterator.next()
    Path("pieces.json").write_text(json.dumps({"pieces": listed}), encoding="utf-8")
    return made


class Piece(NamedTuple):
    """Colour (3,) of a material if it has one, vertices (n, 3) and triangles (m, 3)."""

    tint: list[float] | None
    vertices: np.ndarray
    triangles: np.ndarray


def pieces_of(shape: Any) -> Iterator[Piece]:
    """Pieces of an element, one per material, each with its own vertices.

    IfcOpenShell turns elements inside out that are mirrored: they are turned back.
    """
    vertices = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
    triangles = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
    open_edges, volume_m3 = closedness(vertices, triangles) if len(triangles) else (0, 0.0)
    if volume_m3 < 0 and not open_edges:
        triangles = triangles[:, ::-1]
    looks = np.array(shape.geometry.material_ids, dtype=np.int64)
    for look in np.unique(looks):
        used, corners = np.unique(triangles[looks == look], return_inverse=True)
        tint = color(shape.geometry.materials[look]) if look >= 0 else None
        yield Piece(tint, vertices[used], corners.reshape(-1, 3))


def color(material: Any) -> list[float]:
    """Red, green and blue, 0..1."""
    diffuse = material.diffuse
    rgb = [diffuse.r(), diffuse.g(), diffuse.b()] if hasattr(diffuse, "r") else list(diffuse)[:3]
    return [min(max(float(each), 0.0), 1.0) for each in rgb]


def first_error(log: str) -> str:
    """Message and object of the first error in IfcOpenShell's log, "" without any; levels are lower case since 0.9."""
    for line in log.splitlines():
        with suppress(ValueError):
            entry = json_value(line)
            if entry["level"].lower() == "error":
                return f"{entry['message'].splitlines()[0].rstrip(':')} {entry.get('instance', '')}".strip()
    return ""


if __name__ == "__main__":
    main()
    sys.stderr.flush()
    os._exit(0)  # no destructor of the library can crash any more
