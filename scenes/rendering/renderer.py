"""Renderer of lit parts, with its own shaders and passes on pyrender's context and primitives.

OpenGL's camera axes (x right, y up, view along -z) are used in this module only. Pixel centres are at integer
coordinates.
"""

import ctypes
from dataclasses import replace
from functools import lru_cache
from itertools import chain
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.renderables import STRUCTURE, Light, Mover, Part, Texture
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.rendering import shaders
from uavbench.scenes.rendering.antialiasing.facet_table import FacetTable
from uavbench.scenes.rendering.antialiasing.outlines import Moment, Outlines, Pixels
from uavbench.scenes.rendering.camera_simulator import Geometry
from uavbench.scenes.rendering.facets import DrawnPart, Facets
from uavbench.scenes.rendering.gpu import Mesh, Program, Target, upload
from uavbench.scenes.rendering.lighting import Lighting
from uavbench.scenes.rendering.mirror import Mirror, mirror_level_m
from uavbench.scenes.rendering.shadows import split_by_lamp
from uavbench.trajectories.pose import Array, Pose

GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])
NEAR_M, FAR_M = 0.05, 2000.0
AT_REST = np.eye(4)
MIRROR_UNIT, FILM_UNIT, SOIL_UNIT = 2, 5, 6
"""Texture units of a mirrored image, wet ground and dirt; `lighting` has further ones, unit 0 is the surface's."""
KEPT_TIMES = 2
"""Times at which poses of moving parts are kept: drawing, antialiasing and truth of a frame ask for the same one."""
WHITE: Texture = np.full((1, 1, 3), 255, dtype=np.uint8)


class DrawnMesh(NamedTuple):
    """A mesh, its motion, None for a static one, and the number of the part that it is of."""

    mesh: Mesh
    mover: Mover | None
    part: int


class Draw(NamedTuple):
    """A mesh that is drawn, its motion, the number of its first facet from 1 on, and how it looks: in the image, and in
    a mirror, None for water, which is not mirrored.
    """

    mesh: Mesh
    mover: Mover | None
    first: float
    look: tuple[str, ...]
    mirrored: tuple[str, ...] | None


