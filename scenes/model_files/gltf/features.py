"""What a glTF file uses and its reader leaves out without a word, so that a model would have another shape or look."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from uavbench.trajectories.errors import UserError

SUPPORTED = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", "KHR_lights_punctual",
             "KHR_animation_pointer", "KHR_xmp_json_ld")  # fmt: skip
"""Extensions that a file may require: read, of no effect on surfaces, or checked where they are used."""
LOOKS = "KHR_materials_"
"""Beginning of the names of extensions for gloss, transmission and the like, none of which is drawn."""
GLOSS = "KHR_materials_pbrSpecularGlossiness"
GLOSS_TEXTURES = ("diffuseTexture", "specularGlossinessTexture")
"""Extension of older files in place of metallic and roughness, and its textures, which trimesh converts in part."""
FAN = 6
"""Primitive mode of triangle fans (glTF 2.0, 3.7.2.1)."""
FLOAT, USHORT = 5126, 5123
"""Component types of an accessor (glTF 2.0, 3.6.2.2)."""


class Feature(NamedTuple):
    """What a file uses, and what its author may do instead."""

    used: str
    instead: str


def check_features(path: Path, scene: dict[str, Any]) -> None:
    """UserError for the first feature of a glTF header that is not supported, with what to export in place of it.

    LookupError, TypeError, AttributeError or ValueError for a header that is not as glTF has it.
    """
    for feature in (*_of_the_file(scene), *_of_nodes(scene), *_of_meshes(scene)):
        raise UserError(f"{path}: {feature.used}: not supported; {feature.instead}")


def _of_the_file(scene: dict[str, Any]) -> Iterator[Feature]:
    for name in scene.get("extensionsRequired", []):
        if name not in SUPPORTED and not name.startswith(LOOKS):
            yield Feature(f"requires the extension {name}", "export it without")


def _of_nodes(scene: dict[str, Any]) -> Iterator[Feature]:
    meshes = scene.get("meshes", [])
    for number, node in enumerate(scene.get("nodes", [])):
        place = f"its node {node.get('name', number)}"
        if "camera" in node and ("mesh" in node or node.get("children")):  # trimesh takes it for a camera alone
            yield Feature(f"{place} has a camera beside a mesh or further nodes", "export it without cameras")
        if "mesh" not in node:
            continue
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            yield Feature(f"{place} has instances (EXT_mesh_gpu_instancing)", "export each of them as a node")
        if "skin" in node:
            yield Feature(f"{place} has a skeleton", "apply its pose to the mesh, and export it again")
        if any(node.get("weights", meshes[node["mesh"]].get("weights", []))):
            yield Feature(f"{place} has morph targets with weights", "apply them to the mesh, and export it again")


def _of_meshes(scene: dict[str, Any]) -> Iterator[Feature]:
    materials = scene.get("materials", [])
    for number, mesh in enumerate(scene.get("meshes", [])):
        place = f"its mesh {mesh.get('name', number)}"
        for primitive in mesh["primitives"]:
            which = primitive.get("material")
            material = {} if which is None else materials[which]
            texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            yield from _of_primitive(place, primitive, scene.get("accessors", []), textured=texture is not None)
            if which is None and _is_short(primitive["attributes"].get("COLOR_0"), scene.get("accessors", [])):
                yield Feature(f"{place} has colours of 16 bits", "export them with 8 bits, or as floats")
            gloss = material.get("extensions", {}).get(GLOSS, {})
            if any(key in gloss for key in GLOSS_TEXTURES):
                yield Feature(
                    f"its material {material.get('name', which)} has a texture of {GLOSS}",
                    "export it with metallic and roughness, as `gltf-transform metalrough` does",
                )
            if texture is not None:
                yield from _of_texture(f"its material {material.get('name', which)}", texture)


def _of_primitive(
    place: str, primitive: dict[str, Any], accessors: list[dict[str, Any]], *, textured: bool
) -> Iterator[Feature]:
    attributes = primitive["attributes"]
    if primitive.get("mode") == FAN:
        yield Feature(f"{place} has triangle fans", "export triangles")
    keys = ("POSITION", "TEXCOORD_0") if textured else ("POSITION",)
    read = [accessors[attributes[key]] for key in keys if key in attributes]
    if any(accessor.get("normalized") and accessor["componentType"] != FLOAT for accessor in read):
        yield Feature(f"{place} has normalized integers as coordinates", "export it without quantization")
    indices = [accessors[primitive["indices"]]] if "indices" in primitive else []
    if any("sparse" in accessor for accessor in (*read, *indices)):
        yield Feature(f"{place} has sparse accessors", "export it without them")


def _is_short(index: int | None, accessors: list[dict[str, Any]]) -> bool:
    return index is not None and accessors[index]["componentType"] == USHORT


def _of_texture(place: str, texture: dict[str, Any]) -> Iterator[Feature]:
    moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
    shifted = any(number % 1 for number in moved.get("offset", [0, 0]))  # textures repeat
    if shifted or moved.get("scale", [1, 1]) != [1, 1] or moved.get("rotation", 0):
        yield Feature(f"{place} moves its texture (KHR_texture_transform)", "apply it to the texture coordinates")
    if moved.get("texCoord", texture.get("texCoord", 0)):
        yield Feature(f"{place} has its texture in a second set of texture coordinates", "make them the first")
