"""Every library whose version or build may change a result is in the key of that result."""

import base64
import hashlib
import os
import re
import subprocess
import sys
import tomllib
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import Distribution, PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

import pytest

from uavbench.bench.inputs import library_builds as builds
from uavbench.bench.inputs.content_hash import code_hash, content_hash, sources_hash
from uavbench.bench.inputs.library_builds import LIBRARIES, READ_WITH, blas_build, build, library_builds, opencv_build
from uavbench.bench.inputs.plugin_files import _distributions
from uavbench.scenes.model_files.mesh_file import MeshFile

PYPROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OF_THE_COMMAND_ALONE = {"annotated-types", "click", "manifold3d", "tqdm"}
"""Dependencies that change no file that a job writes."""
WITHOUT_KEPT_RESULTS = {
    "dask": "runs jobs, whose keys its workers compare",
    "submitit": "starts shards of jobs",
    "gymnasium": "steps flights without keeping them",
    "ruptures": "computed anew by each `history`",
    "rerun-sdk": "computed anew by each `export`",
    "pytest": "times",
    "pytest-benchmark": "times",
}
"""Optional dependencies of no key, and why."""


def names(requirements):
    return {re.match(r"[\w-]+", line)[0] for line in requirements}


DEPENDENCIES = names(PYPROJECT["dependencies"]) - OF_THE_COMMAND_ALONE
OPTIONAL = names(line for lines in PYPROJECT["optional-dependencies"].values() for line in lines)


