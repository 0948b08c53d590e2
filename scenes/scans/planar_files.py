"""The files of a planar model: OBJ, and a picture of its edges before the scan."""

from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.hidden_lines import seen_parts
from uavbench.scenes.scans.planar_model import PlanarModel
from uavbench.scenes.structure import Structure
from uavbench.trajectories.files.writing import new_file, write_text
from uavbench.trajectories.pose import Array

PLANAR = "planar model of a scan"
VIEW_PX = (800, 600)
"""Width and height of each of the four views."""
FILLED = 0.9
"""Part of a view that the model fills."""
FAR = 20.0
"""Distance of the eye, in diagonals of the model: nearly a parallel projection."""
SLOPE = 0.45
"""Tangent of the angle by which the eye looks down."""
SCAN, EDGE, BORDER = (170, 170, 170), (0, 110, 0), (0, 0, 230)
"""Colours (BGR) of the scan in full light, of edges between two planes, and of borders of one."""


def write_planar_model(model: PlanarModel, path: Path) -> None:
    """Write the triangles as OBJ, in metres, a group for each plane; numbers round-trip exactly."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in model.vertices.tolist()]
    for plane in range(model.planes):
        lines.append(f"g plane_{plane}")
        lines += [f"f {a} {b} {c}" for a, b, c in (model.triangles[model.plane == plane] + 1).tolist()]
    write_text(path, "\n".join(lines) + "\n", kind=PLANAR)


def write_edge_picture(structure: Structure, scan: Array, path: Path) -> None:
    """Write a PNG of the visible edges of a structure over the triangles (m, 3, 3) of its scan, from four sides."""
    low, high = structure.bounds
    ways = [np.array([x, y, SLOPE]) for x, y in ((-1.0, -0.6), (1.0, -0.6), (1.0, 0.6), (-1.0, 0.6))]
    views = [_view(structure, scan, way / np.linalg.norm(way), (low + high) / 2) for way in ways]
    picture = np.vstack([np.hstack(views[:2]), np.hstack(views[2:])])
    with new_file(path, kind=PLANAR) as new:
        new.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def _view(structure: Structure, scan: Array, way: Array, centre: Array) -> np.ndarray:
    """The view (h, w, 3) from the direction `way` (3,): the scan shaded, edges in green and borders in red."""
    across = np.cross([0.0, 0.0, 1.0], way)
    across /= np.linalg.norm(across)
    axes = np.stack([across, -np.cross(way, across)])  # to the right, and down
    flat = (structure.vertices - centre) @ axes.T
    scale = FILLED * float((np.array(VIEW_PX) / np.ptp(flat, axis=0)).min())
    shift = np.array(VIEW_PX) / 2 - scale * (flat.min(axis=0) + flat.max(axis=0)) / 2
    picture = np.full((VIEW_PX[1], VIEW_PX[0], 3), 255, dtype=np.uint8)
    normals = np.cross(scan[:, 1] - scan[:, 0], scan[:, 2] - scan[:, 0])
    lit = (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)) @ way
    places = np.rint(scale * (scan - centre) @ axes.T + shift).astype(np.int32)
    for k in np.argsort(scan.mean(axis=1) @ way, kind="stable").tolist():  # the nearest last
        if lit[k] > 0:
            shade = [float(255 - (255 - light) * (1.2 - 0.7 * lit[k])) for light in SCAN]
            cv2.fillConvexPoly(picture, places[k], shade)
    eye = centre + FAR * float(np.linalg.norm(np.ptp(structure.vertices, axis=0))) * way
    for colour, rows in ((EDGE, structure.edge_faces[:, 0] >= 0), (BORDER, structure.edge_faces[:, 0] < 0)):
        parts = seen_parts(structure, eye, structure.edge_segments[rows])
        ends = np.rint(scale * (parts - centre) @ axes.T + shift).astype(int)
        for a, b in ends.tolist():
            cv2.line(picture, a, b, colour, 1, cv2.LINE_AA)
    return picture
