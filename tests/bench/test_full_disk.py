"""A disk that is full or broken at any moment ends a command with one message, and leaves nothing half-made."""

import errno
import os
import resource
import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.small_suites import own_images
from uavbench.bench.cli.main import main
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.style import house_style, new_figure, save_figure
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.exports.registry import EXPORTS
from uavbench.scenes.image_files import begin_video, finish_video
from uavbench.trajectories.errors import DiskError, UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_file, new_folder, new_parts
from uavbench.trajectories.sensors.sensor import Table, write_records

MOST_CALLS = 10_000


@contextmanager
def files_of_at_most(size):
    """No file of this process gets larger: a write beyond fails as on a full disk, with another number."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def everything(folder):
    return sorted(folder.rglob("*"))


def failing(number, after):
    """An `os.fsync` that raises from its call `after` on, and counts its calls."""
    calls = [0]

    def fsync(handle):
        calls[0] += 1
        if calls[0] > after:
            raise OSError(number, os.strerror(number))

    return fsync, calls


COMMANDS = {
    "export": ["export", str(TRIAL), "--format", "tum", "--out", "{out}/e"],
    "track": [
        *("track", "hold", "--images", "{here}/frames", "--model", "{here}/model.obj"),
        *("--camera", "{here}/camera.toml", "--init", "{here}/init.toml", "--out", "{out}/t"),
    ],
}


@pytest.mark.parametrize(("number", "frees"), [(errno.ENOSPC, True), (errno.EDQUOT, True), (errno.EACCES, False)])
def test_space_is_to_be_freed_where_there_is_none_and_not_where_a_right_is_missing(tmp_path, number, frees):
    with pytest.raises(UserError, match="choose another folder") as told, disk_errors(tmp_path):
        raise OSError(number, os.strerror(number))
    assert ("free space" in str(told.value)) == frees


def test_a_missing_file_elsewhere_is_told_by_its_own_name(tmp_path):
    """As one that a user's effect reads: the folder that was written had been told."""
    folder, table = tmp_path / "out" / "box-s0", tmp_path / "gains.npy"
    with pytest.raises(UserError, match=r"gains\.npy: No such file or directory; check"), disk_errors(folder):
        table.read_bytes()
    with pytest.raises(UserError, match="box-s0: cannot be written: No such file"), disk_errors(folder):
        (folder / "frames.csv").read_bytes()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
@pytest.mark.parametrize("command", ["export", "track"])
def test_a_disk_that_fails_at_any_moment_is_told_and_nothing_is_left(tmp_path, monkeypatch, command, number):
    here, out = tmp_path / "here", tmp_path / "out"
    here.mkdir()
    out.mkdir()
    own_images(here)
    words = [word.format(here=here, out=out) for word in COMMANDS[command]]
    left = []
    for after in range(MOST_CALLS):
        fsync, calls = failing(number, after)
        monkeypatch.setattr(os, "fsync", fsync)
        done = CliRunner().invoke(main, words)
        if done.exit_code == 0:
            break
        assert done.exit_code == 1 and isinstance(done.exception, SystemExit), (after, done.exception)
        assert os.strerror(number) in done.output and str(out) in done.output, done.output
        assert "-uavbench-" not in done.output, "a temporary name tells nobody anything"
        left.append({*everything(out)})
        shutil.rmtree(out)
        out.mkdir()
    assert calls[0] == after > 3
    whole = {*everything(out)}
    assert [found for found in left if found] in ([], [whole]), "only the folder above could not be synchronized"


CODECS = [("mp4v", "overlay.mp4"), ("VP80", "flight.webm"), ("vp09", "video.mp4")]
FRAMES = 30


def film(path, codec):
    """A video of noise, as the commands write theirs."""
    writer = begin_video(path, codec, 15.0, (96, 64))
    for image in np.random.default_rng(0).integers(0, 255, (FRAMES, 64, 96, 3), dtype=np.uint8):
        writer.write(image)
    finish_video(writer, path, FRAMES)


