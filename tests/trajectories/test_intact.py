"""What uavbench wrote is read only as it was written; what is no part of it is read as it is."""

import json
import os

import pytest

from uavbench.trajectories.errors import DamagedFileError
from uavbench.trajectories.files.intact import LISTS, refuse_damaged
from uavbench.trajectories.files.limits import SETTINGS
from uavbench.trajectories.files.listed import Marker, mark
from uavbench.trajectories.files.reading import opened, read_text
from uavbench.trajectories.files.seals import seal

DEEPEST = "cameras/right/frames/000000.csv"


@pytest.fixture
def folder(tmp_path):
    """A folder with two files and a list of them."""
    return listed(tmp_path / "folder", LISTS[0])


def listed(folder, marker):
    for name in ("a.csv", DEEPEST):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("1\n")
    mark(folder, Marker(marker, "list"))
    return folder


def edit(path):
    """Other bytes of the same number."""
    path.write_bytes(path.read_bytes().replace(b"1", b"2"))


@pytest.mark.parametrize("marker", LISTS)
@pytest.mark.parametrize("name", ["a.csv", DEEPEST])
def test_a_listed_file_is_read_until_it_is_edited(tmp_path, monkeypatch, marker, name):
    folder = listed(tmp_path / "folder", marker)
    monkeypatch.chdir(folder)
    for path in (folder / name, type(folder)(name)):
        assert read_text(path) == "1\n"
    edit(folder / name)
    for path in (folder / name, type(folder)(name)):
        with pytest.raises(DamagedFileError, match=rf"{name}: is damaged, or was edited since"):
            read_text(path)
    with opened(folder / name, SETTINGS, damaged=True) as handle:
        assert handle.read() == b"2\n"


def test_an_edit_that_keeps_size_and_time_is_noticed(folder):
    path = folder / "a.csv"
    before = path.stat()
    assert read_text(path) == "1\n"
    edit(path)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(DamagedFileError, match=r"a\.csv"):
        read_text(path)


def test_a_file_that_is_whole_again_is_read_again(folder):
    path = folder / "a.csv"
    edit(path)
    with pytest.raises(DamagedFileError):
        read_text(path)
    path.write_text("1\n")
    assert read_text(path) == "1\n"


def test_a_file_that_no_list_names_is_read_as_it_is(folder):
    (folder / "notes.txt").write_text("mine")
    (folder / "mine.json").write_text("{}\n")
    for name in ("notes.txt", "mine.json"):
        edit(folder / name)
        assert read_text(folder / name)
    refuse_damaged(folder / "none.csv")


def test_a_json_file_proves_itself(tmp_path):
    path = tmp_path / "score.json"
    path.write_text('{\n "rms_m": 0.1\n}\n')
    seal(path, "score")
    assert json.loads(read_text(path))["rms_m"] == 0.1
    path.write_text(path.read_text().replace("0.1", "0.2"))
    with pytest.raises(DamagedFileError, match=r"score\.json: is damaged"):
        read_text(path)


def test_beside_an_edited_list_nothing_is_read(folder):
    (folder / "notes.txt").write_text("mine")
    marker = folder / LISTS[0]
    marker.write_text(marker.read_text().replace('"a.csv"', '"b.csv"'))
    for name in ("a.csv", "notes.txt", LISTS[0]):
        with pytest.raises(DamagedFileError, match=LISTS[0]):
            read_text(folder / name)


def test_the_list_of_a_folder_within_counts_as_that_of_the_folder_around_it(folder):
    """Results in a report's folder: each has a list of its own."""
    inner = listed(folder / "results", LISTS[1])
    edit(inner / "a.csv")
    with pytest.raises(DamagedFileError, match="results/a"):
        read_text(inner / "a.csv")
    assert read_text(folder / "a.csv") == "1\n"
