"""Nothing foreign is replaced, whatever it is; of what processes left, only that of dead ones is removed."""

import errno
import hashlib
import json
import os
import re
import signal
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.process_trees import as_from_a_terminal
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files import folders, machines, origin, temporary_names, writing
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.machines import Machine
from uavbench.trajectories.files.origin import owning
from uavbench.trajectories.files.seals import is_sealed, seal, seal_table, sealed_kind
from uavbench.trajectories.files.temporary_names import remove_leftovers, start_ticks, temporary
from uavbench.trajectories.files.writing import new_file, new_folder, new_parts, write_text

RECORD, REPORT = Marker("record.json", "estimates"), Marker("report.json", "report")
PRECIOUS = b"years of work"


def lay(path, what):
    """Something precious at a path; what to look at afterwards."""
    far = path.parent.parent / "far" / path.name
    far.parent.mkdir(exist_ok=True)
    match what:
        case "file":
            path.write_bytes(PRECIOUS)
        case "link":
            far.write_bytes(PRECIOUS)
            path.symlink_to(far)
        case "link to a folder":
            far.mkdir()
            (far / "thesis.tex").write_bytes(PRECIOUS)
            path.symlink_to(far)
        case "dangling link":
            path.symlink_to(far)
        case "hard link":
            far.write_bytes(PRECIOUS)
            path.hardlink_to(far)
        case "fifo":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
            (path / ".thesis.tex").write_bytes(PRECIOUS)


def snapshot(folder):
    """Every name below a folder, with what stands there."""

    def told(path):
        if path.is_symlink():
            return "link", str(path.readlink())
        return (path.read_bytes() if path.is_file() else "", path.lstat().st_mode)

    return {path.relative_to(folder).as_posix(): told(path) for path in sorted(folder.rglob("*"))}


def sealed_without_kind(before):
    """A seal and the end of its line, as the first versions wrote it after the opening of a comment."""
    return b"uavbench-made-" + hashlib.sha256(before).hexdigest().encode() + b"\n"


def test_parts_are_not_written_into_a_file(tmp_path):
    (tmp_path / "out").touch()
    with pytest.raises(UserError, match="out: is a file; name a folder"), new_parts(tmp_path / "out", REPORT):
        pass


KINDS = ["file", "link", "link to a folder", "dangling link", "hard link", "fifo", "folder"]


@pytest.mark.parametrize("what", KINDS)
def test_nothing_foreign_gives_way_to_a_file_a_folder_or_a_part(tmp_path, what):
    here = tmp_path / "here"
    here.mkdir()
    for name in ("camera.toml", "results", "index.html"):
        lay(here / name, what)
    before = snapshot(tmp_path)
    with pytest.raises(UserError, match=r"camera\.toml"):
        write_text(here / "camera.toml", "width = 1\n", kind="camera")
    with pytest.raises(UserError, match="results"), new_folder(here / "results", RECORD) as new:
        (new / "frames.csv").touch()
    with pytest.raises(UserError, match=r"index\.html"), new_parts(here, REPORT) as new:
        write_text(new / "report.json", "{}\n")
        write_text(new / "index.html", "<html></html>\n")
        write_text(new / "figures" / "a.csv", "a\n")
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("suffix", [".toml", ".json", ".md", ".xml", ".html", ".pdf", ".txt", ".png"])
def test_a_sealed_file_is_written_anew_until_somebody_changes_it(tmp_path, suffix):
    from matplotlib.figure import Figure

    def write():
        with new_file(path, kind=RECORD.kind) as new:
            if suffix in (".png", ".pdf"):
                Figure().savefig(new)
            else:
                new.write_text('{\n "a": 1\n}\n' if suffix == ".json" else "a = 1\n")

    path = tmp_path / f"made{suffix}"
    write()
    write()
    whole = path.read_bytes()
    assert is_sealed(path)
    if suffix == ".json":
        assert json.loads(whole)["a"] == 1
    if suffix == ".png":
        import cv2

        assert cv2.imread(str(path)) is not None
    for changed in (whole + b"x = 2\n", b"x" + whole, whole.replace(whole[20:21], b"~", 1), whole[:-1], b""):
        path.write_bytes(changed)
        with pytest.raises(UserError, match="is not an unmodified file of uavbench"):
            write()
        assert path.read_bytes() == changed


