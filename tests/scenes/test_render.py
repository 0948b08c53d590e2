from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, grey_wall, looking, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import panel
from uavbench.scenes.renderables import Light, Mover, Part
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.rendering.antialiasing.border_kernels import find_smooth, number_planes
from uavbench.scenes.rendering.antialiasing.outlines import opposite_facets
from uavbench.scenes.rendering.radiance import RENDERED, decode, encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.rendering.shadows import split_by_lamp
from uavbench.trajectories.pose import Pose, rotation_exp


def edge_column(row: np.ndarray) -> float:
    """Sub-pixel column where light changes from dark to bright, from the coverage of the pixels."""
    return len(row) - 0.5 - float((row / row.max()).sum())


@pytest.mark.parametrize("shift", [0.0, 0.013, 0.027, -0.041])
def test_a_rendered_edge_lies_where_the_camera_projects_it(camera: Camera, shift: float) -> None:
    """The half pixel: pixel centres at integer coordinates. Every row of a slanted edge agrees within 0.02 px."""
    wall = white_box((2.0, -9.0, -9.0), (2.0001, shift, 9.0))
    roll = Pose(rotation_exp(np.array([0.0, 0.0, 0.05])), np.zeros(3))
    pose = roll @ looking((0.0, 0.0, 0.0), (1.0, 0.002, 0.0))
    with Renderer((wall,), FLAT_LIGHT, camera.width, camera.height) as renderer:
        light = RENDERED[renderer.color(pose, camera)[..., 1]]
    edge = camera.project(pose.transform(np.column_stack([[2.0] * 2, [shift] * 2, [-1.0, 1.0]])))
    rows = np.arange(camera.height)
    expected = np.interp(rows, edge[::-1, 1], edge[::-1, 0])
    error = np.array([edge_column(row) for row in light]) - expected
    assert np.abs(error).max() < 0.02


def test_the_mean_over_many_edges_has_no_bias(camera: Camera) -> None:
    errors = []
    with Renderer((white_box((2.0, -9.0, -9.0), (2.0001, 0.0, 9.0)),), FLAT_LIGHT, 320, 240) as renderer:
        for turn in np.linspace(-0.2, 0.2, 45):
            pose = looking((0.0, 0.0, 0.0), (1.0, float(turn), 0.0))
            light = RENDERED[renderer.color(pose, camera)[..., 1]]
            expected = camera.project(pose.transform(np.array([[2.0, 0.0, 0.0]])))[0, 0]
            row = round(camera.cy)
            errors.append(edge_column(light[row]) - expected)
    assert abs(np.mean(errors)) < 0.005
    assert np.max(np.abs(errors)) < 0.02


def test_a_face_thinner_than_a_pixel_is_drawn_where_no_pixel_centre_hits_it() -> None:
    """The front of a box (0.5) and beneath it 0.6 px of its underside (1), slanted: the light of every column."""
    camera = Camera(64, 64, 300.0, 300.0, 32.0, 32.0)
    lit = Light(to_lamp=(0.0, 0.0, 1.0), lamp=(0.0,) * 3, above=(0.0,) * 3, below=(1.0,) * 3, shadow_map=False)
    roll = Pose(rotation_exp(np.array([0.0, 0.0, 0.05])), np.zeros(3))
    pose = roll @ looking((0.0, 0.0, -0.02), (1.0, 0.0, -0.02))
    with Renderer((white_box((2.0, -1.0, 0.0), (2.5, 1.0, 0.5)),), lit, 64, 64) as renderer:
        light = RENDERED[renderer.color(pose, camera)[..., 1]].sum(axis=0)
    front, back = (camera.project(pose.transform(np.array([[x, y, 0.0] for y in (0.5, -0.5)]))) for x in (2.0, 2.5))
    upper, lower = (np.interp(np.arange(64), edge[:, 0], edge[:, 1]) for edge in (front, back))
    assert (lower - upper).mean() == pytest.approx(0.6, abs=0.01)
    assert light == pytest.approx(0.5 * (upper + 0.5) + (lower - upper), abs=0.08)


