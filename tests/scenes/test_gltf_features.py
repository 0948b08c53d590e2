"""What a glTF file uses is read as glTF has it, or the file is refused; nothing is left out without a word."""

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.trajectories.errors import UserError

CORNERS = np.array([(x, y, z) for z in (0, 2) for x, y in ((0, 0), (3, 0), (3, 1), (0, 1))])
QUADS = [(3, 2, 1, 0), (4, 5, 6, 7), *((k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4))]
TRIANGLES = np.array([corners for a, b, c, d in QUADS for corners in ((a, b, c), (a, c, d))])
Change = Callable[[dict[str, Any]], dict[str, Any]]
KINDS = {"f4": 5126, "i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123}


def header(*, points: Any = CORNERS, kind: str = "f4", normalized: bool = False, **node: Any) -> dict[str, Any]:
    """A closed box of 3 x 1 x 2 as a glTF header, its positions as numbers of a kind, padded to four bytes."""
    numbers = np.asarray(points).astype("<" + kind)
    pad = -numbers.itemsize * 3 % 4 // numbers.itemsize
    rows = np.pad(numbers, ((0, 0), (0, pad))).tobytes()
    data = rows + TRIANGLES.astype("<u2").tobytes()
    position = {"bufferView": 0, "componentType": KINDS[kind], "count": 8, "type": "VEC3", "normalized": normalized}
    views = [{"buffer": 0, "byteLength": len(rows), "byteStride": len(rows) // 8},
             {"buffer": 0, "byteOffset": len(rows), "byteLength": TRIANGLES.size * 2}]  # fmt: skip
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0, "name": "hut", **node}],
        "meshes": [{"name": "box", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [position, {"bufferView": 1, "componentType": 5123, "count": TRIANGLES.size, "type": "SCALAR"}],
        "bufferViews": views,
        "buffers": [
            {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
    }


def written(path: Path, head: dict[str, Any]) -> Path:
    path.write_text(json.dumps(head))
    return path


@pytest.mark.parametrize(
    ("head", "extent"),
    [
        (header(), (3, 1, 2)),
        (header(scale=[-1, 1, 1]), (3, 1, 2)),
        (header(scale=[2, 1, 1], rotation=[0, 0, 0.5**0.5, 0.5**0.5]), (1, 6, 2)),
        (header(matrix=[0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]), (1, 3, 2)),
        (header(points=CORNERS * 1000, kind="u2", scale=[0.001, 0.001, 0.001]), (3, 1, 2)),
        (header(points=CORNERS * 20, kind="i1", scale=[0.05, 0.05, 0.05]), (3, 1, 2)),
    ],
    ids=["plain", "mirrored", "turned", "matrix", "ushort", "byte"],
)
def test_a_box_has_its_size_however_its_node_places_it(
    tmp_path: Path, head: dict[str, Any], extent: tuple[int, ...]
) -> None:
    structure = MeshFile(path=str(written(tmp_path / "a.gltf", head)), up="z").build(np.random.default_rng(0)).structure
    assert np.ptp(structure.vertices, axis=0) == pytest.approx(extent)
    assert len(structure.edges) == 12


def changed(**keys: Any) -> Change:
    return lambda head: {**head, **keys}


def with_primitive(**keys: Any) -> Change:
    def change(head: dict[str, Any]) -> dict[str, Any]:
        head["meshes"][0]["primitives"][0].update(keys)
        return head

    return change


def with_texture(*, drawn: bool = True, **keys: Any) -> Change:
    """The box with a material of a grey image; drawn: whether the box has this material."""
    grey = base64.b64encode(cv2.imencode(".png", np.full((2, 2, 3), 128, np.uint8))[1].tobytes()).decode()

    def change(head: dict[str, Any]) -> dict[str, Any]:
        head["meshes"][0]["primitives"][0].update({"material": 0} if drawn else {})
        return head | {
            "materials": [{"name": "brick", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **keys}}}],
            "textures": [{"source": 0}],
            "images": [{"uri": "data:image/png;base64," + grey}],
        }

    return change


def with_attribute(name: str, kind: str, columns: int, *, normalized: bool, then: Change = dict) -> Change:
    """The box with zeros as another attribute of its vertices; then: a further change."""

    def change(head: dict[str, Any]) -> dict[str, Any]:
        head["meshes"][0]["primitives"][0]["attributes"][name] = len(head["accessors"])
        of = {"componentType": KINDS[kind], "type": f"VEC{columns}", "count": 8, "normalized": normalized}
        head["accessors"].append(of)
        return then(head)

    return change


def with_colours(rgb: Any, *, then: Change = dict) -> Change:
    """The box with a colour of its own at each corner, floats; then: a further change."""

    def change(head: dict[str, Any]) -> dict[str, Any]:
        data = np.asarray(rgb, dtype="<f4").tobytes()
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        head = with_attribute("COLOR_0", "f4", 3, normalized=False)(head)
        head["accessors"][-1]["bufferView"] = len(head["bufferViews"])
        head["bufferViews"].append({"buffer": len(head["buffers"]), "byteLength": len(data)})
        head["buffers"].append({"byteLength": len(data), "uri": uri})
        return then(head)

    return change


def with_factor(head: dict[str, Any]) -> dict[str, Any]:
    """The box with a material of one colour."""
    head["meshes"][0]["primitives"][0]["material"] = 0
    return head | {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.2, 0.6, 1.0]}}]}


