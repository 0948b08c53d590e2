"""Names and options of textures of OBJ files, as exporters write them."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.model_files.obj.materials import TextureMap, texture_map
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.tracker.images.track_images import load_model
from uavbench.trajectories.errors import UserError

SHADE = 77
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3\n"


def written(folder, line, texture="wall.png", *, library="a.mtl", says="mtllib a.mtl\n", material="w"):
    """An OBJ file of one triangle, its library and its texture; the first piece."""
    for name in (texture, library):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((4, 4, 3), SHADE, np.uint8)).save(folder / texture)
    (folder / library).write_text(f"newmtl other\nKd 1 0 0\nnewmtl {material}\nKd 0.5 0.5 0.5\n{line}\n")
    (folder / "a.obj").write_text(f"{says}{CORNERS}usemtl {material}\n{FACE}")
    return read(folder / "a.obj")[0]


@pytest.mark.parametrize(
    ("line", "texture"),
    [
        ("map_Kd my wall.png", "my wall.png"),
        ("map_Kd my  wall.png  ", "my  wall.png"),
        ("map_Kd -s 1 1 1 wall.png", "wall.png"),
        ("map_Kd -s 1 1 1 -clamp on -bm 0.5 my wall.png", "my wall.png"),
        ("map_Kd -blendu off\t-o 0 my wall.png", "my wall.png"),
        ("map_Kd -mm 0 1 -t 0 0 0 1 2.png", "1 2.png"),
        ('map_Kd "my wall.png"', "my wall.png"),
        ("map_Kd tex\\my wall.png", "tex/my wall.png"),
        ("map_Kd .\\wall.png", "wall.png"),
        ("MAP_KD\twall.png", "wall.png"),
        ("map_Kd wall.png # brick", "wall.png"),
        ("map_Kd C:\\Users\\me\\my wall.png", "my wall.png"),
        ("map_Kd /home/me/wall.png\r", "wall.png"),
        ("map_Kd w#1.png", "w#1.png"),
    ],
)
def test_a_texture_is_found_by_the_name_that_exporters_write(tmp_path, line, texture):
    piece = written(tmp_path, line, texture)
    assert piece.texture is not None and (piece.texture == SHADE).all()
    np.testing.assert_array_equal(piece.uv, [[0, 0], [1, 0], [0, 1]])
    assert {path.name for path in parts_of(tmp_path / "a.obj")} == {"a.mtl", texture.rpartition("/")[2]}


@pytest.mark.parametrize(
    ("says", "library"),
    [
        ("mtllib my lib.mtl\n", "my lib.mtl"),
        ('mtllib "my lib.mtl"\n', "my lib.mtl"),
        ("mtllib .\\a.mtl\r\n", "a.mtl"),
        ("mtllib red.mtl a.mtl\n", "a.mtl"),
        ("mtllib red.mtl\nmtllib a.mtl\n", "a.mtl"),
        ("# mtllib none.mtl\nmtllib a.mtl\n", "a.mtl"),
        ("mtllib sub/a.mtl\n", "sub/a.mtl"),
    ],
)
@pytest.mark.parametrize("material", ["w", "my wall"])
def test_every_library_counts(tmp_path, says, library, material):
    (tmp_path / "red.mtl").write_text("newmtl red\nKd 1 0 0\n")
    piece = written(tmp_path, "map_Kd wall.png", library=library, says=says, material=material)
    assert piece.texture is not None
    named = {path.name for path in parts_of(tmp_path / "a.obj")}
    assert {"wall.png", library.rpartition("/")[2]} <= named


def test_a_texture_beside_its_library_is_found(tmp_path):
    piece = written(tmp_path, "map_Kd wall.png", "sub/wall.png", library="sub/a.mtl", says="mtllib sub/a.mtl\n")
    assert piece.texture is not None
    assert {path.name for path in parts_of(tmp_path / "a.obj")} == {"a.mtl", "wall.png"}


def test_a_texture_is_scaled_and_shifted_as_its_options_say(tmp_path):
    piece = written(tmp_path, "map_Kd -s 2 3 1 -o 0.5 wall.png")
    np.testing.assert_allclose(piece.uv, [[0.5, 0], [2.5, 0], [0.5, 3]])
    assert texture_map("-o 0.25 -1 0 -s 4 a b.png") == TextureMap("a b.png", (4.0, 1.0), (0.25, -1.0))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("map_Kd -mm 0.2 1 wall.png", "the option -mm of its texture wall.png is not supported; bake it"),
        ("map_Kd -t 0.1 0 0 wall.png", "the option -t of its texture wall.png"),
        ("map_Kd -imfchan r wall.png", "the option -imfchan of its texture wall.png"),
        ("map_Kd -clamp on -s 2 2 2 wall.png", "its texture wall.png has -clamp on, and faces that reach beyond it"),
        ("map_Kd -s 1 1 1 no such.png", "refers to no such.png, which is missing"),
        ("map_Kd C:\\tex\\no such.png", r"refers to C:\\tex\\no such.png, which is missing"),
    ],
)
def test_what_cannot_be_drawn_is_told(tmp_path, line, message):
    with pytest.raises(UserError, match=f"a.obj: .*{message}"):
        written(tmp_path, line)


def test_a_missing_one_of_several_libraries_is_named(tmp_path):
    with pytest.raises(UserError, match=r"a.obj: refers to b.mtl, which is missing"):
        written(tmp_path, "map_Kd wall.png", says="mtllib b.mtl a.mtl\n")


@pytest.mark.parametrize("says", ["", "mtllib a.mtl\nusemtl unknown\n"])
def test_texture_coordinates_without_a_material_are_no_fault(tmp_path, says):
    (tmp_path / "a.mtl").write_text("newmtl w\nKd 1 0 0\n")
    faces = "".join(f"f {a}/1 {b}/2 {c}/3\n" for a, b, c in ((1, 3, 2), (1, 2, 4), (2, 3, 4), (1, 4, 3)))
    (tmp_path / "a.obj").write_text(f"{says}{CORNERS}v 0 0 1\n{faces}")
    piece = read(tmp_path / "a.obj")[0]
    assert piece.texture is None and piece.tint is None
    built = MeshFile(path=str(tmp_path / "a.obj")).build(np.random.default_rng(0))
    assert len(built.structure.edges) == 6


@pytest.mark.parametrize("suffix", ["png", "tif", "pgm"])
def test_grey_textures_of_16_bits_have_their_shades(tmp_path, suffix):
    written(tmp_path, f"map_Kd deep.{suffix}", f"deep.{suffix}")
    Image.fromarray(np.full((4, 4), SHADE * 257, np.uint16)).save(tmp_path / f"deep.{suffix}")
    piece = read(tmp_path / "a.obj")[0]
    assert piece.texture is not None and (piece.texture == SHADE).all() and piece.texture.shape == (4, 4, 3)


def test_a_texture_of_floating_point_numbers_is_told(tmp_path):
    written(tmp_path, "map_Kd wall.png")
    header = b"Pf\n2 2\n-1.0\n"
    (tmp_path / "wall.png").write_bytes(header + np.full(4, 0.5, np.float32).tobytes())
    with pytest.raises(UserError, match=r"a\.obj: .* samples of its texture are floating-point numbers"):
        read(tmp_path / "a.obj")


@pytest.mark.parametrize("line", ["Kd 200 100 50", "Kd 0.5 255.0 0"])
def test_a_material_colour_from_0_to_255_is_told(tmp_path, line):
    with pytest.raises(UserError, match=r"a\.obj: the colour in `Kd .*` is beyond 1, .* divide colours from 0 to 255"):
        written(tmp_path, line)


def test_vertex_colours_from_0_to_255_are_told(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0 0 0 0\nv 5 0 0 200 100 50\nv 0 5 0 0 0 0\nf 1 2 3\n")
    with pytest.raises(UserError, match=r"a\.obj: the colour in `v 5 0 0 200 100 50` is beyond 1"):
        read(tmp_path / "a.obj")


@pytest.mark.parametrize("numbers", ["", " 2", " 1 0.5 1", " 1.0 1 0", " 1 0 0 7"])
def test_weights_and_colours_up_to_1_are_read(tmp_path, numbers):
    (tmp_path / "a.obj").write_text(f"v 0 0 9{numbers}\nv 5 0 9{numbers}\nv 0 5 9{numbers}\nf 1 2 3\n")
    assert len(read(tmp_path / "a.obj")[0].triangles) == 1


def test_vertex_colours_of_8_bits_that_are_nearly_black_stay_so(tmp_path):
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = np.tile([1, 1, 0, 255], (8, 1)).astype(np.uint8)
    mesh.export(tmp_path / "dark.ply")
    tint = read(tmp_path / "dark.ply")[0].tint
    assert tint is not None and tint[:, :3].max() < 1e-4


@pytest.mark.parametrize(
    ("face", "told"),
    [
        ("f 1/1 2/2 3/4", "line 10: a face refers to a missing texture coordinate, of which the file has 3; export"),
        ("f 1/1/1 2/2/1 3/10/1", "line 10: a face refers to a missing texture coordinate"),
        ("f\t1/1 \\\n2/2 3/004", "line 10: a face refers to a missing texture coordinate"),
        ("f 1 2 3", "line 10: a face has no texture coordinates, and others of its material my w have; unwrap it, or"),
        ("f 1/1 2 3/3", "line 10: a face has no texture coordinates"),
        ("f 1/1 2//1 3/3", "line 10: a face has no texture coordinates"),
        ("f 1/1 2/2 3/", "line 10: a face has no texture coordinates"),
        ("usemtl bare\nf 1 2 3\nusemtl my  w\nf 1 2 3/3", "line 13: a face has no texture coordinates"),
    ],
)
def test_a_face_without_a_place_in_its_texture_is_told(tmp_path, face, told):
    """The texture had been left out of all faces of its material."""
    written(tmp_path, "map_Kd wall.png", material="my w")
    with (tmp_path / "a.obj").open("a") as file:
        file.write(face + "\n")
    with pytest.raises(UserError, match=f"a.obj: {told}"):
        read(tmp_path / "a.obj")


@pytest.mark.parametrize("count", [1, 3, 9, 10, 19, 99, 120])
def test_all_texture_coordinates_of_a_file_may_be_used(tmp_path, count):
    written(tmp_path, "map_Kd wall.png")
    others = f"f 1/{count}/1 2/0{count}/1 3/1/1\nusemtl other\nf 1/1 2/{count + 1} 3/3\nf 1 2 3\nl 1/{count + 1} 2/1"
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n" + "vt 0.5 1\n" * count
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl w\n{others}\n")
    assert [piece.texture is not None for piece in read(tmp_path / "a.obj")].count(True) == 1
    text = (tmp_path / "a.obj").read_text().replace(f"/{count}/1 ", f"/{count + 1}/1 ", 1)
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(UserError, match=f"a missing texture coordinate, of which the file has {count};"):
        read(tmp_path / "a.obj")


def test_a_texture_of_faces_that_have_no_place_in_it_is_left_out(tmp_path):
    written(tmp_path, "map_Kd wall.png")
    (tmp_path / "a.obj").write_text((tmp_path / "a.obj").read_text().replace(FACE, "f 1 2 3\nf 1//1 2//1 3//1"))
    assert [piece.texture for piece in read(tmp_path / "a.obj")] == [None]


def test_a_structure_without_colours_needs_no_material(tmp_path):
    """The same structure, to the bit, with all materials, without the texture, and without the library."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    faces = "usemtl w\nf 1/1 3/3 2/2\nf 1/1 2/2 4/3\nusemtl other\nf 2/1 3/2 4/3\nf 1 4 3\n"
    written(tmp_path, "map_Kd wall.png", "wall.png")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}{faces}")
    (tmp_path / "a.mtl").write_text("newmtl w\nKd 0.5 0.5 0.5\nnewmtl other\nKd 1 0 0\n")
    model = MeshFile(path=str(tmp_path / "a.obj"), keep_origin=True)
    whole = model.build(np.random.default_rng(0)).structure
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Kd none.png\n")
    without_texture = model.shape()
    (tmp_path / "a.mtl").unlink()
    for shape in (without_texture, model.shape(), load_model(tmp_path / "a.obj")):
        for name in ("vertices", "triangles", "triangle_face", "face_normals", "edges", "edge_faces"):
            np.testing.assert_array_equal(getattr(shape, name), getattr(whole, name))
    with pytest.raises(UserError, match=r"refers to a.mtl, which is missing"):
        model.build(np.random.default_rng(0))
    (tmp_path / "a.obj").write_text(f"mtllib ../a.mtl\n{corners}{faces}")
    with pytest.raises(UserError, match="not in the folder of the model"):
        model.shape()
