"""Runs inside Blender: blender --background --python blender_script.py -- FOLDER SAMPLES THREADS.

Builds the scene that `scene_files.write_scene` wrote into FOLDER, then answers requests, one JSON object a line on its
standard input, by files of linear radiance (h, w, 4) float32 RGBA, bottom row first. Blender's Python has no library of
uavbench, and needs none.
"""

import array
import json
import math
import os
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

BOUNCES = 4
"""A fifth reflection off surfaces of albedo 0.5 would add 3 % of the light indoors, and far less outdoors."""
LAYERS = 64
"""Transparent surfaces that a ray may pass, such as leaves with cutouts."""


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

    def image(self, path: Path, kind: str) -> Any:
        """Node of an image file whose codes are the square root of linear radiance."""
        node = self._tree.nodes.new(f"ShaderNode{kind}")
        node.image = bpy.data.images.load(str(path), check_existing=True)
        node.image.colorspace_settings.name = "Non-Color"
        node.image.alpha_mode = "CHANNEL_PACKED"
        return node


def numbers(path: Path, code: str) -> Any:
    """All numbers of a raw file; code: their type, as in the module `array`."""
    values = array.array(code)
    values.frombytes(path.read_bytes())
    return values


def build_part(folder: Path, about: dict[str, Any], scene: dict[str, Any]) -> Any:
    """Add a part of the scene to the collection; its object."""
    name = about["name"]
    flat = numbers(folder / f"{name}.vertices", "f")
    rows = numbers(folder / f"{name}.triangles", "i")
    mesh = bpy.data.meshes.new(name)
    triangles = [tuple(rows[k : k + 3]) for k in range(0, len(rows), 3)]
    mesh.from_pydata([tuple(flat[k : k + 3]) for k in range(0, len(flat), 3)], [], triangles)
    if "uv" in about["arrays"]:
        mesh.uv_layers.new(name="uv").data.foreach_set("uv", numbers(folder / f"{name}.uv", "f"))
    if "tint" in about["arrays"]:
        tint = mesh.attributes.new("tint", "FLOAT_COLOR", "POINT")
        tint.data.foreach_set("color", numbers(folder / f"{name}.tint", "f"))
    if "normals" in about["arrays"]:
        normals = numbers(folder / f"{name}.normals", "f")
        mesh.polygons.foreach_set("use_smooth", [True] * len(triangles))
        if hasattr(mesh, "use_auto_smooth"):  # before Blender 4.1
            mesh.use_auto_smooth = True
        mesh.normals_split_custom_set_from_vertices([tuple(normals[k : k + 3]) for k in range(0, len(normals), 3)])
    mesh.materials.append(material(folder, about, scene))
    mesh.update()
    item = bpy.data.objects.new(name, mesh)
    if about["lets_light_through"]:
        item.visible_diffuse = item.visible_glossy = item.visible_transmission = item.visible_shadow = False
    bpy.context.collection.objects.link(item)
    return item


def material(folder: Path, about: dict[str, Any], scene: dict[str, Any]) -> Any:
    """Material of a part: albedo as texture times tint, roughness, cutouts, and haze in front of it."""
    made = bpy.data.materials.new(about["name"])
    nodes = Nodes(made)
    albedo, holes = (1.0, 1.0, 1.0), None
    if about["texture"]:
        image = nodes.image(folder / about["texture"], "TexImage")
        albedo = nodes.times(image.outputs["Color"], image.outputs["Color"])
        if about["cutout"]:
            holes = nodes.math("GREATER_THAN", image.outputs["Alpha"], 0.5)
    if "tint" in about["arrays"]:
        albedo = nodes.times(albedo, nodes.add("Attribute", attribute_name="tint"))
    surface = nodes.add("BsdfPrincipled")
    nodes.wire(surface.node.inputs["Base Color"], albedo if not isinstance(albedo, tuple) else (*albedo, 1.0))
    nodes.wire(surface.node.inputs["Roughness"], about["roughness"])
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


def hazy(nodes: Nodes, surface: Any, scene: dict[str, Any]) -> Any:
    """The surface seen through haze: attenuated by exp(-haze * distance) for camera rays only."""
    away = nodes.add("CameraData", output="View Distance")
    clear = nodes.math("EXPONENT", nodes.math("MULTIPLY", away, -scene["haze_per_m"]))
    seen = nodes.add("LightPath", output="Is Camera Ray")
    share = nodes.math("MULTIPLY", seen, nodes.math("SUBTRACT", 1.0, clear))
    return nodes.add("MixShader", share, surface, nodes.add("Emission", (*scene["haze_color"], 1.0), 1.0))


