"""Scans of boxes: a fine mesh with rounded borders, noise, holes and floating bits."""

import numpy as np

CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (0.0, 0.3)])
CENTRE = np.array([0.0, 0.0, 0.15])
HALF = np.array([0.2, 0.15, 0.15])


def fine_box(step_m=0.005):
    """Vertices and triangles of the box of CORNERS, divided into squares; its vertices are welded."""
    counts = np.rint(2 * HALF / step_m).astype(int)
    points, triangles, n = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        i, j = np.meshgrid(np.arange(counts[u] + 1), np.arange(counts[v] + 1), indexing="ij")
        square = np.arange(i.size).reshape(i.shape)
        a, b, c, d = square[:-1, :-1], square[1:, :-1], square[1:, 1:], square[:-1, 1:]
        pairs = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
        for side in (-1, 1):
            place = np.empty((i.size, 3))
            place[:, u], place[:, v] = (
                (2 * HALF[u] * i / counts[u] - HALF[u]).ravel(),
                (2 * HALF[v] * j / counts[v] - HALF[v]).ravel(),
            )
            place[:, axis] = side * HALF[axis]
            points.append(place)
            triangles.append((pairs if side > 0 else pairs[:, ::-1]) + n)
            n += len(place)
    points, triangles = np.concatenate(points), np.concatenate(triangles)
    _, first, same = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return points[first] + CENTRE, same.reshape(-1)[triangles]


def scanned_box(noise_m=0.001, radius_m=0.006, seed=0):
    """The box with rounded borders, and noise in all directions of which a half is shared by neighbours."""
    rng = np.random.default_rng(seed)
    vertices, triangles = fine_box()
    inner = np.clip(vertices - CENTRE, radius_m - HALF, HALF - radius_m)
    out = vertices - CENTRE - inner
    rounded = (
        CENTRE + inner + radius_m * out / np.maximum(np.abs(out).max(axis=1), np.linalg.norm(out, axis=1))[:, None]
    )
    waves = 2 * np.pi / 0.08 * rng.standard_normal((12, 3)), rng.uniform(0, 2 * np.pi, 12)
    shared = np.cos(vertices @ waves[0].T + waves[1]).sum(axis=1) / np.sqrt(6)
    off = np.sqrt(0.5) * (rng.standard_normal(vertices.shape) + shared[:, None] * out / radius_m)
    return rounded + noise_m * off, triangles


def write_ply(path, vertices, triangles):
    """Write a mesh as PLY in text; its path."""
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    rows = [*(" ".join(map(repr, v)) for v in vertices.tolist()), *(f"3 {a} {b} {c}" for a, b, c in triangles.tolist())]
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(head + "\n".join(rows) + "\n")
    return path
