"""Builds of the libraries that results depend on: their versions, and the digests of their compiled files.

One version of OpenCV is built with and without contributed modules, by its makers and by users; NumPy with any BLAS. An
installer records a digest of each file, so that only files that were written since need to be read.
"""

import base64
import csv
import ctypes
import hashlib
import re
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import cv2
import scipy

from uavbench.trajectories.sources.digests import file_digest

LIBRARIES = (
    *("numpy", "scipy", "opencv-python-headless", "numba", "llvmlite", "mujoco", "mujoco-core", "trimesh", "pillow"),
    *("pyrender", "PyOpenGL", "pandas", "matplotlib", "contourpy", "jinja2", "pydantic"),
)
"""Libraries whose build may affect a frame, an estimate, a score or a figure."""
READ_WITH = {".ifc": "ifcopenshell", ".mcap": "rosbags", ".db3": "rosbags"}
"""Optional libraries by the ending of the files that they read: the key of what is made from such a file holds them."""
OPENCVS = [f"opencv-{contrib}python{headless}" for contrib in ("", "contrib-") for headless in ("", "-headless")]
"""Distributions of OpenCV; the one installed last provides `cv2`."""
RECORD = re.compile(r"^\S*\.dist-info/RECORD(?=,)", re.MULTILINE)
COMPILED = re.compile(r"^.*\.so[.\d]*\"?,sha256=.*$", re.MULTILINE)
ANY_FILE = re.compile(r"^\"?(?!\.\./|__editable__|[^/\n]*\.dist-info/|[^/\n]*\.pth\"?,).*,sha256=.*$", re.MULTILINE)
"""Lines of a record of compiled files, and of all but those that tell how and where a distribution is installed."""
LOADED = Path("/proc/self/maps")
LOADED_OPENCV = re.compile(r"/.*/(?:cv2|libopencv_)[^/\n]*\.so[^/\n]*$", re.MULTILINE)
"""OpenCV's files among those that a process has loaded."""
LOADED_BLAS = re.compile(r"/.*/lib(?:[^/\n]*(?:blas|lapack)|mkl_|blis|atlas)[^/\n]*\.so[^/\n]*$", re.MULTILINE)
"""Files of BLAS and LAPACK, which conda and systems install apart from NumPy and SciPy."""
LINKED_WITH_BLAS = ("numpy", "scipy")
"""Distributions whose modules compute with them."""
BLAS_OF_SCIPY = ("_fblas", "_flapack")
"""Compiled modules of `scipy.linalg` with which those of SciPy are loaded; those of NumPy are with NumPy."""


def library_builds() -> list[list[str]]:
    """Builds of all libraries."""
    return [*map(build, LIBRARIES), opencv_build(), blas_build()]


def build(name: str) -> list[str]:
    """Name and version of a distribution, and the digests of its compiled files; only the name where it is absent."""
    try:
        found = distribution(name)
    except PackageNotFoundError:
        return [name]
    return [name, found.version, *sorted(recorded(found, COMPILED).values())]


def opencv_build() -> list[str]:
    """OpenCV's own description of its build, and the digests of the files of `cv2`."""
    about = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()
    known: dict[Path, str] = {}
    for name in OPENCVS:
        try:
            known |= recorded(distribution(name), COMPILED)
        except PackageNotFoundError:
            continue
    return ["cv2", about, *sorted(known.get(path) or _digest(path) for path in _loaded(LOADED_OPENCV))]


def blas_build() -> list[str]:
    """Digests of the BLAS and LAPACK that NumPy and SciPy compute with."""
    _load_blas_of_scipy()
    known: dict[Path, str] = {}
    for name in LINKED_WITH_BLAS:
        try:
            known |= recorded(distribution(name), COMPILED)
        except PackageNotFoundError:
            continue
    return ["blas", *sorted(known.get(path) or _digest(path) for path in _loaded(LOADED_BLAS))]


def _load_blas_of_scipy() -> None:
    """Load what `scipy.linalg` is linked with, without its package, whose import takes 0.15 s of each command."""
    folders = [str(Path(place) / "linalg") for place in scipy.__path__]
    for name in BLAS_OF_SCIPY:
        spec = PathFinder.find_spec(name, folders)
        if spec is None or spec.origin is None:  # a version in which it has another name
            import_module("scipy.linalg")
        else:
            ctypes.CDLL(spec.origin)


def recorded(found: Distribution, lines: re.Pattern[str]) -> dict[Path, str]:
    """sha256 of a distribution's files in these lines of its record, or read where one is newer or of other size."""
    text = found.read_text("RECORD") or ""
    record = RECORD.search(text)
    if record is None:
        return {}
    written_ns = _at(found, record[0]).stat().st_mtime_ns
    digests: dict[Path, str] = {}
    for name, digest, size in csv.reader(lines.findall(text)):
        path = _at(found, name)
        try:
            about = path.stat()
            is_unchanged = about.st_mtime_ns <= written_ns and str(about.st_size) == size
        except OSError:
            is_unchanged = False
        digests[path] = _hex(digest) if is_unchanged else _digest(path)
    return digests


def _digest(path: Path) -> str:
    try:
        return file_digest(path)
    except OSError:  # removed while it is in use, by an upgrade
        return "not readable"


def _loaded(kind: re.Pattern[str]) -> set[Path]:
    try:
        return {Path(path) for path in kind.findall(LOADED.read_text(encoding="utf-8", errors="replace"))}
    except OSError:
        return set()


def _at(found: Distribution, name: str) -> Path:
    return Path(str(found.locate_file(name)))


def _hex(recorded: str) -> str:
    """A digest of an installer's record, `sha256=` with base64, as hexadecimal digits."""
    return base64.urlsafe_b64decode(recorded.removeprefix("sha256=") + "==").hex()
