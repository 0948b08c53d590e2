"""The folder of a suite: claimed, locked and cleaned, and never taken from anybody."""

import fcntl
import json
import os

import pytest

from tests.bench.small_suites import FLOWN, small_suite
from uavbench.bench.config.shard import Shard
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.output_folder import RESULTS, clean_leftovers, refuse_foreign_folder, resolved, suite_folder
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text

TOKEN = "3" * 32


@pytest.fixture
def suite(tmp_path):
    return load_suite(small_suite(tmp_path))


def leftover(folder, name="a"):
    """What a killed process of another machine leaves."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f".{name}-uavbench-{TOKEN}").mkdir()
    (folder / f".{name}-uavbench-{TOKEN}.owner").symlink_to(f"uavbench elsewhere 12 345 {TOKEN}")


def hidden(folder):
    return [path for path in folder.rglob(".*") if not path.name.startswith(".lock")]


def test_a_folder_is_claimed_and_says_whose_it_is(suite, tmp_path):
    out = tmp_path / "deep" / "out"
    with suite_folder(out, suite) as folder:
        assert folder == out
        about = json.loads((out / "suite.json").read_text())
    assert sealed_kind(out / "suite.json") == RESULTS
    assert (about["suite"], about["title"], about["trackers"]) == ("small", "small", ["hold"])
    assert (about["sequences"], about["rates_hz"]) == (["box-s0", "box-s1"], [15.0])
    assert "loops" not in about
    before = (out / "suite.json").stat()
    with suite_folder(out, suite):
        assert (out / "suite.json").stat() == before
    (tmp_path / "flown.toml").write_text(FLOWN)
    with suite_folder(out, load_suite(tmp_path / "flown.toml")):
        about = json.loads((out / "suite.json").read_text())
        assert (about["suite"], about["loops"]) == ("flown", [""])


def test_one_process_uses_it_or_shards_that_differ(suite, tmp_path):
    out = tmp_path / "out"
    used = "another uavbench process uses it"
    with suite_folder(out, suite):
        for shard in (None, Shard(1, 2)):
            with pytest.raises(UserError, match=used), suite_folder(out, suite, shard):
                pass
    with suite_folder(out, suite, Shard(1, 2)), suite_folder(out, suite, Shard(2, 2)):
        for shard in (None, Shard(1, 2), Shard(2, 2)):
            with pytest.raises(UserError, match=used), suite_folder(out, suite, shard):
                pass
    with suite_folder(out, suite):
        pass


def test_the_lock_is_free_after_an_error(suite, tmp_path):
    with pytest.raises(ZeroDivisionError), suite_folder(tmp_path / "out", suite):
        leftover(tmp_path / "out")
        raise ZeroDivisionError
    assert not hidden(tmp_path / "out")
    with suite_folder(tmp_path / "out", suite):
        pass


def test_what_was_left_goes_before_and_after_unless_a_shard_may_be_at_work_on_it(suite, tmp_path):
    out = tmp_path / "out"
    with suite_folder(out, suite):
        pass
    leftover(out / "results" / "box-s0" / "hold@15hz")
    with suite_folder(out, suite, Shard(1, 2)):
        assert len(hidden(out)) == 2
    assert len(hidden(out)) == 2
    with suite_folder(out, suite):
        assert not hidden(out)
        leftover(out)
    assert not hidden(out)


@pytest.mark.parametrize(
    "below",
    ["", "sequences", "results/a/b", "restarts/a/b", "flights/a/b", "videos/a/b", "failed/a", "made/a/b/c/d"],
)
def test_leftovers_are_found_wherever_jobs_write(tmp_path, below):
    leftover(tmp_path / below)
    leftover(tmp_path / "users" / "own")
    clean_leftovers(tmp_path, alone=True)
    assert not hidden(tmp_path / below) or not below
    assert len(hidden(tmp_path / "users")) == 2


def test_links_to_folders_are_cleaned_as_any_and_files_in_their_place_are_left(tmp_path):
    (tmp_path / "results").write_text("mine")
    clean_leftovers(tmp_path, alone=True)
    assert (tmp_path / "results").read_text() == "mine"


def test_a_folder_of_others_is_refused_by_what_is_in_it(suite, tmp_path):
    out = tmp_path / "out"
    refuse_foreign_folder(out)
    out.mkdir()
    refuse_foreign_folder(out)
    (out / ".lock").touch()
    (out / "slurm").mkdir()
    (out / f".suite.json-uavbench-{TOKEN}").touch()
    refuse_foreign_folder(out)
    (out / "thesis.tex").write_text("mine")
    with pytest.raises(UserError, match=r"out: holds something other than uavbench's output: thesis\.tex"):
        refuse_foreign_folder(out)
    with pytest.raises(UserError, match=r"thesis\.tex"), suite_folder(out, suite):
        pass
    assert not (out / "suite.json").exists()
    (out / "thesis.tex").unlink()
    write_text(out / "suite.json", '{\n "suite": "a"\n}\n', kind=RESULTS)
    (out / "thesis.tex").write_text("mine")
    refuse_foreign_folder(out)  # a user's file in a folder of ours


def test_what_somebody_puts_there_while_it_is_locked_is_seen(suite, tmp_path, monkeypatch):
    real = fcntl.flock

    def late(*arguments):
        (tmp_path / "out" / "thesis.tex").write_text("mine")
        real(*arguments)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(UserError, match=r"thesis\.tex"), suite_folder(tmp_path / "out", suite):
        pass
    assert not (tmp_path / "out" / "suite.json").exists()


@pytest.mark.parametrize("kind", ["", "package"])
def test_a_description_of_another_kind_or_of_a_user_is_refused(suite, tmp_path, kind):
    (tmp_path / "out").mkdir()
    write_text(tmp_path / "out" / "suite.json", '{\n "suite": "a"\n}\n', kind=kind)
    with pytest.raises(UserError, match=r"suite\.json"):
        refuse_foreign_folder(tmp_path / "out")
    with pytest.raises(UserError, match=r"suite\.json"), suite_folder(tmp_path / "out", suite):
        pass
    assert (tmp_path / "out" / "suite.json").read_text().startswith('{\n "suite": "a"')


@pytest.mark.parametrize("kind", ["file", "dangling link"])
def test_what_is_no_folder_is_refused(suite, tmp_path, kind):
    out = tmp_path / "out"
    if kind == "file":
        out.write_text("mine")
    else:
        out.symlink_to(tmp_path / "none")
        with pytest.raises(UserError, match="out: is a dangling link; name another folder"):
            resolved(out)
    with pytest.raises(UserError, match="out: not a folder"), suite_folder(out, suite):
        pass
    assert os.path.lexists(out)
    inside = out / "in" if kind == "file" else tmp_path / "small.toml" / "out" / "in"
    with pytest.raises(UserError, match=r"out/in: cannot be written: .*; name another"), suite_folder(inside, suite):
        pass


def test_a_link_to_a_folder_is_resolved(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "out").symlink_to("far")
    assert resolved(tmp_path / "out") == (tmp_path / "far").resolve()
    assert resolved(tmp_path / "new") == (tmp_path / "new").resolve()
    assert resolved(tmp_path / "out" / "new") == (tmp_path / "far" / "new").resolve()


def test_a_link_to_a_disk_that_is_not_mounted_is_refused_anywhere_in_a_path(tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "disk" / "out")
    for below in ("", "suite", "of/a/suite"):
        with pytest.raises(UserError, match=r"/out: is a dangling link"):
            resolved(tmp_path / "out" / below)
    assert not (tmp_path / "disk").exists()


@pytest.mark.parametrize("name", [".lock", ".lock_1_of_2"])
@pytest.mark.parametrize("what", ["link", "dangling link", "fifo", "folder"])
def test_a_lock_is_a_file_and_nothing_else(suite, tmp_path, name, what):
    out, far = tmp_path / "out", tmp_path / "far"
    out.mkdir()
    far.write_text("mine")
    if what == "fifo":
        os.mkfifo(out / name)
    elif what == "folder":
        (out / name).mkdir()
    else:
        (out / name).symlink_to(far if what == "link" else tmp_path / "none")
    refused = pytest.raises(UserError, match=r"is not a regular file|cannot be written")
    with refused, suite_folder(out, suite, Shard(1, 2)):
        pass
    assert far.read_text() == "mine"
    assert not (tmp_path / "none").exists()


def test_a_lock_file_is_never_written_to(suite, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".lock").write_text("somebody's note")
    with suite_folder(tmp_path / "out", suite):
        pass
    assert (tmp_path / "out" / ".lock").read_text() == "somebody's note"


def test_the_folder_of_the_truth_is_not_told_by_the_option_of_another(suite, tmp_path):
    """`pack` names it with --truth; --out is the participants'."""
    (tmp_path / "truth").write_text("")
    with pytest.raises(UserError, match=r"not a folder; name another one$"), suite_folder(tmp_path / "truth", suite):
        pass
