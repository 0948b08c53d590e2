import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.generate import generate
from uavbench.scenes.model_files import face_limits, mesh_checks
from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.model_files.obj.faces import with_triangles
from uavbench.scenes.renderables import BuiltStructure
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.registry import PATHS
from uavbench.trajectories.simulation.flight import FlightSpec

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
        (CUBE_CAO.replace("cylinders\n0", "cylinders\n2"), "ends before its cylinders"),
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


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
@pytest.mark.parametrize("again", [[0], [0, 5, 5], range(12)])
def test_triangles_that_are_there_twice_do_not_open_a_mesh(tmp_path: Path, again: list[int], kind: str) -> None:
    """In each format, of a few triangles as of all; what is missing all the same is counted without the copies."""
    mesh = house()
    for name, kept in (("closed", mesh.faces), ("open", mesh.faces[:-1])):
        faces = np.concatenate([kept, np.roll(kept[[k % len(kept) for k in again]], 1, axis=1)])
        trimesh.Trimesh(mesh.vertices, faces, process=False).export(tmp_path / f"{name}.{kind}")
    assert len(built(tmp_path / f"closed.{kind}").structure.edges) == 12
    with pytest.raises(UserError, match="the mesh is open: 3 of its edges"):
        built(tmp_path / f"open.{kind}")
    found = built(tmp_path / f"open.{kind}", allow_open=True)
    assert len(found.structure.edges) == 13 and len(found.structure.triangles) == 11


@pytest.mark.parametrize("seed", range(3))
def test_triangles_that_face_the_other_way_make_no_edges(tmp_path: Path, seed: int) -> None:
    """Of a closed model as of an open one, and what is drawn faces outwards, too."""
    mesh = house().subdivide()
    turned = np.random.default_rng(seed).random(len(mesh.faces)) < 0.3
    for name, kept in {"closed": np.full(len(mesh.faces), True), "open": mesh.face_normals[:, 2] > -0.5}.items():
        faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)[kept]
        trimesh.Trimesh(mesh.vertices, faces, process=False).export(tmp_path / f"{name}.ply")
        found = built(tmp_path / f"{name}.ply", allow_open=name == "open")
        assert len(found.structure.edges) == 12
        centre = found.structure.vertices.mean(axis=0)
        assert (np.einsum("fi,fi->f", found.structure.face_normals, found.structure.face_points - centre) > 0).all()
        (part,) = found.parts
        drawn = trimesh.Trimesh(part.vertices, part.triangles, process=False)
        assert (np.einsum("fi,fi->f", drawn.face_normals, drawn.triangles_center - centre) > 0).all()


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
    for module in (face_limits, mesh_checks):
        monkeypatch.setattr(module, "MOST_TRIANGLES", 11)
    monkeypatch.setattr(mesh_checks, "_obj_wants", lambda path: pytest.fail("it was read"))
    house().export(tmp_path / "big.obj")
    with pytest.raises(UserError, match="12 triangles are more than the 11"):
        built(tmp_path / "big.obj")


def test_too_many_triangles_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(face_limits, "MOST_TRIANGLES", 11)
    house().export(tmp_path / "big.ply")
    with pytest.raises(UserError, match="simplify the model"):
        built(tmp_path / "big.ply")


def test_a_missing_texture_is_named(tmp_path: Path) -> None:
    house().export(tmp_path / "a.obj")
    text = (tmp_path / "a.obj").read_text()
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + text)
    with pytest.raises(UserError, match=r"a.obj: refers to a.mtl, which is missing"):
        built(tmp_path / "a.obj")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd brick.png\n")
    with pytest.raises(UserError, match=r"a.obj: refers to brick.png"):
        built(tmp_path / "a.obj")


def changed_glb(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """A small GLB with its JSON changed."""
    data = trimesh.exchange.gltf.export_glb(model_of_several_nodes())
    size = int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20 : 20 + size])
    change(scene)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = data[:8] + (20 + len(text) + len(rest)).to_bytes(4, "little") + len(text).to_bytes(4, "little")
    path.write_bytes(head + b"JSON" + text + rest)
    return path


def outside_image(scene: dict[str, Any]) -> None:
    scene["images"][0] = {"uri": "old%20wall.png"}


def with_image_of_another_view(scene: dict[str, Any]) -> None:
    scene["images"][0]["bufferView"] = scene["accessors"][0]["bufferView"]