def test_facets_know_their_neighbours_across_each_side() -> None:
    """Of a box all sides are shared by two triangles; another part at the same place is none of them."""
    one = white_box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    corners = one.vertices[one.triangles]
    opposite = opposite_facets(np.concatenate([corners, corners]), np.repeat([0, 1], len(corners)))
    assert (opposite[:12] >= 0).all() and (opposite[:12] < 12).all()
    assert np.array_equal(opposite[12:], opposite[:12] + 12)
    for row, others in enumerate(opposite[:12]):
        for corner, other in enumerate(others):
            ends = np.delete(corners[row], corner, axis=0)
            assert all((corners[other] == end).all(axis=1).any() for end in ends)
    alone = opposite_facets(corners[:1], np.zeros(1, dtype=np.int64))
    assert alone.tolist() == [[-1, -1, -1]]


def test_facets_of_one_plane_have_one_number() -> None:
    """The two triangles of each side of a box; not one without area that lies between two sides."""
    box = white_box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    corners = box.vertices[box.triangles]
    opposite, plane = opposite_facets(corners, np.zeros(12, dtype=np.int64)), np.empty(12, dtype=np.int64)
    number_planes(corners, opposite, plane)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    same = plane[:, None] == plane
    assert np.array_equal(same, normals @ normals.T > 0.0)
    folded = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]]], dtype=np.float64)
    folded = np.insert(folded, 1, [[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], axis=0)
    between = np.array([[-1, -1, 1], [-1, 2, 0], [-1, -1, 1]])
    number_planes(folded, between, plane[:3])
    assert plane[:3].tolist() == [0, 1, 2]


def test_a_facet_goes_on_in_the_other_half_of_its_face_and_where_it_hardly_bends() -> None:
    box = white_box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    corners = box.vertices[box.triangles]
    opposite, smooth = opposite_facets(corners, np.zeros(12, dtype=np.int64)), np.empty((12, 3), dtype=np.int64)
    find_smooth(corners, opposite, smooth)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for row in range(12):
        (other,) = smooth[row][smooth[row] >= 0]
        assert other != row
        assert normals[other] @ normals[row] > 0.0
    for angle_rad, goes_on in ((0.04, True), (0.05, False)):  # the cosines are 0.9992 and 0.9988
        bent = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, -1, 0], [1, 0, 0]]], dtype=np.float64)
        bent[1, 1] = [0, -np.cos(angle_rad), np.sin(angle_rad)]
        find_smooth(bent, np.array([[-1, -1, 1], [-1, 0, -1]]), smooth[:2])
        assert smooth[:2].tolist() == ([[-1, -1, 1], [-1, 0, -1]] if goes_on else [[-1] * 3] * 2)


def test_an_error_of_a_call_that_is_not_checked_is_raised_by_the_next_that_is() -> None:
    GL = gl.functions()
    GL.glEnable(0xFFFF)
    with pytest.raises(GL.GLError) as raised:
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
    assert raised.value.err == GL.GL_INVALID_ENUM  # its text is GLU's, which a bare machine has not
    GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)


def test_depth_and_instances_are_those_of_the_surface(camera: Camera) -> None:
    wall = white_box((2.0, -0.5, -0.5), (2.1, 0.5, 0.5), instance=7)
    with Renderer((wall,), FLAT_LIGHT, camera.width, camera.height) as renderer:
        depth, instances = renderer.geometry(looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), camera)
    assert depth[118, 161] == pytest.approx(2.0, abs=1e-4)
    assert instances[118, 161] == 7
    assert depth[0, 0] == 0.0
    assert instances[0, 0] == 0