@pytest.mark.parametrize(
    ("found", "wanted", "told"),
    [
        ("camera", "airframe", "was written by uavbench as `camera`, not as `airframe`; move it"),
        ("camera", "", "was written by uavbench as `camera`; move it"),
        (None, "camera", "was written by an earlier version of uavbench, which did not record what it is; move it"),
    ],
)
def test_a_product_of_another_kind_is_not_written_over(tmp_path, found, wanted, told):
    path = tmp_path / "a.toml"
    if found is None:
        path.write_bytes(b"a = 1\n# " + sealed_without_kind(b"a = 1\n# "))
    else:
        write_text(path, "a = 1\n", kind=found)
    before = path.read_bytes()
    with pytest.raises(UserError, match=re.escape(f"a.toml: {told}")):
        write_text(path, "a = 2\n", kind=wanted)
    assert path.read_bytes() == before


def test_a_folder_of_another_kind_is_not_written_over(tmp_path):
    with new_folder(tmp_path / "a", REPORT) as new:
        write_text(new / "frames.csv", "1\n")
        write_text(new / RECORD.name, "{}\n")
    before = snapshot(tmp_path)
    with pytest.raises(UserError, match=r"a: contains (frames\.csv|report\.json)"):
        make(tmp_path / "a", "frames.csv")
    assert snapshot(tmp_path) == before


def test_a_file_without_a_seal_is_never_written_anew(tmp_path):
    write_text(tmp_path / "a.csv", "1\n")
    with pytest.raises(UserError, match=r"a\.csv"):
        write_text(tmp_path / "a.csv", "2\n")
    with owning([tmp_path / "a.csv"]):
        write_text(tmp_path / "a.csv", "2\n")
    assert (tmp_path / "a.csv").read_text() == "2\n"


def make(folder, *names):
    with new_folder(folder, RECORD) as new:
        for name in names:
            write_text(new / name, name)


def test_a_folder_of_ours_is_made_anew_but_not_with_a_users_file_in_it(tmp_path):
    folder = tmp_path / "results"
    make(folder, "frames.csv", "deep/er/b.csv")
    make(folder, "frames.csv")
    assert {p.name for p in folder.iterdir()} == {"frames.csv", "record.json"}
    for name, what in (("notes.txt", "file"), (".notes", "file"), ("deep", "folder"), ("pipe", "fifo")):
        lay(folder / name, what)
        before = snapshot(tmp_path)
        with pytest.raises(UserError, match=name.strip(".")):
            make(folder, "frames.csv")
        assert snapshot(tmp_path) == before
        (folder / name).rename(tmp_path / f"away-{name}")
    (folder / "frames.csv").unlink()
    (folder / "frames.csv").symlink_to(tmp_path / "away-notes.txt")
    with pytest.raises(UserError, match="frames"):
        make(folder, "frames.csv")
    assert (tmp_path / "away-notes.txt").read_bytes() == PRECIOUS


@pytest.mark.parametrize("where", ["new", "deep/er"])
def test_nothing_is_written_into_a_folder_that_is_checked_as_a_whole(tmp_path, where):
    folder = tmp_path / "results"
    make(folder, "frames.csv")
    before = snapshot(tmp_path)
    with pytest.raises(UserError, match="results, which uavbench wrote and checks as a whole; name a folder outside"):
        make(folder / where, "groundtruth.txt")
    for place in (folder, folder / where):
        with pytest.raises(UserError, match="checks as a whole"), new_parts(place, REPORT):
            raise AssertionError("the work is not begun")
    assert snapshot(tmp_path) == before
    make(folder, "frames.csv")
    (folder / "record.json").write_text("{}")  # somebody's own
    make(folder / where, "groundtruth.txt")


