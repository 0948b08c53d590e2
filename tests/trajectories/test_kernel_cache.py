"""A compiled kernel is that of the source as it stands, whichever file a part of it stands in."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import pytest

from uavbench.trajectories.kernels.cache import KEPT_DAYS, MARKER, KernelCache, folder_of, remove_old
from uavbench.trajectories.kernels.pipeline import KernelCompiler
from uavbench.trajectories.sources.dependencies import sources

ROOT = Path(__file__).parents[2]
TREE = {
    "scale": "SCALE = 2.0\n",
    "plant": "from typing import NamedTuple\n\n\nclass Plant(NamedTuple):\n    mass: float\n    drag: float\n",
    "inner": """from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.scale import SCALE
OFFSET = 1.0


@compiled
def inner(x):
    return SCALE * x + OFFSET
""",
    "outer": """from uavbench.trajectories import inner as below
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.plant import Plant
step = below.inner


@compiled
def outer(plant: Plant):
    return step(plant.mass)
""",
}
RUN = """import sys
from uavbench.trajectories.outer import outer
from uavbench.trajectories.plant import Plant
made = Plant(3.0, 5.0)
print(outer(made), sum(outer.stats.cache_hits.values()))
"""
CALLED_BY_ANOTHER = """
from uavbench.trajectories.kernels.compiled import compiled
@compiled
def caller(plant):
    return outer(plant) + 1.0
