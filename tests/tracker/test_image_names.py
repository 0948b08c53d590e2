"""Doubts about the times of images by their names."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.bench.conftest import in_one_process
from tests.bench.small_suites import OWN_IMAGES, own_images
from uavbench.tracker.images.image_names import doubts_of_names, doubts_of_order, refuse_twins, stamps_in_names
from uavbench.tracker.images.track_images import in_order
from uavbench.trajectories.errors import UserError

FLIGHT = Path("flight")


def named(*names):
    return [FLIGHT / name for name in names]


@pytest.mark.parametrize(
    "names",
    [
        ["a.png"],
        ["0.png", "1.png", "2.png"],
        ["000010.png", "000020.png", "000030.png"],
        ["left.png", "left1.png"][:1],
        ["f1_07.png", "f1_08.png"],
        ["20240101_120000.png", "20240101_120001.png"],
        ["1_01.png", "2_02.png", "9_03.png"],
        [f"20240101_1200{k // 15:02d}_{k % 15:03d}.png" for k in range(40)],
        [f"DJI_2024010112{k // 900:02d}{k // 15 % 60:02d}_{k:04d}_V.JPG" for k in range(1000)],
        [f"PXL_20240101_1200{k // 15:02d}{k % 15 * 1000 // 15:03d}.jpg" for k in range(40)],
        [f"20240101_120000_{k:04d}.png" for k in range(40)],
        [f"20241399_1200{k:02d}.png" for k in range(40)],
        [f"{k:04d}_{1403636579000000000 + round(k * 1e9 / 15)}.png" for k in range(5)],
        [f"{1403636579000000000 + round(k * 1e9 / 15)}.png" for k in range(5)],
        [f"{1403636579000 + round(k * 1e3 / 15)}.png" for k in range(5)],
        [f"{1305031102.8 + k / 15:.6f}.png" for k in range(5)],
        [f"rgb_{k / 15:.9f}.png" for k in range(20)],
        [f"{k / 15:.3f}.png" for k in range(20)],
        ["2.0007.png", "2.0008.png", "3.0001.png", "3.0002.png"],
        ["1.8.png", "1.9.png", "1.10.png", "1.11.png"],
        ["1.9.png", "1.10.png"],
        ["1.1.png", "1.2.png", "2.1.png", "2.2.png"],
        ["1.8_left.png", "1.9_left.png", "1.10_left.png"],
    ],
)
def test_names_without_gaps_leave_no_doubt(names):
    assert doubts_of_names(named(*names), 15.0) == []


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["1.png", "2.png", "5.png"], "flight: after 2.png comes 5.png: if images are missing, the times are wrong"),
        (
            ["f00.png", "f02.png", "f06.png", "f08.png", "f20.png"],
            "after f02.png comes f06.png, and after 1 more",
        ),
        (
            ["1403636579000000000.png", "1403636579050000000.png"],
            "look like times .* taken 1 / 15 s apart; correct",
        ),
        *(
            ([form.format(1305031102.8 + k / 30) for k in range(9)], "look like times .* taken 1 / 15 s apart; correct")
            for form in ("{:.6f}.png", "cam0.{:.6f}.png", "{:.3f}.png", "{}.png")
        ),
        ([f"{k / 30:.3f}.png" for k in range(40)], "look like times .* taken 1 / 15 s apart; correct"),
        *(
            ([form.format(2 * k // 60, 2 * k % 60, k + 1) for k in range(40)], "look like times .* 1 / 15 s apart")
            for form in (
                "DJI_2024013112{0:02d}{1:02d}_{2:04d}_V.JPG",
                "IMG_20240131_12{0:02d}{1:02d}.jpg",
                "2024-01-31-12-{0:02d}-{1:02d}.png",
                "frame_{2:04d}_2024-01-31T12:{0:02d}:{1:02d}.250.png",
            )
        ),
        (
            [f"{k:04d}_{1403636579000000000 + k * 50_000_000}.png" for k in range(5)],
            "look like times .* 1 / 15 s apart",
        ),
        ([f"{k:04d}_{1305031102.8 + k / 30:.6f}.png" for k in range(9)], "look like times .* 1 / 15 s apart"),
        ([f"{k / 10:.1f}.png" for k in range(25)], "look like times .* taken 1 / 15 s apart; correct"),
        (["0.png", "0.5.png", "1.png", "1.5.png"], "look like times .* taken 1 / 15 s apart; correct"),
        (["5.png", "4.png", "3.png"], "flight: 4.png is given after 5.png: images are taken in the order in which"),
        ([f"{k / 2}.png" for k in (3, 2, 1, 0)], "flight: 1.0.png is given after 1.5.png"),
        (["1_01.png", "1_02.png", "0_01.png"], "flight: 0_01.png is given after 1_02.png"),
        (["left1.png", "left2.png", "right1.png"], "right1.png follows left2.png: if these are of different cameras"),
    ],
)
def test_a_doubt_says_where_and_what_to_do(names, message):
    (found,) = doubts_of_names(named(*names), 15.0)
    with pytest.raises(UserError, match=message):
        raise UserError(found)


def test_stills_two_seconds_apart_are_of_half_a_hertz():
    """Their names are times of day, whose seconds end at 59."""
    names = [f"DJI_2024013112{2 * k // 60:02d}{2 * k % 60:02d}_{k + 1:04d}_V.JPG" for k in range(100)]
    assert doubts_of_names(named(*names), 0.5) == []


@pytest.mark.parametrize("first_s", [0.0, 1305031102.0])
@pytest.mark.parametrize("prefix", ["", "cam0.", "rgb_2_"])
@pytest.mark.parametrize("rate_hz", [4, 15])
def test_images_named_by_seconds_are_in_the_order_of_time(tmp_path, prefix, first_s, rate_hz):
    names = [f"{prefix}{round(first_s + k / rate_hz, 6)}.png" for k in range(40)]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names


@pytest.mark.parametrize("form", ["{:g}.png", "img_{:.4g}.png", "t={:.4g}s.png", "{:.6g}_left.png"])
@pytest.mark.parametrize("rate_hz", [2, 4, 15, 30, 100 / 7])
def test_whole_seconds_may_be_without_decimals(tmp_path, form, rate_hz):
    names = [form.format(k / rate_hz) for k in range(70)]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names
    stamps = stamps_in_names(in_order(tmp_path))
    assert stamps is not None and np.allclose(stamps / 1e9, np.arange(70) / rate_hz, atol=6e-3)


@pytest.mark.parametrize("written", ["{!r}", "{:g}", "{:.2e}", "{:.1E}"])
def test_seconds_with_an_exponent_are_in_the_order_of_time(tmp_path, written):
    seconds = [0.0, 2e-05, 0.0001, 0.025, 1.0, 20.0]
    names = [f"{written.format(second)}.png" for second in seconds]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names
    assert (stamps_in_names(in_order(tmp_path)) == np.rint(np.array(seconds) * 1e9)).all()
    assert doubts_of_order(in_order(tmp_path)) == []


@pytest.mark.parametrize(
    "names",
    [
        ["1e3_left.png", "1e10_left.png", "2e1_left.png"],
        ["1e1.png", "1e2.png", "1e10.png", "2e1.png"],
        ["1E1.png", "1E2.png", "1E10.png", "1E30.png", "10.png"],
    ],
)
def test_letters_among_counts_are_no_exponents(tmp_path, names):
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names and stamps_in_names(in_order(tmp_path)) is None


def test_images_of_two_flights_may_be_given_one_after_the_other():
    assert doubts_of_names([Path(f"{flight}/{k}.png") for flight in "ab" for k in range(3)], 15.0) == []


def test_images_of_takes_are_in_the_order_of_their_counts(tmp_path):
    names = [f"{take}.{image}.png" for take in (1, 2, 10) for image in range(1, 12)]
    for name in sorted(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names


def test_images_of_every_kind_that_can_be_read_are_taken(tmp_path):
    names = [f"{k}.{kind}" for k, kind in enumerate(["png", "JPG", "jpeg", "bmp", "tif", "tiff", "ppm", "pgm", "webp"])]
    for name in [*names, "9.txt", "10.csv"]:
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names


def test_hidden_files_are_no_images(tmp_path):
    """As macOS writes them beside each image on disks of other systems."""
    for name in ("1.png", "._1.png", "2.png", ".2.png"):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == ["1.png", "2.png"]


def test_two_files_of_one_image_are_refused():
    refuse_twins(named("1.png", "01.png", "2.jpg"))
    with pytest.raises(UserError, match=r"flight: has 1\.jpg and 1\.png, which would count as two images; keep"):
        refuse_twins(named("1.jpg", "1.png"))


def test_a_missing_image_is_told_by_both_commands(tmp_path):
    own_images(tmp_path)
    frames = sorted((tmp_path / "frames").iterdir())
    frames[1].unlink()
    (tmp_path / "suite.toml").write_text(OWN_IMAGES)
    words = {
        "track": [
            "hold",
            "--images",
            "frames",
            "--model",
            "model.obj",
            "--camera",
            "camera.toml",
            "--init",
            "init.toml",
        ],
        "render": ["suite.toml"],
    }
    for command, given in words.items():
        given = [str(tmp_path / word) if (tmp_path / word).exists() else word for word in given]
        done = in_one_process(command, *given, "--out", tmp_path / command)
        assert done.exit_code == 0, done.output
        assert f"after {frames[0].name} comes {frames[2].name}" in done.output
        assert "doubt: " in done.output
    frames[0].with_suffix(".jpg").write_bytes(frames[0].read_bytes())
    for command, given in words.items():
        given = [str(tmp_path / word) if (tmp_path / word).exists() else word for word in given]
        done = in_one_process(command, *given, "--out", tmp_path / f"{command}2")
        assert done.exit_code == 2 and "would count as two images" in done.output, done.output


def test_a_recorded_suite_tells_of_times_beside_its_images_and_of_black_ones(tmp_path):
    """As `track --images` does of the same images."""
    own_images(tmp_path)
    *_, last = frames = sorted((tmp_path / "frames").iterdir())
    cv2.imwrite(str(last), np.zeros_like(cv2.imread(str(last))))
    (tmp_path / "suite.toml").write_text(OWN_IMAGES)
    for rate_hz, told in ((15, 0), (10, 1)):
        lines = [f"{k / rate_hz:.6f} frames/{path.name}" for k, path in enumerate(frames)]
        (tmp_path / "rgb.txt").write_text("\n".join(lines))
        out = tmp_path / str(rate_hz)
        done = in_one_process("render", tmp_path / "suite.toml", "--out", out)
        assert done.exit_code == 0, done.output
        assert done.output.count("rgb.txt: seems to hold the times of the images, which are not read") == told
        assert f"frames: 1 of {len(frames)} images have no grey level above 8 of 255" in done.output


@pytest.mark.parametrize(("names", "stamps_ns"), [
    (["1305031102.175304.png", "1305031102.211214.png"], [1305031102175304000, 1305031102211214000]),
    (["1403636579763555584.png", "1403636579813555456.png"], [1403636579763555584, 1403636579813555456]),
    (["cam_1403636579763.png", "cam_1403636579813.png"], [1403636579763000000, 1403636579813000000]),
    (["1403636579763555.png", "1403636579813555.png"], [1403636579763555000, 1403636579813555000]),
    (["000000.png", "000001.png"], None),
    (["20240131120005123.png", "20240131120006123.png"], None),
    (["DJI_20240131120005_0001_V.png", "DJI_20240131120006_0002_V.png"], None),
    (["1403636579813555456.png", "1403636579763555584.png"], None),
    (["99999999999999999990.png", "99999999999999999991.png"], None),
    (["first.png", "1403636579763555584.png"], None),
    (["9999999999.5.png", "10000000000.5.png"], None),
    (["9300000000000000000.png", "9300000000050000000.png"], None),
])  # fmt: skip
def test_stamps_are_those_of_names_that_are_times(names, stamps_ns):
    found = stamps_in_names([Path(name) for name in names])
    assert (None if found is None else found.tolist()) == stamps_ns


@pytest.mark.parametrize(
    "names", [["1.png", *(f"1.{k}.png" for k in range(1, 13))], ["a1.png", "a1.9.png", "a1.10.png"]]
)
def test_numbered_copies_of_an_image_with_a_whole_number_are_in_the_order_of_their_counts(names, tmp_path):
    for name in names:
        cv2.imwrite(str(tmp_path / name), np.zeros((4, 4), np.uint8))
    assert [path.name for path in in_order(tmp_path)] == names