@pytest.mark.parametrize("distance_m", [1.0, 30.0, 120.0, 600.0])
def test_a_pane_2_mm_before_a_wall_is_drawn_at_every_distance(distance_m: float) -> None:
    # As in facades: a depth buffer of integers from a near plane of 5 cm mixes the two from 25 m on.
    wall = white_box((distance_m, -500.0, -500.0), (distance_m + 1.0, 500.0, 500.0), instance=2)
    pane = white_box((distance_m - 0.002, -0.3 * distance_m, -0.3 * distance_m), (distance_m, 500.0, 500.0), instance=7)
    camera = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
    pose = Pose(rotation_exp(np.array([0.0, 0.0, 0.3])), np.zeros(3)) @ looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    with Renderer((wall, pane), FLAT_LIGHT, camera.width, camera.height) as renderer:
        instances = renderer.geometry(pose, camera).instances
    rays = camera.rays(np.argwhere(np.ones((120, 160)))[:, ::-1].astype(float)) @ pose.rotation
    at = (rays[:, 1:] / rays[:, :1]).reshape(120, 160, 2)
    assert set(instances[(at > -0.29).all(axis=2)].tolist()) == {7}
    assert set(instances[(at < -0.31).any(axis=2)].tolist()) == {2}


def test_a_mover_is_drawn_where_it_is_at_that_time(camera: Camera) -> None:
    ball = white_box((2.0, -0.1, -0.1), (2.2, 0.1, 0.1), instance=9)
    mover = Mover(ball, lambda t: Pose(np.eye(3), np.array([0.0, t, 0.0])))
    with Renderer((), FLAT_LIGHT, camera.width, camera.height, (mover,)) as renderer:
        pose = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        columns = [np.flatnonzero(renderer.geometry(pose, camera, t)[1][118] == 9).mean() for t in (0.0, 0.3)]
    assert columns[1] - columns[0] == pytest.approx(-0.3 * 300 / 2.05, abs=2.0)


def test_light_is_linear_in_the_albedo(camera: Camera) -> None:
    pose = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    for level in (0.05, 0.2, 0.7):
        with Renderer((grey_wall(2.0, 8.0, level),), FLAT_LIGHT, 320, 240) as renderer:
            seen = RENDERED[renderer.color(pose, camera)[120, 160, 1]]
        assert seen == pytest.approx(level, abs=0.006)


def test_the_same_scene_gives_the_same_bytes(camera: Camera) -> None:
    pose = looking((0.3, 0.1, 0.4), (2.0, 0.0, 0.0))
    images = []
    for _ in range(2):
        with Renderer((white_box((2.0, -0.5, -0.5), (2.1, 0.5, 0.5)),), FLAT_LIGHT, 320, 240) as renderer:
            images.append(renderer.color(pose, camera))
    assert np.array_equal(*images)


SUN = Light(to_lamp=(-1.0, 0.0, 0.2), lamp=(0.6, 0.6, 0.6), above=(0.1, 0.1, 0.1), below=(0.1, 0.1, 0.1))


def test_a_part_is_split_into_what_faces_the_lamp_and_the_rest() -> None:
    part = white_box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    halves = split_by_lamp(part, SUN)
    assert [lit for _, lit in halves] == [True, False]
    for half, lit in halves:
        a, b, c = (half.vertices[half.triangles[:, k]] for k in range(3))
        assert ((np.cross(b - a, c - a) @ np.array(SUN.to_lamp) > 0) == lit).all()
    together = np.concatenate([half.triangles for half, _ in halves])
    assert sorted(map(tuple, together.tolist())) == sorted(map(tuple, part.triangles.tolist()))
    leaf = replace(part, two_sided=True)
    assert split_by_lamp(leaf, SUN) == [(leaf, True)]


def test_a_sheet_throws_no_shadow_on_the_side_that_the_lamp_sees(camera: Camera) -> None:
    """Whichever way its normals point."""
    pose = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    wall = replace(grey_wall(2.0, 4.0, 0.8), two_sided=True)
    seen = []
    for part in (wall, replace(wall, triangles=wall.triangles[:, ::-1])):
        with Renderer((part,), SUN, 320, 240) as renderer:
            seen.append(RENDERED[renderer.color(pose, camera)[120, 160, 1]])
    slope = 1 / np.sqrt(1.04)
    assert seen == pytest.approx([0.8 * (0.1 + 0.6 * slope)] * 2, abs=0.05)