def with_image_as_text(scene: dict[str, Any]) -> None:
    scene["images"][0] = {"name": "wall", "uri": "data:image/ktx2;base64,q0tUWCAyMLsNChoK"}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (outside_image, r"a.glb: refers to old wall.png, which is missing"),
        (
            with_image_of_another_view,
            r"a.glb: its image 0 \(image/png\) is damaged, too large, or not one of PNG",
        ),
        (with_image_as_text, r"a.glb: its image 0 \(wall\) is damaged, too large, or not one of"),
        (lambda scene: scene["images"][0].update(bufferView=99), "not a readable glb file"),
        (
            lambda scene: scene.update(extensionsRequired=["KHR_draco_mesh_compression"]),
            "compressed with KHR_draco_mesh_compression; export it without compression",
        ),
        (lambda scene: scene.update(meshes=[], nodes=[{}], scenes=[{"nodes": [0]}]), "has no triangles"),
        (lambda scene: scene.update(buffers=7), "not a readable glb file"),
    ],
)
def test_a_glb_that_cannot_be_drawn_is_told(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str
) -> None:
    with pytest.raises(UserError, match=told):
        built(changed_glb(tmp_path / "a.glb", change))


@pytest.mark.parametrize(
    ("nodes", "primitives", "told"),
    [
        ([{"children": [1], "mesh": 0}, {"children": [0], "mesh": 0}], 1, "in a circle"),
        (99, 1, ""),
        (100, 1, "nested deeper than 100 levels"),
        (119_999, 1, "120,001 nodes and pieces are more than"),
        ([{"mesh": 0}], 30_000, "30,001 nodes and pieces are more than"),
        ([{"children": [*range(1, 201)]}] + [{"mesh": 0}] * 200, 200, "40,201 nodes and pieces are more than"),
    ],
)
def test_too_many_nodes_or_levels_or_a_circle_of_them_are_told(
    tmp_path: Path, nodes: list[dict[str, Any]] | int, primitives: int, told: str
) -> None:
    """Of nodes, or of so many levels of them."""
    if isinstance(nodes, int):
        nodes = [*({"children": [k + 1]} for k in range(nodes)), {"mesh": 0}]
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(house())).items():
        (tmp_path / name).write_bytes(data)
    path = tmp_path / "model.gltf"
    model = json.loads(path.read_text())
    model["meshes"][0]["primitives"] *= primitives
    path.write_text(json.dumps({**model, "nodes": nodes}))
    if told:
        with pytest.raises(UserError, match=rf"model\.gltf: .*{told}"):
            built(path)
    else:
        assert len(built(path).structure.edges) == 12


def test_an_obj_of_too_many_materials_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    path.write_text(corners + "".join(f"o part{k}\nusemtl paint{k}\nf 1 2 3\n" for k in range(30_000)))
    with pytest.raises(UserError, match=r"a\.obj: 30,000 materials are more than the 2,000"):
        built(path)
    path.write_text(corners + "".join(f"usemtl\\\npaint{k}\nf 1 2 3\n" for k in range(2_001)))
    with pytest.raises(UserError, match="2,001 materials"):
        built(path)
    path.write_text(corners + "".join(f"o part{k}\nusemtl paint{k % 2}\nf 1 2 3\n" for k in range(30_000)))
    assert len(read(path)) == 2


def test_an_unknown_type_and_a_missing_file_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.dwg").write_text("x")
    with pytest.raises(UserError, match=r"cannot read models of type .dwg; supported: .obj"):
        built(tmp_path / "a.dwg")
    with pytest.raises(UserError, match="no such file"):
        built(tmp_path / "none.obj")


def test_crease_angle_and_minimum_edge_choose_the_edges(tmp_path: Path) -> None:
    trimesh.creation.cylinder(radius=1.0, height=2.0, sections=32).export(tmp_path / "c.ply")
    assert len(built(tmp_path / "c.ply").structure.edges) == 64
    assert len(built(tmp_path / "c.ply", crease_angle_deg=5.0).structure.edges) == 96
    assert len(built(tmp_path / "c.ply", crease_angle_deg=5.0, min_edge_m=1.0).structure.edges) == 32
    with pytest.raises(UserError, match="no edge is left"):
        built(tmp_path / "c.ply", min_edge_m=5.0)