class Renderer:
    """A scene on the GPU (or in llvmpipe) rendered at one image size; a context manager, or call `close`.

    sharp takes finer mipmaps than OpenGL does, most of all on surfaces seen at a slant.
    """

    def __init__(
        self,
        parts: tuple[Part, ...],
        light: Light,
        width: int,
        height: int,
        movers: tuple[Mover, ...] = (),
        sky: Texture | None = None,
        sharp: bool = False,
    ) -> None:
        self._gl = GL = gl.functions()
        self.width, self.height = width, height
        self._textures: dict[int, int] = {}
        self._kept: list[Texture] = []
        self._sharp = sharp
        self._meshes = [
            DrawnMesh(self._mesh(half, lit), None, number)
            for number, part in enumerate(parts)
            for half, lit in split_by_lamp(part, light)
        ]
        movers = tuple(replace(mover, world_from_part=lru_cache(KEPT_TIMES)(mover.world_from_part)) for mover in movers)
        self._meshes += [
            DrawnMesh(self._mesh(mover.part, True), mover, len(parts) + k) for k, mover in enumerate(movers)
        ]
        self._meshes.sort(key=lambda item: item.mesh.cutout)
        self.facets = Facets.of(
            [DrawnPart(mesh.part, mover) for mesh, mover, _ in self._meshes], has_sky=sky is not None
        )
        self._outlines = Outlines(self.facets, [number for _, _, number in self._meshes])
        boxes = [(p.vertices.min(axis=0), p.vertices.max(axis=0)) for p in parts]
        self._boxes = np.array(boxes).reshape(-1, 2, 3)
        self._sky = None if sky is None else self._texture(sky, mipmap=False)
        self._target = Target(GL, width, height, numbered=True)
        self._color = np.empty((height, width, 4), dtype=np.uint8)
        self._numbers = np.empty((height, width, 2), dtype=np.float32)
        self._pixels = self._outlines.pixels(np.zeros_like(self._numbers))
        self._seen: Moment | None = None
        self._no_vertices = GL.glGenVertexArrays(1)
        self._depth = self._programs(shaders.DEPTH)
        self._light = Lighting(GL, light, [mesh for mesh, mover, _ in self._meshes if mover is None], self._depth)
        self._draws = self._in_order()
        levels = sorted({level for mesh, _, _ in self._meshes if (level := mirror_level_m(mesh.part)) is not None})
        self._mirrors = {level: Mirror(GL, width, height, level) for level in levels}
        self._lit = {look: self._programs(*look) for look in sorted(self._looks(bool(levels)))}
        self._geometry = self._programs(shaders.GEOMETRY)
        self._sky_program = Program(GL, shaders.SKY_VERTEX, shaders.SKY)
        for program in chain.from_iterable(self._lit.values()):
            self._set_light(program)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def color(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> NDArray[np.uint8]:
        """Square-root coded image (h, w, 3) BGR of a pinhole camera of this renderer's image size."""
        GL = self._gl
        view_projection = _projection(camera) @ GL_FROM_CV @ cam_from_world.matrix
        eye = cam_from_world.inverse().translation
        for mirror in self._mirrors.values():
            self._begin(mirror.target, (mirror.width, mirror.height))
            mirror.begin()
            self._draw(view_projection @ mirror.turned_over, mirror.eye(eye), time_s, mirror)
            mirror.end()
        self._begin(self._target)
        for program in chain.from_iterable(self._lit.values()):
            program.use()
            program.vector("depth_row", cam_from_world.matrix[2])
        self._draw(view_projection, eye, time_s)
        self._read(0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, self._color)
        self._read(1, GL.GL_RG, GL.GL_FLOAT, self._numbers)
        self._seen, self._pixels = Moment(cam_from_world, camera, time_s), self._outlines.pixels(self._numbers)
        return self._outlines.image(self._color, self._pixels, self._seen)

    def _draw(self, view_projection: Array, eye: Array, time_s: float, into: Mirror | None = None) -> None:
        """Draw all meshes, then the sky, into a mirror or the image; water is not mirrored."""
        GL = self._gl
        drawn = [look for look in self._lit if ("MIRRORED" in look) == (into is not None)]
        for program in chain.from_iterable(self._lit[look] for look in drawn):
            program.use()
            if into is not None:
                program.number("water_level", into.level_m)
            program.matrix("view_projection", view_projection)
            program.vector("eye", eye)
            self._light.move(program, time_s)
        self._light.bind()
        for mesh, mover, first, *looks in self._draws:
            look = looks[into is not None]
            if look is None:
                continue
            program = self._lit[look][mesh.cutout]
            program.use()
            self._bind(mesh.part, program, into is not None)
            program.matrix("model", AT_REST if mover is None else mover.world_from_part(time_s).matrix)
            program.number("roughness", mesh.part.roughness)
            program.number("first_facet", first)
            mesh.draw()
        GL.glBindVertexArray(self._no_vertices)
        if self._sky is not None:
            self._sky_program.use()
            self._sky_program.matrix("world_from_clip", np.linalg.inv(view_projection))
            GL.glDepthFunc(GL.GL_GEQUAL)
            GL.glDisable(GL.GL_CULL_FACE)  # the mirror reverses its winding
            GL.glBindTexture(GL.GL_TEXTURE_2D, self._sky)
            GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
            GL.glDepthFunc(GL.GL_GREATER)

    def geometry(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> Geometry:
        """Depth in metres and instances (h, w) at the pixel centres of a pinhole camera of this renderer's size."""
        return self.pixels_seen(cam_from_world, camera, time_s).geometry

    def pixels_seen(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> Pixels:
        """What is visible at the pixel centres: rendered, unless it was for this view before."""
        GL, moment = self._gl, Moment(cam_from_world, camera, time_s)
        if moment.same(self._seen):
            return self._pixels
        self._begin(self._target)
        for program in self._geometry:
            program.use()
            program.matrix("view_projection", _projection(camera) @ GL_FROM_CV @ cam_from_world.matrix)
            program.vector("depth_row", cam_from_world.matrix[2])
        for mesh, mover, first, *_ in self._draws:
            program = self._geometry[mesh.cutout]
            program.use()
            program.matrix("model", AT_REST if mover is None else mover.world_from_part(time_s).matrix)
            program.number("first_facet", first)
            mesh.draw()
        self._read(1, GL.GL_RG, GL.GL_FLOAT, self._numbers)
        self._seen, self._pixels = moment, self._outlines.pixels(self._numbers)
        return self._pixels

    def facet_table(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> FacetTable:
        """The `facets` as they are in view; valid until the next image or table of another view."""
        return self._outlines.table(Moment(cam_from_world, camera, time_s))

    def nearest_m(self, eye: Array) -> float:
        """Lower bound of the distance in metres from a point (3,) in the world to all static parts."""
        if self._boxes.size == 0:
            return FAR_M
        gap = np.maximum(np.maximum(self._boxes[:, 0] - eye, eye - self._boxes[:, 1]), 0.0)
        return float(np.linalg.norm(gap, axis=1).min())

    def close(self) -> None:
        """Release all GPU resources of this renderer."""
        GL = self._gl
        for mesh, _, _ in self._meshes:
            mesh.primitive.delete()
        self._target.delete()
        self._light.delete()
        for mirror in self._mirrors.values():
            mirror.delete()
        if self._textures:
            GL.glDeleteTextures(list(self._textures.values()))
        GL.glDeleteVertexArrays(1, [self._no_vertices])
        for program in chain(*self._lit.values(), self._geometry, self._depth, [self._sky_program]):
            GL.glDeleteProgram(program.id)
        self._meshes, self._textures = [], {}

    def _begin(self, target: Target, size: tuple[int, int] | None = None) -> None:
        GL = self._gl
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, target.id)
        GL.glViewport(0, 0, *(size or (self.width, self.height)))
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_BLEND)
        GL.glClipControl(GL.GL_LOWER_LEFT, GL.GL_ZERO_TO_ONE)
        GL.glDepthFunc(GL.GL_GREATER)
        GL.glClearDepth(0.0)
        GL.glClearColor(0.0, 0.0, 0.0, 0.0)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)

    def _read(self, output: int, layout: int, kind: int, out: NDArray[Any]) -> None:
        self._gl.glReadBuffer(self._gl.GL_COLOR_ATTACHMENT0 + output)
        self._gl.glPixelStorei(self._gl.GL_PACK_ALIGNMENT, 1)
        self._gl.glReadPixels(0, 0, self.width, self.height, layout, kind, out.ctypes.data_as(ctypes.c_void_p))

    def _programs(self, fragment: str, *switches: str) -> tuple[Program, Program]:
        """The program of opaque parts, and that of parts with an alpha mask."""
        switches = (*switches, *(["OWN_LEVELS"] * (not gl.is_llvmpipe())))
        vertex = shaders.with_switches(shaders.VERTEX, *switches)
        solid = Program(self._gl, vertex, shaders.with_switches(fragment, *switches))
        return solid, Program(self._gl, vertex, shaders.with_switches(fragment, *switches, "CUTOUT"))

    def _looks(self, mirrored: bool) -> set[tuple[str, ...]]:
        """Fragment shader and switches of every lit program that the meshes need."""
        looks = {draw.look for draw in self._draws}
        return looks | {draw.mirrored for draw in self._draws if mirrored and draw.mirrored is not None}

    def _in_order(self) -> list[Draw]:
        """The meshes as drawn: those with an alpha mask last; of each kind the structure first, then small ones.

        Pixels that an earlier mesh hides are not shaded, and small things are mostly before large ones. Where faces lie
        in one plane the first one is seen.
        """
        draws = [
            Draw(
                mesh,
                mover,
                first + 1.0,
                self._look(mesh, False),
                None if mesh.part.ripples is not None else self._look(mesh, True),
            )
            for (mesh, mover, _), first in zip(self._meshes, self.facets.first.tolist(), strict=True)
        ]

        def place(draw: Draw) -> tuple[bool, float]:
            part = draw.mesh.part
            size_m = float(np.linalg.norm(np.ptp(part.vertices, axis=0)))
            return draw.mesh.cutout, 0.0 if part.instance == STRUCTURE else size_m

        return sorted(draws, key=place)

    def _look(self, mesh: Mesh, mirrored: bool) -> tuple[str, ...]:
        part, light = mesh.part, self._light
        if part.ripples is not None:
            return (shaders.WATER, *light.haze, *light.clouds)
        switches = [*(("LAMP", *light.switches) if mesh.lit else light.haze), *(["SHARP"] * self._sharp)]
        switches += ["SOIL"] * (part.soil is not None) + ["FILM"] * (part.film is not None)
        switches += ["STANDING"] * (mirror_level_m(part) is not None and not mirrored) + ["MIRRORED"] * mirrored
        return (shaders.SURFACE, *switches)

    def _bind(self, part: Part, program: Program, mirrored: bool) -> None:
        """Bind the textures of a part besides its surface."""
        level, film = mirror_level_m(part), part.film
        if level is not None and not mirrored:
            self._bind_to(MIRROR_UNIT, self._mirrors[level].target.texture)
        if film is not None:
            self._bind_to(FILM_UNIT, self._texture(film.texture))
            program.number("film_per_m", 1 / film.tile_m)
        if part.soil is not None:
            self._bind_to(SOIL_UNIT, self._texture(part.soil))
        self._gl.glActiveTexture(self._gl.GL_TEXTURE0)

    def _bind_to(self, unit: int, texture: int) -> None:
        self._gl.glActiveTexture(self._gl.GL_TEXTURE0 + unit)
        self._gl.glBindTexture(self._gl.GL_TEXTURE_2D, texture)

    def _set_light(self, program: Program) -> None:
        self._light.set(program)
        program.pair("size", (float(self.width), float(self.height)))
        for name, unit in (("surface", 0), ("mirror", MIRROR_UNIT), ("film", FILM_UNIT), ("soil", SOIL_UNIT)):
            program.integer(name, unit)

    def _mesh(self, part: Part, lit: bool) -> Mesh:
        for image in (part.film.texture if part.film is not None else None, part.soil):
            if image is not None:
                self._texture(image)  # uploads it
        surface = part.texture if part.ripples is None else part.ripples
        return Mesh(self._gl, part, self._texture(surface, keeps_cover=part.keeps_cover), lit)

    def _texture(self, source: Texture | None, mipmap: bool = True, keeps_cover: bool = False) -> int:
        image = WHITE if source is None else source
        if id(image) not in self._textures:
            self._kept.append(image)
            self._textures[id(image)] = upload(self._gl, image, mipmap, keeps_cover)
        return self._textures[id(image)]


def _projection(camera: Camera) -> Array:
    """OpenGL projection matrix (4, 4) of a pinhole camera; the image spans -0.5 .. size - 0.5 px.

    Depth is 1 at NEAR_M and 0 at FAR_M: in floats its step is a constant fraction of the distance, so that a pane 2 mm
    before a wall is drawn at every distance.
    """
    w, h = camera.width, camera.height
    depth = FAR_M - NEAR_M
    return np.array(
        [
            [2 * camera.fx / w, 0, 1 - 2 * (camera.cx + 0.5) / w, 0],
            [0, 2 * camera.fy / h, 2 * (camera.cy + 0.5) / h - 1, 0],
            [0, 0, NEAR_M / depth, FAR_M * NEAR_M / depth],
            [0, 0, -1, 0],
        ]
    )
