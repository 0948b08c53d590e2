"""Source files of modules are found without importing anything."""

from uavbench.trajectories.source_files import made_of, source_file, sources


def test_a_module_in_folders_without_init_is_found(tmp_path, monkeypatch):
    folder = tmp_path / "room_of_test" / "inner" / "innermost"
    folder.mkdir(parents=True)
    (folder / "leaf.py").write_text("import os\n")
    (tmp_path / "reader_of_test.py").write_text("import room_of_test.inner.innermost.leaf\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert source_file("room_of_test.inner.innermost.leaf") == folder / "leaf.py"
    assert source_file("room_of_test.inner.innermost") is None
    assert source_file("room_of_test.inner.absent.leaf") is None
    assert folder / "leaf.py" in sources("reader_of_test")


def test_a_library_of_another_environment_is_installed(tmp_path, monkeypatch):
    folder = tmp_path / "lib" / "site-packages"
    folder.mkdir(parents=True)
    (folder / "library_of_test.py").write_text("import os\n")
    monkeypatch.syspath_prepend(folder)
    assert source_file("library_of_test") is None
    assert source_file("uavbench.trajectories.pose") is not None


def test_imports_for_type_checkers_are_not_what_a_module_runs(tmp_path, monkeypatch):
    (tmp_path / "hinted_of_test.py").write_text("A = 1\n")
    (tmp_path / "run_of_test.py").write_text("B = 1\n")
    (tmp_path / "lazy_of_test.py").write_text(
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    import hinted_of_test\nelse:\n    import run_of_test\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert sources("lazy_of_test") == {tmp_path / "lazy_of_test.py", tmp_path / "run_of_test.py"}
    assert tmp_path / "hinted_of_test.py" in made_of(["lazy_of_test"]).files


def test_a_kernel_is_not_made_of_what_is_above_it():
    rooms = {path.parts[-3] for path in sources("uavbench.trajectories.reproducible_math")}
    assert not rooms & {"bench", "reports", "scenes", "tracker"}
    names = {path.as_posix().rpartition("/uavbench/")[2] for path in sources("uavbench.tracker.geometry_kernels")}
    assert "trajectories/kernels/compiled.py" in names
    assert not [name for name in names if name.startswith(("bench/", "reports/"))]
