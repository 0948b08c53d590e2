"""Files and folders appear whole: at every call to the system there is the old one, the new one or none, on disk."""

import os
import sys
from pathlib import Path

import pytest

from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, new_file, new_folder, noting, write_text

RECORD, REPORT = Marker("record.json", "estimates"), Marker("report.json", "report")
NAMES = ("frames.csv", "deep/a.csv", "deep/b.csv")
_look = None


def _at_every_call(event, arguments):
    global _look
    if _look is not None and event.split(".")[0] in ("open", "os", "shutil"):
        look, _look = _look, None  # what it does itself is no call to look at
        try:
            look()
        finally:
            _look = look


sys.addaudithook(_at_every_call)


@pytest.fixture
def states():
    """Collects what a function returns at every call to the system, whether a file is opened, renamed or removed."""
    global _look

    def collect(see):
        global _look
        found = []

        def look():
            if not found or found[-1] != (now := see()):
                found.append(now if found else see())

        _look = look
        return found

    yield collect
    _look = None


def content(folder):
    """What stands in a folder, None where there is none."""
    if not folder.exists():
        return None
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*.csv")}


def write_folder(folder, text):
    with new_folder(folder, RECORD) as new:
        for name in NAMES:
            write_text(new / name, text)
        (new / "latest").symlink_to("frames.csv")


def test_a_folder_is_there_whole_or_not_at_all(tmp_path, states):
    found = states(lambda: content(tmp_path / "results"))
    for text in ("1", "2"):
        write_folder(tmp_path / "results", text)
    one, two = (dict.fromkeys(NAMES, text) for text in ("1", "2"))
    assert [state for state in found if state not in (None, one, two)] == []
    assert one in found and content(tmp_path / "results") == two


def test_a_file_is_there_whole_or_not_at_all(tmp_path, states):
    path = tmp_path / "a.toml"
    found = states(lambda: path.read_text().splitlines()[:1] if path.exists() else None)
    for text in ("a = 1", "a = 2"):
        write_text(path, f"{text}\n", kind="note")
    assert [state for state in found if state not in (None, ["a = 1"], ["a = 2"])] == []
    assert None not in found[found.index(["a = 1"]) :], "the old one stays until the new one is there"


@pytest.fixture
def flushed(monkeypatch):
    """Paths that were flushed to disk, in order."""
    real, found = os.fsync, []

    def fsync(handle):
        found.append(Path(f"/proc/self/fd/{handle}").readlink())
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    return found


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no names of open files")
def test_all_is_on_disk_before_it_has_its_name_and_then_the_name_is(tmp_path, flushed):
    write_folder(tmp_path / "results", "1")
    within = {path.name for path in flushed[:-1]}
    assert {"frames.csv", "a.csv", "b.csv", "deep", "record.json"} < within
    assert "latest" not in within  # a link has no content
    (temporary,) = {path for path in flushed if path.parent == tmp_path}
    assert temporary.name.startswith(".results-uavbench-")
    assert flushed[-1] == tmp_path
    flushed.clear()
    write_text(tmp_path / "a.csv", "1\n")
    assert [path.parent for path in flushed[:1]] == [tmp_path] and flushed[0].name != "a.csv"
    assert flushed[1:] == [tmp_path]


@in_parts(REPORT)
def write_page(folder, text):
    write_text(folder / "report.json", "{}\n")
    write_text(folder / "deep" / "index.html", text, kind=REPORT.kind)
    return folder / "deep" / "index.html"


def test_a_function_that_writes_in_parts_returns_where_its_file_is_in_the_end(tmp_path):
    assert write_page(tmp_path, "one\n") == tmp_path / "deep" / "index.html"
    assert (tmp_path / "deep" / "index.html").read_text().startswith("one\n")


def test_what_was_written_is_noted_by_its_final_name(tmp_path):
    with noting() as outer:
        with noting() as written:
            write_folder(tmp_path / "results", "1")
            write_text(tmp_path / "a.csv", "1\n")
            with new_file(tmp_path / "b.csv") as new:
                new.touch()
            write_page(tmp_path / "report", "one\n")
        write_text(tmp_path / "c.csv", "1\n")
    results = {f"results/{name}" for name in (*NAMES, "latest", "record.json")}
    page = {"report/report.json", "report/deep/index.html"}
    assert {path.relative_to(tmp_path).as_posix() for path in written} == {*results, *page, "a.csv", "b.csv"}
    assert outer == {tmp_path / "c.csv"}