@pytest.mark.parametrize("check", [1, 2])
def test_what_a_user_puts_into_a_folder_while_it_is_checked_stays(tmp_path, monkeypatch, check):
    folder = tmp_path / "results"
    make(folder, "frames.csv")
    real, checks = writing.foreign, []

    def slow(*asked):
        checks.append(asked)
        now = len(checks)
        yield from list(real(*asked))
        if now == check and folder.exists():
            (folder / "notes.txt").write_bytes(PRECIOUS)
            put.append(True)

    put = []
    for module in (origin, writing):
        monkeypatch.setattr(module, "foreign", slow)
    before = snapshot(tmp_path)
    if check == 1:
        with pytest.raises(UserError, match=r"results: contains notes\.txt"):
            make(folder, "frames.csv")
        assert set(snapshot(tmp_path)) == {*before, "results/notes.txt"}
    else:
        make(folder, "frames.csv")
    assert len(checks) == 2
    assert (folder / "notes.txt").exists() == bool(put)


def test_a_list_that_somebody_wrote_proves_nothing(tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "thesis.tex").write_bytes(PRECIOUS)
    (folder / "record.json").write_text('{\n "files": [\n  "thesis.tex"\n ]\n}\n')
    with pytest.raises(UserError, match=r"record|thesis"):
        make(folder, "frames.csv")
    write_text(tmp_path / "other" / "record.json", '{\n "files": []\n}\n', kind=RECORD.kind)
    seal_of_another = (tmp_path / "other" / "record.json").read_bytes()
    (folder / "record.json").write_bytes(seal_of_another)
    with pytest.raises(UserError, match=r"record|thesis"):
        make(folder, "frames.csv")


@pytest.mark.parametrize("marker", ["files", "sha256"])
def test_a_list_that_was_copied_proves_nothing_of_what_has_the_same_names(tmp_path, marker):
    """A user's files, called as those that a marker lists: it was copied to them, or one of them to its folder."""

    def write(folder):
        with new_folder(folder, Marker("list.json", "list")) as new:
            for name in ("frames.csv", "deep/b.csv"):
                write_text(new / name, name)
            if marker == "sha256":
                digests = {name: hashlib.sha256(name.encode()).hexdigest() for name in ("frames.csv", "deep/b.csv")}
                write_text(new / "list.json", json.dumps({"sha256": digests}))

    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    write(ours)
    (theirs / "deep").mkdir(parents=True)
    (theirs / "list.json").write_bytes((ours / "list.json").read_bytes())
    (theirs / "deep" / "b.csv").write_bytes(PRECIOUS)
    (theirs / "frames.csv").write_text("frames.csv")
    (ours / "frames.csv").write_bytes(PRECIOUS)
    before = snapshot(tmp_path)
    for folder, name in ((ours, "frames.csv"), (theirs, "deep/b.csv")):
        with pytest.raises(UserError, match=name):
            write(folder)
    assert snapshot(tmp_path) == before
    with owning([ours / "frames.csv"]):  # a job's own record says that it wrote it: what is damaged is made again
        write(ours)
    assert (ours / "frames.csv").read_text() == "frames.csv"


@pytest.mark.parametrize("names", [("index.html", "a.csv"), ("index.html",), ("a.csv",)])
def test_parts_do_not_take_the_place_of_what_a_user_wrote_under_their_names(tmp_path, names):
    def write(folder, *names):
        with new_parts(folder, REPORT) as new:
            for name in (*names, "report.json"):
                write_text(new / name, "{}")

    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    write(ours, "index.html", "a.csv")
    theirs.mkdir()
    (theirs / "report.json").write_bytes((ours / "report.json").read_bytes())
    for folder in (ours, theirs):
        (folder / "index.html").write_bytes(PRECIOUS)
        if "index.html" in names:
            before = snapshot(tmp_path)
            with pytest.raises(UserError, match=r"index\.html"):
                write(folder, *names)
            assert snapshot(tmp_path) == before
        else:
            write(folder, *names)
        assert (folder / "index.html").read_bytes() == PRECIOUS


def test_a_list_of_names_alone_as_earlier_versions_wrote_it_proves_nothing(tmp_path):
    make(tmp_path / "results", "frames.csv")
    write_text(tmp_path / "old" / "record.json", '{\n "files": [\n  "frames.csv"\n ]\n}\n', kind=RECORD.kind)
    (tmp_path / "old" / "frames.csv").write_bytes(PRECIOUS)
    with pytest.raises(UserError, match=r"frames\.csv"):
        make(tmp_path / "old", "frames.csv")
    assert (tmp_path / "old" / "frames.csv").read_bytes() == PRECIOUS


