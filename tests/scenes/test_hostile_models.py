"""Models made to fill the memory, to never end, or to be read from elsewhere are refused, and quickly."""

import base64
import json
import os
import struct
import zlib

import numpy as np
import pytest
import trimesh

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.trajectories.errors import UserError

BOX = trimesh.creation.box((1, 2, 3))
NUMBERS = BOX.vertices.astype("<f4").tobytes() + BOX.faces.astype("<u2").tobytes()
NAN = struct.pack("<16f", *[np.nan] * 16)


def uri(data):
    return f"data:;base64,{base64.b64encode(data).decode()}"


def gltf(**changed):
    """A box, as JSON."""
    model = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [accessor(0, 5126, 8, "VEC3"), accessor(1, 5123, 36, "SCALAR")],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"byteLength": len(NUMBERS), "uri": uri(NUMBERS)}],
    }
    return model | changed


def accessor(view, component, count, kind):
    return {"bufferView": view, "componentType": component, "count": count, "type": kind}


def glb(model):
    text = json.dumps(model).encode()
    text += b" " * (-len(text) % 4)
    return b"glTF" + struct.pack("<IIII", 2, 0xFFFFFFFF, len(text), 0x4E4F534A) + text


def png(width, height, pixels):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def textured(image, uv=bytes(64)):
    """The box with a texture."""
    model = gltf(
        images=[{"uri": "data:image/png;base64," + base64.b64encode(image).decode()}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        buffers=[{"byteLength": 168, "uri": uri(NUMBERS)}, {"byteLength": 64, "uri": uri(uv)}],
    )
    model["bufferViews"].append({"buffer": 1, "byteLength": 64})
    model["accessors"].append(accessor(2, 5126, 8, "VEC2"))
    model["meshes"][0]["primitives"][0] |= {"material": 0}
    model["meshes"][0]["primitives"][0]["attributes"] |= {"TEXCOORD_0": 2}
    return model


WHOLE = png(4, 4, bytes(4 * 13))
ZEROS = {"componentType": 5126, "count": 5_900_000, "type": "MAT4"}
"""An accessor without bytes: as many zeros as it says."""
HOSTILE = [
    (gltf(accessors=[*gltf()["accessors"], *[ZEROS] * 40]), "accessors claim more values"),
    (gltf(accessors=[accessor(0, 5126, -8, "VEC3"), gltf()["accessors"][1]]), "accessors claim more values"),
    (gltf(materials=[{}] * 3000), "3,000 materials"),
    (textured(png(2000, 2000, b"abc")), "texture or colour is damaged"),
    (textured(WHOLE, NAN), "texture coordinates or colours are not finite"),
]


@pytest.mark.parametrize("model", [gltf(), textured(WHOLE)])
def test_the_models_are_good_as_they_are(tmp_path, model):
    (tmp_path / "a.gltf").write_text(json.dumps(model))
    assert len(read(tmp_path / "a.gltf")[0].triangles) == 12


@pytest.mark.parametrize(("model", "told"), HOSTILE)
def test_a_hostile_gltf_is_refused(tmp_path, model, told):
    (tmp_path / "a.gltf").write_text(json.dumps(model))
    with pytest.raises(UserError, match=told):
        read(tmp_path / "a.gltf")


def test_a_glb_of_millions_of_empty_chunks_is_refused(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb(gltf()))
    read(tmp_path / "a.glb")
    (tmp_path / "a.glb").write_bytes(glb(gltf()) + bytes(50_000_000))
    with pytest.raises(UserError, match="more than 16 chunks"):
        read(tmp_path / "a.glb")


@pytest.mark.parametrize("corner", ["-1", "1e300"])
def test_a_face_of_a_missing_vertex_before_the_first_is_refused(tmp_path, corner):
    text = BOX.export(file_type="ply", encoding="ascii").decode()
    rows = text.splitlines()
    rows[-1] = f"3 0 1 {corner}"
    (tmp_path / "a.ply").write_text("\n".join(rows) + "\n")
    with pytest.raises(UserError, match=r"missing vertex|not a readable"):
        MeshFile(str(tmp_path / "a.ply"), allow_open=True).build(np.random.default_rng(0))


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def test_a_name_of_any_length_is_a_missing_file(tmp_path):
    (tmp_path / "a.obj").write_text(f"mtllib {'x' * 10_000}\n{CORNERS}f 1 2 3\n")
    with pytest.raises(UserError, match="which is missing"):
        read(tmp_path / "a.obj")
    assert parts_of(tmp_path / "a.obj") == ()


def test_materials_are_looked_at_once_however_often_they_are_named(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n" * 1000)
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" * 100_000 + CORNERS + "f 1 2 3\n")
    assert len(read(tmp_path / "a.obj")) == 1
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd t.png\n" * 50_000)
    with pytest.raises(UserError, match="50,000 materials"):
        read(tmp_path / "a.obj")


def test_a_reference_of_many_words_has_few_interpretations(tmp_path, monkeypatch):
    """Options and their numbers come before a name, which may have blanks."""
    (tmp_path / "a b.png").write_bytes(WHOLE)
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n")
    (tmp_path / "a.mtl").write_text("".join(f"map_Kd {k} {'1 ' * 2000}a b.png\n" for k in range(10)))
    asked = []
    real = os.stat
    monkeypatch.setattr(os, "stat", lambda path, **more: asked.append(path) or real(path, **more))
    assert {path.name for path in parts_of(tmp_path / "a.obj")} == {"a.mtl", "a b.png"}
    assert len(asked) < 5000


@pytest.mark.parametrize("kind", ["obj", "cao", "gltf"])
@pytest.mark.parametrize("way", ["absolute", "up", "link"])
def test_no_file_elsewhere_is_opened_for_the_hash(tmp_path, kind, way, monkeypatch):
    """Such as /proc/kmsg, which is a regular file and is read without end."""
    folder, elsewhere = tmp_path / "model", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    (elsewhere / "a.mtl").write_text("newmtl a\n")
    (folder / "link.mtl").symlink_to(elsewhere / "a.mtl")
    name = {"absolute": str(elsewhere / "a.mtl"), "up": "../elsewhere/a.mtl", "link": "link.mtl"}[way]
    form = {"obj": "mtllib {}\n", "cao": 'V1\nload("{}")\n', "gltf": '{{"buffers": [{{"uri": "{}"}}]}}'}[kind]
    (folder / f"a.{kind}").write_text(form.format(name))
    assert parts_of(folder / f"a.{kind}") == ()


def test_a_model_with_a_hole_fills_no_memory_for_its_hash(tmp_path):
    with (tmp_path / "a.obj").open("wb") as file:
        file.truncate(1 << 42)
    assert parts_of(tmp_path / "a.obj") == ()
