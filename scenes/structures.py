"""Every structure by its name."""

from scenes.box import Box
from scenes.bridge import Bridge
from scenes.building import Building
from scenes.checkerboard import Checkerboard
from scenes.mesh_file import MeshFile
from scenes.truss import Truss
from scenes.wall import Wall

STRUCTURES: dict[str, type] = {
    "box": Box,
    "wall": Wall,
    "bridge": Bridge,
    "building": Building,
    "truss": Truss,
    "checkerboard": Checkerboard,
    "mesh": MeshFile,
}
