"""Readers in a process of their own: whatever a file does to them, it becomes an error that names the file."""

import os
import sys

import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import FileLimit
from uavbench.trajectories.processes import reading_apart
from uavbench.trajectories.processes.reading_apart import read_apart

LIMIT = FileLimit("model", 100, "make it smaller")


@pytest.fixture
def reader(tmp_path, monkeypatch):
    """What reads a file of some text with a reader of the given code: the content of the file `out`."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "model.x").write_text("some text")

    def read(code):
        (tmp_path / "its_reader.py").write_text(code)
        with read_apart("its_reader", tmp_path / "model.x", LIMIT) as folder:
            content = (folder / "out").read_text()
        assert not folder.exists()
        return content

    return read


def test_what_a_reader_writes_is_there_until_it_is_left(reader):
    assert reader("import sys; open('out', 'w').write(sys.stdin.read()[::-1])") == "txet emos"


def test_a_reader_finds_the_modules_that_we_find(reader):
    found = reader("import sys; open('out', 'w').write('\\n'.join(sys.path))").splitlines()
    assert {*filter(None, sys.path)} <= {*found}


REFUSING = "from uavbench.trajectories.processes.reading_apart import refuse; print('more'); "


@pytest.mark.parametrize(
    ("code", "told"),
    [
        (
            REFUSING + "refuse('it has\\nno wall')",
            r"model\.x: it has no wall$",
        ),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", r"model\.x: its reader crashed \(Segmentation"),
        ("import os; os.abort()", r"model\.x: its reader crashed \(Aborted"),
        ("import sys; sys.exit('\\x1b[31mred')", r"model\.x: cannot be read \(\\x1b\[31mred\)"),
        (
            "import sys; print('MemoryError'); print('x' * 3000, flush=True); sys.exit('at line 7')",
            r"model\.x: cannot be read \(at line 7\)",
        ),
        ("import os; os._exit(5)", r"model\.x: cannot be read \(exit code 5\)"),
        ("import no_such_library", r"cannot be read \(ModuleNotFoundError: No module named 'no_such_library'\)"),
        ("while True: pass", r"model\.x: reading it takes more than 2 s"),
        ("x = bytearray(1 << 30)", r"model\.x: reading it takes more than 512 MB of memory"),
        (
            "import os; os.write(2, b\"terminate called after throwing an instance of 'std::bad_alloc'\"); os.abort()",
            r"model\.x: reading it takes more than 512 MB of memory",
        ),
        ("open('out', 'wb').write(bytes(2 << 20))", r"model\.x: cannot be read \(OSError: .*large"),
    ],
)
def test_what_happens_to_a_reader_is_told_with_the_file(reader, monkeypatch, code, told):
    monkeypatch.setattr(reading_apart, "MOST_CPU_S", 2)
    monkeypatch.setattr(reading_apart, "MOST_MEMORY_MB", 512)
    monkeypatch.setattr(reading_apart, "MOST_FILE_MB", 1)
    with pytest.raises(UserError, match=told):
        reader(code)


def test_a_reader_that_waits_is_ended(reader, monkeypatch):
    monkeypatch.setattr(reading_apart, "LONGEST_S", 0.5)
    with pytest.raises(UserError, match=r"model\.x: reading it takes more than"):
        reader("import time; time.sleep(600)")


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda path: path.write_bytes(bytes(101)), "has 101 bytes; a model has at most 100: make it smaller"),
        (os.mkfifo, "is not a regular file"),
        (lambda path: path.symlink_to("/dev/zero"), "is not a regular file"),
    ],
)
def test_a_file_is_looked_at_before_it_is_read(tmp_path, make, told):
    make(tmp_path / "file")
    with pytest.raises(UserError, match=told), read_apart("no_such_reader", tmp_path / "file", LIMIT):
        pass
