"""Light of a scene on the GPU: uniforms of the lamp and the sky, and the maps of what dims the lamp."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uavbench.scenes.renderables import CloudShadow, Light
from uavbench.scenes.rendering.gpu import Mesh, Program, upload
from uavbench.scenes.rendering.shadows import ShadowMap, lamp_axes
from uavbench.trajectories.pose import Array

NEAR_UNIT, FAR_UNIT, CLOUD_UNIT = 1, 3, 4
"""Texture units of the shadow maps and the clouds; unit 0 is the surface's, unit 2 the mirror's."""


def cloud_axes(light: Light, clouds: CloudShadow) -> Array:
    """Axes (2, 3) of the clouds' texture in the world, texture units per metre, in the plane across the lamp."""
    return np.asarray(lamp_axes(np.array(light.to_lamp))[:2] / clouds.tile_m)


def cloud_shift(light: Light, clouds: CloudShadow, time_s: float) -> Array:
    """Shift (2,) of the clouds' texture at a time, texture units, by the wind."""
    across = lamp_axes(np.array(light.to_lamp))[:2]
    return np.asarray(-time_s / clouds.tile_m * (across @ np.array(clouds.wind_m_s)))


class Lighting:
    """Shadow maps of a light, one of near parts and, if there are any, one of distant parts; and its clouds."""

    def __init__(self, GL: Any, light: Light, still: Sequence[Mesh], depth: tuple[Program, Program]) -> None:
        self._gl, self._light = GL, light
        self._maps: dict[str, ShadowMap] = {}
        self._textures: dict[int, int] = {}
        self.haze, self.clouds = ["HAZE"] * (light.haze_per_m > 0), ["CLOUDS"] * (light.clouds is not None)
        self.switches = [*self.haze]
        if not light.shadow_map:
            return
        far = [mesh for mesh in still if mesh.part.distant]
        self._maps["shadow"] = ShadowMap(GL, light, [mesh for mesh in still if not mesh.part.distant], depth)
        self._textures[NEAR_UNIT] = self._maps["shadow"].texture
        self.switches.append("SHADOW_MAP")
        if far:
            self._maps["far"] = ShadowMap(GL, light, far, depth)
            self._textures[FAR_UNIT] = self._maps["far"].texture
            self.switches.append("FAR_SHADOW_MAP")
        if light.clouds is not None:
            self._textures[CLOUD_UNIT] = upload(GL, light.clouds.texture, mipmap=True)
            self.switches += self.clouds

    def set(self, program: Program) -> None:
        """Set the uniforms of a lit program."""
        light = self._light
        program.use()
        program.integer("shadow_map", NEAR_UNIT)
        program.integer("far_map", FAR_UNIT)
        program.vector("to_lamp", np.array(light.to_lamp) / np.linalg.norm(light.to_lamp))
        for name in ("lamp", "above", "below", "haze_color"):
            program.vector(name, np.array(getattr(light, name)))
        program.number("haze", light.haze_per_m)
        if light.clouds is not None:
            program.integer("clouds", CLOUD_UNIT)
            for name, axis in zip(("cloud_u", "cloud_v"), cloud_axes(light, light.clouds), strict=True):
                program.vector(name, axis)
        for name, shadow in self._maps.items():
            program.matrix(f"{name}_from_world", shadow.matrix)
            program.number(f"{name}_texel", shadow.texel_m)
            program.number(f"{name}_spread", shadow.spread)

    def move(self, program: Program, time_s: float) -> None:
        """Set the place of the clouds at a time, for the current program."""
        if (clouds := self._light.clouds) is not None:
            u, v = cloud_shift(self._light, clouds, time_s)
            program.pair("cloud_shift", (float(u), float(v)))

    def bind(self) -> None:
        """Bind the maps to their texture units."""
        GL = self._gl
        for unit, texture in self._textures.items():
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
        GL.glActiveTexture(GL.GL_TEXTURE0)

    def delete(self) -> None:
        """Release the GPU resources."""
        for shadow in self._maps.values():
            shadow.delete()
        if CLOUD_UNIT in self._textures:
            self._gl.glDeleteTextures([self._textures[CLOUD_UNIT]])
