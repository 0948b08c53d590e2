"""Optical flow and normals of frames, against points of the meshes that are projected by the written poses."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, flow_codes, looking, white_box
from uavbench.scenes.camera import Camera, camera_array
from uavbench.scenes.dataset.annotations import read_depth
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.surfaces.flow_kernels import (
    Lens,
    Motions,
    RowScratch,
    carry,
    flow_rows,
    list_doubtful,
)
from uavbench.scenes.dataset.surfaces.normal_kernels import normal_rows
from uavbench.scenes.dataset.surfaces.occlusion_kernels import BEFORE
from uavbench.scenes.dataset.surfaces.shown_kernels import Shown, end_of_run, read_near
from uavbench.scenes.dataset.surfaces.surface_files import HIDDEN, LARGEST_FLOW_PX, OUTSIDE, SEEN, UNKNOWN
from uavbench.scenes.dataset.surfaces.surface_truth import FlowTruth, SurfaceTruth
from uavbench.scenes.dataset.surfaces.trace_kernels import trace, trace_centres
from uavbench.scenes.generate import generate
from uavbench.scenes.png.filters import UP
from uavbench.scenes.primitives.meshes import panel
from uavbench.scenes.renderables import Mover, Part
from uavbench.scenes.rendering import context
from uavbench.scenes.rendering.antialiasing.coverage import BORDERED, cells
from uavbench.scenes.rendering.antialiasing.facet_table import FacetTable
from uavbench.scenes.rendering.camera_simulator import ideal_camera, pixel_grid, render_camera
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.surfaces import SceneSurfaces
from uavbench.scenes.world.indoor import Indoor
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Pose, rotation_exp
from uavbench.trajectories.simulation.flight import FlightSpec

SPEC = SequenceSpec(
    name="surfaces",
    seed=4,
    structure=Box(),
    environment=Indoor(),
    flight=FlightSpec(path=HandPilot(duration_s=0.3)),
    mount=Mount(pitch_deg=-25.0, offset_m=(0.02, 0.0, 0.01)),
    camera=CameraSpec(
        width=200, height=150, horizontal_fov_deg=75.0, distortion_model="radtan", distortion=(-0.2, 0.05, 1e-3, -1e-3)
    ),
    sensors=(),
    annotations=("depth", "mask", "flow", "normals"),
)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("surfaces") / "distorted"
    generate(SPEC, folder, content_hash="abc")
    return Sequence.load(folder)


@pytest.fixture(scope="module")
def pinhole(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("surfaces") / "pinhole"
    generate(
        replace(SPEC, camera=replace(SPEC.camera, distortion_model="none", distortion=())), folder, content_hash=""
    )
    return Sequence.load(folder)


def faces_met(sequence: Sequence, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (k, 2) deep within the structure's mask, the point of the model (k, 3) they show, and its normal."""
    mask = sequence[frame].mask
    assert mask is not None
    inner = cv2.erode((mask == 1).astype(np.uint8), np.ones((3, 3), dtype=np.uint8))
    return met(sequence, frame, np.argwhere(inner)[:, ::-1].astype(np.float64))