def test_parts_of_last_time_go_and_what_a_user_put_beside_them_stays(tmp_path):
    for names in (("index.html", "pages/a.html", "figures/a.csv"), ("index.html", "figures/b.csv")):
        (tmp_path / "figures").mkdir(exist_ok=True)
        (tmp_path / "figures" / "mine.pdf").write_bytes(PRECIOUS)
        with new_parts(tmp_path, REPORT) as new:
            for name in names:
                write_text(new / name, name)
            write_text(new / "report.json", '{"content_hash": "a"}\n')
    assert set(snapshot(tmp_path)) == {"figures", "figures/mine.pdf", "figures/b.csv", "index.html", "report.json"}
    assert json.loads((tmp_path / "report.json").read_text())["content_hash"] == "a"


def test_an_error_or_an_interrupt_in_the_middle_leaves_the_old_and_nothing_else(tmp_path):
    make(tmp_path / "results", "frames.csv")
    before = snapshot(tmp_path)
    for error in (ZeroDivisionError, KeyboardInterrupt, SystemExit):
        with pytest.raises(error), new_folder(tmp_path / "results", RECORD) as new:
            (new / "half").touch()
            raise error
        with pytest.raises(error), new_file(tmp_path / "a.toml", kind=RECORD.kind) as new:
            new.write_text("half")
            raise error
    assert snapshot(tmp_path) == before


WRITERS = {
    "a file": lambda path: new_file(path, kind=RECORD.kind),
    "a folder": lambda path: new_folder(path, RECORD),
    "parts": lambda path: new_parts(path, REPORT),
}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_no_folder_is_left_of_what_was_not_made_but_those_that_were_there_before(tmp_path, write):
    (tmp_path / "there").mkdir()
    before = snapshot(tmp_path)
    with pytest.raises(KeyboardInterrupt), write(tmp_path / "there" / "a" / "b"):
        raise KeyboardInterrupt
    assert snapshot(tmp_path) == before
    with pytest.raises(KeyboardInterrupt), write(tmp_path / "there" / "a" / "b"):
        (tmp_path / "there" / "a" / "of another process.txt").write_bytes(PRECIOUS)
        raise KeyboardInterrupt
    assert (tmp_path / "there" / "a" / "of another process.txt").read_bytes() == PRECIOUS


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_no_folder_is_left_above_one_that_cannot_be_made(tmp_path, write):
    with pytest.raises(OSError, match="File name too long"), write(tmp_path / "a" / "b" / ("n" * 256) / "c"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@pytest.mark.parametrize("where", ["file/b", "/proc/none/b", "/proc/self/b"])
def test_a_place_where_nothing_can_be_made_is_told_as_that(tmp_path, write, where):
    (tmp_path / "file").touch()
    before = snapshot(tmp_path)
    with pytest.raises(NotADirectoryError) as told, write(tmp_path / where):
        pass
    assert told.value.filename == str(tmp_path / where) and "-uavbench-" not in str(told.value)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_folder_that_another_process_made_in_vain_and_removed_is_made_again(tmp_path, write, monkeypatch):
    make = folders.make_folder

    def made_and_removed(folder):
        monkeypatch.setattr(folders, "make_folder", make)
        make(folder)
        folder.rmdir()

    monkeypatch.setattr(folders, "make_folder", made_and_removed)
    with write(tmp_path / "a" / "b") as new:
        (new / "report.json" if new.is_dir() else new).write_text("{}")
    assert (tmp_path / "a" / "b").exists()


def test_a_folder_that_one_process_removed_and_another_made_again_is_written_to(tmp_path, monkeypatch):
    link = Path.symlink_to

    def in_a_removed_folder(path, target):
        monkeypatch.setattr(Path, "symlink_to", link)
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(path))

    monkeypatch.setattr(Path, "symlink_to", in_a_removed_folder)
    write_text(tmp_path / "a", "x")
    assert (tmp_path / "a").read_text() == "x"


