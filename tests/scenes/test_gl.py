"""Where no OpenGL context can be made, a user is told why and what to install; each case in a process of its own."""

import os
import subprocess
import sys
from ctypes.util import find_library

import pytest

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
    process = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert process.returncode == 2, process.stderr
    assert told in process.stdout


WITH_OSMESA = pytest.param(
    "osmesa",
    marks=pytest.mark.skipif(not find_library("OSMesa"), reason="absent: OSMesa (Debian's libosmesa6)"),
)


@pytest.mark.parametrize("platform", ["egl", WITH_OSMESA])
def test_the_platform_asked_for_is_the_one_used(platform: str) -> None:
    code = "from uavbench.scenes.rendering import context; print(context.name(), context.version())"
    process = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "UAVBENCH_GL": platform},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout.startswith(f"{platform} ")