def test_the_shadow_of_a_rail_is_no_row_of_teeth() -> None:
    """Of a rail 5 cm wide in a scene of 80 m: along its middle the shadow is about equally deep, and nowhere broken."""
    at = np.array([[-50.0, -50.0, 0.0], [50.0, -50.0, 0.0], [50.0, 50.0, 0.0], [-50.0, 50.0, 0.0]])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    ground = Part(vertices=at, triangles=np.array([[0, 1, 2], [0, 2, 3]]), normals=up, casts_shadow=False)
    far = [white_box((x, y, 0.0), (x + 1.0, y + 1.0, 1.0)) for x, y in ((-40.0, -40.0), (39.0, 39.0))]
    rail = white_box((-6.0, -0.025, 1.0), (6.0, 0.025, 1.05))
    sun = np.array([0.39, -0.67, 0.63])  # across the rail, which so lies askew in the shadow map
    lamp = Light(to_lamp=tuple(sun), lamp=(0.6,) * 3, above=(0.2,) * 3, below=(0.2,) * 3, softness_m=0.08)
    middle = -1.025 * sun[1] / sun[2]
    camera = Camera(640, 120, 600.0, 600.0, 319.5, 59.5)
    with Renderer((ground, *far, rail), lamp, camera.width, camera.height) as renderer:
        seen = renderer.color(looking((0.0, middle - 0.01, 6.0), (0.0, middle, 0.0)), camera)[..., 1].astype(float)
    across = seen[40:80].min(axis=0)
    lit = float(np.median(seen[:20]))
    depth = (lit - across) / lit
    assert depth.min() > 0.85 * depth.max() > 0.3


def test_the_shadow_of_a_tower_reaches_ground_that_lies_deeper_than_all_of_it() -> None:
    """A tower 2 m high under a lamp at 45 degrees: its shadow is 2 m long, and ground beside or behind that is lit."""
    lamp = replace(SUN, to_lamp=(1.0, 0.0, 1.0))
    vertices, triangles = panel((-4.0, -4.0, 0.0), (8.0, 0.0, 0.0), (0.0, 8.0, 0.0), 8.0)[:2]
    ground = Part(vertices=vertices, triangles=triangles, casts_shadow=False)
    tower = white_box((0.0, -0.5, 0.0), (0.5, 0.5, 2.0))
    above, camera = looking((-1.5, -0.01, 6.0), (-1.5, 0.0, 0.0)), Camera(320, 240, 150.0, 150.0, 159.5, 119.5)
    dark, lit = 0.1, 0.1 + 0.6 / np.sqrt(2)
    with Renderer((ground, tower), lamp, 320, 240) as renderer:
        seen = RENDERED[renderer.color(above, camera)[..., 1]]
    places = {(-0.2, 0.0): dark, (-1.0, 0.4): dark, (-1.9, 0.0): dark, (-2.1, 0.0): lit, (-1.0, 0.6): lit}
    for (x, y), light in places.items():
        column, row = np.rint(camera.project(above.transform(np.array([[x, y, 0.0]])))[0]).astype(int)
        assert seen[row, column] == pytest.approx(light, abs=0.03), (x, y)


def test_light_that_is_no_number_or_out_of_range_has_a_code() -> None:
    light = np.array([[[np.nan, -np.inf, np.inf], [-1.0, 2.0, 1.0]]], dtype=np.float32)
    assert encode(light).tolist() == [[[0, 0, 255], [0, 255, 255]]]


def test_encode_undoes_decode() -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(1, 256, 1).repeat(3, axis=2)
    assert np.array_equal(encode(decode(codes)), codes)


@pytest.mark.parametrize("structure_first", [True, False])
def test_where_faces_lie_in_one_plane_the_structure_is_seen(structure_first: bool) -> None:
    structure = white_box((2.0, -2.0, -2.0), (3.0, 2.0, 2.0))
    obstacle = white_box((2.0, -0.5, -0.5), (3.0, 0.5, 0.5), instance=0)
    parts = (structure, obstacle) if structure_first else (obstacle, structure)
    camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    with Renderer(parts, FLAT_LIGHT, 64, 48) as renderer:
        assert renderer.geometry(looking((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), camera).instances[24, 32] == 1
