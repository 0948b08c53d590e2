"""Registry of structures by kind."""

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.checkerboard import Checkerboard
from uavbench.scenes.structures.truss import Truss
from uavbench.scenes.structures.wall import Wall

STRUCTURES: dict[str, type] = {
    "box": Box,
    "wall": Wall,
    "bridge": Bridge,
    "building": Building,
    "truss": Truss,
    "checkerboard": Checkerboard,
    "mesh": MeshFile,
}
