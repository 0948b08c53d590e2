"""What is kept of the job folder of a faulty tracker: all within limits, links as links, words without commands."""

import os

import pytest

from uavbench.bench.external import kept_folder
from uavbench.bench.external.kept_folder import KEPT_MARKER, MOST_BYTES, keep
from uavbench.trajectories.files.listed import Listed


@pytest.fixture
def job(tmp_path):
    (tmp_path / "job" / "frames").mkdir(parents=True)
    (tmp_path / "job" / "job.toml").write_text("seed = 0\n")
    (tmp_path / "job" / "frames" / "0.png").write_bytes(b"0")
    return tmp_path / "job"


def kept(job, faults=("a fault", "another")):
    folder = job.parent / "kept"
    keep(job, folder, faults)
    return folder, (folder / "faults.txt").read_text()


def names(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_symlink() or path.is_file()}


def test_a_job_folder_is_kept_with_its_faults_and_their_list(job):
    (job / "latest").symlink_to("/etc/hostname")
    folder, told = kept(job)
    assert told == "a fault\nanother\n"
    assert names(folder) == {"job.toml", "frames/0.png", "latest", "faults.txt", KEPT_MARKER.name}
    assert str((folder / "latest").readlink()) == "/etc/hostname"
    assert Listed.of(folder, KEPT_MARKER).holds(folder, "frames/0.png")
    assert names(kept(job)[0]) == names(folder)  # written anew


def test_names_of_ours_are_not_the_programs_at_the_top_and_are_kept_below(job):
    for at in (job, job / "frames"):
        for name in (KEPT_MARKER.name, "faults.txt"):
            (at / name).write_text("the program's")
        (at / "tmp").mkdir()
        (at / "tmp" / "scratch").touch()
    folder, told = kept(job)
    assert told == "a fault\nanother\n"
    assert "tmp/scratch" not in names(folder)
    assert {"frames/uavbench.json", "frames/faults.txt", "frames/tmp/scratch"} <= names(folder)


def test_the_programs_words_are_kept_as_text_up_to_the_limit(job, monkeypatch):
    monkeypatch.setattr(kept_folder, "MOST_BYTES", 20)
    (job / "stdout.txt").write_bytes(b"\x1b[31mred\xff" + b"x" * 100)
    (job / "stderr.txt").symlink_to(job / "job.toml")
    folder, told = kept(job)
    text = (folder / "stdout.txt").read_text()
    assert "\x1b" not in text and "red" in text
    assert text.count("x", text.index("red")) == 20 - len(b"\x1b[31mred\xff")
    assert "stderr.txt" not in names(folder)
    assert "not kept" not in told


@pytest.mark.parametrize("over", [0, 1])
def test_the_largest_file_that_is_kept_is_of_the_limit(job, over):
    with (job / "large").open("wb") as handle:
        handle.truncate(MOST_BYTES + over)
    folder, told = kept(job)
    assert ("large" in names(folder)) == (not over)
    assert ("not kept: files of more than 16,777,216 bytes\n" in told) == bool(over)


@pytest.mark.parametrize("over", [0, 1])
def test_as_many_files_and_levels_are_kept_as_the_limits_say(job, monkeypatch, over):
    monkeypatch.setattr(kept_folder, "MOST_FILES", 5)
    monkeypatch.setattr(kept_folder, "MOST_LEVELS", 3)
    for number in range(3 + over):
        (job / "frames" / f"{number + 1}.png").touch()
    below = job / "/".join("abcd"[: 3 + over])
    below.mkdir(parents=True)
    folder, told = kept(job)
    assert len([name for name in names(folder) if name.startswith("frames/")]) + 1 <= 5
    assert ("not kept: more than 5 files\n" in told) == bool(over)
    assert (folder / "a/b/c").is_dir()
    assert (folder / "a/b/c/d").exists() is False
    assert ("not kept: folders more than 3 levels deep\n" in told) == bool(over)


def test_what_is_neither_file_folder_nor_link_is_left_out(job):
    os.mkfifo(job / "pipe")
    os.mkfifo(job / "stdout.txt")
    folder, told = kept(job)
    assert names(folder) == {"job.toml", "frames/0.png", "faults.txt", KEPT_MARKER.name}
    assert told == "a fault\nanother\n"


@pytest.mark.parametrize("instead", ["link", "file", "nothing"])
def test_a_job_folder_that_is_gone_is_told(job, instead):
    job.rename(job.with_name("moved"))
    if instead == "link":
        job.symlink_to("moved")
    elif instead == "file":
        job.touch()
    folder, told = kept(job)
    assert names(folder) == {"faults.txt", KEPT_MARKER.name}
    wanted = (
        "not all of the job folder could be kept: " if instead == "nothing" else "not kept: the program replaced its"
    )
    assert told.startswith("a fault\nanother\n" + wanted)
