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