def picture(size: int = 64) -> Image.Image:
    return Image.fromarray(np.random.default_rng(0).integers(0, 255, (size, size, 3)).astype(np.uint8))


def model_of_several_nodes(scale: float = 1.0) -> trimesh.Scene:
    """A y-up scene as a modelling program leaves it: nodes with transforms, one mesh used twice, three materials."""
    pbr = trimesh.visual.material.PBRMaterial
    walls, tower = trimesh.creation.box((6.0, 3.0, 4.0)), trimesh.creation.box((1.0, 5.0, 1.0))
    walls.visual = trimesh.visual.TextureVisuals(
        uv=walls.vertices[:, :2] / 3, material=pbr(name="bricks", baseColorTexture=picture())
    )
    tower.visual = trimesh.visual.TextureVisuals(material=pbr(name="paint", baseColorFactor=[255, 0, 0, 255]))
    scene, at = trimesh.Scene(), trimesh.transformations.translation_matrix
    big = trimesh.transformations.scale_matrix(scale)
    scene.add_geometry(walls, node_name="walls", transform=big @ at((50.0, 1.5, -20.0)))
    scene.add_geometry(tower, geom_name="tower", node_name="left", transform=big @ at((46.5, 2.5, -20.0)))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene.add_geometry(tower, geom_name="tower", node_name="right", transform=big @ at((53.5, 2.5, -20.0)) @ mirror)
    return scene


def test_a_glb_of_several_nodes_stands_upright_with_its_textures_and_colours(tmp_path: Path) -> None:
    model_of_several_nodes().export(tmp_path / "hall.glb")
    thing = built(tmp_path / "hall.glb")
    assert thing.structure.bounds == pytest.approx(np.array([[-4, -2, 0], [4, 2, 5]]), abs=1e-5)
    assert len(thing.structure.edges) == 3 * 12
    walls = next(part for part in thing.parts if len(part.vertices) < 36 and part.tint is None)
    assert walls.texture is not None
    assert np.array_equal(walls.texture, np.asarray(picture()))
    reds = [part for part in thing.parts if part is not walls]
    assert len(reds) == 2
    for part in reds:
        assert part.tint is not None
        assert part.tint[:, :3] == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(part.tint), 1)))


def test_a_glb_in_millimetres_is_noticed_and_mended(tmp_path: Path) -> None:
    model_of_several_nodes(1000.0).export(tmp_path / "hall.glb")
    with pytest.raises(UserError, match=r'8,000 m large; is it in millimetres\? Then set unit = "mm"'):
        built(tmp_path / "hall.glb")
    bounds = built(tmp_path / "hall.glb", unit="mm").structure.bounds
    assert bounds == pytest.approx(np.array([[-4, -2, 0], [4, 2, 5]]), abs=1e-3)


def test_vertex_colours_are_kept_and_an_open_model_is_drawn_from_both_sides(tmp_path: Path) -> None:
    mesh = house()
    mesh.update_faces(mesh.face_normals[:, 1] > -0.5)
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.tile([0, 0, 255, 255], (len(mesh.vertices), 1)))
    trimesh.Scene(mesh).export(tmp_path / "shed.glb")
    (part,) = built(tmp_path / "shed.glb", allow_open=True).parts
    assert part.two_sided
    assert part.tint is not None
    assert part.tint[:, :3] == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(part.tint), 1)))


def test_an_obj_keeps_its_texture_and_a_model_without_a_look_is_covered(tmp_path: Path) -> None:
    mesh = house()
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2] / 4, image=picture())
    mesh.export(tmp_path / "house.obj")
    (part,) = built(tmp_path / "house.obj").parts
    assert part.tint is None
    assert np.array_equal(part.texture, np.asarray(picture()))
    house().export(tmp_path / "bare.ply")
    (bare,) = built(tmp_path / "bare.ply", surface="brick").parts
    assert bare.texture is not None
    assert bare.texture.shape[0] > 1000