assert caller(made) == outer(made) + 1.0
"""


@pytest.fixture
def tree(tmp_path):
    folder = tmp_path / "tree" / "uavbench" / "trajectories"
    folder.parent.mkdir(parents=True)
    (folder.parent / "__init__.py").touch()
    shutil.copytree(ROOT / "trajectories", folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in TREE.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def ran(tree, more=""):
    """What the kernel returned, and whether it was on disk; `more` is run after it."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "PYTHON"))}
    env = {**kept, "XDG_CACHE_HOME": str(tree.parents[1] / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", RUN + more]
    run = subprocess.run(command, cwd=tree.parents[1], env=env, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    result, hits = run.stdout.split()
    return float(result), bool(int(hits))


def edit(tree, name, old, new):
    text = (tree / f"{name}.py").read_text()
    assert old in text
    (tree / f"{name}.py").write_text(text.replace(old, new))


def test_a_kernel_follows_the_source_of_all_that_it_is_made_of(tree):
    assert ran(tree) == (7.0, False)
    assert ran(tree, CALLED_BY_ANOTHER) == (7.0, True)  # one from the disk and one that is compiled fit together
    edit(tree, "inner", "OFFSET = 1.0", "OFFSET = 9.0")  # a constant of what it calls
    assert ran(tree) == (15.0, False)
    edit(tree, "scale", "2.0", "4.0")  # a constant that what it calls has from elsewhere
    assert ran(tree) == (21.0, False)
    swapped = "    drag: float\n    mass: float\n"
    edit(tree, "plant", "    mass: float\n    drag: float\n", swapped)  # what its argument is
    assert ran(tree) == (29.0, False)


def test_a_kernel_follows_the_settings_that_numba_finds_in_the_current_folder(tree):
    """Of them `fastmath` or `cpu_name` would change its numbers."""
    ran(tree)
    (tree.parents[1] / ".numba_config.yaml").write_text("opt: 0\n")
    assert ran(tree) == (7.0, False)
    assert ran(tree) == (7.0, True)


def test_a_source_edited_after_its_import_is_never_kept(tree):
    edited = tree / "scale.py"
    change = f"open({str(edited)!r}, 'w').write('SCALE = 100.0')\n"
    before, call = RUN.split("print")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "PYTHON"))}
    env = {**kept, "XDG_CACHE_HOME": str(tree.parents[1] / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", f"{before}{change}print{call}"]
    run = subprocess.run(command, cwd=tree.parents[1], env=env, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["7.0", "0"], "the code that was imported"
    assert ran(tree) == (301.0, False), "the code that stands there now"


def test_kernels_are_kept_elsewhere_where_the_cache_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    place, key = folder_of.__wrapped__, "0" * 32
    assert place(key) == tmp_path / "numba" / "uavbench-kernels" / key
    (tmp_path / "numba" / MARKER).touch()  # as an external program is told: ours stay where they are
    assert place(key) == tmp_path / "cache" / "uavbench" / "kernels" / key
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert place(key) == tmp_path / "cache" / "uavbench" / "kernels" / key
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    own = place(key).parent
    assert own.parent == tmp_path / "tmp"
    own.chmod(0o777)  # somebody else could put code there
    assert place(key) is None


def test_a_home_that_is_missing_is_not_made_for_kernels(tmp_path, monkeypatch):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    place, key = folder_of.__wrapped__, "0" * 32
    assert place(key).parent.parent == tmp_path and not (tmp_path / "home").exists()
    (tmp_path / "home").mkdir()
    assert place(key) == tmp_path / "home" / ".cache" / "uavbench" / "kernels" / key


def test_a_broken_file_is_compiled_anew(tmp_path):
    def hits():
        kernel = numba.njit(pipeline_class=KernelCompiler)(scaled)
        kernel._cache = KernelCache("scaled", lambda: tmp_path)
        assert kernel(3.0) == 6.0
        return sum(kernel.stats.cache_hits.values())

    assert [hits(), hits()] == [0, 1]
    (path,) = tmp_path.glob("*.nbc")
    path.write_bytes(path.read_bytes()[:100])
    assert [hits(), hits()] == [0, 1]
    shutil.rmtree(tmp_path)
    tmp_path.write_text("in the way")
    assert hits() == 0


def scaled(x):
    return 2.0 * x


def test_only_old_kernels_of_ours_are_removed(tmp_path):
    def folder(number, days, *names):
        made = tmp_path / f"{number:032x}"
        made.mkdir()
        for name in names:
            (made / name).write_text("x")
            os.utime(made / name, (made.stat().st_mtime - days * 86400.0,) * 2)
        return made

    old = folder(1, KEPT_DAYS + 1, MARKER, "a.nbc", ".a-half.nbc")
    new = folder(2, KEPT_DAYS - 1, MARKER, "a.nbc")
    foreign = folder(3, KEPT_DAYS + 1, "a.nbc")
    mixed = folder(4, KEPT_DAYS + 1, MARKER, "a.nbc", "thesis.tex")
    other = tmp_path / "notes"
    other.mkdir()
    link = tmp_path / f"{5:032x}"
    link.symlink_to(foreign)
    remove_old(tmp_path)
    assert not old.exists()
    assert (new / "a.nbc").exists()
    assert (foreign / "a.nbc").exists()
    assert (mixed / "thesis.tex").exists()
    assert other.exists() and link.is_symlink()


def test_folders_without_an_init_are_found_in_a_package_that_is_not_imported(tmp_path, monkeypatch):
    module = tmp_path / "own_package" / "plain" / "deep" / "module.py"
    module.parent.mkdir(parents=True)
    (tmp_path / "own_package" / "__init__.py").touch()
    module.write_text("VALUE = 1\n")
    (tmp_path / "own_user.py").write_text("def later():\n    from own_package.plain.deep import module, missing\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert module in sources("own_user")


def test_every_kernel_of_the_project_is_kept_by_its_sources():
    from uavbench.tracker import registry as variants  # noqa: F401, loads the kernels
    from uavbench.trajectories.simulation import simulate  # noqa: F401

    kernels = [
        (module, value)
        for name, module in list(sys.modules.items())
        if name.startswith(("uavbench.trajectories.", "uavbench.scenes.", "uavbench.tracker.")) and module is not None
        for value in vars(module).values()
        if hasattr(value, "py_func") and value.py_func.__module__ == name
    ]
    assert len(kernels) > 80
    for module, kernel in kernels:
        assert kernel._cache.folder is not None, kernel
        assert Path(module.__file__) in sources(module.__name__)
    names = {path.name for path in sources("uavbench.tracker.robust.edges.steps.step_kernels")}
    assert {"step_kernels.py", "profile_kernels.py", "pose.py", "compiled.py", "__init__.py"} <= names
    assert not {"numba", "numpy"} & {
        part for path in sources("uavbench.tracker.robust.edges.steps.step_kernels") for part in path.parts
    }
