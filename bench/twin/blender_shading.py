"""Shaders of Blender's scene: materials with their water and dirt, haze, clouds before the lamp, and the sky.

Runs inside Blender, as `blender_script.py` does, and imports nothing but Blender's own modules.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import bpy
from mathutils import Vector


class Nodes:
    """The node tree of a shader; each node is created, linked and configured in one call."""

    def __init__(self, owner: Any) -> None:
        owner.use_nodes = True
        self._tree = owner.node_tree
        self._tree.nodes.clear()

    def add(self, kind: str, *inputs: Any, output: int | str = 0, **settings: Any) -> Any:
        """Output socket of a new node; each input is a value, the socket of another node, or None for its default."""
        node = self._tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for k, value in enumerate(inputs):
            self.wire(node.inputs[k], value)
        return node.outputs[output] if node.outputs else node

    def wire(self, socket: Any, value: Any) -> None:
        """Set an input to a value, or link it to the output of another node."""
        if isinstance(value, bpy.types.NodeSocket):
            self._tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value

    def times(self, a: Any, b: Any) -> Any:
        """Product of two colours."""
        return self.add("VectorMath", a, b, operation="MULTIPLY")

    def mixed(self, share: Any, a: Any, b: Any) -> Any:
        """Linear interpolation from colour a to colour b by a share from 0 to 1."""
        return self.add("MixRGB", share, a, b)

    def math(self, operation: str, *numbers: Any) -> Any:
        """Result of a scalar operation."""
        return self.add("Math", *numbers, operation=operation)

    def dot(self, a: Any, b: Any) -> Any:
        """Dot product of two vectors."""
        return self.add("VectorMath", a, b, operation="DOT_PRODUCT", output="Value")

    def place(self) -> Any:
        """The point of the surface in the world."""
        return self.add("NewGeometry", output="Position")

    def image(self, path: Path, kind: str, at: Any = None) -> Any:
        """Node of an image file, its codes as they are; at: texture coordinates, None for the part's own."""
        node = self._tree.nodes.new(f"ShaderNode{kind}")
        node.image = bpy.data.images.load(str(path), check_existing=True)
        node.image.colorspace_settings.name = "Non-Color"
        node.image.alpha_mode = "CHANNEL_PACKED"
        self.wire(node.inputs["Vector"], at)
        return node


def material(folder: Path, about: dict[str, Any], scene: dict[str, Any]) -> Any:
    """Material of a part: albedo as texture times dirt and tint, water, roughness, cutouts, and haze in front of it."""
    made = bpy.data.materials.new(about["name"])
    nodes = Nodes(made)
    albedo, holes = (1.0, 1.0, 1.0), None
    water: Any = None
    if about["texture"]:
        image = nodes.image(folder / about["texture"], "TexImage")
        albedo = nodes.times(image.outputs["Color"], image.outputs["Color"])
        if about["cutout"]:
            holes = nodes.math("GREATER_THAN", image.outputs["Alpha"], 0.5)
    if about["film"]:
        water = nodes.image(folder / about["film"], "TexImage", nodes.times(nodes.place(), (about["film_per_m"],) * 3))
        albedo = nodes.mixed(
            nodes.add("SeparateXYZ", water.outputs["Color"], output="X"), albedo, wet(nodes, albedo, scene)
        )
    if about["soil"]:
        soil = nodes.image(folder / about["soil"], "TexImage", nodes.add("UVMap", uv_map="soil_uv"))
        albedo = nodes.times(albedo, soil.outputs["Color"])
    if "tint" in about["arrays"]:
        albedo = nodes.times(albedo, nodes.add("Attribute", attribute_name="tint"))
    surface = nodes.add("BsdfPrincipled")
    nodes.wire(surface.node.inputs["Base Color"], albedo if not isinstance(albedo, tuple) else (*albedo, 1.0))
    nodes.wire(surface.node.inputs["Roughness"], about["roughness"])
    if about["stands"]:
        surface = flooded(nodes, surface, nodes.add("SeparateXYZ", water.outputs["Color"], output="Y"), scene)
    if scene["haze_per_m"] > 0:
        surface = hazy(nodes, surface, scene)
    if holes is not None:
        surface = nodes.add("MixShader", holes, nodes.add("BsdfTransparent"), surface)
    nodes.add("OutputMaterial", surface)
    if hasattr(made, "cycles") and hasattr(made.cycles, "sample_as_light"):
        made.cycles.sample_as_light = False  # haze does not illuminate
    if hasattr(made.cycles, "emission_sampling"):
        made.cycles.emission_sampling = "NONE"
    return made