@pytest.mark.parametrize(("codec", "name"), CODECS)
def test_a_video_that_was_cut_short_anywhere_is_told(tmp_path, codec, name):
    """OpenCV itself writes what fits, and tells nothing."""
    path = tmp_path / name
    film(path, codec)
    whole = path.stat().st_size
    for size in (3000, whole // 3, whole - 2000, whole - 100):
        path.unlink()
        with pytest.raises(OSError, match=f"of {FRAMES} frames") as told, files_of_at_most(size):
            film(path, codec)
        assert told.value.errno == errno.ENOSPC and told.value.filename == str(path)


@pytest.mark.parametrize(("codec", "name"), CODECS)
def test_a_video_of_which_not_a_byte_fits_is_told_as_such(tmp_path, codec, name):
    """It had been called a codec that this build of OpenCV cannot write."""
    with pytest.raises(OSError, match=f"{os.strerror(errno.EFBIG)}|of {FRAMES} frames"), files_of_at_most(0):
        film(tmp_path / name, codec)
    with pytest.raises(UserError, match="this build of OpenCV cannot write zzzz"):
        film(tmp_path / name, "zzzz")


VIDEOS = {"export": ["export", str(TRIAL), "--format", "video", "--out", "{out}/e"], "track": COMMANDS["track"]}


@pytest.mark.parametrize("command", VIDEOS)
def test_a_command_whose_video_does_not_fit_leaves_none(tmp_path, command):
    here, out = tmp_path / "here", tmp_path / "out"
    here.mkdir()
    out.mkdir()
    own_images(here)
    with files_of_at_most(6000):
        done = CliRunner().invoke(main, [word.format(here=here, out=out) for word in VIDEOS[command]])
    assert done.exit_code == 1 and isinstance(done.exception, SystemExit), (done.output, done.exception)
    assert f"{out}/" in done.output and "frames of the video could be written; free space" in done.output, done.output
    assert "-uavbench-" not in done.output
    assert everything(out) == []


@pytest.mark.parametrize("form", [each for each in EXPORTS if each not in ("kalibr", "video")])
def test_an_export_that_does_not_fit_leaves_none(tmp_path, form):
    with files_of_at_most(3000):  # the images are larger
        done = CliRunner().invoke(main, ["export", str(TRIAL), "--format", form, "--out", str(tmp_path / "out" / "e")])
    assert done.exit_code == 1 and isinstance(done.exception, SystemExit), (done.output, done.exception)
    assert "free space" in done.output and "-uavbench-" not in done.output
    assert everything(tmp_path / "out") == []


SUITE = """
title = "full"
rates_hz = [15.0]
[recordings.mine]
rate_hz = 15.0
source = { kind = "files", images_path = "frames", model_file = "model.obj", camera_file = "camera.toml", init_file = "init.toml" }
[trackers]
hold = { kind = "hold" }
"""  # noqa: E501


def test_a_suite_on_a_full_disk_ends_like_one_with_a_failed_job(tmp_path):
    own_images(tmp_path)
    (tmp_path / "full.toml").write_text(SUITE)
    words = ["run", str(tmp_path / "full.toml"), "--jobs", "1", "--out", str(tmp_path / "out")]
    with files_of_at_most(10_000):
        done = CliRunner().invoke(main, words)
    assert done.exit_code == 1, (done.output, done.exception)
    assert "FAILED render mine-s0" in done.output and "free space" in done.output
    (tmp_path / "frames" / "000000.png").unlink()
    (tmp_path / "frames" / "000000.png").write_text("no image")
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2, (done.output, done.exception)


@pytest.mark.parametrize("size", [0, 100, 5000])
def test_a_lidar_that_does_not_fit_is_told_as_a_full_disk(tmp_path, size):
    """numpy's own error has no number: "5420 requested and 5364 written"."""
    table = Table(("range_m",), np.arange(5420), np.ones((5420, 1)))
    with pytest.raises(OSError) as told, files_of_at_most(size):
        write_records(table, ("range_m",), tmp_path / "lidar.npy")
    assert told.value.errno in (errno.ENOSPC, errno.EFBIG)
    assert isinstance(DiskError.of(told.value), DiskError) and everything(tmp_path) == []


def test_a_verdict_is_not_told_by_a_full_disk(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(tmp_path))

    def denied(*_, **__):
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(tmp_path))

    monkeypatch.setattr("uavbench.bench.gate.findings.pronounce", full)
    done = CliRunner().invoke(main, ["gate", str(tmp_path), "--baseline", str(tmp_path)])
    assert done.exit_code == 2 and "free space" in done.output, (done.output, done.exception)
    for raised, code in ((full, 1), (denied, 2)):
        monkeypatch.setattr("uavbench.bench.runner.commands.bring_up_to", raised)
        done = CliRunner().invoke(main, ["run", "tiny", "--out", str(tmp_path)])
        assert done.exit_code == code and str(tmp_path) in done.output, (done.output, done.exception)


@pytest.mark.parametrize("size", [0, 1, 1000, 3000, 10_000])
def test_a_figure_that_does_not_fit_is_told_by_its_name(tmp_path, size):
    with house_style():
        figure = new_figure(2.0)
        figure.subplots().plot([0, 1], [0, 1])
        with pytest.raises(OSError) as told, files_of_at_most(size):
            save_figure(figure, tmp_path / "plot", suffixes=(".pdf", ".png"))
    assert told.value.errno == errno.EFBIG
    assert told.value.filename.startswith(str(tmp_path / "plot"))
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_an_error_of_the_disk_names_the_file_and_not_the_temporary_one(tmp_path):
    with pytest.raises(OSError) as told, new_file(tmp_path / "a.txt") as new, files_of_at_most(10):
        new.write_text(100 * "x")
    assert told.value.filename == str(tmp_path / "a.txt")
    with pytest.raises(OSError) as told, new_folder(tmp_path / "folder") as new:
        (new / "inner").mkdir()
        (new / "inner").rename(new / "x" / "y")
    assert told.value.filename == str(new / "inner"), "no disk error"
    with pytest.raises(OSError) as told, new_folder(tmp_path / "folder") as new:
        (new / "b.txt").mkdir()
        (new / "b.txt").write_text("")
    assert told.value.filename == str(tmp_path / "folder" / "b.txt")
    with pytest.raises(OSError) as told, new_parts(tmp_path, Marker("parts.json", "parts")) as new:
        (new / "c.txt").mkdir()
        (new / "c.txt").write_text("")
    assert told.value.filename == str(tmp_path / "c.txt")
    assert everything(tmp_path) == []
