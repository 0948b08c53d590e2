"""The record of what a job wrote: its files are whole while they are as written, for the hash of the job."""

import json
import os

import pytest

from uavbench.bench.runner.written_files import Made, Place, Record, expect_whole
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder, write_text

LIST = Marker("list.json", "list")
FILES = {"results/a/record.json", "results/a/frames.csv", "results/a/list.json"}


@pytest.fixture
def place(tmp_path):
    return Place(tmp_path, tmp_path / "results" / "a" / "record.json", LIST)


def write(place, content_hash, text="1\n"):
    """What a job does."""
    with place.writing(content_hash):
        put(place, content_hash, text)


def put(place, content_hash, text="1\n"):
    with new_folder(place.marker.parent, LIST) as new:
        write_text(new / "frames.csv", text)
        write_text(new / place.marker.name, json.dumps({"content_hash": content_hash}))


def test_what_was_written_is_whole_for_its_hash_alone(place):
    assert not place.is_whole("")
    assert not place.is_whole("x")
    write(place, "x")
    assert place.is_whole("x")
    assert not place.is_whole("y")
    assert set(Record.read(place.record).files) == FILES
    write(place, "y")
    assert place.is_whole("y") and not place.is_whole("x")


@pytest.mark.parametrize("name", sorted(FILES))
@pytest.mark.parametrize("how", ["edited", "grown", "removed", "a link to the same bytes", "a folder"])
def test_a_change_of_any_file_ends_it(place, tmp_path, name, how):
    write(place, "x")
    path = tmp_path / name
    data, times = path.read_bytes(), path.stat()
    path.unlink()
    if how == "edited":
        path.write_bytes(b"?" * len(data))
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    elif how == "grown":
        path.write_bytes(data + b"\n")
    elif how == "a link to the same bytes":
        (tmp_path / "far").write_bytes(data)
        path.symlink_to(tmp_path / "far")
    elif how == "a folder":
        path.mkdir()
    assert not place.is_whole("x")


def test_files_with_other_times_are_compared_once(place, tmp_path, monkeypatch):
    write(place, "x")
    os.utime(tmp_path / "results" / "a" / "frames.csv", ns=(1, 1))
    before = place.record.read_bytes()
    assert place.is_whole("x")
    assert place.record.read_bytes() != before
    after = place.record.read_bytes()
    opened = []
    real = type(tmp_path).open
    monkeypatch.setattr(
        type(tmp_path), "open", lambda path, *a, **k: (opened.append(path.name), real(path, *a, **k))[1]
    )
    assert place.is_whole("x")
    assert "frames.csv" not in opened
    assert place.record.read_bytes() == after


def test_while_it_is_written_and_after_an_interrupt_it_is_not_whole(place):
    write(place, "x")
    with pytest.raises(KeyboardInterrupt), place.writing("x"):
        assert not place.is_whole("x")
        assert set(Record.read(place.record).files) == FILES  # a kill now: they are known as ours
        raise KeyboardInterrupt
    assert not place.is_whole("x")
    assert set(Record.read(place.record).files) == FILES
    with pytest.raises(KeyboardInterrupt), place.writing("y"):
        put(place, "y", "2\n")
        raise KeyboardInterrupt
    assert not place.is_whole("y") and not place.is_whole("x")
    write(place, "x")
    assert place.is_whole("x")


def test_what_an_interrupted_job_wrote_is_known_as_ours(place, tmp_path):
    """A file without a seal, of which only the record says where it is from."""
    bare = Place(tmp_path, tmp_path / "notes" / "a.json")
    with pytest.raises(KeyboardInterrupt), bare.writing("x"):
        write_text(bare.marker, "half\n")
        raise KeyboardInterrupt
    with bare.writing("x"):
        write_text(bare.marker, "whole\n")
    assert bare.marker.read_text() == "whole\n"
    with pytest.raises(UserError, match=r"a\.json: exists and is not an unmodified file"):
        write_text(bare.marker, "other\n")
    assert bare.is_whole("x")


def test_disowned_files_are_stale_and_may_be_written_anew_though_damaged(place):
    write(place, "x")
    place.disown()
    assert not place.is_whole("x")
    assert set(Record.read(place.record).files) == FILES
    (place.marker.parent / "frames.csv").write_text("damaged\n")
    place.refuse_foreign()
    write(place, "x")
    assert place.is_whole("x")


def test_only_files_at_its_place_are_recorded(place, tmp_path):
    with place.writing("x"):
        put(place, "x")
        write_text(tmp_path / "results" / "b" / "cache.csv", "1\n")
    assert set(Record.read(place.record).files) == FILES


def test_a_users_file_among_them_is_refused_and_that_of_another_job_is_not(place, tmp_path):
    place.refuse_foreign()
    write(place, "x")
    place.refuse_foreign()
    score = Place(tmp_path, place.marker.with_name("score.json"))
    with score.writing("s"):
        write_text(score.marker, "1\n")
    place.refuse_foreign()
    (place.marker.parent / "notes.txt").write_text("mine")
    with pytest.raises(UserError, match=r"contains notes\.txt, which uavbench did not write"):
        place.refuse_foreign()
    score.refuse_foreign()  # it has no folder of its own


@pytest.mark.parametrize("what", ["link", "dangling link", "file"])
def test_what_stands_where_its_folder_was_is_refused(place, tmp_path, what):
    write(place, "x")
    folder = place.marker.parent
    folder.rename(tmp_path / "far")
    if what == "file":
        folder.write_text("mine")
    else:
        folder.symlink_to(tmp_path / ("far" if what == "link" else "none"))
    with pytest.raises(UserError, match=r"is a (link|file); name"):
        place.refuse_foreign()


DAMAGED = [
    "", "{", "[]", "3", "{}", '{"content_hash": "x"}', '{"content_hash": "x", "files": 3}',
    '{"content_hash": "x", "files": {"a": [1]}}',
]  # fmt: skip


@pytest.mark.parametrize("text", DAMAGED)
def test_a_damaged_record_proves_nothing(place, text):
    write(place, "x")
    place.record.unlink()
    place.record.write_text(text)
    assert Record.read(place.record) == Record()
    assert not place.is_whole("x")


def test_a_job_reads_only_what_is_as_it_was_made(place):
    write(place, "x")
    expect_whole([])
    expect_whole([Made(place, "x")])
    assert not Made(place, "y").is_whole
    with pytest.raises(UserError, match="results/a: another process replaces what this job reads"):
        expect_whole([Made(place, "x"), Made(place, "y")])
    (place.marker.parent / "frames.csv").write_text("2\n")
    with pytest.raises(UserError, match="another process"):
        expect_whole([Made(place, "x")])


def test_a_marker_of_another_hash_is_not_what_a_job_reads(place):
    with place.writing("x"):
        put(place, "y")
    assert place.is_whole("x") and not Made(place, "x").is_whole
