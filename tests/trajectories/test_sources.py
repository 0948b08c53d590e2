"""Source files of modules are found without importing anything."""

from uavbench.trajectories.kernels import kept_imports
from uavbench.trajectories.sources import parsed_source
from uavbench.trajectories.sources.dependencies import made_of, parents, sources
from uavbench.trajectories.sources.digests import digest, file_digest
from uavbench.trajectories.sources.module_files import among, editable, source_file
from uavbench.trajectories.sources.parsed_source import imports, texts


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
    found = sources("uavbench.tracker.robust.fit.edge_fit")
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
        monkeypatch.setattr(parsed_source, "known_imports", {})
        parsed_source._imports.cache_clear()
        kept_imports._recall.cache_clear()
        with kept_imports.remembered(lambda key: places["kept"]):
            known = len(parsed_source.known_imports)
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


def test_imports_are_named_whole_wherever_they_stand(tmp_path):
    text = (
        "import a.b, c as d\nfrom . import e\nfrom .f import g\nfrom ..h import i as j\nfrom k.l import m\n"
        "def late():\n    try:\n        import n\n    except ImportError:\n        import o\n"
        "    else:\n        import p\n"
        "    finally:\n        import q\nif TYPE_CHECKING:\n    import r\nelse:\n    import s\n"
        "match 1:\n    case 1:\n        import t\n"
    )
    (tmp_path / "module.py").write_text(text)
    inside = ["top.in.e", "top.in", "top.in.f", "top.in.f.g", "top.h", "top.h.i"]
    everywhere = ["a", "a.b", "c", "k.l", "k.l.m", "n", "o", "p", "q", "s", "t"]
    assert sorted(imports(tmp_path / "module.py", "top.in.module")) == sorted([*inside, *everywhere])
    (tmp_path / "__init__.py").write_text("from . import x\nfrom .y import z\n")
    assert set(imports(tmp_path / "__init__.py", "top.in")) == {"top.in", "top.in.x", "top.in.y", "top.in.y.z"}
    (tmp_path / "broken.py").write_text("import a b")
    assert imports(tmp_path / "broken.py", "broken") == ()
    (tmp_path / "class.py").write_text("class __getattr__: pass\nif TYPE_CHECKING:\n    import a\n")
    assert imports(tmp_path / "class.py", "class") == ()
    (tmp_path / "giving.py").write_text("def __getattr__(n): pass\nif TYPE_CHECKING:\n    import a\n")
    assert imports(tmp_path / "giving.py", "giving") == ("a",)
    assert imports(tmp_path / "giving.py", "giving", on_demand=False) == ()


def test_texts_are_all_literals_with_a_star_for_what_is_put_in(tmp_path):
    path = tmp_path / "a.py"
    path.write_text('"""Doc."""\nA = "one", 2, b"three", f"{A}/data/{B}.npy"\n')
    assert texts(path) == {"Doc.", "one", "*/data/*.npy", "/data/", ".npy"}
    path.write_text("A = 'other'\n")
    assert texts(path) == {"other"}


def test_a_digest_is_of_names_folders_and_contents_in_any_order(tmp_path):
    def at(*parts, text="1"):
        path = tmp_path.joinpath(*parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    a, b = at("here", "x", "a"), at("here", "x", "b", text="2")
    assert digest([a, b]) == digest([b, a]) == digest([at("there", "x", "a"), b])
    others = [
        [a],
        [a, at("here", "y", "b", text="2")],
        [a, at("there", "x", "b", text="3")],
        [a, at("here", "x", "c")],
        [],
    ]
    assert len({digest([a, b]), *map(digest, others)}) == 1 + len(others)
    assert digest([tmp_path / "x" / "none"]) != digest([])
    assert len(digest([])) == len(file_digest(a)) == 64
    assert file_digest(a) != file_digest(b)


def test_modules_among_folders_are_those_of_the_first_that_has_them(tmp_path):
    for name in ("one/a.py", "two/a.py", "two/b/__init__.py", "two/b/c.py", "two/d"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("import json\nimport absent_of_test.inner\nfrom a import x\n")
    find = among([tmp_path / "one", tmp_path / "two"])
    found = {name: find(name) for name in ("a", "b", "b.c", "d", "e")}
    assert found == {
        "a": tmp_path / "one" / "a.py", "b": tmp_path / "two" / "b" / "__init__.py",
        "b.c": tmp_path / "two" / "b" / "c.py", "d": None, "e": None,
    }  # fmt: skip
    made = made_of(["b.c"], [tmp_path / "two" / "a.py"], find)
    assert made.files == {tmp_path / name for name in ("one/a.py", "two/a.py", "two/b/__init__.py", "two/b/c.py")}
    assert made.others == {"absent_of_test", "a"}, "a.x is found nowhere"
    assert list(parents("b.c.d")) == ["b.c", "b"]


def test_what_is_installed_is_not_a_source_and_what_is_linked_to_it_neither(tmp_path):
    from pathlib import Path

    import numpy

    assert source_file("numpy") is None and source_file("json") is None and source_file("sys") is None
    assert not editable(Path(numpy.__file__))
    link = tmp_path / "linked.py"
    link.symlink_to(numpy.__file__)
    assert not editable(link)
    own = tmp_path / "own.py"
    own.write_text("")
    assert editable(own)
