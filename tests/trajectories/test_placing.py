"""What somebody writes at the very moment of a rename stays, under its name or under a free one that is told."""

import ctypes
import errno

import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files import placing, writing
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.placing import exchange, put_file, rename_new, take_away
from uavbench.trajectories.files.writing import new_folder, new_parts, write_text

PRECIOUS = b"years of work"
FOLDER, REPORT = Marker("record.json", "estimates"), Marker("report.json", "report")


def unsupported(number):
    """A system call that fails with this error."""

    def call(*_):
        ctypes.set_errno(number)
        return -1

    return call


@pytest.fixture(params=["renameat2", "without it", "a disk without it", "an old kernel"])
def system(request, monkeypatch):
    """A system with the renames of Linux, and those that lack them."""
    if request.param == "without it":
        monkeypatch.setattr(placing, "_renameat2", lambda: None)
    elif request.param == "a disk without it":
        monkeypatch.setattr(placing, "_renameat2", lambda: unsupported(errno.EINVAL))
    elif request.param == "an old kernel":
        monkeypatch.setattr(placing, "_renameat2", lambda: unsupported(errno.ENOSYS))
    elif placing._renameat2() is None:
        pytest.skip("not a Linux")
    return request.param


def at(monkeypatch, name, act):
    """Have `act` done right before the first call of a function of `placing` under the user's eyes."""
    real, left = getattr(placing, name), [act]

    def first(*arguments):
        if left:
            left.pop()()
        return real(*arguments)

    for module in (placing, writing):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, first)


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def test_a_free_name_is_taken_and_a_used_one_is_not(tmp_path, system):
    (tmp_path / "a").write_bytes(b"a")
    rename_new(tmp_path / "a", tmp_path / "b")
    (tmp_path / "a").write_bytes(b"other")
    with pytest.raises(FileExistsError):
        rename_new(tmp_path / "a", tmp_path / "b")
    with pytest.raises(FileNotFoundError):
        rename_new(tmp_path / "none", tmp_path / "c")
    assert contents(tmp_path) == {"a": b"other", "b": b"a"}
    assert exchange(tmp_path / "a", tmp_path / "b") == (system == "renameat2")


def test_names_are_of_the_working_folder(tmp_path, monkeypatch, system):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").write_bytes(b"a")
    rename_new(type(tmp_path)("a"), type(tmp_path)("b"))
    assert contents(tmp_path) == {"b": b"a"}


def test_what_is_refused_stays_and_what_is_not_gives_way(tmp_path, system):
    made, path = tmp_path / "made", tmp_path / "path"

    def refuse(where):
        if where.read_bytes() == PRECIOUS:
            raise UserError("stays")

    path.write_bytes(PRECIOUS)
    made.write_bytes(b"made")
    with pytest.raises(UserError, match="stays"):
        put_file(made, path, refuse)
    assert contents(tmp_path) == {"made": b"made", "path": PRECIOUS}
    path.write_bytes(b"ours")
    put_file(made, path, refuse)
    assert path.read_bytes() == b"made"


def test_an_error_of_the_disk_is_no_lack_of_support(tmp_path, monkeypatch):
    """Else a file that cannot be exchanged would be replaced without the check afterwards."""
    (tmp_path / "a").write_bytes(b"a")
    (tmp_path / "b").write_bytes(PRECIOUS)
    monkeypatch.setattr(placing, "_renameat2", lambda: unsupported(errno.EIO))
    for rename in (rename_new, exchange):
        with pytest.raises(OSError, match="Input/output error"):
            rename(tmp_path / "a", tmp_path / "b")
    assert contents(tmp_path) == {"a": b"a", "b": PRECIOUS}


@pytest.mark.parametrize("moment", ["rename_new", "exchange"])
@pytest.mark.parametrize("before", [True, False])
def test_a_file_that_comes_or_changes_at_the_last_moment_stays(tmp_path, monkeypatch, moment, before):
    path = tmp_path / "camera.toml"
    if before:
        write_text(path, "width = 1\n", kind="camera")
    elif moment == "exchange":
        pytest.skip("there is nothing to exchange")
    at(monkeypatch, moment, lambda: path.write_bytes(PRECIOUS))
    with pytest.raises(UserError, match="is not an unmodified file of uavbench"):
        write_text(path, "width = 2\n", kind="camera")
    assert contents(tmp_path) == {"camera.toml": PRECIOUS}


