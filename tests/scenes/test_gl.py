"""Where no OpenGL context can be made, a user is told why and what to install; each case in a process of its own.

And what a driver is free to choose is chosen for it: another one draws textures as llvmpipe does.
"""

import os
import subprocess
import sys
from ctypes.util import find_library

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import panel
from uavbench.scenes.renderables import Part
from uavbench.scenes.rendering import context, gpu
from uavbench.scenes.rendering.renderer import Renderer

with_llvmpipe = pytest.mark.skipif(not context.is_llvmpipe(), reason="compares with llvmpipe, which does not draw here")

CODE = """
import sys
from uavbench.scenes.rendering import context
from uavbench.trajectories.errors import UserError
try:
    context.context()
except UserError as error:
    print(error)
    sys.exit(2)
"""


@pytest.mark.parametrize(
    ("environment", "told"),
    [
        ({"UAVBENCH_GL": "vulkan"}, "UAVBENCH_GL='vulkan': must be egl or osmesa"),
        ({"UAVBENCH_GL": "egl", "EGL_DEVICE_ID": "99"}, "EGL_DEVICE_ID=99, but there are"),
        ({"UAVBENCH_GL": "egl", "EGL_DEVICE_ID": "first"}, "EGL_DEVICE_ID='first' is not a number"),
        ({"UAVBENCH_GL": "egl", "MESA_GL_VERSION_OVERRIDE": "2.1"}, "install it with: apt-get install"),
        ({"UAVBENCH_GL": "", "GALLIUM_DRIVER": "softpipe"}, "softpipe has no OpenGL 4.1"),
        ({"UAVBENCH_GL": "", "GALLIUM_DRIVER": "softpipe"}, "unset GALLIUM_DRIVER='softpipe', or install"),
        ({"UAVBENCH_GL": "osmesa", "GALLIUM_DRIVER": "none"}, "only llvmpipe can draw the scenes, not none"),
    ],
)
def test_a_context_that_cannot_be_made_is_told(environment: dict[str, str], told: str) -> None:
    if "MESA_GL_VERSION_OVERRIDE" in environment and "Mesa" not in context.version():
        pytest.skip("another driver than Mesa, which this variable does not reach")
    process = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert process.returncode == 2, process.stderr
    assert told in process.stdout


WITH_OSMESA = pytest.param(
    "osmesa",
    marks=pytest.mark.skipif(not find_library("OSMesa"), reason="absent: OSMesa (Debian's libosmesa6)"),
)


@pytest.mark.parametrize("optimized", [[], ["-O"], ["-OO"]], ids=["", "-O", "-OO"])
@pytest.mark.parametrize("platform", ["egl", WITH_OSMESA])
def test_the_platform_asked_for_is_the_one_used(platform: str, optimized: list[str]) -> None:
    """Also of a Python that leaves out `assert`, within which pyrender makes its context."""
    code = "from uavbench.scenes.rendering import context; print(context.name(), context.version())"
    process = subprocess.run(
        [sys.executable, *optimized, "-c", code],
        env={**os.environ, "UAVBENCH_GL": platform},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout.startswith(f"{platform} ")


def test_of_pyrender_only_what_is_drawn_with_is_imported_until_more_is_asked_for() -> None:
    code = """
import sys
from uavbench.scenes.rendering import context, gpu
context.context()
from pyrender.primitive import Primitive
assert "trimesh" not in sys.modules
import pyrender
assert not hasattr(pyrender, "__wrapped__") and "trimesh" not in sys.modules
assert pyrender.Primitive is Primitive and pyrender.Mesh and pyrender.__version__
assert not hasattr(pyrender, "nothing")
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@with_llvmpipe
@pytest.mark.parametrize(("shape", "off"), [((64, 128), 0), ((96, 96), 0), ((37, 53), 2), ((100, 140), 2)])
def test_own_mipmaps_are_those_of_llvmpipe(shape: tuple[int, int], off: int) -> None:
    """To the last bit of sides that can be halved; within two codes where an odd side is sampled between its pixels."""
    image = np.random.default_rng(3).integers(0, 256, (*shape, 3), dtype=np.uint8)
    GL = context.functions()
    texture, own = gpu.upload(GL, image, mipmap=True), gpu.halved_levels(image[::-1])
    assert own[-1].shape == (1, 1, 3)
    for level, expected in enumerate(own, 1):
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        data = GL.glGetTexImage(GL.GL_TEXTURE_2D, level, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
        found = np.frombuffer(data, dtype=np.uint8).reshape(expected.shape)
        odd = any(side >> k & 1 for side in shape for k in range(level) if side >> k > 1)
        assert np.abs(found.astype(int) - expected).max() <= off * odd
    GL.glDeleteTextures([texture])


@with_llvmpipe
@pytest.mark.parametrize("sharp", [False, True])
def test_other_drivers_draw_textures_as_llvmpipe_does(sharp: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ground seen at a slant takes every mipmap; drawn by its own levels it differs as `verify --against` allows."""
    noise = cv2.GaussianBlur(np.random.default_rng(5).normal(size=(256, 256, 3)), (0, 0), 1.0)
    image = (128 + 100 * noise).clip(0, 255).astype(np.uint8)
    vertices, triangles, uv = panel((-20.0, -20.0, 0.0), (40.0, 0.0, 0.0), (0.0, 40.0, 0.0), 4.0)
    ground = Part(vertices=vertices, triangles=triangles, uv=uv, texture=image)
    seen = []
    for llvmpipe in (True, False):
        for module in (context, gpu):
            monkeypatch.setattr(module, "is_llvmpipe", lambda llvmpipe=llvmpipe: llvmpipe)
        with Renderer((ground,), FLAT_LIGHT, 160, 120, sharp=sharp) as renderer:
            view = looking((-18.0, -18.0, 3.0), (0.0, 0.0, 0.0)), Camera(160, 120, 120.0, 120.0, 80.0, 60.0)
            seen.append(renderer.color(*view).astype(int))
    off = np.abs(seen[0] - seen[1]).max(axis=2)
    assert seen[0].std() > 8
    assert off.any(), "by other instructions"
    assert (off <= 3).mean() > 0.999