def met(sequence: Sequence, frame: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those of the pixels (k, 2) whose rays meet the model, where (k, 3), and its normal there."""
    structure, pose = sequence.structure, sequence.true_cam_from_world(frame)
    centre = pose.inverse().translation
    rays = sequence.camera.rays(pixels) @ pose.rotation
    best, normal = np.full(len(rays), np.inf), np.zeros((len(rays), 3))
    for triangle in structure.vertices[structure.triangles]:
        a, b, c = triangle
        n = np.cross(b - a, c - a)
        t = (a - centre) @ n / (rays @ n)
        p = centre + t[:, None] * rays
        sides = [np.cross(q - o, p - o) @ n for o, q in ((a, b), (b, c), (c, a))]
        nearer = (np.min(sides, axis=0) >= 0) & (t > 0) & (t < best)
        best[nearer], normal[nearer] = t[nearer], n / np.linalg.norm(n)
    known = np.isfinite(best)
    return pixels[known].astype(int), centre + best[known, None] * rays[known], normal[known]


@pytest.mark.parametrize("which", ["sequence", "pinhole"])
def test_flow_is_the_projected_motion_of_the_meshs_points(which: str, request: pytest.FixtureRequest) -> None:
    sequence, checked, worst = request.getfixturevalue(which), 0, 0.0
    for frame in range(len(sequence) - 1):
        pixels, points, _ = faces_met(sequence, frame)
        flow = sequence[frame].flow_px
        assert flow is not None
        now, later = (
            sequence.camera.project(sequence.true_cam_from_world(f).transform(points)) for f in (frame, frame + 1)
        )
        read = flow[pixels[:, 1], pixels[:, 0]]
        error = np.abs(read - (later - now)).max(axis=1)
        assert np.isfinite(read).all()
        assert np.abs(later - now).max() > 0.2
        checked, worst = checked + len(error), max(worst, float(error.max()))
    assert checked > 3000
    assert worst < 0.0085  # half of 1/64 px, the form's rounding; asked for: 0.02
    assert sequence[len(sequence) - 1].flow_px is None


def snapped_m(camera: Camera, pose: Pose, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Depth (k,) in metres by which surfaces move where vertices are drawn at the nearest 1/256 px, as GPUs do.

    Of a plane n X = c, depth z over pixels changes by z^2 n_x / (f c) along a row, and likewise along a column.
    """
    if context.is_llvmpipe():
        return np.zeros(len(points))
    X, n = pose.transform(points), normals @ pose.rotation.T
    slope = X[:, 2] ** 2 * (np.abs(n[:, 0]) / camera.fx + np.abs(n[:, 1]) / camera.fy) / np.abs((n * X).sum(axis=1))
    return np.asarray(slope / 512)


@pytest.mark.parametrize("which", ["sequence", "pinhole"])
def test_depth_is_that_of_the_point_at_the_pixels_centre(which: str, request: pytest.FixtureRequest) -> None:
    sequence = request.getfixturevalue(which)
    for frame in range(len(sequence)):
        pixels, points, normals = faces_met(sequence, frame)
        pose = sequence.true_cam_from_world(frame)
        expected = pose.transform(points)[:, 2]
        error = np.abs(read_depth(sequence, frame)[pixels[:, 1], pixels[:, 0]] - expected)
        allowed = 0.00051 + snapped_m(sequence.camera, pose, points, normals)
        assert (error < allowed).all()  # half of the files' millimetre; of the nearest pixel of a pinhole, several


def test_the_mask_is_where_the_rays_of_pixels_meet_the_model_also_at_its_borders(sequence: Sequence) -> None:
    """Facets smaller than a pixel, as of the box's bevelled edges, lie before others that are rendered beside them."""
    everywhere = np.argwhere(np.ones((150, 200)))[:, ::-1].astype(np.float64)
    for frame in range(len(sequence)):
        mask, expected = sequence[frame].mask, np.zeros((150, 200), dtype=bool)
        pixels, points, _ = met(sequence, frame, everywhere)
        expected[pixels[:, 1], pixels[:, 0]] = True
        assert mask is not None and expected.sum() > 1000
        depth = sequence.true_cam_from_world(frame).transform(points)[:, 2]
        error = np.abs(read_depth(sequence, frame)[pixels[:, 1], pixels[:, 0]] - depth)
        assert ((mask == 1) != expected).sum() <= 1
        assert error.max() < 0.03  # of a facet that no pixel shows; of what lies behind the box, 0.8


def test_depth_and_mask_are_the_same_with_and_without_other_annotations(sequence: Sequence, tmp_path: Path) -> None:
    generate(replace(SPEC, annotations=("depth", "mask")), tmp_path / "fewer", content_hash="")
    for name in ("depth/000001.png", "mask/000001.png"):
        assert (tmp_path / "fewer" / name).read_bytes() == (sequence.folder / name).read_bytes()
    assert not (tmp_path / "fewer" / "normals").exists()


@pytest.mark.parametrize("which", ["sequence", "pinhole"])
def test_normals_are_those_of_the_faces_towards_the_camera(which: str, request: pytest.FixtureRequest) -> None:
    sequence = request.getfixturevalue(which)
    for frame in range(len(sequence)):
        pixels, _, expected = faces_met(sequence, frame)
        normals = sequence[frame].normals
        assert normals is not None
        read = normals[pixels[:, 1], pixels[:, 0]]
        cosine = np.einsum("ij,ij->i", read, expected @ sequence.true_cam_from_world(frame).rotation.T)
        assert np.degrees(np.arccos(np.minimum(cosine, 1))).max() < 0.005  # asked for: 0.1
        floor = sequence.true_cam_from_world(frame).rotation @ [0, 0, 1]
        assert np.abs(normals[-1, -1] - floor).max() < 1e-4


def test_the_files_of_flow_are_kittis(sequence: Sequence) -> None:
    codes = cv2.imread(str(sequence.folder / "flow" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert codes is not None
    assert (codes.dtype, codes.shape) == (np.uint16, (150, 200, 3))
    assert set(np.unique(codes[..., 0])) <= {0, 1}
    u = (codes[..., 2].astype(float) - 2**15) / 64
    flow = sequence[0].flow_px
    assert flow is not None
    assert np.array_equal(u[codes[..., 0] == 1], flow[..., 0][codes[..., 0] == 1])


UNIT_PX = 1 / 64
"""Step of the flow in its files."""


def flow_of(truth: FlowTruth) -> np.ndarray:
    """Flow (h, w, 2) in px of the rows of a file, NaN where it is not known."""
    u, v, known = np.moveaxis(flow_codes(truth), 2, 0).astype(np.float64)
    return np.where(known[..., None] == 1, (np.stack([u, v], axis=-1) - 2**15) * UNIT_PX, np.nan)


def truth_of(
    parts: tuple, movers: tuple, poses: list[Pose], sky: bool = False
) -> tuple[np.ndarray, np.ndarray, Camera]:
    """Flow and occlusion from the first pose to the second, one second apart, and the camera."""
    camera = Camera.from_field_of_view(160, 120, 70.0)
    panorama = np.full((8, 16, 3), 99, dtype=np.uint8) if sky else None
    with Renderer(parts, FLAT_LIGHT, 160, 120, movers, panorama) as renderer:
        pinhole, lens = render_camera(camera)
        source = ideal_camera(renderer, camera, pinhole, lens, lambda ns: poses[round(ns / 1e9)])
        truth = SurfaceTruth(renderer, source)
        found = truth.flow(truth.view(0), truth.view(10**9))
        return flow_of(found), found.occlusion, camera


def test_what_moves_flows_as_the_part_that_it_belongs_to() -> None:
    pose = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    mover = Mover(
        white_box((2.0, -0.2, -0.2), (2.4, 0.2, 0.2)), lambda t: Pose(np.eye(3), np.array([0.0, -0.1 * t, 0.0]))
    )
    flow, occlusion, camera = truth_of((white_box((4.0, -5, -5), (4.1, 5, 5)),), (mover,), [pose, pose])
    assert flow[60, 80] == pytest.approx([0.1 * camera.fx / 2.0, 0.0], abs=0.5 * UNIT_PX)
    assert flow[60, 20] == pytest.approx([0.0, 0.0], abs=0)
    # The wall just right of the box is hidden by it one second later; the wall left of it is seen still.
    right = int(camera.project(np.array([[0.2, 0.0, 2.0]]))[0, 0])
    assert (occlusion[60, right + 2], occlusion[60, 20], occlusion[60, 80]) == (HIDDEN, SEEN, SEEN)


def test_the_sky_flows_with_the_turn_of_the_camera_and_nothing_has_none() -> None:
    poses = [looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), looking((5.0, 1.0, 0.0), (15.0, 1.0, 0.5))]
    flow, occlusion, camera = truth_of((), (), poses, sky=True)
    turn = poses[1].rotation @ poses[0].rotation.T
    expected = camera.project((turn @ camera.rays(np.array([[80.0, 60.0]])).T).T)[0] - [80, 60]
    assert flow[60, 80] == pytest.approx(expected, abs=0.5 * UNIT_PX)
    assert occlusion[60, 80] == SEEN
    assert occlusion[119, 0] == OUTSIDE
    flow, occlusion, _ = truth_of((white_box((4.0, -1, -1), (4.1, 1, 1)),), (), poses)
    assert np.isnan(flow[0, 0]).all()
    assert occlusion[0, 0] == UNKNOWN


def test_what_comes_behind_the_camera_has_no_flow() -> None:
    poses = [looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), looking((3.0, 0.0, 0.0), (4.0, 0.0, 0.0))]
    flow, occlusion, _ = truth_of((white_box((2.0, -1, -1), (2.1, 1, 1)),), (), poses)
    assert np.isnan(flow[60, 80]).all()
    assert occlusion[60, 80] == UNKNOWN


SIZE = (60, 80)
"""Rows and columns of the images below, and of the wider pinhole's."""
WIDE = (90, 110)
NO_PLANES = np.empty((0, 3))
PINHOLE = Camera(WIDE[1], WIDE[0], 50.0, 51.0, 54.0, 45.5)


def facet_table(corners: np.ndarray, cam_from_world: Pose) -> FacetTable:
    """A table of facets (n, 3, 3) as seen by the pinhole at a pose."""
    none, beyond = np.full(len(corners), -1, dtype=np.int64), np.full((len(corners), 3), -1, dtype=np.int64)
    outlines = np.full((len(corners), 4, 3), np.nan)
    return FacetTable(corners, none, beyond, none, beyond, PINHOLE.K @ cam_from_world.matrix[:3], outlines)


def random_scene(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Pixels that show random facets, a sky or nothing, some of them moving, and random facets in a later image.

    The later camera is at the origin of the world.
    """
    facets = 40
    depths, rows = rng.uniform(1.0, 9.0, SIZE), rng.integers(0, facets, SIZE)
    depths[rng.random(SIZE) < 0.1], depths[rng.random(SIZE) < 0.1] = np.inf, np.nan
    rows[~np.isfinite(depths)] = -1
    seen = np.repeat(np.repeat(rng.integers(-1, facets, (WIDE[0] // 5, WIDE[1] // 5)), 5, axis=0), 5, axis=1)
    motions = np.concatenate(
        [rotation_exp(rng.normal(scale=0.1, size=(4, 3))), rng.normal(scale=1.5, size=(4, 3, 1))], axis=2
    )
    corners = rng.normal(size=(facets, 1, 3)) * [2, 2, 4] + [0, 0, 4] + rng.normal(scale=2.0, size=(facets, 3, 3))
    corners[-1] = [[-9, -9, 0.2], [9, -9, 0.2], [0, 18, 0.2]]  # before all, so that no facet, -1, is not taken for it
    return {
        "depths": depths,
        "rows": rows,
        "mover_of": rng.integers(0, 4, facets),
        "motions": motions,
        "corners": corners,
        "seen": seen,
    }


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("model", "distortion"),
    [("none", ()), ("radtan", (-0.2, 0.05, 1e-3, -1e-3, 0.01)), ("equidistant", (-0.02, 0.01, -0.004, 0.001))],
)
def test_the_kernels_are_the_formulas_on_random_facets(model: str, distortion: tuple[float, ...], seed: int) -> None:
    (height, width), scene = SIZE, random_scene(np.random.default_rng(seed))
    camera = Camera(width, height, 50.0, 51.0, 39.0, 30.5, model, distortion)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    rays, depths, rows = camera.rays(pixels), scene["depths"].reshape(-1), scene["rows"].reshape(-1)
    near = np.isfinite(depths)
    shown = Shown(
        scene["rows"].astype(np.int32), 1 / scene["depths"], NO_PLANES, PINHOLE.project(rays).reshape(*SIZE, 2)
    )
    from_place = np.eye(4)
    from_place[:3, :3] = np.linalg.inv(PINHOLE.K)
    (moving,) = np.nonzero(scene["mover_of"])
    motions = Motions(scene["mover_of"], scene["motions"] @ from_place, moving[[0, -1]] + [0, 1])
    scratch = RowScratch.of(width)

    motion = scene["motions"][np.where(near, scene["mover_of"][rows], 0)]
    points = np.where(near, depths, 1.0)[:, None] * rays
    expected = np.einsum("kij,kj->ki", motion[:, :, :3], points) + np.where(near[:, None], motion[:, :, 3], 0)
    expected[np.isnan(depths)] = np.nan
    ahead = expected[:, 2] > 1e-6 * np.linalg.norm(expected, axis=1)
    aside = ahead & (np.hypot(expected[:, 0], expected[:, 1]) > 1.2 * expected[:, 2])
    doubtful, at = np.empty((len(rays), 3)), np.empty((len(rays), 2), dtype=np.int64)
    count = list_doubtful(shown, motions, 1.2, scratch, doubtful, at)
    assert np.array_equal(at[:count], pixels[aside])
    assert count > 50
    per_depth = expected[aside] / np.where(near[aside], depths[aside], 1.0)[:, None]
    np.testing.assert_allclose(doubtful[:count], per_depth, atol=1e-12)

    never = np.random.default_rng(seed).random(SIZE) < 0.05
    out = FlowTruth(np.empty((height, 1 + 6 * width), np.uint8), np.where(never, UNKNOWN, SEEN).astype(np.uint8))
    lens = Lens(camera_array(camera), np.array([PINHOLE.fx, PINHOLE.fy, PINHOLE.cx, PINHOLE.cy]))
    table = facet_table(scene["corners"], Pose.identity())
    image = scene["seen"].astype(np.int32), np.full(cells(*WIDE), BORDERED, dtype=np.int32)
    flow_rows(shown, motions, lens, image, table, scratch, tuple(out))
    to = np.full((len(rays), 2), np.nan)
    to[ahead] = camera.project(expected[ahead])
    known = ahead & (np.abs(to - pixels) < LARGEST_FLOW_PX).all(axis=1) & ~never.reshape(-1)
    to[~known] = np.nan
    np.testing.assert_allclose(flow_of(out).reshape(-1, 2), to - pixels, rtol=0, atol=0.5 * UNIT_PX + 1e-6)
    inside = known & ((to >= -0.5) & (to <= [width - 0.5, height - 0.5])).all(axis=1)
    occlusion = out.occlusion.reshape(-1)
    for k in np.flatnonzero(inside).tolist():
        u, v = np.floor(PINHOLE.project(expected[k : k + 1])[0]).astype(int)
        before = []
        for column, row in ((u, v), (u + 1, v), (u, v + 1), (u + 1, v + 1)):
            other = scene["seen"][np.clip(row, 0, WIDE[0] - 1), np.clip(column, 0, WIDE[1] - 1)]
            if other >= 0 and other != rows[k]:  # the ray through the place, by shares of the corners (Cramer)
                shares = np.linalg.solve(scene["corners"][other].T, expected[k])
                along = 1 / shares.sum()
                before.append((shares * along >= 0).all() and (along > 0 if not near[k] else 0 < along < 1 - BEFORE))
        assert occlusion[k] == (HIDDEN if any(before) else SEEN), k
    assert (occlusion[known & ~inside] == OUTSIDE).all()
    assert (occlusion[~known] == UNKNOWN).all()
    assert np.bincount(occlusion, minlength=4).min() > 100


@pytest.mark.parametrize(("mover", "moves"), [(4, False), (5, True), (7, True), (8, False), (-1, False)])
def test_what_moves_is_moved_where_it_is_alone_in_its_row(mover: int, moves: bool) -> None:
    """Rows without facets in the range that moves are left out."""
    rows = np.full((1, 40), 2, dtype=np.int32)
    rows[0, 17] = mover
    shown = Shown(rows, np.ones((1, 40)), NO_PLANES, np.empty((1, 0, 2)))
    mover_of = np.array([0, 0, 0, 0, 0, 1, 1, 1, 0])
    still, moved = np.eye(4)[:3], np.eye(4)[:3] + np.array([0, 0, 0, 5.0])
    scratch = RowScratch.of(40)
    carry(shown, Motions(mover_of, np.array([still, moved]), np.array([5, 8])), 0, scratch)
    expected = np.array([np.arange(40.0), np.zeros(40), np.ones(40)])
    expected[:, 17] += 5.0 * moves
    assert np.array_equal(scratch.points, expected)


def test_the_rows_of_normals_are_the_formula_on_random_facets() -> None:
    rng = np.random.default_rng(5)
    scene, pose = random_scene(rng), Pose(rotation_exp(rng.normal(size=(1, 3)))[0], rng.normal(size=3))
    rows = np.repeat(np.repeat(scene["rows"][::4, ::5], 4, axis=0), 5, axis=1)  # runs, in the rows below, too
    rows[rng.random(SIZE) < 0.1] = -1
    out, codes = np.full((SIZE[0], 1 + 6 * SIZE[1]), 99, dtype=np.uint8), np.zeros(len(scene["corners"]) + 1, np.uint64)
    normal_rows(rows.astype(np.int32), scene["corners"], np.ascontiguousarray(pose.matrix[:3]), codes, out)
    assert (out[:, 0] == UP).all()
    unfiltered = np.ascontiguousarray(np.cumsum(out[:, 1:], axis=0, dtype=np.uint8))
    normals = np.cross(*np.moveaxis(np.diff(scene["corners"] @ pose.rotation.T, axis=1), 1, 0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign(np.einsum("ij,ij->i", normals, pose.transform(scene["corners"][:, 0])))[:, None]
    expected = np.rint((normals[rows] + 1) / 2 * 65535)
    expected[rows < 0] = 0
    assert np.array_equal(unfiltered.view(">u2").reshape(*SIZE, 3), expected)


@pytest.mark.parametrize(("model", "distortion"), [("radtan", (-0.28, 0.07, 0.0, 0.0)), ("equidistant", (0.0,) * 4)])
def test_depth_is_that_of_a_face_thinner_than_a_pixel(model: str, distortion: tuple[float, ...]) -> None:
    """The top of a shelf, 2 m deep and a third of a pixel high in the image, before a wall."""
    parts = (white_box((-4.0, 0.0, 0.0), (4.0, 2.0, 1.0)), white_box((-4.0, 2.0, 0.0), (4.0, 2.2, 4.0)))
    camera = Camera(320, 240, 400.0, 400.0, 159.5, 119.5, model, distortion)
    pinhole, lens = render_camera(camera)
    pose = looking((0.0, -6.0, 1.02), (0.0, 0.0, 2.0))  # with the edge where the lens bends it
    with Renderer(parts, FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        truth = SurfaceTruth(renderer, ideal_camera(renderer, camera, pinhole, lens, lambda _: pose))
        depth = truth.geometry(truth.view(0)).depth_m.reshape(-1)
    rays = camera.rays(pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64))
    away = np.linalg.norm(rays, axis=1)
    eye, ways = pose.inverse().translation, rays / away[:, None] @ pose.rotation
    struck = SceneSurfaces(parts, ()).strike(np.tile(eye, (len(ways), 1)), ways, np.zeros(len(ways), dtype=np.int64))
    expected = np.where(np.isfinite(struck.distances_m), struck.distances_m * rays[:, 2] / away, 0.0)
    on_top = np.abs(eye[2] + struck.distances_m * ways[:, 2] - 1.0) < 1e-6
    assert on_top.sum() > 50
    wrong = np.abs(depth - expected) > 1e-3
    assert not wrong.any(), "nor does the wall end beside its end"


def test_a_gap_of_an_alpha_mask_shows_what_lies_behind_it_also_beside_the_mask() -> None:
    """A leaf of slats and gaps, 4 px each in the image, before a wall; their sides may be half a pixel off."""
    wall = white_box((-4.0, 2.0, -1.0), (4.0, 2.2, 4.0))
    slats = np.full((64, 64, 4), 255, dtype=np.uint8)
    slats[:, 32:, 3] = 0
    vertices, triangles, uv = panel((-2.0, 0.0, -1.0), (4.0, 0, 0), (0, 0, 4.0), 4.0)
    leaf = Part(vertices=vertices, triangles=triangles, uv=25 * uv, texture=slats, two_sided=True, instance=2)
    camera = Camera(320, 240, 320.0, 320.0, 159.5, 119.5, "radtan", (-0.2, 0.03, 0.0, 0.0))
    pinhole, lens = render_camera(camera)
    pose = looking((0.0, -6.4, 1.02), (0.0, 0.0, 1.0))
    with Renderer((wall, leaf), FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        truth = SurfaceTruth(renderer, ideal_camera(renderer, camera, pinhole, lens, lambda _: pose))
        found = truth.geometry(truth.view(0))
    rays = camera.rays(pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64)) @ pose.rotation
    eye = pose.inverse().translation
    x, z = (eye[[0, 2], None] - eye[1] * rays[:, [0, 2]].T / rays[:, 1]).reshape(2, *found.instances.shape)
    on = (np.abs(x) < 1.9) & (z > -0.9) & (z < 2.9)
    slat = np.mod(x + 2.0, 0.16) / 0.16  # from 0 to 0.5 on a slat, then a gap
    inner = on & (np.abs(np.mod(slat, 0.5) - 0.25) < 0.17)
    assert inner.sum() > 10_000
    assert ((found.instances[inner] == 2) == (slat[inner] < 0.5)).mean() > 0.998
    assert abs((found.instances[on] == 2).mean() - 0.5) < 0.01, "slats and gaps are of the same width"


NOTHING = 7000.0
"""Inverse depth of the background, 1/m, which no facet has."""


@pytest.mark.parametrize("length", [1, 2, 15, 16, 17, 33, 50])
def test_a_run_ends_where_its_facet_does(length: int) -> None:
    for begin in (0, 3, 20):
        for after in (0, 1, 40):
            facets = [-1] * begin + [2**24 + 5] * length + [5] * after
            assert end_of_run(np.array(facets, dtype=np.int32), begin) == begin + length


@pytest.mark.parametrize("with_lens", [False, True])
def test_a_pixel_shows_the_nearest_facet_around_it_that_its_ray_meets(with_lens: bool) -> None:
    """Without a lens its own first; of random facets, and with some pixels that show another, as if drawn elsewhere."""
    rng = np.random.default_rng(9)
    corners = np.concatenate([rng.normal(size=(30, 3, 2)) * 3, rng.uniform(3, 6, (30, 3, 1))], axis=2)
    table = facet_table(corners, Pose.identity())
    places = np.stack(np.meshgrid(np.arange(WIDE[1]), np.arange(WIDE[0])), axis=-1).astype(float)
    if with_lens:
        places = (places[2:-2, 2:-2] + rng.uniform(-0.5, 0.5, (WIDE[0] - 4, WIDE[1] - 4, 2))).copy()
    plane = np.linalg.inv(corners) @ np.ones((30, 3, 1))  # plane . x = 1

    def met(place: np.ndarray) -> np.ndarray:
        """Inverse depths (30,) at which the ray of a place meets the facets, 0 for none."""
        ray = np.linalg.inv(PINHOLE.K) @ [*place, 1.0]
        shares = np.linalg.solve(np.swapaxes(corners, 1, 2), np.tile(ray, (30, 1))[..., None])[..., 0]
        return np.where((shares >= 0).all(axis=1), (plane[..., 0] @ ray), 0.0)

    seen = np.full(WIDE, -1, dtype=np.int32)
    for v, u in np.ndindex(*WIDE):
        nearness = met(np.array([u, v]))
        seen[v, u] = np.argmax(nearness) if nearness.max() > 0 else -1
    seen[rng.random(WIDE) < 0.02] = 0
    steps = [(0, 0), (1, 0), (0, 1), (1, 1)] if with_lens else [(0, 0), (-1, 0), (1, 0), (0, 1), (0, -1)]
    tried = np.array(steps, dtype=np.int64), 4 if with_lens else 1, np.zeros(30, dtype=np.uint8)
    shown, near = Shown.through_lens(places) if with_lens else Shown.rendered(WIDE, 30), np.empty(places.shape[:2])
    if with_lens:
        trace(seen, places, table, tried, NOTHING, shown.rows, shown.near)
    else:
        trace_centres(seen, table, tried, NOTHING, shown.rows, shown.planes)
    for v in range(len(near)):
        read_near(shown, v, near[v])
    rows = shown.rows
    checked = 0
    for v, u in np.ndindex(*rows.shape):
        place = places[v, u]
        nearness = met(place)
        base = np.floor(place).astype(int)
        around = [seen[min(max(base[1] + y, 0), WIDE[0] - 1), min(max(base[0] + x, 0), WIDE[1] - 1)] for x, y in steps]
        centre = seen[tuple(np.rint(place).astype(int)[::-1])]
        if not with_lens:
            around = [centre] if centre < 0 or nearness[centre] > 0 else around
        found = [k for k in around if k >= 0 and nearness[k] > 0]
        if found:
            best = max(found, key=lambda k: nearness[k])
            assert rows[v, u] == best
            assert near[v, u] == pytest.approx(nearness[best], rel=1e-9)
            checked += best != centre
        else:
            nothing = centre < 0 or (with_lens and min(around) < 0)
            assert rows[v, u] == (-1 if nothing else centre)
            assert (near[v, u] == NOTHING) == nothing
    assert checked > 20
    assert (rows >= 0).sum() > 1000 < (rows < 0).sum()


def test_points_where_the_distortion_folds_over_have_no_flow(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = Camera(160, 120, 130.0, 130.0, 79.5, 59.5, "radtan", (-0.2, 0.0, 1e-3, -1e-3))
    poses = [looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), looking((0.0, 0.0, 0.0), (1.0, 0.9, 0.3))]
    pinhole, lens = render_camera(camera)
    with Renderer((white_box((4.0, -9, -9), (4.1, 9, 9)),), FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        source = ideal_camera(renderer, camera, pinhole, lens, lambda ns: poses[round(ns / 1e9)])
        truth = SurfaceTruth(renderer, source)
        views = truth.view(0), truth.view(10**9)
        found = truth.flow(*views)
        monkeypatch.setattr(truth, "_widest", 0.0)  # every point is projected and undistorted
        expected = truth.flow(*views)
        monkeypatch.setattr(truth, "_widest", np.inf)  # none is
        unaware = truth.flow(*views)
    assert np.array_equal(found.filtered, expected.filtered)
    assert np.array_equal(found.occlusion, expected.occlusion)
    folded = (expected.occlusion == UNKNOWN) & (unaware.occlusion != UNKNOWN)
    assert folded.sum() > 100
    assert (expected.occlusion == SEEN).sum() > 1000


def test_asking_for_them_changes_no_image(sequence: Sequence, tmp_path: Path) -> None:
    generate(replace(SPEC, annotations=()), tmp_path / "plain", content_hash="abc")
    for k in range(len(sequence)):
        name = f"frames/{k:06d}.png"
        assert (tmp_path / "plain" / name).read_bytes() == (sequence.folder / name).read_bytes()
    assert not (tmp_path / "plain" / "flow").exists()