KILLED = """
import os, sys
from pathlib import Path
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_file, new_folder
folder = Path(sys.argv[1])
with new_folder(folder / "results", Marker("record.json", "estimates")) as new, new_file(folder / "a.toml") as file:
    (new / "half").mkdir()
    (new / "half" / "b.csv").write_text("x")
    print("begun", flush=True)
    sys.stdin.read()
"""


def begin(folder):
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "begun\n"
    return process


def test_only_what_a_dead_process_left_is_removed(tmp_path):
    for name in (".pre-commit-config.yaml", ".git-credentials", ".a-uavbench-b", f".a-uavbench-{'0' * 32}.toml"):
        (tmp_path / name).write_bytes(PRECIOUS)
    (tmp_path / f".a-uavbench-{'1' * 32}.owner").symlink_to("uavbench elsewhere 1 1 2")  # of another token
    (tmp_path / f".b-uavbench-{'1' * 32}.owner").symlink_to(tmp_path / ".git-credentials")
    before = snapshot(tmp_path)
    process = begin(tmp_path)
    begun = snapshot(tmp_path)
    assert len(begun) > len(before) + 3
    for alone in (True, False):
        remove_leftovers(tmp_path, alone=alone)
        assert snapshot(tmp_path) == begun, "its owner lives"
    process.send_signal(signal.SIGKILL)
    process.wait()
    remove_leftovers(tmp_path, alone=False)
    assert snapshot(tmp_path) == before


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


@pytest.mark.parametrize("write", ["a folder", "a file", "parts"])
def test_the_next_that_is_written_there_removes_what_a_dead_process_left_and_nothing_else(tmp_path, write, monkeypatch):
    monkeypatch.setattr(temporary_names, "_cleaned", set())
    (tmp_path / f".a-uavbench-{'0' * 32}.toml").write_bytes(PRECIOUS)
    killed = begin(tmp_path)
    kill(killed)
    alive = begin(tmp_path)
    of_it = [name for name in snapshot(tmp_path) if "uavbench" in name]
    assert len(of_it) > 6
    if write == "a folder":
        make(tmp_path / "other", "frames.csv")
    elif write == "a file":
        write_text(tmp_path / "other.toml", "x")
    else:
        with new_parts(tmp_path, REPORT) as new:
            (new / "report.json").write_text("{}")
    left = {name.split("/")[0] for name in snapshot(tmp_path) if "uavbench" in name}
    assert len([name for name in left if name.endswith(".owner")]) == 2, "those of the process that lives"
    assert (tmp_path / f".a-uavbench-{'0' * 32}.toml").read_bytes() == PRECIOUS
    kill(alive)


REPLACING = """
import os, signal, sys
from pathlib import Path
from uavbench.trajectories.files import writing
from uavbench.trajectories.files.listed import Marker
before = getattr(writing, sys.argv[2])
def die(*given):
    if sys.argv[3] == "after":
        before(*given)
    os.kill(os.getpid(), getattr(signal, sys.argv[4]))
    if sys.argv[3] == "before":
        before(*given)
setattr(writing, sys.argv[2], die)
with writing.new_folder(Path(sys.argv[1]), Marker("record.json", "estimates")) as new:
    (new / "frames.csv").write_text("new")
"""


@pytest.mark.parametrize("sign", ["SIGKILL", "SIGINT"])
@pytest.mark.parametrize("at", [("_set_aside", "after"), ("rename_new", "before"), ("rename_new", "after")])
def test_a_folder_that_is_replaced_is_never_lost_whenever_the_process_ends(tmp_path, at, sign, monkeypatch):
    folder = tmp_path / ("results of " + "a flight, " * 5)  # longer than what its temporary name repeats of it
    make(folder, "frames.csv")
    old = (folder / "frames.csv").read_text()
    told = subprocess.run(
        [sys.executable, "-c", REPLACING, str(folder), *at, sign], check=False, preexec_fn=as_from_a_terminal
    )
    assert told.returncode != 0
    monkeypatch.setattr(temporary_names, "_cleaned", set())  # as of a new process
    write_text(tmp_path / "next.toml", "x")
    held = ("", "/frames.csv", "/record.json")
    assert set(snapshot(tmp_path)) == {"next.toml", *(f"{folder.name}{name}" for name in held)}
    assert (folder / "frames.csv").read_text() == ("new" if at == ("rename_new", "after") else old)


