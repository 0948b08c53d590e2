"""Creation of the OpenGL context, with workarounds for pyrender and PyOpenGL.

pyrender 0.1.45 uses `np.infty` (removed in numpy 2), pins PyOpenGL 3.1.0 (which lacks Python 3.12's name of ctypes
argument objects, and OSMesaCreateContextAttribs), and disables framebuffer objects with OSMesa. No other module may
import OpenGL or pyrender before `context()` has run.
"""

import ctypes
import ctypes.util
import functools
import importlib
import importlib.util
import os
import sys
import types
from typing import Any

import numpy as np

from uavbench.trajectories.errors import UserError

PACKAGES = "apt-get install libegl1 libgl1 libgl1-mesa-dri libosmesa6"
DRIVER = "GALLIUM_DRIVER"
"""Variable that names the driver which Mesa draws with."""
OFTEN = {
    "glActiveTexture": "u",
    "glBindTexture": "uu",
    "glBindVertexArray": "u",
    "glDisable": "u",
    "glDrawElements": "uiup",
    "glEnable": "u",
    "glUniform1f": "if",
    "glUniform1i": "ii",
    "glUniform2f": "iff",
    "glUniform3fv": "iip",
    "glUniform4fv": "iip",
    "glUniformMatrix4fv": "iibp",
    "glUseProgram": "u",
}
"""Functions that are called for every mesh of a frame, with the types of their arguments (see `TYPES`)."""
CLIP_CONTROL = "glClipControl"
"""The one function of OpenGL 4.5 that is called; with OSMesa PyOpenGL does not find it."""
TYPES: dict[str, Any] = {
    "b": ctypes.c_ubyte,
    "f": ctypes.c_float,
    "i": ctypes.c_int,
    "p": ctypes.c_char_p,
    "u": ctypes.c_uint,
}


class GLUnavailableError(UserError):
    """No OpenGL context can be created; the message says why and which packages to install."""


@functools.cache
def context() -> Any:
    """The GL context of this process (a pyrender platform), made current.

    UAVBENCH_GL=egl|osmesa selects the platform; by default EGL is tried first, then OSMesa. GLUnavailableError when no
    context can be created.
    """
    wanted = os.environ.get("UAVBENCH_GL", "")
    probes = {"egl": _probe_egl, "osmesa": _probe_osmesa}
    if wanted and wanted not in probes:
        raise GLUnavailableError(f"UAVBENCH_GL={wanted!r}: must be egl or osmesa")
    reasons = []
    for name in [wanted] if wanted else list(probes):
        reason = probes[name]()
        if reason is None:
            return _make(name)
        reasons.append(f"{name}: {reason}")
    driver = os.environ.get(DRIVER)
    remedy = f"unset {DRIVER}={driver!r}, or install" if driver else "install it with"
    raise GLUnavailableError(f"cannot make an OpenGL context ({'; '.join(reasons)}); {remedy}: {PACKAGES}")


@functools.cache
def functions() -> Any:
    """OpenGL's functions and constants.

    PyOpenGL asks for an error after each call, which takes longer than most calls. Those that are called OFTEN are not
    followed by that question: the next of the others, such as the read of a frame, raises the error.
    """
    context()
    from OpenGL import GL
    from OpenGL.platform import PLATFORM

    bound = {
        name: ctypes.CFUNCTYPE(None, *(TYPES[letter] for letter in letters))((name, PLATFORM.GL))
        for name, letters in OFTEN.items()
    }
    place = PLATFORM.getExtensionProcedure(CLIP_CONTROL.encode())
    if not place:
        raise GLUnavailableError(f"{version()} has no {CLIP_CONTROL}, of OpenGL 4.5; update it with: {PACKAGES}")
    address = int(ctypes.cast(place, ctypes.c_void_p).value or 0)
    bound[CLIP_CONTROL] = ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(address)
    return types.SimpleNamespace(**(vars(GL) | bound))


def name() -> str:
    """Platform of `context()`: `egl` or `osmesa`."""
    context()
    return os.environ["PYOPENGL_PLATFORM"]


