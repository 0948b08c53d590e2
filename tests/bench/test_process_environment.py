"""What a process's environment makes its libraries do is in the key of every job."""

from dataclasses import replace

import pytest

from tests.bench.small_suites import FLOWN
from uavbench.bench.config.suite import load_suite
from uavbench.bench.inputs.content_hash import code_hash, one_look
from uavbench.bench.inputs.touched_files import touched_since
from uavbench.bench.runner.jobs import plan, plan_flights
from uavbench.tracker.baselines.hold import Hold

LIBRARY = b"\x7fELF one"


@pytest.fixture(autouse=True)
def bare(monkeypatch, tmp_path):
    """No variable of this machine, and a home and a current folder without settings."""
    for name in ("LD_LIBRARY_PATH", "LD_PRELOAD", "LIBGL_DRIVERS_PATH"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libGL.so.1").write_bytes(LIBRARY)
    return tmp_path / "lib"


@pytest.mark.parametrize(
    "name",
    [
        *("OPENCV_CPU_DISABLE", "OPENCV_OPENCL_DEVICE", "NUMBA_DISABLE_JIT", "NUMBA_OPT", "NUMBA_CPU_NAME"),
        *("MESA_GL_VERSION_OVERRIDE", "GALLIUM_DRIVER", "LP_NATIVE_VECTOR_WIDTH", "LIBGL_ALWAYS_SOFTWARE", "DRI_PRIME"),
        *("NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE", "MKL_CBWR", "GLIBC_TUNABLES"),
        *("__GL_FSAA_MODE", "__EGL_VENDOR_LIBRARY_FILENAMES", "LD_PRELOAD", "LD_AUDIT"),
    ],
)
def test_a_variable_that_changes_what_libraries_compute_is_in_every_key(monkeypatch, name):
    monkeypatch.delenv(name, raising=False)
    hashes = [code_hash()]
    for value in ("one", "two"):
        monkeypatch.setenv(name, value)
        hashes.append(code_hash())
    monkeypatch.delenv(name)
    assert len({*hashes}) == 3
    assert code_hash() == hashes[0]


@pytest.mark.parametrize(
    "name",
    [
        *("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMBA_CACHE_DIR"),
        *("MESA_SHADER_CACHE_DIR", "HOME", "LANG", "LC_ALL", "TZ", "EGL_DEVICE_ID", "PYTHONHASHSEED", "UAVBENCH_GL"),
    ],
)
def test_a_variable_that_changes_no_result_is_in_no_key(monkeypatch, name):
    before = code_hash()
    monkeypatch.setenv(name, "7")
    assert code_hash() == before


@pytest.mark.parametrize("name", ["LD_LIBRARY_PATH", "LIBGL_DRIVERS_PATH", "LD_PRELOAD", "LD_AUDIT"])
def test_a_library_that_a_variable_makes_a_process_load_is_in_every_key(monkeypatch, folder, name):
    path = folder / "libGL.so.1"
    monkeypatch.setenv(name, str(path if name in ("LD_PRELOAD", "LD_AUDIT") else folder))
    before = code_hash()
    path.write_bytes(b"\x7fELF two")
    assert code_hash() != before
    path.write_bytes(LIBRARY)
    assert code_hash() == before
    moved = folder.rename(folder.with_name("moved"))
    monkeypatch.setenv(name, str(moved / path.name if name in ("LD_PRELOAD", "LD_AUDIT") else moved))
    assert code_hash() == before, "the same libraries in another place"


def test_every_library_of_every_folder_counts_in_the_order_of_the_search(monkeypatch, folder, tmp_path):
    other = tmp_path / "other"
    (other / "glibc-hwcaps" / "x86-64-v3").mkdir(parents=True)
    hashes = []

    def told(*folders):
        monkeypatch.setenv("LD_LIBRARY_PATH", ":".join(map(str, folders)))
        hashes.append(code_hash())

    told(folder, other)
    (other / "libGL.so.1").write_bytes(b"\x7fELF other")
    told(folder, other)
    told(other, folder)
    (other / "glibc-hwcaps" / "x86-64-v3" / "libGL.so.1").write_bytes(b"\x7fELF wide")
    told(other, folder)
    (tmp_path / "libOpenCL.so").symlink_to(folder / "libGL.so.1")
    told(other, folder, "")  # the current folder
    for name in ("README", "report.json", "results.so.md"):
        (tmp_path / name).write_text("no library")
    told(other, folder, "")
    assert len({*hashes}) == 5 and hashes[-1] == hashes[-2]
    told(tmp_path / "not there")
    told("")


def test_the_descriptions_of_vendors_of_egl_count(monkeypatch, tmp_path):
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", str(tmp_path))
    before = code_hash()
    (tmp_path / "50_mesa.json").write_text("{}")
    assert code_hash() != before


def test_preloaded_libraries_are_separated_by_spaces_or_colons(monkeypatch, folder):
    (folder / "libm.so").write_bytes(b"\x7fELF m")
    for by in (" ", ":"):
        monkeypatch.setenv("LD_PRELOAD", by.join(str(folder / name) for name in ("libGL.so.1", "libm.so")))
        before = code_hash()
        (folder / "libm.so").write_bytes(b"\x7fELF m of" + by.encode())
        assert code_hash() != before


@pytest.mark.parametrize("name", ["home/.drirc", ".numba_config.yaml"])
def test_settings_that_libraries_read_by_themselves_are_in_every_key(tmp_path, name):
    before = code_hash()
    (tmp_path / name).write_text("a setting")
    assert code_hash() != before


def test_every_job_of_a_suite_is_stale_after_another_library(monkeypatch, folder, tmp_path):
    (tmp_path / "few.toml").write_text(FLOWN)
    suite = replace(load_suite(tmp_path / "few.toml"), trackers={"a": Hold()}, protocols=("reset",))

    def keys():
        jobs = [*plan(suite, tmp_path / "out"), *plan_flights(suite, tmp_path / "out", video=True)]
        return {f"{k} {job.name}": job.content_hash for k, job in enumerate(jobs)}

    monkeypatch.setenv("LD_LIBRARY_PATH", str(folder))
    before = keys()
    (folder / "libGL.so.1").write_bytes(b"\x7fELF two")
    after = keys()
    assert before.keys() == after.keys()
    assert [name for name in before if before[name] == after[name]] == []
    (folder / "libGL.so.1").write_bytes(LIBRARY)
    assert touched_since(after, keys, after).jobs == {*after}, "a library that was replaced while jobs ran"


def test_libraries_are_looked_at_once_in_a_look(monkeypatch, folder):
    monkeypatch.setenv("LD_LIBRARY_PATH", str(folder))
    with one_look():
        before = code_hash("tracker")
        (folder / "libGL.so.1").write_bytes(b"\x7fELF two")
        assert code_hash("tracker") == before
    assert code_hash("tracker") != before
