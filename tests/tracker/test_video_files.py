"""Videos as phones, browsers and recorders write them: what the file tells of its images, and what it does not."""

import re
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import begin_video, finish_video, frame_count, open_video
from uavbench.tracker.images.track_images import refuse_another_rate
from uavbench.tracker.images.video_images import VideoImages
from uavbench.trajectories.errors import UserError

SIZE = (64, 48)
CAMERA = Camera(*SIZE, fx=60.0, fy=60.0, cx=31.5, cy=23.5)


def film(path, images=6, still=0):
    """Path of a video at 10 Hz of grey noise, of which the last images, `still` of them, are all the same."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, SIZE)
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8) for _ in range(images - still)]
    for image in [*noise, *noise[-1:] * still]:
        writer.write(image)
    writer.release()
    return path


def with_times(path, stamps_ms, duration_ms):
    """The Matroska file with other times of its images, as of a camera that exposes longer in the dark."""
    data = bytearray(path.read_bytes())
    at = data.index(b"\x44\x89\x88")  # the element Duration
    data[at + 3 : at + 11] = struct.pack(">d", duration_ms)
    blocks = [found.start() + 4 for found in re.finditer(rb"\xa3[\x40-\x7f].\x81..\x80", data, re.DOTALL)]
    for frame, (at, stamp_ms) in enumerate(zip(blocks, stamps_ms, strict=True)):
        cluster_ms = 200 * (frame // 2)  # of two images each
        data[at : at + 2] = struct.pack(">h", stamp_ms - cluster_ms)
    path.write_bytes(data)
    return path


def read(path):
    """The images of a video, read to their end."""
    images = VideoImages(path, CAMERA, 30.0)
    assert len(list(images)) == len(images.stamps_ns)
    return images


STAMPS_MS = [0, 100, 200, 600, 900, 1000]


def test_of_a_matroska_file_of_a_variable_rate_nothing_is_missing(tmp_path):
    images = read(with_times(film(tmp_path / "dark.mkv"), STAMPS_MS, 1100.0))
    assert images.stamps_ns == [stamp * 1_000_000 for stamp in STAMPS_MS]
    assert images.doubts == []


def test_a_matroska_file_that_ends_before_its_time_is_told(tmp_path):
    images = read(with_times(film(tmp_path / "cut.mkv"), STAMPS_MS, 3000.0))
    (doubt,) = images.doubts
    assert "cut.mkv: 6 of 30 frames can be read" in doubt


def test_an_avi_file_of_which_images_are_missing_is_told(tmp_path):
    path = film(tmp_path / "cut.avi")
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"00dc", 0, data.rindex(b"idx1"))])
    assert "cut.avi: 5 of 6 frames can be read" in read(path).doubts[0]


@pytest.mark.parametrize(("still", "told"), [(1, False), (3, True), (5, True)])
def test_images_that_repeat_the_one_before_are_told(tmp_path, still, told):
    doubts = read(film(tmp_path / "still.avi", still=still)).doubts
    assert len(doubts) == told
    if told:
        assert f"still.avi: {still} of 6 frames are the one before again" in doubts[0]
        assert "interlaced" in doubts[0]


def test_images_are_counted_where_the_file_does_not(tmp_path):
    path = with_times(film(tmp_path / "live.mkv"), STAMPS_MS, 1100.0)
    assert frame_count(path) == 6
    data = path.read_bytes()
    at = data.index(b"\x44\x89\x88")
    path.write_bytes(data[:at] + b"\xec\x89" + bytes(9) + data[at + 11 :])  # a browser's recording tells no duration
    assert frame_count(path) == 6
    assert frame_count(film(tmp_path / "a.mp4", images=4)) == 4
    (tmp_path / "b.mkv").write_bytes(path.read_bytes()[:200])
    with pytest.raises(UserError, match=r"b\.mkv"):
        frame_count(tmp_path / "b.mkv")


def test_a_name_that_is_no_text_ends_no_process(tmp_path):
    """OpenCV crashes on it."""
    folder = tmp_path / "caf\udce9"  # of Latin-1
    folder.mkdir()
    path = film(tmp_path / "a.mp4").rename(folder / "a.mp4")
    with pytest.raises(UserError, match=r"a\.mp4: its name, or that of a folder above, is not in UTF-8"):
        open_video(path)
    with pytest.raises(UserError, match=r"b\.mp4: its name, or that of a folder above, is not in UTF-8"):
        begin_video(folder / "b.mp4", "mp4v", 10.0, SIZE)


def test_a_folder_with_a_colon_is_no_url(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("x:y").mkdir()
    path = Path("x:y/a.mp4")
    finish_video(begin_video(path, "mp4v", 10.0, SIZE), path, 0)
    assert path.is_file()


def test_another_rate_than_that_of_a_video_is_refused(tmp_path):
    """As of slow motion, played at 30 Hz and taken at 120: --rate-hz had been left aside without a word."""
    path = film(tmp_path / "slow.avi")
    refuse_another_rate(path, 10.0)
    refuse_another_rate(path, 9.97)
    refuse_another_rate(tmp_path, 120.0)
    with pytest.raises(UserError, match=r"slow\.avi: its images have times of their own, 10 a second, .*passthrough"):
        refuse_another_rate(path, 120.0)
