"""Images of cameras with 10, 12 or 14 bits are as bright as they are, or told."""

import struct
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.bench.small_suites import own_images
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.calibration import calibrate
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.image_files import ORIENTATION, decoded, exif_turn, is_plain, load_image, read_image
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.images.recorded_sequence import Files, RecordingSpec, record
from uavbench.tracker.images.track_images import track_images
from uavbench.trajectories.errors import UserError

LEVELS = np.random.default_rng(0).integers(0, 256, (12, 16), dtype=np.uint8)
"""The image as it is shown."""
SIZE = Camera.from_field_of_view(16, 12, 60.0)


def samples(bits):
    """Samples of the image by a camera of so many bits."""
    return np.rint(LEVELS.astype(float) * ((1 << bits) - 1) / 255).astype(np.uint16)


def png(image, *significant):
    """A PNG file of 16 bits, with an sBIT chunk if given."""
    data = cv2.imencode(".png", image)[1].tobytes()
    content = b"sBIT" + bytes(significant)
    chunk = struct.pack(">I", len(significant)) + content + struct.pack(">I", zlib.crc32(content))
    return data[:33] + (chunk if significant else b"") + data[33:]  # after IHDR


def tiff(image, bits=16, white=0):
    """An uncompressed grey TIFF file; white: MaxSampleValue."""
    data = image if isinstance(image, bytes) else image.astype("<u2").tobytes()
    tags = {256: 16, 257: 12, 258: bits, 259: 1, 262: 1, 273: 0, 277: 1, 278: 12, 279: len(data)}
    tags |= {281: white} if white else {}
    tags[273] = 14 + 12 * len(tags)
    head = b"II*\0" + struct.pack("<IH", 8, len(tags))
    return head + b"".join(struct.pack("<HHII", t, 4, 1, v) for t, v in sorted(tags.items())) + bytes(4) + data


def packed(image):
    """Samples of 12 bits, two in three bytes."""
    a, b = image.reshape(-1, 2).T
    return np.stack([a >> 4, (a & 15) << 4 | b >> 8, b & 255], axis=1).astype(np.uint8).tobytes()


def pgm(image, white):
    return f"P5\n# by hand\n16 12\n{white}\n".encode() + image.astype(">u2" if white > 255 else "u1").tobytes()


TOLD = {
    "png": png(samples(12), 12),
    "colour png": png(np.dstack([samples(10)] * 3), 10, 10, 10),
    "png with alpha": png(np.dstack([samples(12)] * 3 + [np.full_like(samples(12), 65_535)]), 12, 12, 12, 16),
    "png as the specification wants it": png(samples(12) << 4 | samples(12) >> 8, 12),
    "tiff": tiff(samples(12), white=4095),
    "packed tiff": tiff(packed(samples(12)), bits=12),
    "pgm": pgm(samples(12), 4095),
    "pgm of few": pgm(np.rint(LEVELS.astype(float) * 100 / 255), 100),
    "pgm of many": pgm(samples(16), 65_535),
    "png of 16": png(samples(16)),
    "tiff of 16": tiff(samples(16)),
}


