from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes import mesh_file
from scenes.mesh_file import MeshFile
from scenes.parts import BuiltStructure
from trajectories.errors import UserError

CUBE_CAO = """V1
# 3D Points
8
0 0 0  # a comment
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
# 3D Lines
0
# Faces from 3D lines
0
# Faces from 3D points
6
4 0 3 2 1
4 4 5 6 7
4 0 1 5 4
4 1 2 6 5
4 2 3 7 6
4 3 0 4 7
# 3D cylinders
0
# 3D circles
0
"""


def built(path: Path, **options: object) -> BuiltStructure:
    return MeshFile(path=str(path), **options).build(np.random.default_rng(0))  # type: ignore[arg-type]


def house() -> trimesh.Trimesh:
    mesh = trimesh.creation.box((4.0, 3.0, 2.0))
    mesh.apply_translation((10.0, 20.0, 30.0))
    return mesh


@pytest.mark.parametrize("kind", ["obj", "stl", "ply", "glb", "gltf", "off"])
def test_every_format_gives_the_same_structure_on_the_ground(tmp_path: Path, kind: str) -> None:
    mesh = house()
    if kind in ("glb", "gltf"):  # glTF is y-up
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    if kind == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / name).write_bytes(data)
        path = tmp_path / "model.gltf"
    else:
        path = tmp_path / f"house.{kind}"
        mesh.export(path)
    structure = built(path).structure
    assert len(structure.edges) == 12
    assert structure.bounds == pytest.approx(np.array([[-2, -1.5, 0], [2, 1.5, 2]]), abs=1e-5)


def test_a_cao_cube_has_twelve_edges_and_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "cube.cao"
    path.write_text(CUBE_CAO)
    structure = built(path, keep_origin=True).structure
    assert len(structure.edges) == 12
    assert structure.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


def test_a_cao_face_may_be_made_of_lines(tmp_path: Path) -> None:
    lines = [(0, 3), (3, 2), (2, 1), (1, 0)]
    text = CUBE_CAO.replace("# 3D Lines\n0", "# 3D Lines\n4\n" + "\n".join(f"{a} {b}" for a, b in lines))
    text = text.replace("lines\n0", "lines\n1\n4 0 1 2 3").replace("points\n6\n4 0 3 2 1", "points\n5")
    path = tmp_path / "cube.cao"
    path.write_text(text)
    assert len(built(path).structure.edges) == 12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("V2\n", "line 1: a CAO model begins with V1"),
        (CUBE_CAO.replace("1 1 0", "1 x 0"), "line 6: expected numbers for the points"),
        (CUBE_CAO[:60], "ends before its points"),
        (CUBE_CAO.replace("cylinders\n0", "cylinders\n2"), "has 2 cylinders"),
        (CUBE_CAO.replace("4 0 3 2 1", "4 0 3 2 99"), "not a simple polygon of existing points"),
    ],
)
def test_a_wrong_cao_file_is_told(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wrong.cao"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        built(path)


def test_an_open_mesh_is_refused_unless_allowed(tmp_path: Path) -> None:
    mesh = house()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.ply")
    with pytest.raises(UserError, match=r"open.ply: the mesh is open: 3 of its edges .* allow_open = true"):
        built(tmp_path / "open.ply")
    assert len(built(tmp_path / "open.ply", allow_open=True).structure.edges) > 0


def test_an_inside_out_mesh_is_refused_and_flip_mends_it(tmp_path: Path) -> None:
    mesh = house()
    mesh.invert()
    mesh.export(tmp_path / "inverted.ply")
    with pytest.raises(UserError, match=r"inside out .* flip = true"):
        built(tmp_path / "inverted.ply")
    assert len(built(tmp_path / "inverted.ply", flip=True).structure.edges) == 12


def test_millimetres_are_noticed_and_unit_mends_it(tmp_path: Path) -> None:
    mesh = house()
    mesh.apply_scale(1000.0)
    mesh.export(tmp_path / "mm.stl")
    with pytest.raises(UserError, match=r'4,000 m large; is it in millimetres\? Then set unit = "mm"'):
        built(tmp_path / "mm.stl")
    structure = built(tmp_path / "mm.stl", unit="mm").structure
    assert structure.bounds == pytest.approx(np.array([[-2, -1.5, 0], [2, 1.5, 2]]), abs=1e-3)


def test_an_empty_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    with pytest.raises(UserError, match=r"no triangles|not a readable"):
        built(tmp_path / "empty.obj")


def test_a_huge_stl_is_refused_by_its_header_alone(tmp_path: Path) -> None:
    count = 10_000_000
    with (tmp_path / "huge.stl").open("wb") as handle:
        handle.write(bytes(80) + count.to_bytes(4, "little"))
        handle.truncate(84 + 50 * count)
    with pytest.raises(UserError, match="10,000,000 triangles are more than the 2,000,000"):
        built(tmp_path / "huge.stl")


def test_a_huge_ply_is_refused_by_its_header_alone(tmp_path: Path) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 5000000\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element face 10000000\nproperty list uchar int vertex_indices\nend_header\n"
    with (tmp_path / "huge.ply").open("wb") as handle:
        handle.write(head.encode())
        handle.truncate(len(head) + 5_000_000 * 12 + 10_000_000 * 13)
    with pytest.raises(UserError, match="10,000,000 triangles are more than the 2,000,000"):
        built(tmp_path / "huge.ply")


def test_a_huge_obj_is_refused_by_a_glance_at_its_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 11)
    monkeypatch.setattr(mesh_file, "check_textures", lambda path: pytest.fail("it was read"))
    house().export(tmp_path / "big.obj")
    with pytest.raises(UserError, match="12 triangles are more than the 11"):
        built(tmp_path / "big.obj")