def test_a_file_that_goes_at_the_last_moment_is_written_all_the_same(tmp_path, monkeypatch):
    path = tmp_path / "camera.toml"
    write_text(path, "width = 1\n", kind="camera")
    at(monkeypatch, "exchange", path.unlink)
    write_text(path, "width = 2\n", kind="camera")
    assert path.read_text().startswith("width = 2\n")


def test_what_is_written_while_the_old_file_is_checked_stays_too(tmp_path):
    """The new file is at its place already: somebody writes there, and the old one has to come back."""
    made, path = tmp_path / "made", tmp_path / "path"
    for write in (lambda: path.write_bytes(b"newer work"), path.unlink):
        made.write_bytes(b"made")
        path.write_bytes(PRECIOUS)

        def refuse(where, write=write):
            assert where.read_bytes() == PRECIOUS
            write()
            raise UserError("stays")

        with pytest.raises(UserError, match="stays"):
            put_file(made, path, refuse)
        assert path.read_bytes() == PRECIOUS
    assert (tmp_path / "path.kept-1").read_bytes() == b"newer work"


def test_a_folder_that_was_taken_away_comes_back_whatever_was_made_there_meanwhile(tmp_path, system):
    folder, to = tmp_path / "folder", tmp_path / "to"
    folder.mkdir()
    (folder / "a").write_bytes(PRECIOUS)

    def refuse(where):
        folder.mkdir()
        (folder / "b").write_bytes(b"newer work")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        take_away(folder, to, refuse)
    assert contents(tmp_path) == {"folder/b": b"newer work", "folder.kept-1/a": PRECIOUS}


def make(folder, text):
    with new_folder(folder, FOLDER) as new:
        write_text(new / "frames.csv", text)


def test_an_interrupt_while_a_folder_is_checked_loses_nothing(tmp_path, monkeypatch):
    folder = tmp_path / "results"
    make(folder, "1\n")
    real = writing.foreign

    def interrupted(where, marker):
        (where / "notes.txt").write_bytes(PRECIOUS)
        raise KeyboardInterrupt
        yield from real(where, marker)

    monkeypatch.setattr(writing, "foreign", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make(folder, "2\n")
    assert (folder / "notes.txt").read_bytes() == PRECIOUS
    assert (folder / "frames.csv").read_text() == "1\n"


def test_a_folder_that_somebody_makes_while_ours_is_away_stays_and_so_does_ours(tmp_path, monkeypatch):
    folder = tmp_path / "results"
    make(folder, "1\n")
    real = writing.foreign

    def slow(where, marker):
        yield from list(real(where, marker))
        folder.mkdir()
        (folder / "notes.txt").write_bytes(PRECIOUS)

    monkeypatch.setattr(writing, "foreign", slow)
    with pytest.raises(UserError, match="results: was made by something else meanwhile"):
        make(folder, "2\n")
    assert contents(folder) == {"notes.txt": PRECIOUS}
    assert (tmp_path / "results.kept-1" / "frames.csv").read_text() == "1\n"


@pytest.mark.parametrize("name", ["index.html", "a.csv", "old.csv"])
def test_a_part_that_changes_after_the_check_stays(tmp_path, monkeypatch, name):
    """`old.csv` was a part of the last time, and is none of this one."""

    def write(*names):
        with new_parts(tmp_path, REPORT) as new:
            for each in names:
                write_text(new / each, "{}\n")

    write("index.html", "a.csv", "old.csv")
    real = writing.put_file

    def late(made, path, refuse):
        if path.name == REPORT.name:
            (tmp_path / name).write_bytes(PRECIOUS)
        real(made, path, refuse)

    monkeypatch.setattr(writing, "put_file", late)
    if name == "old.csv":
        write("index.html", "a.csv")
    else:
        with pytest.raises(UserError, match=name):
            write("index.html", "a.csv")
    assert (tmp_path / name).read_bytes() == PRECIOUS


def test_of_two_that_make_a_folder_at_once_the_second_is_told_so(tmp_path):
    with (
        pytest.raises(UserError, match="export: was made by something else meanwhile; choose another folder"),
        new_folder(tmp_path / "export") as late,
    ):
        (late / "README.md").write_text("late")
        with new_folder(tmp_path / "export") as first:
            (first / "README.md").write_text("first")
    assert [path.read_text() for path in tmp_path.rglob("*") if path.is_file()] == ["first"]