@pytest.mark.parametrize("flags", [cv2.IMREAD_COLOR, cv2.IMREAD_GRAYSCALE])
@pytest.mark.parametrize("kind", TOLD)
def test_what_the_file_tells_counts(tmp_path, kind, flags):
    (tmp_path / "a").write_bytes(TOLD[kind])
    read = load_image(tmp_path / "a", flags)
    assert read.dtype == np.uint8
    assert np.abs(read.astype(int).reshape(12, 16, -1) - LEVELS[..., None]).max() <= (2 if "few" in kind else 1)
    unchanged = load_image(tmp_path / "a", cv2.IMREAD_UNCHANGED)
    assert unchanged.dtype == np.uint16 or "few" in kind, "samples as they are"


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_bits_of_the_camera_count(tmp_path, bits):
    (tmp_path / "a.png").write_bytes(png(samples(bits)))
    read = read_image(tmp_path / "a.png", replace(SIZE, bits=bits))
    assert np.abs(read[..., 0].astype(int) - LEVELS).max() <= 1


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("form", [png, tiff])
def test_a_nearly_black_image_is_told_with_its_bits(tmp_path, bits, form):
    path = tmp_path / "a.image"
    path.write_bytes(form(samples(bits)))
    with pytest.raises(
        UserError, match=rf"a\.image: .*which is (nearly black|dark); .*set bits = {bits} in camera\.toml"
    ):
        read_image(path, SIZE)
    dark = read_image(path, replace(SIZE, bits=16))
    np.testing.assert_array_equal(dark[..., 0], samples(bits) >> 8)


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("ratio", ["of zeros", "of whites"])
def test_a_dark_image_whose_values_were_scaled_to_16_bits_is_as_dark_as_it_is(tmp_path, bits, ratio):
    levels = samples(bits).astype(float) * (16_000 / 65_535)
    factor = 1 << 16 - bits if ratio == "of zeros" else 65_535 / ((1 << bits) - 1)
    dark = np.rint(np.rint(levels) * factor).astype(np.uint16)
    assert 4096 < dark.max() < 16384
    np.testing.assert_array_equal(decoded(tmp_path / "a", png(dark), cv2.IMREAD_GRAYSCALE), dark >> 8)


@pytest.mark.parametrize(("image", "told"), [
    (Image.fromarray(np.zeros((12, 16), np.float32)), "signed or floating-point numbers of 32 bits"),
    (Image.fromarray(np.zeros((12, 16), np.int32)), "numbers of 32 bits"),
])  # fmt: skip
def test_samples_without_a_white_are_told(tmp_path, image, told):
    image.save(tmp_path / "a.tif")
    with pytest.raises(UserError, match=rf"a\.tif: its samples are .*{told}.*; save it with 8 or 16 bits"):
        read_image(tmp_path / "a.tif", SIZE)


def test_what_is_black_or_has_8_bits_is_left_alone(tmp_path):
    np.testing.assert_array_equal(decoded(tmp_path / "a", png(np.zeros((12, 16), np.uint16))), 0)
    grey = cv2.imencode(".png", LEVELS)[1].tobytes()
    np.testing.assert_array_equal(decoded(tmp_path / "a", grey, cv2.IMREAD_GRAYSCALE, bits=12), LEVELS)
    assert is_plain(grey) and not is_plain(TOLD["png of 16"])


def test_values_beyond_the_bits_are_told(tmp_path):
    for data, white in ((png(samples(14)), 4095), (tiff(samples(14)), 4095), (pgm(samples(12), 1000), 1000)):
        with pytest.raises(UserError, match=rf"a: has the value \d+, beyond its largest one, {white}"):
            decoded(tmp_path / "a", data, bits=12 if white == 4095 else 0)


@pytest.mark.parametrize("bits", [7, 17, 12.0, True, "12", -1])
def test_other_bits_are_refused(bits):
    with pytest.raises(ValueError, match=r"bits = .*: must be a whole number from 8 to 16"):
        replace(SIZE, bits=bits)


def twelve_bits(folder, *, told):
    """The images of the example as a camera of 12 bits gives them; Camera.bits where told."""
    own_images(folder)
    for path in (folder / "frames").glob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path)).astype(np.uint16) << 4)
    if told:
        with (folder / "camera.toml").open("a") as camera:
            camera.write("bits = 12\n")


def test_own_images_of_12_bits_are_tracked_and_recorded(tmp_path):
    twelve_bits(tmp_path, told=True)
    assert Camera.load(tmp_path / "camera.toml").bits == 12
    given = {name: tmp_path / file for name, file in (("model", "model.obj"), ("init", "init.toml"))}
    track_images(Hold(), tmp_path / "frames", camera=tmp_path / "camera.toml", out=tmp_path / "t", **given)
    files = Files(
        images_path=str(tmp_path / "frames"),
        model_file=str(given["model"]),
        camera_file=str(tmp_path / "camera.toml"),
        init_file=str(given["init"]),
    )
    record(RecordingSpec(name="a-s0", seed=0, source=files), tmp_path / "a-s0", content_hash="")
    sequence = Sequence.load(tmp_path / "a-s0")
    raw = cv2.imread(str(sequence.folder / sequence.files[0]), cv2.IMREAD_UNCHANGED)
    assert raw.dtype == np.uint8 and sequence.camera.bits == 0
    np.testing.assert_array_equal(raw, sequence.image(0))
    assert np.abs(raw.astype(int) - Sequence.load(TRIAL).image(0)).max() <= 1