SHADES = np.linspace(0.2, 1.0, 8)[:, None] * [1.0, 0.5, 0.0]


@pytest.mark.parametrize(
    ("then", "factor"),
    [(dict, 1.0), (with_factor, [1.0, 0.2, 0.6]), (with_texture(), 1.0)],
    ids=["alone", "of a material", "of a texture"],
)
def test_colours_at_corners_are_parts_of_light_and_multiply_those_of_the_material(
    tmp_path: Path, then: Change, factor: Any
) -> None:
    """As glTF 2.0, 3.9.2 says; they had been decoded as sRGB, and left out where the box has a material."""
    (piece,) = read(written(tmp_path / "a.gltf", with_colours(SHADES, then=then)(header())))
    assert piece.tint is not None
    np.testing.assert_allclose(piece.tint[:, :3], SHADES * factor, atol=0.005)  # a factor is rounded to 8 bits


def test_white_corners_change_no_look(tmp_path: Path) -> None:
    (piece,) = read(written(tmp_path / "a.gltf", with_colours(np.ones((8, 3)), then=with_factor)(header())))
    assert piece.tint is not None
    np.testing.assert_allclose(piece.tint, [[1.0, 0.2, 0.6, 1.0]], atol=0.005)


def with_sparse(head: dict[str, Any]) -> dict[str, Any]:
    head["accessors"][0]["sparse"] = {"count": 1}
    return head


def with_gloss(head: dict[str, Any]) -> dict[str, Any]:
    """The box with a material of the older extension, whose colours are in a texture."""
    head = with_texture()(head)
    gloss = {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}
    return head | {"materials": [{"name": "brick", "extensions": gloss}]}


def with_camera_on(head: dict[str, Any]) -> dict[str, Any]:
    """The box beside another one, on whose node a camera is."""
    view = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    nodes = [{"mesh": 0}, {"mesh": 0, "camera": 0, "translation": [9, 0, 0]}]
    return head | {"cameras": [view], "nodes": nodes, "scenes": [{"nodes": [0, 1]}]}


def with_weights(head: dict[str, Any]) -> dict[str, Any]:
    head["meshes"][0]["weights"] = [0.0, 1.0]
    return head


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda _: header(points=CORNERS * 40, kind="i1", normalized=True), "mesh box has normalized integers as coor"),
        (lambda _: header(points=CORNERS * 9999, kind="i2", normalized=True, scale=[3, 3, 3]), "without quantization"),
        (with_primitive(mode=6), "its mesh box has triangle fans: not supported; export triangles"),
        (with_sparse, "its mesh box has sparse accessors: not supported"),
        (with_weights, "its node hut has morph targets with weights: not supported; apply them"),
        (lambda _: header(skin=0), "its node hut has a skeleton: not supported; apply its pose"),
        (lambda _: header(extensions={"EXT_mesh_gpu_instancing": {}}), "its node hut has instances"),
        (changed(extensionsRequired=["VENDOR_shape"]), "requires the extension VENDOR_shape: not supported; export it"),
        (with_texture(texCoord=1), "its material brick has its texture in a second set of texture coordinates"),
        (
            with_texture(extensions={"KHR_texture_transform": {"scale": [2, 2]}}),
            "its material brick moves its texture .KHR_texture_transform.: not supported; apply it to the texture coor",
        ),
        (
            with_attribute("TEXCOORD_0", "u2", 2, normalized=True, then=with_texture()),
            "mesh box has normalized integers as coordinates",
        ),
        (with_attribute("COLOR_0", "u2", 4, normalized=True), "mesh box has colours of 16 bits: not supported; export"),
        (with_gloss, "its material brick has a texture of KHR_materials_pbrSpecularGlossiness: not supported; export"),
        (with_camera_on, "its node 1 has a camera beside a mesh or further nodes: not supported; export it without"),
    ],
    ids=[
        "byte",
        "short",
        "fans",
        "sparse",
        "morphed",
        "skinned",
        "instances",
        "extension",
        "texcoord",
        "transform",
        "normalized uv",
        "colours",
        "gloss",
        "camera",
    ],
)
def test_what_would_be_left_out_is_refused_by_its_name(tmp_path: Path, change: Change, told: str) -> None:
    with pytest.raises(UserError, match=rf"a\.gltf: .*{told}"):
        read(written(tmp_path / "a.gltf", change(header())))


@pytest.mark.parametrize(
    "change",
    [
        changed(extensionsRequired=["KHR_materials_unlit", "KHR_mesh_quantization"]),
        changed(extensionsRequired=["KHR_animation_pointer", "KHR_xmp_json_ld"]),
        with_texture(extensions={"KHR_texture_transform": {"offset": [0, 0], "scale": [1.0, 1.0], "rotation": 0.0}}),
        with_texture(extensions={"KHR_texture_transform": {"offset": [0.0, -1.0]}}),
        with_texture(drawn=False, texCoord=1),
        lambda _: header(normalized=True),
        with_attribute("TEXCOORD_0", "u2", 2, normalized=True),
        with_attribute("TEXCOORD_1", "u2", 2, normalized=True, then=with_texture()),
        with_attribute("COLOR_0", "u1", 4, normalized=True),
        with_attribute("COLOR_0", "u2", 4, normalized=True, then=with_texture()),
    ],
)
def test_what_changes_nothing_that_is_drawn_is_accepted(tmp_path: Path, change: Change) -> None:
    (piece,) = read(written(tmp_path / "a.gltf", change(header())))
    assert len(piece.triangles) == 12
