"""GPU resources: programs, meshes, textures, and framebuffers."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.rendering.context import is_llvmpipe
from uavbench.trajectories.pose import Array

SMALLEST_PX = 8
"""Least side of a mipmap of an alpha mask that keeps its cover: of fewer pixels all would be opaque, or none."""


class Program:
    """A linked shader program that sets uniforms when they change; RuntimeError when it does not compile or link."""

    def __init__(self, GL: Any, vertex: str, fragment: str) -> None:
        self._gl, self._at, self._has = GL, dict[str, int](), dict[str, Any]()
        self.id = GL.glCreateProgram()
        for kind, source in ((GL.GL_VERTEX_SHADER, vertex), (GL.GL_FRAGMENT_SHADER, fragment)):
            shader = GL.glCreateShader(kind)
            GL.glShaderSource(shader, [source])
            GL.glCompileShader(shader)
            if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
                raise RuntimeError(f"shader does not compile: {GL.glGetShaderInfoLog(shader)}")
            GL.glAttachShader(self.id, shader)
            GL.glDeleteShader(shader)
        GL.glLinkProgram(self.id)
        if not GL.glGetProgramiv(self.id, GL.GL_LINK_STATUS):
            raise RuntimeError(f"shaders do not link: {GL.glGetProgramInfoLog(self.id)}")

    def use(self) -> None:
        """Make it the current program."""
        self._gl.glUseProgram(self.id)

    def matrix(self, name: str, value: NDArray[np.floating[Any]]) -> None:
        """Set a mat4 uniform from a row-major (4, 4)."""
        if self._changes(name, data := value.astype(np.float32).tobytes()):
            self._gl.glUniformMatrix4fv(self._at[name], 1, True, data)

    def vector(self, name: str, value: Array) -> None:
        """Set a vec3 or vec4 uniform."""
        if self._changes(name, data := value.astype(np.float32).tobytes()):
            set_vector = self._gl.glUniform3fv if len(value) == 3 else self._gl.glUniform4fv
            set_vector(self._at[name], 1, data)

    def pair(self, name: str, value: tuple[float, float]) -> None:
        """Set a vec2 uniform."""
        if self._changes(name, value):
            self._gl.glUniform2f(self._at[name], *value)

    def number(self, name: str, value: float) -> None:
        """Set a float uniform."""
        if self._changes(name, value):
            self._gl.glUniform1f(self._at[name], value)

    def integer(self, name: str, value: int) -> None:
        """Set an int or sampler uniform."""
        if self._changes(name, value):
            self._gl.glUniform1i(self._at[name], value)

    def _changes(self, name: str, value: Any) -> bool:
        """Note the value of a uniform; whether it was another one. Its place is known from then on."""
        if self._has.get(name) == value:
            return False
        if name not in self._at:
            self._at[name] = self._gl.glGetUniformLocation(self.id, name)
        self._has[name] = value
        return True


class Mesh:
    """Vertices of a part on the GPU, as a pyrender primitive; lit when some of its faces may face the lamp."""

    def __init__(self, GL: Any, part: Part, texture: int, lit: bool) -> None:
        from pyrender.primitive import Primitive

        self._gl, self.part, self.texture, self.lit = GL, part, texture, lit
        positions, normals, uv, tint, indices = _corners(part)
        soil_uv = part.soil_uv
        if part.soil_uv is not None and part.normals is None:
            soil_uv = part.soil_uv[part.triangles.reshape(-1)]
        self.primitive = Primitive(
            positions=positions,
            normals=normals,
            texcoord_0=uv,
            texcoord_1=soil_uv,  # moves the tint from location 3 to 4
            color_0=tint,
            indices=indices,
            mode=GL.GL_TRIANGLES,
        )
        self.primitive._add_to_context()
        self._vertices, self._count = int(self.primitive._vaid), int(self.primitive.indices.size)

    @property
    def cutout(self) -> bool:
        """Whether the texture has an alpha mask."""
        return self.part.cutout

    def draw(self) -> None:
        """Draw the mesh with the current program."""
        GL = self._gl
        GL.glBindTexture(GL.GL_TEXTURE_2D, self.texture)
        if self.part.two_sided:
            GL.glDisable(GL.GL_CULL_FACE)
        else:
            GL.glEnable(GL.GL_CULL_FACE)
        GL.glBindVertexArray(self._vertices)
        GL.glDrawElements(GL.GL_TRIANGLES, self._count, GL.GL_UNSIGNED_INT, None)


class Target:
    """Framebuffer with depth and a texture of 8-bit colour, and, if numbered, one of two floats per pixel.

    RuntimeError when the framebuffer is incomplete.
    """

    def __init__(self, GL: Any, width: int, height: int, *, numbered: bool = False) -> None:
        self._gl, self.numbered = GL, numbered
        self.id = GL.glGenFramebuffers(1)
        self._depth = GL.glGenRenderbuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.id)
        storages = [GL.GL_RGBA8, *([GL.GL_RG32F] * numbered)]
        self._textures = [int(GL.glGenTextures(1)) for _ in storages]
        places = [GL.GL_COLOR_ATTACHMENT0 + k for k in range(len(storages))]
        for texture, storage, place in zip(self._textures, storages, places, strict=True):
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, storage, width, height, 0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, None)
            GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, place, GL.GL_TEXTURE_2D, texture, 0)
        GL.glDrawBuffers(len(places), places)
        GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, self._depth)
        GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, GL.GL_DEPTH_COMPONENT32F, width, height)
        GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_RENDERBUFFER, self._depth)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"OpenGL cannot draw into {width} x {height} px")

    @property
    def texture(self) -> int:
        """GL name of the texture of colours."""
        return self._textures[0]

    def delete(self) -> None:
        """Release the GPU resources."""
        self._gl.glDeleteFramebuffers(1, [self.id])
        self._gl.glDeleteTextures(self._textures)
        self._gl.glDeleteRenderbuffers(1, [self._depth])


def upload(GL: Any, image: Texture, mipmap: bool, keeps_cover: bool = False) -> int:
    """Upload an image (h, w, 3 or 4) as a texture that repeats outside 0..1; returns its GL name.

    keeps_cover: whether its alpha mask covers the same share at every size, see `covering_levels`.
    """
    texture = int(GL.glGenTextures(1))
    data = np.ascontiguousarray(image[::-1])
    h, w, channels = data.shape
    GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
    GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
    layout = GL.GL_RGBA if channels == 4 else GL.GL_RGB
    GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA8, w, h, 0, layout, GL.GL_UNSIGNED_BYTE, data)
    if mipmap:
        GL.glGenerateMipmap(GL.GL_TEXTURE_2D)
    own = covering_levels(data) if keeps_cover else [] if is_llvmpipe() else halved_levels(data)
    for level, smaller in enumerate(own * mipmap, 1):
        size = smaller.shape[1], smaller.shape[0]
        GL.glTexImage2D(GL.GL_TEXTURE_2D, level, GL.GL_RGBA8, *size, 0, layout, GL.GL_UNSIGNED_BYTE, smaller)
    if mipmap and keeps_cover:
        GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MAX_LEVEL, len(own))
    smallest = GL.GL_LINEAR_MIPMAP_LINEAR if mipmap else GL.GL_LINEAR
    GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, smallest)
    GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR)
    return texture


def halved_levels(image: Texture) -> list[Texture]:
    """The image (h, w, c) at a half, a quarter ... of its size, down to one pixel, as llvmpipe makes its mipmaps.

    Means of two are rounded up, along a row and then of two rows; an odd side is sampled at the new pixels' centres.
    """
    levels = [image]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halved(_halved(levels[-1], 1), 0))
    return levels[1:]


def _halved(image: Texture, axis: int) -> Texture:
    """The image with half as many pixels along an axis, rounded down, but at least one."""
    size = image.shape[axis]
    half = max(size // 2, 1)
    at = (np.arange(half) + 0.5) * size / half - 0.5
    first = np.maximum(np.floor(at).astype(int), 0)
    share = (at - first).clip(0.0, 1.0).reshape([-1 if k == axis else 1 for k in range(3)])
    left, right = (np.take(image, np.minimum(k, size - 1), axis).astype(float) for k in (first, first + 1))
    return np.asarray(np.floor(left + share * (right - left) + 0.5), dtype=np.uint8)


def covering_levels(image: Texture) -> list[Texture]:
    """The image (h, w, 4) at a half, a quarter ... of its size, down to SMALLEST_PX, each with the same share opaque.

    Alpha is scaled so that as many pixels as before reach a half (Castano 2010, Computing alpha mipmaps).
    """
    share, levels = float((image[..., 3] > 127).mean()), []
    half = image.astype(np.float32)
    while min(half.shape[:2]) > SMALLEST_PX and share > 0:
        half = np.asarray(cv2.resize(half, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.float32)
        least = float(np.quantile(half[..., 3], 1 - share, method="higher"))
        scaled = half.copy()
        scaled[..., 3] *= 128 / max(least, 1.0)
        levels.append(np.ascontiguousarray(np.rint(scaled.clip(0, 255)).astype(np.uint8)))
    return levels


def _corners(part: Part) -> tuple[Array, Array, Array, Array, Any]:
    """Positions, normals, uv, tint, indices; without normals, vertices are duplicated per triangle (flat shading)."""
    n = len(part.vertices)
    uv = np.zeros((n, 2)) if part.uv is None else part.uv
    tint = np.ones((n, 4)) if part.tint is None else part.tint
    if part.normals is not None:
        return part.vertices, part.normals, uv, tint, part.triangles
    flat = part.triangles.reshape(-1)
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return part.vertices[flat], np.repeat(normals, 3, axis=0), uv[flat], tint[flat], np.arange(len(flat)).reshape(-1, 3)