def test_own_images_of_12_bits_without_a_word_are_told(tmp_path):
    twelve_bits(tmp_path, told=False)
    with pytest.raises(UserError, match=r"000000\.png: .*set bits = 12 in camera\.toml"):
        track_images(
            Hold(), tmp_path / "frames", model=tmp_path / "model.obj", camera=tmp_path / "camera.toml",
            init=tmp_path / "init.toml", out=tmp_path / "t",
        )  # fmt: skip
    with pytest.raises(UserError, match=r"--bits 12"):
        calibrate([tmp_path / "frames"], (7, 8), 0.02)
    with pytest.raises(UserError, match="pictures show the whole board"):
        calibrate([tmp_path / "frames"], (7, 8), 0.02, bits=12)


def test_a_turned_image_is_recorded_as_it_is_shown(tmp_path):
    own_images(tmp_path)
    for path in (tmp_path / "frames").glob("*.png"):
        with Image.open(path) as image:
            exif = Image.Exif()
            exif[0x0112] = 6  # turned by 90 degrees
            image.rotate(90, expand=True).save(path, exif=exif)
    files = Files(
        images_path=str(tmp_path / "frames"), model_file=str(tmp_path / "model.obj"),
        camera_file=str(tmp_path / "camera.toml"), init_file=str(tmp_path / "init.toml"),
    )  # fmt: skip
    record(RecordingSpec(name="a-s0", seed=0, source=files), tmp_path / "a-s0", content_hash="")
    sequence = Sequence.load(tmp_path / "a-s0")
    with Image.open(sequence.folder / sequence.files[0]) as image:
        assert image.size == (sequence.camera.width, sequence.camera.height), "to who knows no Exif"
    np.testing.assert_array_equal(sequence.image(0), Sequence.load(TRIAL).image(0))


XMP_TURNED = b"""<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="3"/></rdf:RDF></x:xmpmeta>"""


@pytest.mark.parametrize(("orientation", "xmp", "turn"), [(3, b"", 3), (9, b"", 1), (1, XMP_TURNED, 1)])
def test_an_image_is_turned_as_the_decoder_turns_it(tmp_path, orientation, xmp, turn):
    corner, exif = np.zeros((16, 24, 3), np.uint8), Image.Exif()
    corner[:8, :12] = 255
    exif[ORIENTATION] = orientation
    Image.fromarray(corner).save(tmp_path / "a.jpg", exif=b"" if xmp else exif, xmp=xmp)
    data = (tmp_path / "a.jpg").read_bytes()
    assert exif_turn(data) == turn
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert (shown[2, 2] < 128) == (turn == 3)


def test_images_of_a_folder_that_are_turned_differently_are_told(tmp_path):
    own_images(tmp_path)
    path = tmp_path / "frames" / "000002.png"
    with Image.open(path) as image:
        exif = Image.Exif()
        exif[ORIENTATION] = 3  # upside down
        image.rotate(180).save(path, exif=exif)
    given = {name: tmp_path / file for name, file in (("model", "model.obj"), ("init", "init.toml"))}
    camera, told = tmp_path / "camera.toml", r"000002\.png: its Exif data turn it otherwise .*000000\.png"
    with pytest.raises(UserError, match=told):
        track_images(Hold(), tmp_path / "frames", camera=camera, out=tmp_path / "t", **given)
    files = Files(
        images_path=str(tmp_path / "frames"), model_file=str(given["model"]), camera_file=str(camera),
        init_file=str(given["init"]),
    )  # fmt: skip
    with pytest.raises(UserError, match=told):
        record(RecordingSpec(name="a-s0", seed=0, source=files), tmp_path / "a-s0", content_hash="")
    assert not (tmp_path / "t").exists() and not (tmp_path / "a-s0").exists()
