"""Source files of modules are found without importing anything."""

from uavbench.trajectories.source_files import source_file, sources


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


def test_what_only_type_checkers_import_is_no_part_of_a_module(tmp_path, monkeypatch):
    for name in ("read_of_test", "run_of_test", "else_of_test"):
        (tmp_path / f"{name}.py").touch()
    (tmp_path / "typed_of_test.py").write_text(
        "import typing\nimport run_of_test\nif typing.TYPE_CHECKING:\n    import read_of_test\n"
        "else:\n    import else_of_test\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert {path.stem for path in sources("typed_of_test")} == {"typed_of_test", "run_of_test", "else_of_test"}


def test_a_kernel_is_not_made_of_the_whole_package():
    names = {path.name for path in sources("uavbench.tracker.robust.tracker")}
    assert "solve_kernels.py" in names
    assert not {"render_suite.py", "figures_on_axes.py", "obstacles.py", "seen_edges.py"} & names
