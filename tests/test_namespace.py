"""One namespace: wheel, source archive and editable install work where every name of ours is taken by somebody else."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

import uavbench

ROOT = Path(__file__).parent.parent
INSTALLED_VERSION = "from importlib.metadata import version; print(version('uavbench'))"
NAMES = ("bench", "reports", "scenes", "tracker", "trajectories")


def run(*command, folder, **environment):
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, capture_output=True, text=True, check=False,
        env={**clean, **environment},
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of this tree: a build takes src/uavbench.egg-info away for a while, and fails the tests beside it."""
    without = shutil.ignore_patterns(".*", "out", "__pycache__", "*.egg-info")
    return shutil.copytree(ROOT, tmp_path_factory.mktemp("copy") / "tree", symlinks=True, ignore=without)


@pytest.fixture(scope="module")
def archives(tree, tmp_path_factory):
    """The wheel, and the source archive, of this tree; setuptools has nothing to warn of."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, tree]
    run(*command, folder=folder, PYTHONWARNINGS="error::UserWarning")
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return {"wheel": [wheel], "sdist": [sdist], "editable": ["-e", tree]}


@pytest.fixture(scope="module", params=["wheel", pytest.param("sdist", marks=pytest.mark.ci), "editable"])
def installed(request, archives, tmp_path_factory):
    """The Python of an environment that has uavbench installed this way, and the libraries of this one.

    The wheel was built from the source archive, so what the archive lacks the wheel lacks, too.
    """
    folder = tmp_path_factory.mktemp(request.param) / "environment"
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    purelib = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=folder).strip())
    (purelib / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    options = ["--no-deps", "--no-index", "--no-build-isolation", "--quiet"]
    pip = [sys.executable, "-m", "pip", "--python", python, "install"]
    run(*pip, *options, *archives[request.param], folder=folder, PIP_DISABLE_PIP_VERSION_CHECK="1")
    return python


@pytest.fixture
def hostile(tmp_path):
    """A folder in which every name of ours belongs to somebody else."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('this is the {name} of somebody else')\n")
    for name in ("reports", "metrics"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('of somebody else')\n")
    return tmp_path


def test_the_command_works_among_foreign_names(installed, hostile):
    for command in ([installed.parent / "uavbench"], [installed, "-m", "uavbench"]):
        assert "robust" in run(*command, "list", folder=hostile)


def test_the_api_and_a_spawned_worker_work_among_foreign_names(installed, hostile):
    (hostile / "work.py").write_text(
        "import uavbench as ub\n"
        "from uavbench.bench.runner.executors import local_pool\n"
        "if __name__ == '__main__':\n"
        "    from uavbench.tracker.robust import Robust\n"
        "    with local_pool(1) as (pool, _):\n"
        "        print(pool.submit(ub.Camera.from_field_of_view, 64, 48, 60.0).result().width)\n"
        "    print(Robust.__module__, ub.evaluate.__module__, ub.__version__)\n"
    )
    width, *modules, version = run(installed, "work.py", folder=hostile).split()
    assert width == "64"
    assert modules == ["uavbench.tracker.robust.tracker", "uavbench.reports.evaluation.api"]
    assert version == run(installed, "-c", INSTALLED_VERSION, folder=hostile).strip()


def test_nothing_else_is_installed_at_top_level(installed):
    code = (
        "from importlib.metadata import files\n"
        "print(*sorted({f.parts[0] for f in files('uavbench') if f.parts[0] != '..'}))"
    )
    names = run(installed, "-c", code, folder=installed.parent).split()
    ours = [n for n in names if not n.endswith((".dist-info", ".pth")) and not n.startswith("__editable__")]
    assert set(ours) <= {"uavbench"}
    for name in NAMES:
        missing = f"import importlib.util as u; print(u.find_spec('{name}'))"
        assert run(installed, "-c", missing, folder=installed.parent).strip() == "None"


def test_the_wheel_has_every_file_of_the_packages(archives):
    with zipfile.ZipFile(*archives["wheel"]) as wheel:
        packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
    source = ROOT / "src"
    files = {path for path in source.glob("uavbench/*") if path.is_file()}
    files |= {path for name in NAMES for path in (source / "uavbench" / name).rglob("*") if path.is_file()}
    assert packed == {str(path.relative_to(source)) for path in files if "__pycache__" not in path.parts}


def test_type_checkers_see_its_types(installed):
    code = "import uavbench, pathlib; print(pathlib.Path(uavbench.__file__).with_name('py.typed').is_file())"
    assert run(installed, "-c", code, folder=installed.parent).strip() == "True"


def test_every_folder_of_modules_is_a_package():
    for package in NAMES:
        for module in (ROOT / package).rglob("*.py"):
            assert (module.parent / "__init__.py").is_file(), module


def test_the_citation_names_this_version():
    assert f"\nversion: {uavbench.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
