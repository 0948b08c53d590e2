"""What enters a content hash: every value, type, class, file and source, and nothing else."""

import json
import sys
from dataclasses import dataclass, replace
from importlib import import_module, invalidate_caches
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import combinations
from pathlib import Path

import pytest

from uavbench.bench.external.program import External
from uavbench.bench.inputs import content_hash as content
from uavbench.bench.inputs import plugin_files
from uavbench.bench.inputs.content_hash import (
    carried_hash,
    code_hash,
    content_hash,
    file_form,
    key_of,
    one_look,
    sources_hash,
)
from uavbench.bench.inputs.touched_files import Touched, touched_since
from uavbench.scenes.structures.box import Box
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sensors.imu import Imu, ImuBmi088


@dataclass(frozen=True)
class One:
    number: float = 1.0
    inner: object = None
    items: tuple = (1, 2)


@dataclass(frozen=True)
class Other:
    number: float = 1.0
    inner: object = None
    items: tuple = (1, 2)


@dataclass(frozen=True)
class WithFile:
    image_path: str = ""
    note: str = ""
    file: str = ""


@dataclass(frozen=True)
class Entering:
    folder_name: str

    @property
    def entering_files(self):
        return sorted(Path(self.folder_name).iterdir())


def test_a_hash_is_a_sha256_that_comes_again():
    assert content_hash() == content_hash()
    assert len(content_hash(1)) == 64
    assert int(content_hash(1), 16)
    assert content_hash(One(inner=One())) == content_hash(One(inner=One()))


def test_whatever_differs_has_another_hash():
    values = [
        (), (1,), (1.5,), (2,), (True,), (None,), ("1",), ("",), (1, 2), (2, 1), ([1, 2],), ([2, 1],), ([[1], 2],),
        ({"a": 1},), ({"a": 2},), ({"b": 1},), (One(),), (Other(),), (One(number=2.0),), (One(inner=One()),),
        (One(inner=Other()),), (One(items=(2, 1)),), (Box(),), (Box(length_m=0.41),), (Imu(),),
        (ImuBmi088(),), ([Imu(), Box()],), ({"a": Imu()},), ({"a": Box()},), ([None],), ({"a": {"b": One()}},),
        ({"a": {"b": Other()}},),
    ]  # fmt: skip
    hashes = [content_hash(*parts) for parts in values]
    for a, b in combinations(range(len(values)), 2):
        assert hashes[a] != hashes[b], (values[a], values[b])


def test_the_order_of_keys_and_the_kind_of_a_list_do_not_matter():
    assert content_hash({"a": 1, "b": One()}) == content_hash({"b": One(), "a": 1})
    assert content_hash((1, One())) == content_hash([1, One()])
    assert content_hash({1: "x"}) == content_hash({"1": "x"})


def test_what_has_no_form_is_refused():
    with pytest.raises(UserError, match="is of type object, which no record can hold"):
        content_hash(object())


@pytest.mark.parametrize("name", ["image_path", "file"])
def test_a_file_that_is_named_enters_by_its_content(tmp_path, name):
    path = tmp_path / "image.png"
    value = replace(WithFile(), **{name: str(path)})
    path.write_bytes(b"one")
    one = content_hash(value)
    path.write_bytes(b"two")
    two = content_hash(value)
    path.write_bytes(b"one")
    assert content_hash(value) == one != two
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "image.png").write_bytes(b"one")
    assert content_hash(replace(WithFile(), **{name: str(tmp_path / "elsewhere" / "image.png")})) == one
    path.unlink()
    assert content_hash(value) not in (one, two)


def test_one_look_sees_a_value_as_it_was_at_first_and_the_next_look_sees_it_anew(tmp_path):
    path = tmp_path / "image.png"
    value, other = WithFile(image_path=str(path)), WithFile(file=str(path), note="x")
    path.write_bytes(b"one")
    one, both = content_hash(value), content_hash(value, other)
    with one_look():
        assert (content_hash(value), content_hash(value, other)) == (one, both)
        path.write_bytes(b"two")
        assert (content_hash(value), content_hash(value, other)) == (one, both)
        with one_look():
            assert content_hash(value) != one
        with pytest.raises(ZeroDivisionError), one_look():
            raise ZeroDivisionError
        assert content_hash(value) == one
    assert content_hash(value) != one


