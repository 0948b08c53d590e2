"""The mesh of the inspected structure, which the vehicle must not touch, and the floor at z = 0."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uavbench.trajectories.geometry.bvh import Tree, build_tree
from uavbench.trajectories.geometry.distances import mesh_distances
from uavbench.trajectories.geometry.rays import are_inside, ray_distances, rays_blocked
from uavbench.trajectories.geometry.surfaces import MeshOnFloor, Surfaces
from uavbench.trajectories.pose import Array, read_only

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ObstacleMesh:
    """Triangle mesh in the world frame, metres, z up, floor at z = 0; arrays are read-only.

    vertices (n, 3); triangles (m, 3) rows of vertices, counter-clockwise from outside. ValueError for a mesh without
    triangles, an index out of range or a vertex that is not finite. surroundings: the surfaces that ranging sensors
    measure, if they differ from this mesh: the structure as built and everything around it.
    """

    vertices: Array
    triangles: Indices
    surroundings: Surfaces | None = field(default=None, repr=False, kw_only=True)
    tree: Tree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertices = read_only(self.vertices, (-1, 3))
        triangles = np.array(self.triangles, dtype=np.int64).reshape(-1, 3)
        triangles.setflags(write=False)
        if len(triangles) == 0 or not np.isfinite(vertices).all():
            raise ValueError("a mesh needs at least one triangle and finite vertices")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"a triangle refers to a vertex outside 0..{len(vertices) - 1}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "tree", build_tree(vertices[triangles]))

    @property
    def surfaces(self) -> Surfaces:
        """Surfaces that ranging sensors measure: the surroundings if known, otherwise this mesh and the floor."""
        return (
            self.surroundings
            if self.surroundings is not None
            else MeshOnFloor(self.vertices[self.triangles], self.tree)
        )

    @property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3), metres."""
        used = self.vertices[np.unique(self.triangles)]
        return np.array([used.min(axis=0), used.max(axis=0)])

    @property
    def centre(self) -> Array:
        """Centre (3,) of the bounds, metres."""
        return np.asarray(self.bounds.mean(axis=0))

    def distance(self, points: ArrayLike) -> Array:
        """Unsigned distance (k,) of points (k, 3) to the mesh, metres."""
        return mesh_distances(self.tree, read_only(points, (-1, 3)))

    def ray(self, origins: ArrayLike, directions: ArrayLike) -> Array:
        """Distance (k,) along unit directions (k, 3) from origins (k, 3) to the first triangle, metres; inf: none."""
        return ray_distances(self.tree, read_only(origins, (-1, 3)), read_only(directions, (-1, 3)))

    def blocked(self, origins: Array, directions: Array, within_m: float) -> NDArray[np.bool_]:
        """Mask (n, k) of rays from origins (n, 3), unit directions (n, k, 3), that hit a triangle within within_m."""
        return rays_blocked(self.tree, np.ascontiguousarray(origins), np.ascontiguousarray(directions), within_m)

    def inside(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Mask (k,) of points (k, 3) inside the mesh: rays up and down both exit it more often than they enter.

        Solids may thus overlap or touch, and a sheet without thickness has no interior.
        """
        return are_inside(self.tree, read_only(points, (-1, 3)))

    def clearance(self, points: ArrayLike) -> Array:
        """Distance (k,) of points (k, 3) to mesh or floor, metres; negative inside the mesh or under the floor."""
        at = read_only(points, (-1, 3))
        to_mesh = self.distance(at)
        return np.minimum(np.where(self.inside(at), -to_mesh, to_mesh), at[:, 2])
