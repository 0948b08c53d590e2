"""Planar reflection in level water: the mirrored scene, rendered before each image at half the resolution."""

from typing import Any

import numpy as np

from uavbench.scenes.renderables import Part
from uavbench.scenes.rendering.gpu import Target
from uavbench.trajectories.pose import Array

SHARE = 2
"""Downsampling factor of the mirrored image; ripples blur it anyway."""


class Mirror:
    """Reflection of the scene in a water surface at z = level_m, metres."""

    def __init__(self, GL: Any, width: int, height: int, level_m: float) -> None:
        self._gl, self.level_m = GL, level_m
        self.width, self.height = max(1, width // SHARE), max(1, height // SHARE)
        self.target = Target(GL, self.width, self.height)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self.target.texture)
        for key, value in (
            (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_EDGE),
            (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_EDGE),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, key, value)
        self.turned_over = np.diag([1.0, 1.0, -1.0, 1.0])
        self.turned_over[2, 3] = 2 * level_m

    def eye(self, eye: Array) -> Array:
        """The viewpoint (3,) mirrored at the water surface."""
        return np.array([eye[0], eye[1], 2 * self.level_m - eye[2]])

    def begin(self) -> None:
        """Set the state for the mirrored image: reversed winding, geometry under water clipped."""
        GL = self._gl
        GL.glFrontFace(GL.GL_CW)
        GL.glEnable(GL.GL_CLIP_DISTANCE0)

    def end(self) -> None:
        """Restore the state."""
        GL = self._gl
        GL.glFrontFace(GL.GL_CCW)
        GL.glDisable(GL.GL_CLIP_DISTANCE0)

    def delete(self) -> None:
        """Release the GPU resources."""
        self.target.delete()


def mirror_level_m(part: Part) -> float | None:
    """Level of the mirror that a part shows, metres: that of its water, 0 for standing water on the ground."""
    if part.ripples is not None:
        return float(part.vertices[0, 2])
    return 0.0 if part.film is not None and part.film.stands else None