def test_a_word_that_names_no_file_enters_as_it_is(tmp_path):
    path = tmp_path / "note"
    before = content_hash(WithFile(note=str(path)))
    path.mkdir()
    (path / "inner").write_text("one")
    assert content_hash(WithFile(note=str(path))) == before != content_hash(WithFile(note="x"))


def test_files_that_a_plugin_says_enter_do(tmp_path):
    (tmp_path / "a").write_text("1")
    one = content_hash(Entering(str(tmp_path)))
    (tmp_path / "b").write_text("2")
    two = content_hash(Entering(str(tmp_path)))
    (tmp_path / "b").write_text("3")
    assert len({one, two, content_hash(Entering(str(tmp_path)))}) == 3


MODULE = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Mine:
    number: float = 1.0

    def work(self):
        return {value}
"""


def test_the_source_of_a_users_own_class_enters(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    hashes = []
    for value in (1, 2, 1):
        (tmp_path / "a_users_plugin.py").write_text(MODULE.format(value=value))
        monkeypatch.delitem(sys.modules, "a_users_plugin", raising=False)
        invalidate_caches()
        hashes.append(content_hash(import_module("a_users_plugin").Mine()))
    monkeypatch.delitem(sys.modules, "a_users_plugin", raising=False)
    assert hashes[0] == hashes[2] != hashes[1]


def test_a_compiled_module_that_a_users_own_class_imports_enters(tmp_path, monkeypatch):
    """It is found, never loaded: these are no libraries."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "of_a_library.py").write_text("def late():\n    import compiled_thing\n" + MODULE.format(value=1))
    hashes = []
    for content_of_it in (b"\x7fELF one", b"\x7fELF two", b"\x7fELF one"):
        (tmp_path / f"compiled_thing{EXTENSION_SUFFIXES[0]}").write_bytes(content_of_it)
        invalidate_caches()
        hashes.append(content_hash(import_module("of_a_library").Mine()))
    monkeypatch.delitem(sys.modules, "of_a_library", raising=False)
    assert hashes[0] == hashes[2] != hashes[1]


# What changes while it is used


def test_jobs_are_told_whose_files_were_written_meanwhile(tmp_path):
    for name in ("a.txt", "b.txt", "c.txt"):
        (tmp_path / name).write_text(name)

    def keys():
        return {name: content_hash(file_form(tmp_path / f"{name}.txt")) for name in "abc"}

    planned = keys()
    assert touched_since(planned, keys, "abc") == Touched()
    (tmp_path / "a.txt").write_text("other")
    (tmp_path / "b.txt").write_text("other")
    (tmp_path / "b.txt").write_text("b.txt")
    found = touched_since(planned, keys, "abc")
    assert found.jobs == {"a", "b"}
    assert found.files == tuple(sorted(found.files)) and {"a.txt", "b.txt"} <= {path.name for path in found.files}
    assert str(Touched(tuple(map(Path, "abcde")))) == "a, b, c and 2 more"
    assert touched_since(planned, keys, "bc").jobs <= {"b"}
    planned = keys()
    (tmp_path / "c.txt").unlink()
    assert touched_since(planned, keys, "abc").jobs == {"c"}
    assert keys() == keys(), "what was told apart is no longer"


