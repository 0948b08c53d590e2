"""First surface hit by the rays of a ranging sensor: distance and angle of incidence."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.geometry.bvh import Tree
from uavbench.trajectories.geometry.rays import first_hits
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, eq=False)
class Struck:
    """First hits of k rays: distances_m (k,), inf where there is none, and cosines (k,) of the incidence, 0 to 1."""

    distances_m: Array
    cosines: Array

    def or_nearer(self, other: "Struck") -> "Struck":
        """The nearer hit of each ray."""
        nearer = other.distances_m < self.distances_m
        return Struck(
            np.where(nearer, other.distances_m, self.distances_m), np.where(nearer, other.cosines, self.cosines)
        )


class Surfaces(Protocol):
    """Everything in a scene that reflects light, static or moving."""

    def strike(self, origins_m: Array, directions: Array, times_ns: NDArray[np.int64]) -> Struck:
        """First hits of rays from origins (k, 3) along unit directions (k, 3), each at its time of the flight."""
        ...


@dataclass(frozen=True, eq=False)
class MeshOnFloor:
    """A mesh of triangles, corners_m (m, 3, 3) with their tree, and the floor at z = 0."""

    corners_m: Array
    tree: Tree

    def strike(self, origins_m: Array, directions: Array, times_ns: NDArray[np.int64]) -> Struck:
        """First hits of rays from origins (k, 3) along unit directions (k, 3); the mesh is static."""
        down = np.maximum(-directions[:, 2], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_floor = np.where(down > 0, origins_m[:, 2] / down, np.inf)
        floor = Struck(np.where(to_floor > 0, to_floor, np.inf), down)
        return floor.or_nearer(strike_mesh(self.corners_m, self.tree, origins_m, directions))


def strike_mesh(corners_m: Array, tree: Tree, origins_m: Array, directions: Array) -> Struck:
    """First hits of rays on triangles (m, 3, 3), of which `tree` is the hierarchy."""
    hits = first_hits(tree, np.ascontiguousarray(origins_m), np.ascontiguousarray(directions))
    return Struck(hits.distances, incidence(corners_m[hits.rows], directions))


def incidence(corners_m: Array, directions: Array) -> Array:
    """Cosine (k,), 0 to 1, of the angle between unit directions (k, 3) and the normals of triangles (k, 3, 3)."""
    a, b, c = (corners_m[:, k] for k in range(3))
    normals = np.cross(b - a, c - a)
    size = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    return np.asarray(np.minimum(np.abs(np.einsum("ij,ij->i", normals, directions)) / size, 1.0))


def barycentric(corners_m: Array, places_m: Array) -> Array:
    """Weights (k, 3) of the corners of triangles (k, 3, 3) at points (k, 3) in their planes; all at least 0 inside."""
    a, b, c = (corners_m[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    second = np.einsum("ij,ij->i", np.cross(places_m - a, c - a), normal) / size
    third = np.einsum("ij,ij->i", np.cross(b - a, places_m - a), normal) / size
    return np.column_stack([1.0 - second - third, second, third])
