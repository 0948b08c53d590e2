"""Flow, occlusion and normals to the last unit of their files, and to the last pixel of the image."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.surfaces.surface_files import OUTSIDE, SEEN
from uavbench.scenes.dataset.surfaces.surface_truth import FlowTruth, SurfaceTruth, write_flow, write_normals
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.pose import Pose


def test_normals_are_rounded_to_units_and_none_is_zero(tmp_path: Path) -> None:
    normals = np.random.default_rng(3).normal(size=(20, 30, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    normals[0, :6] = [*np.eye(3), *-np.eye(3)]
    normals[4, 5:9] = np.nan
    write_normals(tmp_path, 7, normals)
    bgr = cv2.imread(str(tmp_path / "normals" / "000007.png"), cv2.IMREAD_UNCHANGED)
    expected = np.rint(np.nan_to_num((normals + 1) / 2 * 65535, nan=0.0)).astype(int)
    assert bgr.dtype == np.uint16
    np.testing.assert_array_equal(bgr[..., ::-1], expected)
    assert bgr[0, 0].tolist() == [32768, 32768, 65535] and bgr[0, 3].tolist() == [32768, 32768, 0]


def test_flow_is_rounded_to_units_of_kitti_and_what_is_not_known_is_zero(tmp_path: Path) -> None:
    flow = np.random.default_rng(4).uniform(-511, 511, (20, 30, 2))
    flow[0, :4] = [[0, 0], [510.99, -510.99], [1 / 64, -1 / 64], [0.011, -0.005]]
    flow[4, 5:9] = np.nan
    occlusion = np.random.default_rng(5).integers(0, 4, (20, 30)).astype(np.uint8)
    write_flow(tmp_path, 2, flow, occlusion)
    bgr = cv2.imread(str(tmp_path / "flow" / "000002.png"), cv2.IMREAD_UNCHANGED)
    known = np.isfinite(flow[..., 0])
    assert bgr.dtype == np.uint16
    np.testing.assert_array_equal(bgr[..., 0], known)
    np.testing.assert_array_equal(bgr[known][:, 2:0:-1], np.rint(64 * flow[known]) + 32768)
    assert not bgr[~known].any()
    read = cv2.imread(str(tmp_path / "occlusion" / "000002.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, occlusion)


def moved_by(shift_px: tuple[float, float]) -> tuple[FlowTruth, Camera]:
    """Of a wall straight ahead, 2 m away, seen by a camera that moves aside; all numbers are exact in binary."""
    camera = Camera(64, 48, 128.0, 128.0, 31.5, 23.5)
    aside = np.array([*shift_px, 0.0]) * 2.0 / 128.0
    poses = [Pose.identity(), Pose(np.eye(3), aside)]
    pinhole, lens = render_camera(camera)
    with Renderer((white_box((-4, -4, 2.0), (4, 4, 2.5)),), FLAT_LIGHT, 64, 48) as renderer:
        source = ideal_camera(renderer, camera, pinhole, lens, lambda ns: poses[round(ns / 1e9)])
        truth = SurfaceTruth(renderer, source)
        return truth.flow(truth.view(0), truth.view(10**9)), camera


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_point_on_the_images_border_is_in_it(axis: int, sign: int) -> None:
    """The image ends half a pixel beyond the centres of its outermost pixels."""
    edge = np.s_[:, 0 if sign < 0 else -1] if axis == 0 else np.s_[0 if sign < 0 else -1, :]
    for further, expected in ((0.0, SEEN), (2.0**-20, OUTSIDE)):
        shift = [0.0, 0.0]
        shift[axis] = sign * (0.5 + further)
        found, camera = moved_by((shift[0], shift[1]))
        np.testing.assert_allclose(found.flow, np.broadcast_to(shift, (camera.height, camera.width, 2)), atol=1e-12)
        assert (found.occlusion[edge] == expected).all()
        assert (found.occlusion == expected).sum() >= found.occlusion[edge].size
        inner = found.occlusion[2:-2, 2:-2]
        assert (inner == SEEN).all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_flow_of_511_px_is_not_known(axis: int, sign: int) -> None:
    for length, known in ((511.0 - 2.0**-10, True), (511.0, False)):
        shift = [0.0, 0.0]
        shift[axis] = sign * length
        assert np.isfinite(moved_by((shift[0], shift[1]))[0].flow).all() == known