# Code


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Two packages of their own."""
    monkeypatch.setattr(content, "ROOT", tmp_path)
    for package in ("first", "second"):
        (tmp_path / package / "sub").mkdir(parents=True)
        (tmp_path / package / "a.py").write_text(f"# {package}")
    return tmp_path


def of(*packages):
    return sources_hash.__wrapped__(*packages)


def test_code_is_that_of_the_packages_named():
    hashes = {code_hash(*names) for names in ((), ("scenes",), ("tracker",), ("scenes", "tracker"))}
    assert len(hashes) == 4
    assert all(len(h) == 64 for h in hashes)


@pytest.mark.parametrize("name", ["b.py", "sub/b.py", "b.xml", "b.html", "b.css", "b.js", "b.toml"])
def test_every_source_of_a_package_enters_by_name_and_content(tree, name):
    other, seen = of("second"), [of("first")]
    path = tree / "first" / name
    for text in ("one", "two"):
        path.write_text(text)
        seen.append(of("first"))
    path.rename(path.with_stem("c"))
    seen.append(of("first"))
    assert len(set(seen)) == 4
    path.with_stem("c").unlink()
    assert of("first") == seen[0]
    assert of("second") == other


def test_compiled_files_do_not_enter(tree):
    before = of("first")
    (tree / "first" / "__pycache__").mkdir()
    (tree / "first" / "__pycache__" / "a.cpython-311.pyc").write_bytes(b"x")
    assert of("first") == before


def test_another_python_is_other_code_and_a_patch_of_it_is_not(tree, monkeypatch):
    hashes = []
    for parts in (("3", "11", "4"), ("3", "11", "9"), ("3", "12", "4")):
        monkeypatch.setattr(content.platform, "python_version_tuple", lambda parts=parts: parts)
        hashes.append(of("first"))
    assert hashes[0] == hashes[1] != hashes[2]


def test_what_every_job_does_is_code_of_all_packages(tree, monkeypatch):
    work = tree / "tasks.py"
    monkeypatch.setattr(content, "WORK", work)
    hashes = []
    for text in ("one", "two"):
        work.write_text(text)
        hashes.append((of("first"), of()))
    assert hashes[0][0] != hashes[1][0] and hashes[0][1] != hashes[1][1]


@pytest.mark.parametrize("name", ["program.py", "process.py", "isolation.py", "rows.py"])
def test_a_class_of_the_benchmark_is_the_code_that_it_runs(monkeypatch, name):
    """Of a tracker that is a program of its own: how that is started, isolated and read."""
    tracker = External(command=("true",))
    before, unchanged = content_hash(tracker), plugin_files.digest

    def edited(files):
        return unchanged(files) + " edited" * any(path.name == name for path in files)

    monkeypatch.setattr(plugin_files, "digest", edited)
    assert content_hash(tracker) != before


def test_the_key_of_a_class_of_the_benchmark_covers_files_of_the_benchmark_alone(monkeypatch):
    """The layers below have keys of their own."""
    covered = []
    monkeypatch.setattr(plugin_files, "digest", lambda files: covered.append(files) or "a digest")
    assert plugin_files.bench_key(External) == "a digest"
    (files,) = covered
    assert {"program.py", "process.py", "isolation.py"} <= {path.name for path in files}
    assert {path.relative_to(content.ROOT).parts[0] for path in files} == {"bench"}


def test_a_file_carries_its_hash(tmp_path):
    path = tmp_path / "score.json"
    assert carried_hash(path) is None
    path.write_text(json.dumps({"content_hash": "abc", "more": 1}))
    assert carried_hash(path) == "abc"
    for damaged in ('{"content_hash": "ab', "[]", "null", "{}", '"abc"', ""):
        path.write_text(damaged)
        assert carried_hash(path) is None, damaged
    path.write_bytes(b"\xff\xfe")
    assert carried_hash(path) is None


def test_the_files_of_a_key_are_told_with_each_hash_of_a_look(tmp_path):
    (tmp_path / "net.bin").write_text("1")
    value = WithFile(file=str(tmp_path / "net.bin"))
    with one_look():
        first, second = key_of(value), key_of("label", value)
    assert first.content_hash == content_hash(value) != second.content_hash
    assert tmp_path / "net.bin" in first.files & second.files
    assert tmp_path / "net.bin" not in key_of("label").files
