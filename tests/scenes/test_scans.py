import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.scenes.scanned import CORNERS, fine_box, scanned_box, write_ply
from uavbench.bench.cli.main import main
from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.scans.planar_model import PlanarModel
from uavbench.scenes.scans.roughness import roughness
from uavbench.scenes.scans.scanned_surface import ScannedSurface
from uavbench.scenes.structure import Structure
from uavbench.scenes.structures.registry import STRUCTURES

ROOT = Path(__file__).parent.parent.parent
MODELS = sorted(path for room in ("bench", "docs", "scenes", "tests") for path in (ROOT / room).glob("**/*.obj"))
NOISE_M = 0.001
BOX = scanned_box(NOISE_M)


def corners_of(structure):
    """Ends of the edges, each once, in the order of CORNERS."""
    ends = structure.vertices[np.unique(structure.edges)]
    return ends[np.linalg.norm(ends - CORNERS[:, None], axis=2).argmin(axis=1)]


def test_a_noisy_box_with_round_borders_has_its_twelve_edges_where_they_are_by_the_noise():
    model = PlanarModel.of(*BOX)
    structure = model.structure()
    assert (len(structure.edges), len(structure.face_normals), model.planes) == (12, 6, 6)
    assert np.abs(corners_of(structure) - CORNERS).max() < 1.5 * NOISE_M
    assert 0.5 * NOISE_M < model.noise_m < 1.5 * NOISE_M
    assert model.left_out == 0.0


@pytest.mark.parametrize("noise_m", [0.001, 0.003])
def test_noise_that_neighbours_share_is_measured_to_a_factor_of_two(noise_m):
    assert 0.5 * noise_m < ScannedSurface.of(*scanned_box(noise_m, seed=3)).noise_m < 2 * noise_m


def test_an_exact_box_has_its_exact_edges():
    structure = PlanarModel.of(*fine_box()).structure()
    assert len(structure.edges) == 12
    assert np.abs(corners_of(structure) - CORNERS).max() < 1e-7


def test_edges_turn_and_grow_with_the_scan():
    vertices, triangles = BOX
    q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    turn = q * np.sign(np.linalg.det(q))
    moved = PlanarModel.of(7.0 * vertices @ turn.T + [30.0, -20.0, 4.0], triangles).structure()
    back = (moved.vertices - [30.0, -20.0, 4.0]) @ turn / 7.0
    still = PlanarModel.of(vertices, triangles).structure()
    assert len(moved.edges) == len(still.edges) == 12
    assert np.linalg.norm(corners_of(still)[:, None] - back, axis=2).min(axis=1).max() < 0.1 * NOISE_M


def test_the_same_scan_gives_the_same_numbers():
    one, other = PlanarModel.of(*BOX), PlanarModel.of(*BOX)
    assert one.vertices.tobytes() == other.vertices.tobytes()
    assert one.triangles.tobytes() == other.triangles.tobytes()


def test_holes_within_a_plane_and_floating_bits_make_no_edges():
    vertices, triangles = BOX
    middle = vertices[triangles].mean(axis=1)
    hole = np.linalg.norm(middle - [0.2, 0.03, 0.15], axis=1) < 0.03
    bit = np.random.default_rng(2).uniform(0.3, 0.33, (4, 3))
    scan = (
        np.concatenate([vertices, bit]),
        np.concatenate([triangles[~hole], len(vertices) + np.array([[0, 1, 2], [0, 2, 3]])]),
    )
    structure = PlanarModel.of(*scan).structure()
    assert len(structure.edges) == 12
    assert np.abs(corners_of(structure) - CORNERS).max() < 1.5 * NOISE_M


def test_a_scan_without_its_bottom_has_the_straight_border_at_which_it_ends():
    vertices, triangles = BOX
    low = (vertices[triangles][:, :, 2] < 0.03).any(axis=1)
    structure = PlanarModel.of(vertices, triangles[~low]).structure()
    border = structure.edge_faces[:, 0] < 0
    assert (~border).sum() == 8
    heights = structure.edge_segments[border][:, :, 2]
    assert np.abs(heights - 0.03).max() < 0.005 + 1.5 * NOISE_M  # a square of the scan, and the noise
    length = np.linalg.norm(np.diff(structure.edge_segments[border], axis=1), axis=2)
    assert abs(length.sum() - 1.4) < 0.02


def test_what_has_no_plane_is_refused(tmp_path):
    scan = write_ply(tmp_path / "few.ply", *fine_box(0.1))
    done = CliRunner().invoke(main, ["planes", str(scan), "--out", str(tmp_path / "model.obj")])
    assert done.exit_code == 2
    assert f"{scan}: no plane is found in it" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["few.ply"]


def test_the_command_writes_a_model_that_a_suite_reads_and_a_picture(tmp_path):
    vertices, triangles = BOX
    scan, out = write_ply(tmp_path / "scan.ply", 1000 * vertices, triangles), tmp_path / "model.obj"
    done = CliRunner().invoke(main, ["planes", str(scan), "--unit", "mm", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "6 planes with 12 edges" in done.stdout
    assert "doubt:" not in done.stderr
    done = CliRunner().invoke(main, ["planes", str(scan), "--out", str(tmp_path / "large.obj")])
    assert re.search(r"doubt: the model is \d{3,4}(\.\d)? m large: is the scan in millimetres\?", done.stderr)
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        structure = MeshFile(str(out), keep_origin=True).shape()
    assert len(structure.edges) == 12
    assert np.abs(corners_of(structure) - CORNERS).max() < 1.5 * NOISE_M


def test_another_suffix_than_that_of_obj_is_refused(tmp_path):
    done = CliRunner().invoke(main, ["planes", "scan.ply", "--out", str(tmp_path / "model.ply")])
    assert done.exit_code == 2
    assert "the model is written as OBJ; name a file such as model.obj" in done.stderr


@pytest.mark.parametrize("crease_angle_deg", [15.0, 40.0])
def test_a_scan_that_is_read_as_it_is_is_told_as_noise(tmp_path, crease_angle_deg):
    scan = write_ply(tmp_path / "scan.ply", *BOX)
    with pytest.warns(
        UserWarning,
        match=r"scan.ply: \d+ % of its edges of 1. degrees or more are noise, as of a scan: .* uavbench planes ",
    ):
        MeshFile(str(scan), crease_angle_deg=crease_angle_deg).shape()


def curved(n=90):
    """A wavy sheet of n * n squares, which turn by up to 4 degrees, with a step of a few rows in it."""
    x, y = np.meshgrid(np.linspace(0, 3, n), np.linspace(0, 3, n), indexing="ij")
    z = 0.1 * np.sin(2 * x) * np.cos(2 * y) + 0.3 * (x > 1.5)
    a = np.arange(n * n).reshape(n, n)
    squares = np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, :-1], a[1:, 1:], a[:-1, 1:]], axis=-1)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), squares.reshape(-1, 3)


def test_no_model_without_noise_is_told_as_noise():
    kinds = [kind for name, kind in STRUCTURES.items() if name != "mesh"]
    models = [kind().unpainted().structure for kind in kinds]
    models += [Structure.from_mesh(*mesh) for mesh in (fine_box(0.01), curved())]
    assert [roughness(model.vertices, model.triangles, 15.0).share for model in models] == [0.0] * len(models)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_no_model_of_the_repository_is_told_as_noise(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MeshFile(str(path), allow_open=True).shape()
