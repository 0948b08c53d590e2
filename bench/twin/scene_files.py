"""A scene as the files that `blender_script.py` reads: raw arrays, PNG textures, and `scene.json`."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.rendering.lighting import cloud_axes
from uavbench.scenes.rendering.renderer import FAR_M, NEAR_M
from uavbench.scenes.rendering.shaders import WATER_INDEX, WET_GAIN, WET_INNER
from uavbench.scenes.scene import Scene
from uavbench.trajectories.files.writing import full_disk_told
from uavbench.trajectories.pose import Array, Pose

BLENDER_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Blender's cameras look along -z, y up."""
SENSOR_MM = 36.0
"""Sensor width given to Blender; arbitrary, because the focal length is given in the same unit."""
LEVEL = 0.99
"""Least z component of a unit normal for a triangle to count as floor."""


def write_scene(scene: Scene, folder: Path) -> None:
    """Write the inputs of `blender_script.py` into an existing folder: meshes, textures, lamp, clouds, sky and haze."""
    textures: dict[int, str] = {}
    still = [_write_part(part, f"part_{i:03d}", folder, textures) for i, part in enumerate(scene.unlit)]
    movers = [_write_part(mover.part, f"mover_{i:03d}", folder, textures) for i, mover in enumerate(scene.movers)]
    light = scene.light
    about = {
        "parts": still,
        "movers": movers,
        "to_lamp": light.to_lamp,
        "lamp": light.lamp,
        "lamp_radius": scene.lamp_radius,
        "above": light.above,
        "below": light.below,
        "haze_per_m": light.haze_per_m,
        "haze_color": light.haze_color,
        "clip_m": (NEAR_M, FAR_M),
        "water_index": WATER_INDEX,
        "wet_gain": WET_GAIN,
        "wet_inner": WET_INNER,
    }
    if light.clouds is not None:
        about["clouds"] = {
            "texture": _write_texture(light.clouds.texture, folder, textures),
            "axes_per_m": cloud_axes(light, light.clouds).tolist(),
        }
    if scene.sky is not None:
        _write_png(folder / "sky.png", scene.sky[:, ::-1, ::-1])  # Blender's azimuth runs the other way
        about |= {"sky": "sky.png", "sky_gain": (np.array(light.above) / sky_light(scene.sky)).tolist()}
    (folder / "scene.json").write_text(json.dumps(about), encoding="utf-8")


def sky_light(sky: Texture) -> Array:
    """Linear radiance (3,) RGB that a white floor reflects under the upper half of a panorama.

    sky: equirectangular (h, w, 3) RGB, codes the square root of linear radiance.
    """
    rows = sky.shape[0] // 2
    light = np.square(sky[:rows].astype(np.float64) / 255).mean(axis=1)
    edges = np.cos(np.linspace(0, np.pi / 2, rows + 1)) ** 2  # of what is above an angle from the zenith
    return np.asarray((edges[:-1] - edges[1:]) @ light)


def blender_camera(camera: Camera) -> dict[str, Any]:
    """Blender's parameters of a pinhole camera: size in px, focal length in mm, shift by the width, pixel aspect.

    As `BKE_camera_params_compute_viewplane` in Blender's source reads them, with the sensor fitted to the width.
    """
    tall = camera.fx / camera.fy
    return {
        "size": (camera.width, camera.height),
        "sensor_mm": SENSOR_MM,
        "lens_mm": camera.fx * SENSOR_MM / camera.width,
        "shift_x": 0.5 - (camera.cx + 0.5) / camera.width,
        "shift_y": tall * ((camera.cy + 0.5) - camera.height / 2) / camera.width,
        "aspect": (max(1.0, 1 / tall), max(1.0, tall)),  # neither may be less than 1
    }


def blender_pose(cam_from_world: Pose) -> list[list[float]]:
    """Blender's `matrix_world` (4, 4) of a camera with OpenCV's axes."""
    rows: list[list[float]] = (cam_from_world.inverse().matrix @ BLENDER_FROM_CV).tolist()
    return rows


def lets_light_through(part: Part) -> bool:
    """Whether the scene's light passes a part: walls of a room and the distant backdrop, but no floor."""
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    level = normals[:, 2] > LEVEL * np.linalg.norm(normals, axis=1)
    return not part.casts_shadow and not bool(level.all())


def _write_part(part: Part, name: str, folder: Path, textures: dict[int, str]) -> dict[str, Any]:
    """Write the arrays of a part, and its texture unless already written; the part's entry of `scene.json`."""
    corners = part.triangles.reshape(-1)
    arrays = {
        "vertices": part.vertices,
        "normals": part.normals,
        "uv": None if part.uv is None else part.uv[corners],
        "tint": part.tint,
        "soil_uv": None if part.soil_uv is None else part.soil_uv[corners],
    }
    given = {key: values for key, values in arrays.items() if values is not None}
    with full_disk_told(folder / name):
        for key, values in given.items():
            np.ascontiguousarray(values, dtype="<f4").tofile(folder / f"{name}.{key}")
        np.ascontiguousarray(part.triangles, dtype="<i4").tofile(folder / f"{name}.triangles")
    film, soil = part.film, part.soil
    return {
        "name": name,
        "arrays": list(given),
        "texture": None if part.texture is None else _write_texture(part.texture, folder, textures),
        "soil": None if soil is None else _write_texture(soil, folder, textures),
        "film": None if film is None else _write_texture(film.texture, folder, textures),
        "film_per_m": None if film is None else 1 / film.tile_m,
        "stands": film is not None and film.stands,
        "cutout": part.cutout,
        "roughness": part.roughness,
        "lets_light_through": lets_light_through(part),
    }


def _write_texture(texture: Texture, folder: Path, textures: dict[int, str]) -> str:
    """Name of the PNG file of a texture, written on the first call."""
    if id(texture) not in textures:
        name = f"texture_{len(textures):03d}.png"
        order = [2, 1, 0, 3][: texture.shape[2]]
        _write_png(folder / name, texture[..., order])
        textures[id(texture)] = name
    return textures[id(texture)]


def _write_png(path: Path, image: Texture) -> None:
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(image))[1].tobytes())  # imwrite tells of no full disk