def left_by_a_dead_process(folder, *endings, name="a", machine="anothermachine"):
    """Leftovers of a process in a folder, each with a file in it; returns their common name."""
    stem = f".{name[:40]}-uavbench-{'3' * 32}"
    for ending in endings:
        (folder / (stem + ending)).mkdir()
        (folder / (stem + ending) / "thesis.tex").write_bytes(PRECIOUS)
    (folder / f"{stem}.owner").symlink_to(f"uavbench {machine} 99999999 345 {'3' * 32} {name}")
    return stem


@pytest.mark.parametrize("name", ["a", " a  b ", "a\nb", os.fsdecode(b"\xff\xfe"), "\U0001f681" * 63, "x" * 255])
def test_what_was_set_aside_is_put_back_whatever_its_name(tmp_path, name):
    left_by_a_dead_process(tmp_path, "", ".replaced", name=name)
    remove_leftovers(tmp_path, alone=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name / "thesis.tex").read_bytes() == PRECIOUS


def test_what_was_set_aside_does_not_take_the_place_of_what_stands_there_now(tmp_path):
    """The process may have ended while it checked whether a user's files are in it: they are kept, as if it lived."""
    left_by_a_dead_process(tmp_path, "", ".replaced")
    (tmp_path / "a").write_bytes(PRECIOUS)
    remove_leftovers(tmp_path, alone=True)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "a.kept-1"}
    assert (tmp_path / "a").read_bytes() == (tmp_path / "a.kept-1" / "thesis.tex").read_bytes() == PRECIOUS


@pytest.mark.parametrize("moved", [False, True])
def test_what_has_been_replaced_does_not_come_back(tmp_path, moved):
    """Its process ended while it removed it, and the new one may have been moved elsewhere since."""
    left_by_a_dead_process(tmp_path, ".replaced")
    if not moved:
        (tmp_path / "a").mkdir()
    remove_leftovers(tmp_path, alone=True)
    assert [path.name for path in tmp_path.iterdir()] == ([] if moved else ["a"])


def test_what_cannot_be_put_back_stays_and_the_rest_is_removed(tmp_path, monkeypatch):
    stem = left_by_a_dead_process(tmp_path, "", ".replaced")
    left_by_a_dead_process(tmp_path, "", name="b")

    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("uavbench.trajectories.files.placing.rename_new", refuse)
    remove_leftovers(tmp_path, alone=True)
    assert {path.name for path in tmp_path.iterdir()} == {stem, f"{stem}.replaced", f"{stem}.owner"}


def test_a_second_interrupt_does_not_lose_what_is_replaced(tmp_path, monkeypatch):
    make(tmp_path / "a", "frames.csv")
    monkeypatch.setattr(writing, "rename_new", interrupt)
    exists = Path.exists
    monkeypatch.setattr(Path, "exists", lambda path: interrupt() if "-uavbench-" in path.name else exists(path))
    with pytest.raises(KeyboardInterrupt):
        make(tmp_path / "a", "other.csv")
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a" / "frames.csv").read_text() == "frames.csv"


def interrupt(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "name", ["a.owner", "a.replaced", "\U0001f681" * 43 + "." + "\U0001f681" * 19, "a." + "b" * 200]
)
def test_files_and_folders_of_any_name_are_written_and_replaced(tmp_path, name):
    for _ in range(2):
        make(tmp_path / name, "frames.csv")
    with new_file(tmp_path / "in" / name) as new:
        new.write_text("x")
    assert {path.name for path in tmp_path.iterdir()} == {"in", name}
    assert [path.name for path in (tmp_path / "in").iterdir()] == [name]


