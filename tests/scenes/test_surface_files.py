"""Flow, occlusion and normals to half a unit of their files, and to the last pixel of the image."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, flow_codes, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.annotations import write_depth
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT
from uavbench.scenes.dataset.surfaces.normal_kernels import normal_rows
from uavbench.scenes.dataset.surfaces.surface_files import OUTSIDE, SEEN, UNKNOWN, read_flow
from uavbench.scenes.dataset.surfaces.surface_truth import FlowTruth, SurfaceTruth, write_flow, write_normals
from uavbench.scenes.png.filters import UP, filter_rows
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.pose import Array, Pose

FLOW_UNIT_PX = 1 / 64


def facets_of(normals: Array) -> Array:
    """Corners (n, 3, 3) of triangles with normals (n, 3) towards a camera 3 m away; every other one is turned over."""
    across = np.cross(normals, np.where(abs(normals[:, :1]) < 0.6, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    corners = np.stack([0 * across, across, np.cross(normals, across)], axis=1) - 3 * normals[:, None]
    corners[::2] = corners[::2, ::-1]
    return corners


def test_normals_are_rounded_to_units_and_none_is_zero(tmp_path: Path) -> None:
    normals = np.random.default_rng(3).normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:6] = [*np.eye(3), *-np.eye(3)]
    facets = np.arange(600, dtype=np.int32).reshape(20, 30)
    facets[4, 5:9] = -1
    rows, codes = np.empty((20, 181), dtype=np.uint8), np.zeros(601, dtype=np.uint64)
    normal_rows(facets, facets_of(normals), np.eye(4)[:3], codes, rows)
    write_normals(tmp_path, 7, rows)
    bgr = cv2.imread(str(tmp_path / "normals" / "000007.png"), cv2.IMREAD_UNCHANGED)
    exact = (normals.reshape(20, 30, 3) + 1) / 2 * 65535
    assert bgr.dtype == np.uint16
    there = facets >= 0
    assert np.abs(bgr[there][:, ::-1] - exact[there]).max() < 0.5 + 1e-6
    assert not bgr[~there].any()
    assert [bgr[0, k, 2 - k] for k in range(3)] == [65535] * 3
    assert [bgr[0, 3 + k, 2 - k] for k in range(3)] == [0] * 3


def test_rows_of_flow_are_written_as_kitti_reads_them(tmp_path: Path) -> None:
    """u and v, the first byte the higher, then whether they are known."""
    rng = np.random.default_rng(4)
    numbers = rng.integers(0, 65536, (20, 30, 3)).astype(np.uint16)
    numbers[..., 2] = rng.integers(0, 2, (20, 30))
    occlusion = rng.integers(0, 4, (20, 30)).astype(np.uint8)
    filtered = np.empty((20, 181), dtype=np.uint8)
    filter_rows(numbers.astype(">u2").view(np.uint8).reshape(20, -1), 6, UP, filtered)
    write_flow(tmp_path, 2, filtered, occlusion)
    bgr = cv2.imread(str(tmp_path / "flow" / "000002.png"), cv2.IMREAD_UNCHANGED)
    assert bgr.dtype == np.uint16
    np.testing.assert_array_equal(bgr[..., ::-1], numbers)
    read = cv2.imread(str(tmp_path / "occlusion" / "000002.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, occlusion)


def test_depths_are_rounded_to_units_and_none_is_kept_where_it_is_too_large(tmp_path: Path) -> None:
    largest = 65535 * DEPTH_M_PER_UNIT
    depths = np.random.default_rng(6).uniform(0.0, largest, (20, 37)).astype(np.float32)
    depths[3, :4] = [0.0, largest, 1.001 * largest, np.inf]
    write_depth(tmp_path, 5, depths)
    read = cv2.imread(str(tmp_path / "depth" / "000005.png"), cv2.IMREAD_UNCHANGED)
    expected = np.rint(depths / np.float32(DEPTH_M_PER_UNIT))
    expected[3, 2:4] = 0
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, expected)


def moved_by(shift_px: tuple[float, float]) -> FlowTruth:
    """Of a wall straight ahead, 2 m away, seen by a camera that moves aside; all numbers are exact in binary."""
    camera = Camera(64, 48, 128.0, 128.0, 31.5, 23.5)
    aside = np.array([*shift_px, 0.0]) * 2.0 / 128.0
    poses = [Pose.identity(), Pose(np.eye(3), aside)]
    pinhole, lens = render_camera(camera)
    with Renderer((white_box((-4, -4, 2.0), (4, 4, 2.5)),), FLAT_LIGHT, 64, 48) as renderer:
        source = ideal_camera(renderer, camera, pinhole, lens, lambda ns: poses[round(ns / 1e9)])
        truth = SurfaceTruth(renderer, source)
        return truth.flow(truth.view(0), truth.view(10**9))


@pytest.mark.parametrize("shift_px", [(0.0, 0.0), (1 / 64, -1 / 64), (0.011, -0.005), (0.02, -3.4), (510.99, -510.99)])
def test_flow_is_rounded_to_units_of_kitti(shift_px: tuple[float, float], tmp_path: Path) -> None:
    found = moved_by(shift_px)
    codes = flow_codes(found)
    assert (codes == [*(np.rint(64 * np.array(shift_px)) + 32768), 1]).all()
    write_flow(tmp_path, 0, *found)
    read = read_flow(tmp_path / "flow" / "000000.png", tmp_path)
    assert np.abs(read - shift_px).max() <= FLOW_UNIT_PX / 2


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_point_on_the_images_border_is_in_it(axis: int, sign: int) -> None:
    """The image ends half a pixel beyond the centres of its outermost pixels."""
    edge = np.s_[:, 0 if sign < 0 else -1] if axis == 0 else np.s_[0 if sign < 0 else -1, :]
    for further, expected in ((0.0, SEEN), (2.0**-20, OUTSIDE)):
        shift = [0.0, 0.0]
        shift[axis] = sign * (0.5 + further)
        found = moved_by((shift[0], shift[1]))
        assert (flow_codes(found) == [*(np.rint(64 * np.array(shift)) + 32768), 1]).all()
        assert (found.occlusion[edge] == expected).all()
        assert (found.occlusion == expected).sum() >= found.occlusion[edge].size
        inner = found.occlusion[2:-2, 2:-2]
        assert (inner == SEEN).all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_flow_of_511_px_is_not_known_and_its_numbers_are_zero(axis: int, sign: int) -> None:
    for length, known in ((511.0 - 2.0**-10, True), (511.0, False)):
        shift = [0.0, 0.0]
        shift[axis] = sign * length
        found = moved_by((shift[0], shift[1]))
        codes = flow_codes(found)
        assert (codes[..., 2] == known).all()
        assert codes.any() == known
        assert (found.occlusion == (OUTSIDE if known else UNKNOWN)).all()
