"""Structure model for trackers: planar faces and the crease edges between them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array

CREASE_ANGLE_DEG = 15.0
"""Faces whose normals differ by less than this angle are one smooth surface, without an edge between them."""
COPLANAR_ANGLE_DEG = 0.5
"""Adjacent triangles whose normals differ by less than this belong to one planar face."""
MOST_FLAT = 50_000
"""Triangles without area for which T-junctions are closed, in a few seconds; a scan may have more, and no edges."""
MOST_SPLITS = 8
"""Splits for each flat triangle: one is the rule, a chain of them on a side takes some."""
MOST_SIDES = 50
"""Sides of surfaces in an edge up to which those that go on are found, which takes the square; more is no surface."""
COLLINEAR, NEARLY_COLLINEAR = 1e-6, 1e-3
"""Sines of the angles by which edges that are one turn at most, rounding included, and pieces that may become one.
"""
WELD_M = 1e-6
"""Vertices closer than this are merged, metres."""

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Structure:
    """Triangle mesh of a structure in its own frame (metres, z up), and its crease edges.

    vertices (n, 3); triangles (m, 3) counter-clockwise seen from outside; triangle_face (m,) the planar
    face that each triangle belongs to; face_normals (f, 3) outward unit normals; edges (e, 2) vertices of each
    straight crease or border edge, cut only where it ends; edge_faces (e, 2) the planar faces on its two sides,
    -1 where there is none. Arrays are read-only.

    >>> import numpy as np
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> square = Structure.from_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> len(square.edges), len(square.face_normals)
    (4, 1)
    """

    vertices: Array
    triangles: Indices
    triangle_face: Indices
    face_normals: Array
    edges: Indices
    edge_faces: Indices

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name).setflags(write=False)

    @property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3), metres."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def edge_segments(self) -> Array:
        """End points of each edge (e, 2, 3), metres."""
        return self.vertices[self.edges]

    @cached_property
    def face_points(self) -> Array:
        """A vertex of each planar face (f, 3), metres."""
        _, first = np.unique(self.triangle_face, return_index=True)
        points = np.asarray(self.vertices[self.triangles[first, 0]])
        points.setflags(write=False)
        return points

    @classmethod
    def from_mesh(
        cls,
        vertices: Array,
        triangles: Indices,
        crease_angle_deg: float = CREASE_ANGLE_DEG,
        min_edge_m: float = 0.0,
    ) -> "Structure":
        """Structure of a triangle mesh: (n, 3) metres, (m, 3) counter-clockwise from outside.

        Edges within a planar face are not crease edges; collinear pieces of an edge are joined. Edges shorter than
        min_edge_m are left out. Triangles without area are dropped, the T-junctions that they close stay closed; of
        equal triangles one is kept. A surface that is there from both sides has the edges of each side.
        ValueError when none has an area, a vertex is not finite, or a triangle has corners that are no vertices.
        """
        vertices, triangles = _weld(*_checked(vertices, triangles))
        normals, areas = _triangle_normals(vertices, triangles)
        pairs, pair_triangles = _triangle_edges(triangles, normals)
        both = pair_triangles[:, 1] >= 0
        left, right = pair_triangles[:, 0], pair_triangles[:, 1]
        cosine = np.where(both, np.einsum("ij,ij->i", normals[left], normals[right]), -1.0)
        flat = both & (cosine > np.cos(np.radians(COPLANAR_ANGLE_DEG)))
        triangle_face = components(len(triangles), left[flat], right[flat])
        n_faces = int(triangle_face.max()) + 1
        face_normals = np.zeros((n_faces, 3))
        np.add.at(face_normals, triangle_face, normals * areas[:, None])
        face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
        crease = cosine <= np.cos(np.radians(crease_angle_deg))
        faces = np.column_stack([triangle_face[left], np.where(both, triangle_face[right], -1)])
        edges, edge_faces = _join_collinear(vertices, pairs[crease], np.sort(faces[crease], axis=1))
        length = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
        keep = length >= min_edge_m
        return cls(vertices, triangles, triangle_face, face_normals, edges[keep], edge_faces[keep])


def _checked(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Vertices and triangles as arrays; ValueError when they are none of a mesh."""
    vertices, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(triangles)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError(f"vertices has the shape {vertices.shape}; give (n, 3) finite numbers, in metres")
    if not triangles.size:
        raise ValueError("none of its triangles has an area")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise ValueError(
            f"triangles has the shape {triangles.shape} and the type {triangles.dtype}; give (m, 3) integers, the "
            "numbers of three vertices each, from 0 on"
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        bad = int(np.argmax(((triangles < 0) | (triangles >= len(vertices))).any(axis=1)))
        raise ValueError(f"triangles[{bad}] = {triangles[bad].tolist()}: there are {len(vertices)} vertices, from 0 on")
    return vertices, triangles


def _weld(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Merge vertices closer than WELD_M; drop degenerate triangles and unreferenced vertices.

    ValueError when no triangle is left.
    """
    _, first, inverse = np.unique(
        np.round(np.asarray(vertices, dtype=np.float64) / WELD_M), axis=0, return_index=True, return_inverse=True
    )
    vertices = np.asarray(vertices, dtype=np.float64)[first]
    triangles = inverse.reshape(-1)[np.asarray(triangles, dtype=np.int64)]
    triangles = triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]  # of three vertices
    flat = _is_flat(vertices, triangles)
    if flat.any():
        if flat.sum() <= MOST_FLAT:
            triangles = _split_at_flat(vertices, triangles, flat)
        triangles = triangles[~_is_flat(vertices, triangles)]
    if not len(triangles):
        raise ValueError("none of its triangles has an area")
    triangles = triangles[_is_first(_turned(triangles))]
    used, inverse = np.unique(triangles, return_inverse=True)
    return vertices[used], inverse.reshape(-1, 3)


def _turned(triangles: Indices) -> Indices:
    """The triangles with the lowest vertex first, in the same orientation."""
    first = triangles.argmin(axis=1)[:, None]
    return np.asarray(np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1))


def _is_first(rows: Indices) -> NDArray[np.bool_]:
    """Mask (n,) of the rows (n, k) that are not equal to an earlier one."""
    order = np.lexsort(rows.T)  # stable: of equal rows the first one leads
    new = np.ones(len(rows), dtype=np.bool_)
    new[order[1:]] = (np.diff(rows[order], axis=0) != 0).any(axis=1)
    return new


def _is_flat(vertices: Array, triangles: Indices) -> NDArray[np.bool_]:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) <= WELD_M**2)


def _split_at_flat(vertices: Array, triangles: Indices, flat: NDArray[np.bool_]) -> Indices:
    """The triangles, split where a flat one joins a side to two shorter ones, as exporters close a T-junction.

    Without its flat triangle such a side would have a face on one side only, and look like an edge of the structure.
    """
    sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    keys = sides[:, 0] * len(vertices) + sides[:, 1]
    near = np.isin(keys, keys.reshape(-1, 3)[flat]).reshape(-1, 3).any(axis=1)
    at_side: dict[frozenset[int], set[tuple[int, int, int]]] = {}
    waiting: list[tuple[int, int, int]] = []

    def put(a: int, b: int, c: int) -> None:
        if len({a, b, c}) == 3:
            for side in ((a, b), (b, c), (c, a)):
                at_side.setdefault(frozenset(side), set()).add((a, b, c))
            if _is_flat(vertices, np.array([[a, b, c]]))[0]:
                waiting.append((a, b, c))

    def take(a: int, b: int, c: int) -> None:
        for side in ((a, b), (b, c), (c, a)):
            at_side[frozenset(side)].discard((a, b, c))

    for corners in triangles[near].tolist():
        put(*corners)
    for _ in range(MOST_SPLITS * len(waiting)):
        if not waiting:
            break
        one = waiting.pop()
        if one not in at_side[frozenset(one[:2])]:
            continue  # split meanwhile
        take(*one)
        turns = [(one[k], one[(k + 1) % 3], one[(k + 2) % 3]) for k in range(3)]
        p, q, middle = max(turns, key=lambda turn: float(np.linalg.norm(vertices[turn[1]] - vertices[turn[0]])))
        for other in sorted(at_side[frozenset((p, q))]):
            k = next(k for k in range(3) if {other[k], other[(k + 1) % 3]} == {p, q})
            first, second, third = other[k], other[(k + 1) % 3], other[(k + 2) % 3]
            take(*other)
            put(first, middle, third)
            put(middle, second, third)
    left = {corners for found in at_side.values() for corners in found}
    return np.array([*triangles[~near].tolist(), *sorted(left)], dtype=np.int64).reshape(-1, 3)


def _triangle_normals(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    return cross / doubled[:, None], doubled / 2


def _triangle_edges(triangles: Indices, normals: Array) -> tuple[Indices, Indices]:
    """Undirected vertex pairs (k, 2) and the triangles (k, 2) adjacent to them, -1 where there is none.

    Of a non-manifold edge, shared by more than two triangles, each further pair of triangles has its own row.
    """
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    half = np.sort(directed, axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((owner, half[:, 1], half[:, 0]))
    half, owner, upward = half[order], owner[order], (directed[:, 0] < directed[:, 1])[order]
    new = np.concatenate([[True], (np.diff(half, axis=0) != 0).any(axis=1)])
    start = np.maximum.accumulate(np.where(new, np.arange(len(half)), 0))
    two_sided = ~_is_first(np.concatenate([_turned(triangles[:, ::-1]), _turned(triangles)]))[len(triangles) :]
    if two_sided.any():
        sides, of_two = np.bincount(start), np.bincount(start, two_sided[owner])
        for first in np.flatnonzero((sides > 2) & (sides <= MOST_SIDES) & (of_two == sides)):
            of_edge = np.arange(first, first + sides[first])
            owner[of_edge] = _by_sides(owner[of_edge].tolist(), upward[of_edge].tolist(), normals)
    even = (np.arange(len(half)) - start) % 2 == 0
    rows = np.flatnonzero(even)
    follows = np.zeros(len(rows), dtype=bool)
    inside = rows + 1 < len(half)
    follows[inside] = ~even[rows[inside] + 1]
    right = np.where(follows, owner[np.minimum(rows + 1, len(half) - 1)], -1)
    return half[rows], np.column_stack([owner[rows], right])


def _by_sides(triangles: list[int], upward: list[bool], normals: Array) -> list[int]:
    """Triangles of an edge that are there from both sides, those that go on on one side next to each other.

    upward: whether each passes the edge from its lower vertex to its higher one; neighbours differ.
    """
    waiting, out = list(zip(triangles, upward, strict=True)), list[int]()
    while waiting:
        one, up = waiting.pop(0)
        others = [other for other in waiting if other[1] != up]
        out.append(one)
        if others:
            best = max(others, key=lambda other: float(normals[one] @ normals[other[0]]))
            waiting.remove(best)
            out.append(best[0])
    return out


def components(n: int, a: Indices, b: Indices) -> Indices:
    """Connected-component labels (n,) of a graph of n nodes and edges a-b, numbered by their first node."""
    from scipy.sparse import coo_array  # lazy: trackers do not need it
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _join_collinear(vertices: Array, pairs: Indices, faces: Indices) -> tuple[Indices, Indices]:
    """Join consecutive collinear edges between the same two faces."""
    merged, alias, kept = pairs.copy(), list(range(len(pairs))), np.ones(len(pairs), dtype=np.bool_)

    def root(row: int) -> int:
        while alias[row] != row:
            row = alias[row]
        return row

    for vertex, *rows in _joints(vertices, pairs, faces).tolist():
        first, second = root(rows[0]), root(rows[1])
        if first == second:
            continue
        tip, tail = (int(merged[row][merged[row] != vertex][0]) for row in (first, second))
        if _turns_less(vertices[None, [tip, vertex, tail]], COLLINEAR)[0]:
            merged[first], alias[second], kept[second] = [tip, tail], first, False
    return merged[kept], faces[kept]


def _joints(vertices: Array, pairs: Indices, faces: Indices) -> Indices:
    """Vertex and two rows of edges (k, 3) that go on in about one direction between the same faces, in their order.

    Edges that were joined before turn by little, and those that turn by much are joined never.
    """
    ends, rows = pairs.ravel(), np.repeat(np.arange(len(pairs)), 2)
    order = np.lexsort((faces[rows, 1], faces[rows, 0], ends))  # stable: those of a group in their order
    keys = np.column_stack([ends, faces[rows]])[order]
    new = np.ones(len(keys) + 1, dtype=np.bool_)
    new[1:-1] = (np.diff(keys, axis=0) != 0).any(axis=1)
    first = np.flatnonzero(new)
    first = order[first[:-1][np.diff(first) == 2][:, None] + np.arange(2)]
    first = first[np.argsort(first[:, 0])]
    tips = ends[first ^ 1]  # the other end of either edge
    turn = _turns_less(vertices[np.stack([tips[:, 0], ends[first[:, 0]], tips[:, 1]], axis=1)], NEARLY_COLLINEAR)
    return np.column_stack([ends[first[:, 0]], rows[first]])[turn]


def _turns_less(corners: Array, sine: float) -> NDArray[np.bool_]:
    """Mask (n,) of paths over three corners (n, 3, 3) that go on and turn by an angle of less than this sine."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    across = np.linalg.norm(np.cross(u, v), axis=1)
    along = np.einsum("ij,ij->i", u, v)
    return np.asarray((along > 0.0) & (across <= sine * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)))
