import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.trajectories.scene import BOX, DECK, PIER, both
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.geometry.bvh import build_tree
from uavbench.trajectories.geometry.distances import mesh_distances
from uavbench.trajectories.geometry.rays import ray_distances, rays_blocked
from uavbench.trajectories.obstacles import ObstacleMesh

near = st.floats(-2.0, 2.0, allow_nan=False)


def box_distance(p: np.ndarray) -> float:
    """Unsigned distance to the surface of BOX, closed form."""
    low, high = BOX.bounds
    outside = np.maximum(np.maximum(low - p, p - high), 0.0)
    if outside.any():
        return float(np.linalg.norm(outside))
    return float(np.minimum(p - low, high - p).min())


@settings(max_examples=300)
@given(x=near, y=near, z=near)
def test_distance_and_inside_of_a_box_match_the_closed_form(x: float, y: float, z: float) -> None:
    p = np.array([x, y, z])
    assert BOX.distance(p[None])[0] == pytest.approx(box_distance(p), abs=1e-12)
    low, high = BOX.bounds
    margin = min(np.abs(p - low).min(), np.abs(p - high).min())
    if margin > 1e-9:
        assert BOX.inside(p[None])[0] == bool(((p > low) & (p < high)).all())


def brute_distance(corners: np.ndarray, p: np.ndarray) -> float:
    """Distance to many triangles by projecting onto the plane and clamping to the sides."""
    best = np.inf
    for a, b, c in corners:
        base = np.column_stack([b - a, c - a])
        weights, *_ = np.linalg.lstsq(base, p - a, rcond=None)
        if weights.min() >= 0 and weights.sum() <= 1:
            best = min(best, float(np.linalg.norm(a + base @ weights - p)))
        for u, v in ((a, b), (b, c), (c, a)):
            t = np.clip((p - u) @ (v - u) / ((v - u) @ (v - u)), 0, 1)
            best = min(best, float(np.linalg.norm(u + t * (v - u) - p)))
    return best


def test_the_tree_agrees_with_brute_force_on_a_soup_of_triangles() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (150, 1, 3)) + 0.3 * rng.standard_normal((150, 3, 3))
    tree = build_tree(corners)
    points = rng.uniform(-2, 2, (60, 3))
    expected = [brute_distance(corners, p) for p in points]
    np.testing.assert_allclose(mesh_distances(tree, points), expected, atol=1e-9)
    directions = rng.standard_normal((60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    alone = [
        min(float(ray_distances(build_tree(t[None]), o[None], d[None])[0]) for t in corners)
        for o, d in zip(points, directions, strict=True)
    ]
    np.testing.assert_array_equal(ray_distances(tree, points, directions), alone)
    for within in (0.5, 1.5, np.inf):
        expected = [distance < within for distance in alone]
        np.testing.assert_array_equal(rays_blocked(tree, points, directions[:, None], within)[:, 0], expected)


def test_rays_hit_faces_where_they_should() -> None:
    hits = BOX.ray([[1, 0, 0.1], [1, 0, 0.1], [0, 0, 1], [0, 0, 0.1]], [[-1, 0, 0], [1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(hits, [0.8, np.inf, 0.7, 0.15], atol=1e-12)


def test_clearance_counts_the_floor_and_is_negative_inside() -> None:
    np.testing.assert_allclose(
        BOX.clearance([[1.2, 0, 0.25], [0, 0, 0.2], [3, 0, 0.1], [3, 0, -0.5]]), [0.25, -0.1, 0.1, -0.5], atol=1e-12
    )
    two = both(DECK, PIER)  # they overlap
    assert two.inside([[0, 0, 5.3], [0, 0, 1], [3, 0, 5.3], [3, 0, 3]]).tolist() == [True, True, True, False]
    sheet = ObstacleMesh([[-1, -1, 1], [1, -1, 1], [0, 2, 1]], [[0, 1, 2]])
    assert not sheet.inside([[0, 0, 0.5], [0, 0, 1.5]]).any()


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [(np.zeros((3, 3)), np.zeros((0, 3))), (np.full((3, 3), np.nan), [[0, 1, 2]]), (np.zeros((3, 3)), [[0, 1, 3]])],
)
def test_a_mesh_that_is_none_is_refused(vertices: np.ndarray, triangles: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"triangle|finite"):
        ObstacleMesh(vertices, triangles)


def test_mounts_turn_the_camera_as_they_say() -> None:
    def axis(mount: Mount) -> np.ndarray:
        return np.asarray(mount.cam_from_body.rotation[2])

    np.testing.assert_allclose(Mount().cam_from_body.rotation, [[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    np.testing.assert_allclose(axis(Mount(pitch_deg=-90)), [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(axis(Mount(yaw_deg=90)), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(axis(Mount(yaw_deg=90, pitch_deg=30)), [0, np.sqrt(0.75), 0.5], atol=1e-12)
    rolled = Mount(roll_deg=90).cam_from_body.rotation
    np.testing.assert_allclose(rolled[0], [0, 0, -1], atol=1e-12)  # its right points down: turned clockwise
    np.testing.assert_allclose(
        Mount(offset_m=(0.1, 0, 0)).cam_from_body.transform(np.array([[1.1, 0, 0]])), [[0, 0, 1]]
    )