def test_a_folder_that_is_not_writable_stays_so(tmp_path):
    """Write permission is taken within what is removed, never of the folder that it is in."""
    folder, user, nobody = tmp_path / "in", os.geteuid(), 65534
    folder.mkdir()
    left_by_a_dead_process(folder, "", machine=Machine.here())
    if user == 0:  # who may write everywhere
        for path in (folder, *folder.rglob("*")):
            os.chown(path, nobody, nobody, follow_symlinks=False)
        for above in tmp_path.parents[:2]:
            above.chmod(0o755)
        tmp_path.chmod(0o755)
    folder.chmod(0o555)
    try:
        if user == 0:
            os.seteuid(nobody)
        temporary_names.clean_once(folder)
    finally:
        os.seteuid(user)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o555
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES])
def test_a_disk_without_room_for_an_owner_is_told_by_the_name_of_the_file(tmp_path, monkeypatch, number):
    def full(link, target):
        raise OSError(number, os.strerror(number), target, None, str(link))

    monkeypatch.setattr(Path, "symlink_to", full)
    with pytest.raises(OSError, match=re.escape(os.strerror(number))) as error:
        write_text(tmp_path / "a.csv", "x")
    assert (error.value.errno, error.value.filename) == (number, str(tmp_path / "a.csv"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["../a", "..", "b/c", ""])
def test_an_owner_that_names_no_file_of_its_folder_moves_nothing(tmp_path, name):
    token = "3" * 32
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / f".a-uavbench-{token}.replaced").write_text("x")
    (tmp_path / "in" / f".a-uavbench-{token}.owner").symlink_to(f"uavbench anothermachine 12 345 {token} {name}")
    remove_leftovers(tmp_path / "in", alone=True)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_what_a_process_of_another_machine_left_goes_only_when_nobody_else_is_at_work(tmp_path):
    token = "2" * 32
    (tmp_path / f".a-uavbench-{token}").mkdir()
    (tmp_path / f".a-uavbench-{token}.owner").symlink_to(f"uavbench anothermachine 12 345 {token}")
    remove_leftovers(tmp_path, alone=False)
    assert len(list(tmp_path.iterdir())) == 2
    remove_leftovers(tmp_path, alone=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("other", "local", "goes"), [
    ({"boot": "0" * 16}, True, True),
    ({"boot": "0" * 16}, False, False),  # a disk that others may write to, whose names may be copies
    ({"boot": "0" * 16, "identity": "1" * 16}, True, False),  # another machine, or its container
    ({"boot": "0" * 16, "identity": ""}, True, False),
    ({"namespace": "0" * 16}, True, False),  # a container beside this one, whose processes are not seen here
])  # fmt: skip
def test_what_this_machine_left_before_it_was_booted_again_is_removed_from_its_own_disks(
    tmp_path, monkeypatch, other, local, goes
):
    monkeypatch.setattr(machines, "is_local", lambda folder: local)
    monkeypatch.setattr(machines, "_here", lambda: Machine("a" * 16, "b" * 16, "c" * 16))
    token, left = "2" * 32, replace(Machine.here(), **other)
    (tmp_path / f".a-uavbench-{token}").mkdir()
    (tmp_path / f".a-uavbench-{token}.owner").symlink_to(f"uavbench {left} {os.getpid()} 345 {token} a")
    remove_leftovers(tmp_path, alone=False)
    assert len(list(tmp_path.iterdir())) == (0 if goes else 2)


def test_the_longest_name_that_a_disk_takes_has_a_temporary_name_too(tmp_path):
    for name in ("n" * 255, "\N{GREEK SMALL LETTER ALPHA}" * 127, "a." + "s" * 253):
        write_text(tmp_path / name, "x")
        assert (tmp_path / name).read_text() == "x"
    with pytest.raises(OSError, match="too long"):
        write_text(tmp_path / ("n" * 256), "x")
    with temporary(tmp_path / "a") as own:
        assert own.made.parent == tmp_path
    assert len(list(tmp_path.iterdir())) == 3


