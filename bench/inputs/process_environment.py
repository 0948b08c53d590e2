"""What environment variables make the libraries of a process load and compute.

The machine itself is no input: with no such variable, a folder stays fresh on another processor or GL driver, and the
gate refuses to compare images that differ. A person who sets a variable asks for another computation.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from uavbench.bench.inputs.elsewhere import of_system
from uavbench.bench.inputs.file_paths import is_file
from uavbench.trajectories.sources.digests import file_digest

LIBRARY, VENDOR = re.compile(r".*\.so(\.\d[\w.]*)?"), re.compile(r".*\.json")
"""Names of shared libraries, and of the files that describe a vendor's EGL."""
FOLDERS = {
    "LD_LIBRARY_PATH": LIBRARY,
    "LIBGL_DRIVERS_PATH": LIBRARY,
    "GBM_BACKENDS_PATH": LIBRARY,
    "__EGL_VENDOR_LIBRARY_DIRS": VENDOR,
}
"""Variables that name folders, separated by colons, and the files that count in them; "" is the current folder."""
FILES = ("LD_PRELOAD", "LD_AUDIT", "__EGL_VENDOR_LIBRARY_FILENAMES")
"""Variables that name libraries or their descriptions, separated by colons or spaces."""
APART = re.compile("[: ]+")
WIDE = "glibc-hwcaps/*/*"
"""Pattern of the libraries for certain processors in a folder of libraries."""
SETTINGS = re.compile(
    r"(OPENCV|NUMBA|MESA|GALLIUM|LIBGL|LP|DRI|ST|NIR|__GL|__GLX|__NV|NPY|OPENBLAS|GOTOBLAS|MKL|BLIS)_.+"
    r"|GLIBC_TUNABLES|FREETYPE_PROPERTIES"
)
"""Names of the settings of OpenCV, numba, Mesa, NVIDIA's driver, NumPy, BLAS, glibc and FreeType."""
WITHOUT_EFFECT = re.compile(r".*(_NUM_THREADS|_CACHE|_LOG).*")
"""Settings that change no result: the number of threads, places of caches and logs."""
SETTINGS_FILES = ("~/.drirc", ".numba_config.yaml")
"""Files in which Mesa and numba look for settings by themselves."""


def process_environment() -> list[object]:
    """Settings of libraries by name, and the libraries and files that variables name, by content in order of search."""
    settings = sorted((name, value) for name, value in os.environ.items() if _is_setting(name))
    libraries = [[name, list(map(_form, _files_in(os.environ.get(name, ""), kind)))] for name, kind in FOLDERS.items()]
    files = [[name, list(map(_form, map(Path, APART.split(os.environ.get(name, "")))))] for name in FILES]
    own = [_form(Path(os.path.expanduser(name))) for name in SETTINGS_FILES]  # noqa: PTH111, raises nothing
    return [settings, libraries, files, own]


def _is_setting(name: str) -> bool:
    return bool(SETTINGS.fullmatch(name)) and not WITHOUT_EFFECT.fullmatch(name) and name not in (*FOLDERS, *FILES)


def _files_in(folders: str, kind: re.Pattern[str]) -> Iterator[Path]:
    for place in folders.split(os.pathsep) if folders else ():
        folder = Path(place or os.curdir)
        try:
            each = sorted([*folder.iterdir(), *folder.glob(WIDE)])
        except OSError:
            continue
        yield from (path for path in each if kind.fullmatch(path.name) and is_file(path))


def _form(path: Path) -> list[str]:
    """Name and digest of a file; of one in a system folder, its size and time, since toolkits there have gigabytes."""
    try:
        if not is_file(path):
            return [path.name, "no file"]
        if of_system(path):
            about = path.stat()
            return [path.name, f"{about.st_size} bytes of {about.st_mtime_ns}"]
        return [path.name, file_digest(path)]
    except OSError:
        return [path.name, "not readable"]
