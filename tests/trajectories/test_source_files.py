"""Source files of modules are found without importing anything."""

from uavbench.trajectories import source_files
from uavbench.trajectories.kernels import kept_imports
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


def test_what_a_package_gives_on_demand_counts_where_the_package_itself_is_imported(tmp_path, monkeypatch):
    folder = tmp_path / "giving_of_test"
    folder.mkdir()
    (folder / "__init__.py").write_text(
        "import typing\nfrom typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from giving_of_test.given import GIVEN\nelse:\n    import giving_of_test.run as run\n"
        "if typing.TYPE_CHECKING:\n    import giving_of_test.given\n"
        "def __getattr__(name):\n    pass\n"
    )
    for name in ("given", "run", "leaf", "annotation"):
        (folder / f"{name}.py").write_text("GIVEN = 1\n")
    (folder / "leaf.py").write_text("if TYPE_CHECKING:\n    import giving_of_test.annotation\n")
    monkeypatch.syspath_prepend(tmp_path)

    def names(text):
        (tmp_path / "user_of_test.py").write_text(text)
        return {path.stem for path in sources("user_of_test")} - {"user_of_test", "__init__"}

    assert names("from giving_of_test.leaf import GIVEN\n") == {"leaf", "run"}
    assert names("import giving_of_test.leaf as leaf\n") == {"leaf", "run"}
    assert names("import giving_of_test.leaf\n") == {"leaf", "run", "given"}
    assert names("from giving_of_test import GIVEN\n") == {"run", "given"}
    assert names("import giving_of_test\n") == {"run", "given"}


def test_a_kernel_does_not_depend_on_the_whole_project():
    found = sources("uavbench.tracker.robust.edge_fit")
    rooms = {path.as_posix().rpartition("/uavbench/")[2].partition("/")[0] for path in found}
    assert rooms <= {"__init__.py", "tracker", "scenes", "trajectories"}


def test_a_tracker_is_not_made_of_what_draws_renders_or_schedules():
    names = {path.name for path in sources("uavbench.tracker.robust.tracker")}
    assert "solve_kernels.py" in names
    assert not {"render_suite.py", "figures_on_axes.py", "obstacles.py", "seen_edges.py"} & names


def test_what_other_processes_read_of_a_file_is_taken_for_this_very_content_alone(tmp_path, monkeypatch):
    """One process's reading serves the next; an edited file, or one that was kept broken, is read anew."""
    places = {"kept": tmp_path / "kept"}
    places["kept"].mkdir()
    for name in ("first_of_test", "second_of_test"):
        (tmp_path / f"{name}.py").write_text("VALUE = 1\n")
    user = tmp_path / "reader_of_kept.py"
    user.write_text("import first_of_test\n")
    monkeypatch.syspath_prepend(tmp_path)

    def names():
        """As a new process finds them."""
        monkeypatch.setattr(source_files, "known_imports", {})
        source_files._imports.cache_clear()
        kept_imports._recall.cache_clear()
        with kept_imports.remembered(lambda key: places["kept"]):
            known = len(source_files.known_imports)
            return {path.stem for path in sources("reader_of_kept")} - {"reader_of_kept"}, known

    kept = places["kept"] / kept_imports.FILE
    assert names() == ({"first_of_test"}, 0)
    assert names() == ({"first_of_test"}, 2)
    user.write_text("import second_of_test\n")
    assert names()[0] == {"second_of_test"}
    for broken in ("{", '{"a": 1}', '{"a": [1]}', "[]", "\xff"):
        kept.write_text(broken, encoding="latin-1")
        assert names() == ({"second_of_test"}, 0), broken
    assert names() == ({"second_of_test"}, 2)
    places["kept"] = None
    assert names() == ({"second_of_test"}, 0), "nowhere to keep them"