def test_processes_that_clean_up_at_the_same_time_do_not_trip_over_each_other(tmp_path):
    for _ in range(3):
        process = begin(tmp_path)
        process.kill()
        process.wait()
    for n in range(100):
        token = f"{n:032x}"
        (tmp_path / f".a-uavbench-{token}").mkdir()
        (tmp_path / f".a-uavbench-{token}" / "b").touch()
        (tmp_path / f".a-uavbench-{token}.owner").symlink_to(f"uavbench m 12 345 {token}")
    code = "import sys, pathlib; from uavbench.trajectories.files.temporary_names import remove_leftovers\n"
    code += "print('ready', flush=True); sys.stdin.read(); remove_leftovers(pathlib.Path(sys.argv[1]), alone=True)"
    together = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        for _ in range(4)
    ]
    assert [process.stdout.readline() for process in together] == [b"ready\n"] * 4
    for process in together:
        process.stdin.close()
    assert [process.stderr.read() for process in together] == [b""] * 4
    assert [process.wait() for process in together] == [0] * 4
    assert not list(tmp_path.iterdir())


def test_what_is_written_is_for_all_to_read_once_it_is_whole(tmp_path):
    def mode(path):
        return stat.S_IMODE(path.stat().st_mode)

    with new_file(tmp_path / "a.csv") as new:
        assert mode(new) == 0o600
    with new_folder(tmp_path / "results", RECORD) as new:
        assert mode(new) == 0o700
    assert (mode(tmp_path / "a.csv"), mode(tmp_path / "results")) == (0o644, 0o755)


def test_a_table_is_sealed_on_request_alone(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1\n")
    seal(path, "table")
    assert path.read_text() == "1\n"
    seal_table(path, "table")
    assert path.read_text().startswith("1\n# table; ")
    assert sealed_kind(path) == "table"
    path.write_text(path.read_text().replace("1\n", "2\n"))
    assert sealed_kind(path) is None


def test_a_seal_keeps_to_the_format_of_its_file(tmp_path):
    for name, text in (("a.json", '{"a": 1}'), ("b.json", "[1]\n"), ("c.csv", "{\n}\n")):
        (tmp_path / name).write_text(text)
        seal(tmp_path / name, "note")
        assert (tmp_path / name).read_text() == text, "a format without comments, or not as we write it"
    (tmp_path / "d.txt").write_text("{\n}\n")
    seal(tmp_path / "d.txt", "note")
    assert (tmp_path / "d.txt").read_text().startswith("{\n}\n# note; ")


def test_a_process_has_one_start_while_it_lives_and_none_afterwards():
    process = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)
    start = start_ticks(process.pid)
    assert start == start_ticks(process.pid)
    assert int(start) >= int(start_ticks(os.getpid()))
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    assert start_ticks(process.pid) == ""  # not yet waited for
    process.wait()
    assert start_ticks(process.pid) == ""
    process.stdin.close()


def test_without_proc_a_process_lives_while_its_number_answers(monkeypatch):
    monkeypatch.setattr(temporary_names, "Path", lambda path: Path(path.replace("/proc", "/no-such-folder")))
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    assert (start_ticks(os.getpid()), start_ticks(process.pid)) == ("running", "")


def test_folders_above_are_made(tmp_path):
    make(tmp_path / "a" / "b" / "results", "frames.csv")
    write_text(tmp_path / "c" / "d" / "e.csv", "1\n")
    assert (tmp_path / "a" / "b" / "results" / "record.json").exists() and (tmp_path / "c" / "d" / "e.csv").exists()


def test_a_seal_is_of_one_file(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"12")
    seal(tmp_path / "a.bin", "blob")
    assert (tmp_path / "a.bin").read_bytes() == b"12"
    assert not is_sealed(tmp_path / "a.bin")
    assert not is_sealed(tmp_path)
    assert not is_sealed(tmp_path / "none")


@pytest.mark.parametrize("where", ["file/b", "/proc/none/b", "/proc/b"])
def test_a_place_is_tried_before_the_work_and_nothing_is_left(tmp_path, where):
    (tmp_path / "file").touch()
    before = snapshot(tmp_path)
    with pytest.raises(NotADirectoryError) as told:
        try_place(tmp_path / where)
    assert told.value.filename == str(tmp_path / where)
    try_place(tmp_path / "a" / "b" / "init.toml")
    try_place(tmp_path / "file")
    assert snapshot(tmp_path) == before