def test_too_many_triangles_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 11)
    house().export(tmp_path / "big.ply")
    with pytest.raises(UserError, match="simplify the model"):
        built(tmp_path / "big.ply")


def test_a_missing_texture_is_named(tmp_path: Path) -> None:
    house().export(tmp_path / "a.obj")
    text = (tmp_path / "a.obj").read_text()
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + text)
    with pytest.raises(UserError, match=r"a.obj: refers to a.mtl, which is not there"):
        built(tmp_path / "a.obj")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd brick.png\n")
    with pytest.raises(UserError, match=r"a.obj: refers to brick.png"):
        built(tmp_path / "a.obj")


def test_an_unknown_type_and_a_missing_file_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.dwg").write_text("x")
    with pytest.raises(UserError, match=r"cannot read models of type .dwg; known are .obj"):
        built(tmp_path / "a.dwg")
    with pytest.raises(UserError, match="no such model file"):
        built(tmp_path / "none.obj")


def test_crease_angle_and_minimum_edge_choose_the_edges(tmp_path: Path) -> None:
    trimesh.creation.cylinder(radius=1.0, height=2.0, sections=32).export(tmp_path / "c.ply")
    assert len(built(tmp_path / "c.ply").structure.edges) == 64
    assert len(built(tmp_path / "c.ply", crease_angle_deg=5.0).structure.edges) == 96
    assert len(built(tmp_path / "c.ply", crease_angle_deg=5.0, min_edge_m=1.0).structure.edges) == 32
    with pytest.raises(UserError, match="no edge is left"):
        built(tmp_path / "c.ply", min_edge_m=5.0)


def test_texture_and_colour_of_the_file_are_drawn(tmp_path: Path) -> None:
    from PIL import Image

    mesh = house()
    picture = Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8))
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2] / 4, image=picture)
    mesh.export(tmp_path / "textured.glb")
    part = built(tmp_path / "textured.glb", up="z").parts[0]
    assert part.texture is not None
    assert part.texture.shape == (64, 64, 3)