def build_lamp(scene: dict[str, Any]) -> None:
    """The distant lamp; its energy is such that a white surface facing it reflects the radiance of `lamp`."""
    strongest = max(scene["lamp"])
    if strongest <= 0:
        return
    lamp = bpy.data.lights.new("lamp", "SUN")
    lamp.energy = math.pi * strongest
    lamp.color = [c / strongest for c in scene["lamp"]]
    lamp.angle = 2 * math.atan(scene["lamp_radius"])
    item = bpy.data.objects.new("lamp", lamp)
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = Vector(scene["to_lamp"]).to_track_quat("Z", "Y")
    bpy.context.collection.objects.link(item)


def build_world(folder: Path, scene: dict[str, Any]) -> None:
    """Light from the upper and the lower hemisphere; the camera sees the panorama, or black."""
    world = bpy.data.worlds.new("world")
    nodes = Nodes(world)
    ray = nodes.add("SeparateXYZ", nodes.add("TexCoord", output="Generated"), output="Z")
    above, seen = (*scene["above"], 1.0), (0.0, 0.0, 0.0, 1.0)
    if "sky" in scene:
        codes = nodes.image(folder / scene["sky"], "TexEnvironment").outputs["Color"]
        seen = nodes.times(codes, codes)
        above = nodes.times(seen, scene["sky_gain"])
    light = nodes.mixed(nodes.math("GREATER_THAN", ray, 0.0), (*scene["below"], 1.0), above)
    color = nodes.mixed(nodes.add("LightPath", output="Is Camera Ray"), light, seen)
    nodes.add("OutputWorld", nodes.add("Background", color, 1.0))
    bpy.context.scene.world = world


def prepare(scene: dict[str, Any], samples: int, threads: int) -> str:
    """Configure Cycles and the output files; the name of the denoiser, "" if this Blender has none."""
    settings = bpy.context.scene
    settings.render.engine = "CYCLES"
    settings.render.threads_mode, settings.render.threads = "FIXED", threads
    settings.render.use_persistent_data = True
    settings.render.resolution_percentage = 100
    settings.render.image_settings.file_format = "OPEN_EXR"
    settings.render.image_settings.color_mode = "RGBA"
    settings.render.image_settings.color_depth = "32"
    settings.render.image_settings.exr_codec = "NONE"
    cycles = settings.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CPU", samples, False
    cycles.pixel_filter_type = "BOX"  # a pixel's light is the mean over its own square, as in uavbench's renderer
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = BOUNCES
    cycles.transparent_max_bounces = LAYERS
    cycles.use_denoising = False
    try:
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.use_denoising = True
    except TypeError:  # built without it
        return ""
    return "OpenImageDenoise"


def build_camera(scene: dict[str, Any]) -> Any:
    """The camera; every request sets its intrinsics and pose."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.clip_start, camera.data.clip_end = scene["clip_m"]
    bpy.context.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def answer(request: dict[str, Any], camera: Any, movers: list[Any]) -> None:
    """Render one view and write its linear radiance to the request's file."""
    render, about = bpy.context.scene.render, request["camera"]
    render.resolution_x, render.resolution_y = about["size"]
    render.pixel_aspect_x, render.pixel_aspect_y = about["aspect"]
    camera.data.sensor_width, camera.data.lens = about["sensor_mm"], about["lens_mm"]
    camera.data.shift_x, camera.data.shift_y = about["shift_x"], about["shift_y"]
    camera.matrix_world = Matrix(request["world_from_camera"])
    for mover, pose in zip(movers, request["world_from_movers"], strict=True):
        mover.matrix_world = Matrix(pose)
    bpy.context.scene.cycles.seed = request["seed"]
    path = Path(request["file"])
    render.filepath = str(path.with_suffix(".exr"))
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    image.colorspace_settings.name = "Non-Color"
    light = array.array("f", bytes(4 * len(image.pixels)))
    image.pixels.foreach_get(light)
    path.write_bytes(light.tobytes())
    bpy.data.images.remove(image)
    path.with_suffix(".exr").unlink()


def main() -> None:
    """Build the scene, then answer each request with a line; Blender's own output goes to standard error."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    folder, samples, threads = sys.argv[sys.argv.index("--") + 1 :]
    scene = json.loads((Path(folder) / "scene.json").read_text(encoding="utf-8"))
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    denoiser = prepare(scene, int(samples), int(threads))
    for about in scene["parts"]:
        build_part(Path(folder), about, scene)
    movers = [build_part(Path(folder), about, scene) for about in scene["movers"]]
    build_lamp(scene)
    build_world(Path(folder), scene)
    camera = build_camera(scene)
    print(json.dumps({"denoiser": denoiser}), file=replies, flush=True)
    for line in sys.stdin:
        answer(json.loads(line), camera, movers)
        print("{}", file=replies, flush=True)


if __name__ == "__main__":
    main()