def version() -> str:
    """Renderer and version strings of the GL implementation."""
    context()
    from OpenGL import GL

    return " ".join(GL.glGetString(what).decode() for what in (GL.GL_RENDERER, GL.GL_VERSION))


@functools.cache
def is_llvmpipe() -> bool:
    """Whether Mesa's llvmpipe draws, on the processor; with all other drivers textures look as with this one."""
    return version().startswith("llvmpipe")


def _make(kind: str) -> Any:
    os.environ["PYOPENGL_PLATFORM"] = kind
    os.environ.setdefault("LP_NUM_THREADS", "0")  # llvmpipe's threads occupy cores without any speed-up
    if not hasattr(np, "infty"):
        setattr(np, "infty", np.inf)  # noqa: B010  (an assignment is what ruff rewrites)
    _without_viewer()
    _without_scenes()
    from OpenGL.plugins import FormatHandler

    arguments = FormatHandler.by_name("ctypesparameter")
    if "_ctypes.CArgObject" not in arguments.check:
        arguments.check.append("_ctypes.CArgObject")
    if kind == "egl":
        egl = _asserting("pyrender.platforms.egl")
        device = egl.get_device_by_index(int(os.environ.get("EGL_DEVICE_ID", "0")))
        platform: Any = egl.EGLPlatform(16, 16, device=device)
    else:
        platform = _OSMesaPlatform()
    platform.init_context()
    platform.make_current()
    _make_hashable()
    return platform


def _asserting(name: str) -> Any:
    """A module that makes its calls within `assert`, as pyrender's of EGL, which `python -O` would leave out."""
    if __debug__:
        return importlib.import_module(name)
    spec = importlib.util.find_spec(name)
    loader: Any = spec.loader if spec else None
    if spec is None or loader is None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    module = importlib.util.module_from_spec(spec)
    exec(compile(loader.get_source(name), str(spec.origin), "exec", optimize=0), vars(module))
    return module


def _without_viewer() -> None:
    """Keep pyrender from importing its viewer, which needs the X11 libraries even without a window."""
    viewer = types.ModuleType("pyrender.viewer")
    setattr(viewer, "Viewer", None)  # noqa: B010  (the name that pyrender's __init__ asks for)
    sys.modules.setdefault(viewer.__name__, viewer)


def _without_scenes() -> None:
    """Keep pyrender from importing its scenes before one is asked for: their trimesh and SciPy take 0.5 s."""
    spec = importlib.util.find_spec("pyrender")
    if "pyrender" in sys.modules or spec is None or spec.loader is None:
        return
    package, loader = importlib.util.module_from_spec(spec), spec.loader

    def whole(name: str) -> Any:
        if name.startswith("__") and name not in ("__all__", "__version__"):
            raise AttributeError(f"module 'pyrender' has no attribute {name!r}")
        vars(package).pop("__getattr__", None)
        loader.exec_module(package)
        return getattr(package, name)

    setattr(package, "__getattr__", whole)  # noqa: B010  (a module's, PEP 562)
    sys.modules[spec.name] = package


def _make_hashable() -> None:
    """Make the context type hashable: PyOpenGL 3.1.0 keeps data by context, and that of OSMesa has no hash."""
    import OpenGL.platform

    current = OpenGL.platform.PLATFORM.GetCurrentContext()
    try:
        hash(current)
    except TypeError:
        kind: Any = type(current)
        kind.__hash__ = lambda self: hash(self.address)
        kind.__eq__ = lambda self, other: isinstance(other, kind) and self.address == other.address


