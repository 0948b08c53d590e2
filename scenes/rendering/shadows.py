"""Shadow mapping: faces turned towards the lamp, and the depth map from its view."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from uavbench.scenes.renderables import Light, Part
from uavbench.scenes.rendering.gpu import Mesh, Program
from uavbench.trajectories.pose import Array

COARSEST_M = 0.01
"""Texel of the small shadow map above which the large one is taken, metres: where trees are around a bridge, a texel of
the small one is as wide as its rails, whose shadow is dashed.
"""


class Grid(NamedTuple):
    """Texels along a side of a shadow map, and the bits of their depths."""

    side: int
    bits: int


SMALL, LARGE = Grid(2048, 24), Grid(3072, 16)
"""The large one takes little more memory, and hence no more time to look up; its depths are in steps of 2 mm for 100 m,
where surfaces are kept from their own shadows by three texels."""


class HalfPart(NamedTuple):
    """Faces of a part, and whether they may face the lamp."""

    part: Part
    lit: bool


def split_by_lamp(part: Part, light: Light) -> list[HalfPart]:
    """Split a part into faces turned towards the lamp and faces turned away, which are cheaper to shade.

    Two-sided parts are not split, and no part is without a shadow map.
    """
    if not light.shadow_map or part.two_sided:
        return [HalfPart(part, True)]
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    to_lamp = np.array(light.to_lamp)
    turned = np.cross(b - a, c - a) @ to_lamp > 0
    if part.normals is not None:
        turned |= (part.normals @ to_lamp > 0)[part.triangles].any(axis=1)
    halves = [HalfPart(replace(part, triangles=part.triangles[turned == lit]), lit) for lit in (True, False)]
    return [half for half in halves if len(half.part.triangles)]


class ShadowMap:
    """Depth map of the static, shadow-casting parts from the view of the lamp, rendered once.

    It ends at the deepest of these parts; the shaders clamp what lies deeper, such as the ground, to its end.
    """

    def __init__(self, GL: Any, light: Light, meshes: list[Mesh], programs: tuple[Program, Program]) -> None:
        self._gl = GL
        casting = [mesh for mesh in meshes if mesh.part.casts_shadow]
        points = np.concatenate([mesh.part.vertices for mesh in casting]) if casting else np.zeros((1, 3))
        self.matrix, half = _lamp_view(points, np.array(light.to_lamp))
        wide = float(2 * max(half[:2]))
        side, bits = LARGE if wide / SMALL.side > COARSEST_M else SMALL
        self.texel_m = wide / side
        self.spread = float(np.clip(light.softness_m * side / wide, 0.7, 1.2)) / side
        self.texture = GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self.texture)
        size = (side, side)
        kept = GL.GL_DEPTH_COMPONENT24 if bits == 24 else GL.GL_DEPTH_COMPONENT16
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, kept, *size, 0, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, None)
        for key, value in (
            (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_COMPARE_MODE, GL.GL_COMPARE_REF_TO_TEXTURE),
            (GL.GL_TEXTURE_COMPARE_FUNC, GL.GL_LEQUAL),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, key, value)
        self._target = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._target)
        GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_TEXTURE_2D, self.texture, 0)
        GL.glDrawBuffer(GL.GL_NONE)
        GL.glViewport(0, 0, *size)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glClipControl(GL.GL_LOWER_LEFT, GL.GL_NEGATIVE_ONE_TO_ONE)
        GL.glDepthFunc(GL.GL_LESS)
        GL.glClearDepth(1.0)
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        for mesh in casting:
            program = programs[mesh.cutout]
            program.use()
            program.matrix("view_projection", self.matrix)
            program.matrix("model", np.eye(4))
            mesh.draw()

    def delete(self) -> None:
        """Release the GPU resources."""
        self._gl.glDeleteTextures([self.texture])
        self._gl.glDeleteFramebuffers(1, [self._target])


def lamp_axes(to_lamp: Array) -> Array:
    """Orthonormal axes (3, 3) as rows: level and upwards in the plane across the lamp's direction, and towards it."""
    forward = -to_lamp / np.linalg.norm(to_lamp)
    side = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(side, forward), -forward])


def _lamp_view(points: Array, to_lamp: Array) -> tuple[Array, Array]:
    """Orthographic `clip_from_world` (4, 4) of a distant lamp covering all points, and half extents (3,) in metres."""
    axes = lamp_axes(to_lamp)
    local = points @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    half = (high - low) / 2 * 1.02 + 0.01
    matrix = np.eye(4)
    matrix[:3, :3] = axes / half[:, None] * [[1.0], [1.0], [-1.0]]
    matrix[:3, 3] = -(low + high) / 2 / half * [1.0, 1.0, -1.0]
    return matrix, half