class Installed(Distribution):
    """A distribution of one compiled file in a folder."""

    def __init__(self, folder, version="1.0"):
        self.folder, self.number = folder, version

    def read_text(self, filename):
        path = self.folder / "x-1.0.dist-info" / filename
        return f"Name: x\nVersion: {self.number}\n" if filename == "METADATA" else path.read_text()

    def locate_file(self, path):
        return self.folder / path


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs a file of this content as `x`."""

    def install(content, version="1.0"):
        (tmp_path / "x-1.0.dist-info").mkdir(exist_ok=True)
        (tmp_path / "x.so.1").write_bytes(content)
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
        record = f"x.py,sha256=abc,3\nx.so.1,sha256={digest},{len(content)}\nx-1.0.dist-info/RECORD,,\n"
        (tmp_path / "x-1.0.dist-info" / "RECORD").write_text(record)
        monkeypatch.setattr(builds, "distribution", lambda name: Installed(tmp_path, version))

    return install


@pytest.mark.parametrize("library", sorted({*DEPENDENCIES, "llvmlite", "PyOpenGL"}))
def test_another_version_of_a_library_is_other_code(monkeypatch, library):
    monkeypatch.setattr("uavbench.bench.inputs.content_hash._builds", library_builds)  # read anew each time
    before = sources_hash.__wrapped__()
    found = builds.distribution

    class Other:
        version = "0.0.1"

        def read_text(self, name):
            return None

    monkeypatch.setattr(builds, "distribution", lambda name: Other() if name == library else found(name))
    assert sources_hash.__wrapped__() != before


def test_an_optional_library_is_in_the_key_of_what_it_reads_or_makes_nothing_that_is_kept():
    assert set(READ_WITH.values()) | set(WITHOUT_KEPT_RESULTS) == OPTIONAL
    assert not set(READ_WITH.values()) & set(WITHOUT_KEPT_RESULTS)


@pytest.mark.parametrize("ending", READ_WITH)
def test_another_version_of_an_optional_library_is_in_the_keys_of_its_files_alone(tmp_path, installed, ending):
    path, other = tmp_path / f"model{ending.upper()}", tmp_path / "model.obj"
    for each in (path, other):
        each.write_text("")
    keys = []
    for number in ("0.1", "0.2"):
        installed(b"one", number)
        keys.append([content_hash(MeshFile(path=str(each))) for each in (path, other)])
    assert keys[0][0] != keys[1][0]
    assert keys[0][1] == keys[1][1]


def test_the_compiled_modules_of_libraries_belong_to_distributions_in_the_key():
    """Those of mujoco are in another one since its version 4."""
    providers = packages_distributions()
    for module in ("cv2", "mujoco", "numba", "llvmlite", "numpy", "scipy", "contourpy", "matplotlib", "pandas", "PIL"):
        with_compiled = {name for name in providers[module] if len(build(name)) > 2}
        assert with_compiled & {*LIBRARIES} or module == "cv2", module


def test_another_build_of_the_same_version_is_another_key(installed):
    installed(b"\x7fELF one")
    one = build("x")
    installed(b"\x7fELF two")
    two = build("x")
    installed(b"\x7fELF one")
    assert build("x") == one != two
    assert one[:2] == two[:2] == ["x", "1.0"]


def test_a_file_that_was_written_after_its_installation_counts_by_its_content(tmp_path, installed):
    keys = []
    for content in (b"two", b"three"):
        installed(b"one")
        path = tmp_path / "x.so.1"
        before = path.stat()
        path.write_bytes(content)
        if len(content) != len(b"one"):
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))  # another size, at the same time
        else:
            os.utime(path, ns=(2 * before.st_mtime_ns, 2 * before.st_mtime_ns))
        keys.append(build("x"))
        assert keys[-1][2] == hashlib.sha256(content).hexdigest()
    path.unlink()
    keys.append(build("x"))
    installed(b"one")
    assert len({*map(tuple, keys), tuple(build("x"))}) == 4


def test_a_library_that_is_absent_has_a_key(monkeypatch):
    def absent(name):
        raise PackageNotFoundError(name)

    before = library_builds()
    monkeypatch.setattr(builds, "distribution", absent)
    assert build("numpy") == ["numpy"]
    assert library_builds() != before


def test_a_library_that_records_no_files_has_its_version(monkeypatch, tmp_path):
    class Bare(Installed):
        def read_text(self, filename):
            return None if filename == "RECORD" else super().read_text(filename)

    monkeypatch.setattr(builds, "distribution", lambda name: Bare(tmp_path))
    assert build("x") == ["x", "1.0"]


def test_opencv_is_told_apart_by_its_description_and_by_the_file_that_is_loaded(tmp_path, monkeypatch):
    """Two builds of a version number differ in their modules, compiler or time; a local one is of no distribution."""
    before = opencv_build()
    assert len(before) > 2 or not builds.LOADED.is_file()
    assert code_hash()
    monkeypatch.setattr(builds.cv2, "getBuildInformation", lambda: "contrib")
    other = opencv_build()
    assert other[1] != before[1] and other[2:] == before[2:]
    local, maps = tmp_path / "cv2.cpython-311-x86_64-linux-gnu.so", tmp_path / "maps"
    maps.write_text(f"7f00-7f01 r--p 0 00:1 1     {local}\n7f01-7f02 r-xp 0 00:1 1     {local}\n7f03-7f04 rw-p 0 0 0\n")
    monkeypatch.setattr(builds, "LOADED", maps)
    keys = []
    for content in (b"one", b"two"):
        local.write_bytes(content)
        keys.append(opencv_build())
        assert keys[-1][2:] == [hashlib.sha256(content).hexdigest()]
    local.unlink()
    assert opencv_build()[2:] == ["not readable"]
    maps.unlink()
    assert opencv_build()[2:] == []


def test_versions_are_those_that_are_installed():
    assert build("numpy")[1] == version("numpy")


def test_the_blas_of_an_environment_is_in_the_key_by_its_content(tmp_path, monkeypatch):
    """As conda installs it: apart from NumPy and SciPy, and chosen by a link."""
    maps = tmp_path / "maps"
    monkeypatch.setattr(builds, "LOADED", maps)
    keys = []
    for name in ("libopenblasp-r0.3.30.so", "libblas.so.3", "libmkl_rt.so.2", "liblapack.so.3", "libz.so.1"):
        maps.write_text(f"7f00-7f01 r-xp 00000000 00:00 0    {tmp_path / name}\n7f02-7f03 rw-p 00000000 00:00 0 \n")
        for content in (b"one", b"two"):
            (tmp_path / name).write_bytes(content)
            keys.append(blas_build())
    of_libraries, of_another = keys[:-2], keys[-2:]
    assert all(one != two for one, two in zip(of_libraries[::2], of_libraries[1::2], strict=True))
    assert of_another == [["blas"], ["blas"]]


def test_the_blas_that_this_process_computes_with_is_in_every_key():
    assert len(blas_build()) > 1
    assert blas_build() in library_builds()


ASKED_BEFORE_AND_AFTER = """
import sys
from uavbench.bench.inputs.library_builds import blas_build
before = blas_build()
assert "scipy.linalg" not in sys.modules, "it takes long to import"
import scipy.linalg
print(before == blas_build())
"""


def test_the_blas_of_scipy_is_known_before_scipy_computes():
    done = subprocess.run([sys.executable, "-c", ASKED_BEFORE_AND_AFTER], capture_output=True, text=True, check=False)
    assert done.stdout == "True\n", done.stderr


def is_compiled_alone(module):
    """Whether a module is one compiled file, in no package."""
    spec = find_spec(module)
    return spec is not None and str(spec.origin).endswith(tuple(EXTENSION_SUFFIXES))


def test_the_owners_of_modules_are_those_that_python_finds_in_the_records():
    found, all_of_them = _distributions(), packages_distributions()
    if sys.version_info < (3, 12):  # which finds no such modules
        all_of_them = {
            each: found[each] for each in found.keys() - all_of_them.keys() if is_compiled_alone(each)
        } | all_of_them
    assert found.items() <= all_of_them.items()
    for module in all_of_them.keys() - found.keys():  # of later versions of Python: folders of no code
        assert not module.isidentifier() or (spec := find_spec(module)) is None or spec.origin is None, module