class _OSMesaPlatform:
    """OSMesa context with a core profile; rendering goes to framebuffer objects, so its own buffer is minimal."""

    FORMAT, PROFILE, CORE, MAJOR, MINOR, DEPTH_BITS = 0x22, 0x33, 0x34, 0x36, 0x37, 0x30
    RGBA, UNSIGNED_BYTE = 0x1908, 0x1401

    def init_context(self) -> None:
        attributes = [self.FORMAT, self.RGBA, self.DEPTH_BITS, 24, self.PROFILE, self.CORE]
        attributes += [self.MAJOR, 3, self.MINOR, 3, 0]
        self._library = _load("OSMesa")
        create = self._library.OSMesaCreateContextAttribs
        create.restype = ctypes.c_void_p
        create.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        self._context = create((ctypes.c_int * len(attributes))(*attributes), None)
        if not self._context:
            raise GLUnavailableError(f"OSMesa cannot make an OpenGL 3.3 context; update it with: {PACKAGES}")
        self._buffer = (ctypes.c_ubyte * (16 * 16 * 4))()

    def make_current(self) -> None:
        make = self._library.OSMesaMakeCurrent
        make.restype = ctypes.c_ubyte
        make.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_int]
        if not make(self._context, self._buffer, self.UNSIGNED_BYTE, 16, 16):
            raise GLUnavailableError(f"OSMesa cannot activate its context; reinstall it with: {PACKAGES}")

    def supports_framebuffers(self) -> bool:
        return True


def _load(library: str) -> ctypes.CDLL:
    """Load a shared library by its base name; OSError when it is missing."""
    found = ctypes.util.find_library(library)
    if found is None:
        raise OSError(f"no lib{library} on this machine")
    return ctypes.CDLL(found, mode=ctypes.RTLD_GLOBAL)


def _probe_osmesa() -> str | None:
    """None when OSMesa can create a core context, otherwise the reason."""
    driver = os.environ.get(DRIVER) or "llvmpipe"
    if driver != "llvmpipe":  # without the driver that is named OSMesa crashes
        return f"of OSMesa's drivers only llvmpipe can draw the scenes, not {driver}"
    try:
        _load("OSMesa").OSMesaCreateContextAttribs  # noqa: B018  (looks the symbol up)
    except (OSError, AttributeError) as error:
        return str(error)
    return None


def _probe_egl() -> str | None:
    """None when EGL can create a desktop OpenGL context, otherwise the reason.

    Probed through ctypes, since PyOpenGL cannot change its platform once it is imported.
    """
    if os.environ.get(DRIVER) == "softpipe":
        return "the driver softpipe has no OpenGL 4.1"
    try:
        egl = _load("EGL")
        _load("GL")
    except OSError as error:
        return str(error)
    pointer, integer = ctypes.c_void_p, ctypes.c_int
    egl.eglGetProcAddress.restype = pointer
    query_address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    display_address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not (query_address and display_address):
        return "libEGL cannot list devices"
    query = ctypes.CFUNCTYPE(integer, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(query_address)
    get_display = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, pointer)(display_address)
    devices, count = (pointer * 16)(), integer()
    if not query(16, devices, ctypes.byref(count)) or count.value < 1:
        return "no EGL device (is libgl1-mesa-dri installed?)"
    wanted_device = os.environ.get("EGL_DEVICE_ID", "0")
    if not wanted_device.isdigit():
        return f"EGL_DEVICE_ID={wanted_device!r} is not a number"
    index = int(wanted_device)
    if index >= count.value:
        return f"EGL_DEVICE_ID={index}, but there are {count.value} devices"
    display = pointer(get_display(0x313F, devices[index], None))  # EGL_PLATFORM_DEVICE_EXT
    if not egl.eglInitialize(display, None, None):
        return "the EGL device cannot be initialized"
    config, found = pointer(), integer()
    wanted = (integer * 7)(0x3033, 1, 0x3040, 8, 0x3025, 24, 0x3038)  # pbuffer, OpenGL, 24 bits of depth
    if not egl.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(found)) or not found.value:
        return "EGL has no configuration for desktop OpenGL"
    egl.eglBindAPI(0x30A2)  # EGL_OPENGL_API
    egl.eglCreateContext.restype = pointer
    egl.eglCreateContext.argtypes = [pointer, pointer, pointer, ctypes.POINTER(integer)]
    version = (integer * 7)(0x3098, 4, 0x30FB, 1, 0x30FD, 1, 0x3038)  # OpenGL 4.1 core
    made = pointer(egl.eglCreateContext(display, config, None, version))
    if not made:
        return "EGL cannot make an OpenGL 4.1 context"
    egl.eglDestroyContext(display, made)
    egl.eglTerminate(display)
    return None
