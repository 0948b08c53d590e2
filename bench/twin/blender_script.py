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

sys.path.append(str(Path(__file__).parent))  # Blender's Python knows no package uavbench

from blender_shading import build_world, clouds, material

BOUNCES = 4
"""A fifth reflection off surfaces of albedo 0.5 would add 3 % of the light indoors, and far less outdoors."""
LAYERS = 64
"""Transparent surfaces that a ray may pass, such as leaves with cutouts."""


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
    for layer in ("uv", "soil_uv"):  # images without coordinates take those of the first layer
        if layer in about["arrays"]:
            mesh.uv_layers.new(name=layer).data.foreach_set("uv", numbers(folder / f"{name}.{layer}", "f"))
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


def build_clouds(folder: Path, scene: dict[str, Any]) -> Any:
    """The pane of the clouds, beyond all that is in the scene; the input that shifts them."""
    made = clouds(folder, scene)
    to_lamp = Vector(scene["to_lamp"]).normalized()
    far = 1.1 * max((item.matrix_world @ Vector(c)).length for item in bpy.data.objects for c in item.bound_box)
    mesh = bpy.data.meshes.new("clouds")
    mesh.from_pydata([(x * far, y * far, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], [], [(0, 1, 2, 3)])
    mesh.materials.append(made.material)
    pane = bpy.data.objects.new("clouds", mesh)
    pane.location, pane.rotation_mode = far * to_lamp, "QUATERNION"
    pane.rotation_quaternion = to_lamp.to_track_quat("Z", "Y")
    pane.visible_camera = pane.visible_diffuse = pane.visible_transmission = False
    bpy.context.collection.objects.link(pane)
    return made.shift


def build_camera(scene: dict[str, Any]) -> Any:
    """The camera; every request sets its intrinsics and pose."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.clip_start, camera.data.clip_end = scene["clip_m"]
    bpy.context.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def answer(request: dict[str, Any], camera: Any, movers: list[Any], shift: Any) -> None:
    """Render one view and write its linear radiance to the request's file."""
    render, about = bpy.context.scene.render, request["camera"]
    render.resolution_x, render.resolution_y = about["size"]
    render.pixel_aspect_x, render.pixel_aspect_y = about["aspect"]
    camera.data.sensor_width, camera.data.lens = about["sensor_mm"], about["lens_mm"]
    camera.data.shift_x, camera.data.shift_y = about["shift_x"], about["shift_y"]
    camera.matrix_world = Matrix(request["world_from_camera"])
    for mover, pose in zip(movers, request["world_from_movers"], strict=True):
        mover.matrix_world = Matrix(pose)
    if shift is not None:
        shift.default_value = (*request["cloud_shift"], 0.0)
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
    shift = build_clouds(Path(folder), scene) if "clouds" in scene else None
    build_lamp(scene)
    build_world(Path(folder), scene)
    camera = build_camera(scene)
    print(json.dumps({"denoiser": denoiser}), file=replies, flush=True)
    for line in sys.stdin:
        answer(json.loads(line), camera, movers, shift)
        print("{}", file=replies, flush=True)


if __name__ == "__main__":
    main()