def wet(nodes: Nodes, albedo: Any, scene: dict[str, Any]) -> Any:
    """The albedo of a wet surface from that of the dry one, as in the renderer's shader (Lekner & Dorf 1988)."""
    left = nodes.add("VectorMath", (1.0,) * 3, nodes.times(albedo, (scene["wet_inner"],) * 3), operation="SUBTRACT")
    return nodes.add("VectorMath", nodes.times(albedo, (scene["wet_gain"],) * 3), left, operation="DIVIDE")


def flooded(nodes: Nodes, surface: Any, share: Any, scene: dict[str, Any]) -> Any:
    """The surface with standing water, a level mirror, on a share of it where it lies at z = 0.

    Light that a diffuse surface scattered is not mirrored: a few such paths would carry the sun as specks.
    """
    up = nodes.add("CombineXYZ", 0.0, 0.0, 1.0)
    level = nodes.math("COMPARE", nodes.add("SeparateXYZ", nodes.place(), output="Z"), 0.0, 0.05)
    seen = nodes.math("SUBTRACT", 1.0, nodes.add("LightPath", output="Is Diffuse Ray"))
    reflected = nodes.math(
        "MULTIPLY", nodes.add("Fresnel", scene["water_index"], up), nodes.math("MULTIPLY", level, seen)
    )
    mirror = nodes.add("BsdfPrincipled")
    for name, value in (("Base Color", (1.0,) * 4), ("Metallic", 1.0), ("Roughness", 0.0), ("Normal", up)):
        nodes.wire(mirror.node.inputs[name], value)
    return nodes.add("MixShader", nodes.math("MULTIPLY", share, reflected), surface, mirror)


def hazy(nodes: Nodes, surface: Any, scene: dict[str, Any]) -> Any:
    """The surface seen through haze: attenuated by exp(-haze * distance) for camera rays only."""
    away = nodes.add("CameraData", output="View Distance")
    clear = nodes.math("EXPONENT", nodes.math("MULTIPLY", away, -scene["haze_per_m"]))
    seen = nodes.add("LightPath", output="Is Camera Ray")
    share = nodes.math("MULTIPLY", seen, nodes.math("SUBTRACT", 1.0, clear))
    return nodes.add("MixShader", share, surface, nodes.add("Emission", (*scene["haze_color"], 1.0), 1.0))


class Clouds(NamedTuple):
    """Material that lets the lamp's light through as clouds do, and the input that shifts them."""

    material: Any
    shift: Any


def clouds(folder: Path, scene: dict[str, Any]) -> Clouds:
    """Clouds on a pane between the scene and the lamp; light from other directions passes.

    The length of a ray to the lamp leads from the pane back to the lit point, whose place among the clouds counts: so
    edges of their shadows are as in uavbench's renderer.
    """
    made = bpy.data.materials.new("clouds")
    nodes = Nodes(made)
    back = nodes.add("NewGeometry", output="Incoming")
    way = nodes.add("VectorMath", back, operation="SCALE")
    nodes.wire(way.node.inputs["Scale"], nodes.add("LightPath", output="Ray Length"))
    lit = nodes.add("VectorMath", nodes.place(), way, operation="ADD")
    u, v = (nodes.dot(lit, axis) for axis in scene["clouds"]["axes_per_m"])
    at = nodes.add("VectorMath", nodes.add("CombineXYZ", u, v, 0.0), operation="ADD")
    passing = nodes.image(folder / scene["clouds"]["texture"], "TexImage", at).outputs["Color"]
    to_lamp = Vector(scene["to_lamp"]).normalized()
    beside = math.cos(2 * math.atan(scene["lamp_radius"]) + 0.002)
    sunny = nodes.math("GREATER_THAN", nodes.dot(back, tuple(-to_lamp)), beside)
    nodes.add("OutputMaterial", nodes.add("BsdfTransparent", nodes.mixed(sunny, (1.0,) * 4, passing)))
    return Clouds(made, at.node.inputs[1])


def build_world(folder: Path, scene: dict[str, Any]) -> None:
    """Light from the upper and the lower hemisphere; camera and mirrors see the panorama, or black."""
    world = bpy.data.worlds.new("world")
    nodes = Nodes(world)
    ray = nodes.add("SeparateXYZ", nodes.add("TexCoord", output="Generated"), output="Z")
    above, seen = (*scene["above"], 1.0), (0.0, 0.0, 0.0, 1.0)
    if "sky" in scene:
        codes = nodes.image(folder / scene["sky"], "TexEnvironment").outputs["Color"]
        seen = nodes.times(codes, codes)
        above = nodes.times(seen, scene["sky_gain"])
    light = nodes.mixed(nodes.math("GREATER_THAN", ray, 0.0), (*scene["below"], 1.0), above)
    looks = nodes.math("MAXIMUM", *(nodes.add("LightPath", output=f"Is {ray} Ray") for ray in ("Camera", "Singular")))
    color = nodes.mixed(looks, light, seen)
    nodes.add("OutputWorld", nodes.add("Background", color, 1.0))
    bpy.context.scene.world = world