def test_a_textured_glb_goes_from_file_to_sequence(tmp_path: Path) -> None:
    """The model is drawn where its edges are said to be, in its own colours."""
    model_of_several_nodes().export(tmp_path / "hall.glb")
    spec = SequenceSpec(
        name="hall",
        seed=1,
        structure=MeshFile(path=str(tmp_path / "hall.glb")),
        environment=Outdoor(sun_azimuth_deg=30.0, cloudiness=0.2),
        flight=FlightSpec(path=PATHS["orbit"](distance_m=6.0, height_m=3.0, turns=0.02, speed_m_s=1.0)),
        camera=CameraSpec(width=160, height=120),
        rate_hz=1.0,
        annotations=("mask",),
    )
    generate(spec, tmp_path / "hall", content_hash="x")
    sequence = Sequence.load(tmp_path / "hall")
    image = sequence.image(0).astype(float)
    mask = cv2.imread(str(tmp_path / "hall" / "mask" / "000000.png"), cv2.IMREAD_GRAYSCALE) == 1
    assert 0.05 < mask.mean() < 0.6
    red = image[..., 2] > 2 * image[..., :2].max(axis=2)
    assert red[mask].mean() > 0.1
    assert image[mask & ~red].std() > 15


@pytest.mark.parametrize("content", [None, b"\x89PNG\r\n\x1a\n"], ids=["missing", "damaged"])
def test_a_texture_that_cannot_be_read_is_told_without_a_traceback(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: bytes | None
) -> None:
    """What is logged goes to stderr, where nothing else is set up."""
    header = "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in "xyzst") + "element face 1\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(header + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    if content is not None:
        (tmp_path / "skin.png").write_bytes(content)
    with pytest.raises(UserError, match=r"a\.ply: refers to skin\.png: .*put it next to the model or export it again"):
        built(tmp_path / "a.ply", allow_open=True)
    assert caplog.text == ""


CUBE = "".join(f"v {x} {y} {z}\n" for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
CUBE_FACES = "f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 7 8\n"
FLAT = {
    "a corner twice": "f 1 1 2\n",
    "one corner": "f 1 1 1\n",
    "a line": "v 0.5 0 0\nf 1 2 9\n",
    "two corners in one place": "v 0 0 0\nf 1 9 2\n",
    "too small for a number": "v 0.5 0 1e-320\nf 1 2 9\n",
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("library", ["", "mtllib a.mtl\nusemtl red\n"])
@pytest.mark.parametrize("flat", FLAT)
def test_triangles_without_area_are_left_out(tmp_path, flat, library):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "a.obj").write_text(f"{CUBE}{library}{CUBE_FACES}{FLAT[flat]}")
    built = MeshFile(path=str(tmp_path / "a.obj"), allow_open=True).build(np.random.default_rng(0))
    assert len(built.structure.edges) == 12 and len(built.structure.face_normals) == 6
    (part,) = built.parts
    assert len(part.triangles) == 12
    assert np.isfinite(part.normals).all() and np.isfinite(part.uv).all()
    assert part.tint is None or len(part.tint) == len(part.vertices)


def test_a_mesh_of_nothing_but_triangles_without_area_is_refused(tmp_path):
    (tmp_path / "a.obj").write_text(f"{CUBE}f 1 1 2\nf 2 3 2\nf 7 7 7\n")
    with pytest.raises(
        UserError, match=r"a\.obj: cannot find the faces of this mesh: none of its triangles has an area"
    ):
        MeshFile(path=str(tmp_path / "a.obj"), allow_open=True).build(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        ("v 0.5 0.5 1\n", "f 5 6 7\nf 5 9 8\nf 9 7 8\nf 5 7 9\n"),
        ("v 0.25 0.25 1\nv 0.75 0.75 1\n", "f 5 6 7\nf 5 9 8\nf 9 10 8\nf 10 7 8\nf 5 10 9\nf 5 7 10\n"),
        ("v 0.25 0.25 1\nv 0.75 0.75 1\n", "f 5 6 7\nf 5 9 8\nf 9 10 8\nf 10 7 8\nf 5 7 9\nf 9 7 10\n"),
    ],
)
def test_a_triangle_without_area_that_closes_a_t_junction_leaves_no_edge(tmp_path, points, faces):
    """The diagonal of the cube's top is one side of the triangle below it, and several of those above."""
    sides = CUBE_FACES.rpartition("f 5")[0]
    (tmp_path / "a.obj").write_text(f"{CUBE}{points}{sides}{faces}")
    structure = MeshFile(path=str(tmp_path / "a.obj")).build(np.random.default_rng(0)).structure
    assert len(structure.edges) == 12 and len(structure.face_normals) == 6


def with_an_opening(path: Path, *, corners: str = "1 2 3 4 5 6 7 8") -> Path:
    """A slab, 1 m deep and open at the back, whose front is one concave face around a doorway."""
    outline = [(0, 0), (1, 0), (1, 2), (2, 2), (2, 0), (3, 0), (3, 3), (0, 3)]
    points = [(x, y, z) for y in (0, 1) for x, z in outline]
    sides = [(k + 1, k + 9, (k + 1) % 8 + 9, (k + 1) % 8 + 1) for k in range(8)]
    rows = [f"v {x} {y} {z}" for x, y, z in points] + ["f " + " ".join(map(str, side)) for side in sides]
    path.write_text("\n".join([*rows, f"f {corners}"]) + "\n")
    return path


@pytest.mark.parametrize(
    "corners", ["1 2 3 4 5 6 7 8", "-16 -15 -14 -13 -12 -11 -10 -9", "3// 4// 5// 6// 7// 8// 1// 2//"]
)
def test_a_concave_face_does_not_cover_its_opening(tmp_path: Path, corners: str) -> None:
    structure = built(
        with_an_opening(tmp_path / "door.obj", corners=corners), keep_origin=True, allow_open=True
    ).structure
    front = structure.vertices[structure.triangles]
    front = front[(front[..., 1] == 0.0).all(axis=1)]
    area = np.linalg.norm(np.cross(front[:, 1] - front[:, 0], front[:, 2] - front[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(3 * 3 - 1 * 2)
    assert len(structure.edges) == 24  # 8 around the front, as many at the back, 8 between them


def in_format(obj: Path, kind: str, front: list[int] | None = None) -> Path:
    """The model of an OBJ file as a text of another format, its faces as they are, or with another last one."""
    rows = [line.split() for line in obj.read_text().splitlines()]
    points = [row[1:] for row in rows if row[0] == "v"]
    faces = [[int(word) - 1 for word in row[1:]] for row in rows if row[0] == "f"]
    faces = faces if front is None else [*faces[:-1], front]
    head = f"OFF # of a doorway\n\n{len(points)} {len(faces)} 0\n"
    if kind == ".ply":
        axes = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{axes}element face {len(faces)}\n"
        head += "property list uchar int vertex_indices\nend_header\n"
    lines = [*points, *[[len(face), *face] for face in faces]]
    path = obj.with_suffix(kind)
    path.write_text(head + "\n".join(" ".join(map(str, line)) for line in lines) + "\n")
    return path


@pytest.mark.parametrize("kind", [".ply", ".off"])
def test_a_concave_face_of_other_formats_does_not_cover_its_opening_either(tmp_path: Path, kind: str) -> None:
    obj = with_an_opening(tmp_path / "door.obj")
    one, other = (built(path, keep_origin=True, allow_open=True).structure for path in (obj, in_format(obj, kind)))
    assert len(other.edges) == len(one.edges) == 24
    assert len(other.triangles) == len(one.triangles)
    with pytest.raises(UserError, match=r"(face 9|line 28): this face is not a simple polygon; export triangles"):
        read(in_format(obj, kind, [2, 4, 0, 7, 5, 1, 6, 3]))


@pytest.mark.parametrize("begins", ["OFF\n4 2 0", "\n# by a program\n\nOFF\n4 2 0", "\ufeffOFF\n4 2 0", "OFF 4 2 0"])
def test_an_off_file_may_begin_with_empty_lines_and_comments(tmp_path: Path, begins: str) -> None:
    text = f"{begins}\n0 0 0\n2 0 0\n0.5 0.5 0\n0 2 0\n4 1 2 3 0\n2 0 1\n"
    (tmp_path / "arrow.off").write_text(text, encoding="utf-8")
    (piece,) = read(tmp_path / "arrow.off")
    assert len(piece.triangles) == 2


def test_a_face_of_two_corners_beside_a_concave_one_is_left_out(tmp_path: Path) -> None:
    path = in_format(with_an_opening(tmp_path / "door.obj"), ".ply")
    (whole,) = read(path)
    text = path.read_text().splitlines()
    number = next(i for i, line in enumerate(text) if line.startswith("element face"))
    text[number] = f"element face {int(text[number].split()[-1]) + 1}"
    path.write_text("\n".join([*text, "2 0 1"]) + "\n")
    (piece,) = read(path)
    np.testing.assert_array_equal(piece.triangles, whole.triangles)


def test_a_concave_face_of_a_binary_ply_file_is_cut_at_its_outline(tmp_path: Path) -> None:
    corners = np.array([(0, 0, 0), (2, 0, 0), (0.5, 0.5, 0), (0, 2, 0)], dtype="<f4")
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    head += b"property float x\nproperty float y\nproperty float z\nelement face 1\n"
    head += b"property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "arrow.ply").write_bytes(head + corners.tobytes() + struct.pack("<B4i", 4, 1, 2, 3, 0))
    (piece,) = read(tmp_path / "arrow.ply")
    a, b, c = (piece.vertices[piece.triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2] == pytest.approx([1.0, 1.0])


def test_a_face_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    path = with_an_opening(tmp_path / "crossed.obj", corners="3 5 1 8 6 2 7 4")
    with pytest.raises(UserError, match=r"line 25: this face is not a simple polygon; export triangles"):
        read(path)


def test_convex_faces_are_left_as_they_are(tmp_path: Path) -> None:
    data = (
        b"v 0 0 0\r\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0 0\nf 1/1 5/2 2/3 3/4 4/5 # with a corner on a side\nf 1 2 3 9"
    )
    assert with_triangles(tmp_path / "flat.obj", data) is data


def test_an_obj_file_with_a_byte_order_mark_has_all_its_vertices(tmp_path):
    plain, marked = (tmp_path / name for name in ("plain.obj", "marked.obj"))
    box = trimesh.creation.box((0.4, 0.3, 0.2))
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces.tolist()]
    plain.write_text("\n".join(lines), encoding="utf-8")
    marked.write_text("\n".join(lines), encoding="utf-8-sig")
    one, other = (MeshFile(path=str(path)).build(np.random.default_rng(0)).structure for path in (plain, marked))
    assert one.vertices.tobytes() == other.vertices.tobytes()


def test_bytes_behind_the_last_triangle_of_a_binary_stl_file_are_padding(tmp_path: Path) -> None:
    """trimesh takes such a file for text, which it is not: a model without triangles."""
    whole = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="stl")
    for count in (0, 2, 49):
        (tmp_path / "padded.stl").write_bytes(whole + bytes(count))
        assert len(built(tmp_path / "padded.stl").structure.edges) == 12


def test_a_truncated_binary_stl_file_is_told(tmp_path):
    whole = b"by a scanner".ljust(80, b"\0") + (12).to_bytes(4, "little") + bytes(12 * 50)
    (tmp_path / "half.stl").write_bytes(whole[:-70])
    with pytest.raises(
        UserError, match=r"half.stl: is truncated: its header counts 12 triangles, and it holds 10; copy it"
    ):
        MeshFile(path=str(tmp_path / "half.stl")).build(np.random.default_rng(0))


UTM_M = (448_123.37, 5_411_234.71, 312.2)
"""Easting, northing and height of a building."""


def boxed_at(place: Path, shift: tuple[float, float, float]) -> Path:
    """A box of 2.123 by 3.217 by 4.031 m at a place, in a file of its suffix."""
    mesh = trimesh.creation.box((2.123, 3.217, 4.031))
    mesh.apply_translation(shift)
    mesh.export(place)
    return place


@pytest.mark.parametrize("suffix", ["stl", "ply", "glb"])
def test_a_model_whose_file_rounds_it_far_from_the_origin_is_told(tmp_path: Path, suffix: str) -> None:
    far = boxed_at(tmp_path / f"far.{suffix}", UTM_M)
    with pytest.raises(UserError, match=rf"far.{suffix}: .* 5,411,236 units, that numbers of 32 bits .* round .* 0.5"):
        built(far)
    near = built(boxed_at(tmp_path / f"near.{suffix}", (300.0, -200.0, 40.0)))
    assert sorted(np.ptp(near.structure.vertices, axis=0)) == pytest.approx([2.123, 3.217, 4.031], abs=1e-3)


def test_a_model_far_from_the_origin_whose_file_holds_all_digits_is_read(tmp_path: Path) -> None:
    far = built(boxed_at(tmp_path / "far.obj", UTM_M))
    assert np.ptp(far.structure.vertices, axis=0) == pytest.approx([2.123, 3.217, 4.031], abs=1e-6)
    with pytest.raises(UserError, match="keep_origin = true leaves the model 5,411 km from the origin"):
        built(tmp_path / "far.obj", keep_origin=True)
