"""Images of others: what they are and how large is looked at before a pixel is decoded."""

import io
import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.calibration import calibrate
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.decoding.jpeg_damage import jpeg_damage
from uavbench.scenes.image_files import KINDS, load_image, open_video, read_image
from uavbench.scenes.model_files.model_reading import read as read_mesh
from uavbench.trajectories.errors import UserError

SIDE = 30_000
"""Pixels: 900 million, 2.7 GB decoded."""


def bomb_png(width=SIDE, height=SIDE):
    """A grey PNG of one colour, whose rows are packed a thousand times."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    row = b"\0" * (1 + (width + 7) // 8)
    packed = zlib.compress(row * min(height, 2000), 9)  # the header is what counts
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def bombs():
    yield "png", bomb_png()
    yield "bmp", b"BM" + struct.pack("<IIIIiiHHIIiiII", 100, 0, 54, 40, SIDE, SIDE, 1, 24, 0, 0, 0, 0, 0, 0)
    yield "pgm", f"P5 {SIDE} {SIDE} 255\n".encode()
    yield "ppm", f"P6 {SIDE} {SIDE} 255\n".encode()
    for kind, form in (("jpg", "JPEG"), ("tif", "TIFF")):
        small = io.BytesIO()
        Image.new("L", (16, 16)).save(small, form)
        data = small.getvalue()
        if kind == "jpg":
            at = data.index(b"\xff\xc0") + 5
            data = data[:at] + struct.pack(">HH", SIDE, SIDE) + data[at + 4 :]
        else:
            for tag in (256, 257):
                at = data.index(struct.pack("<HHI", tag, 4, 1)) + 8
                data = data[:at] + struct.pack("<I", SIDE) + data[at + 4 :]
        yield kind, data
    yield (
        "webp",
        b"RIFF"
        + struct.pack("<I", 22)
        + b"WEBPVP8X"
        + struct.pack("<I", 10)
        + bytes(4)
        + (16383).to_bytes(3, "little") * 2,
    )


@pytest.mark.parametrize(("kind", "data"), list(bombs()), ids=[kind for kind, _ in bombs()])
def test_a_bomb_of_any_kind_is_told_before_it_is_decoded(tmp_path, monkeypatch, kind, data):
    path = tmp_path / f"bomb.{kind}"
    path.write_bytes(data)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    camera = Sequence.load(TRIAL).camera
    for read in (load_image, lambda p: read_image(p, camera), lambda p: calibrate([p], (7, 8), 0.02)):
        with pytest.raises(
            UserError,
            match=rf"bomb\.{kind}: (the image has .* pixels; at most 160,000,000|.*not a readable|neither an image)",
        ):
            read(path)


@pytest.mark.parametrize("kind", KINDS)
def test_images_of_all_kinds_are_read_as_opencv_decodes_them(tmp_path, kind):
    picture = np.random.default_rng(0).integers(0, 255, (12, 17, 3), dtype=np.uint8)
    Image.fromarray(picture).save(tmp_path / "a", kind)
    read = load_image(tmp_path / "a")
    np.testing.assert_array_equal(read, cv2.imread(str(tmp_path / "a")))


@pytest.mark.parametrize(
    ("compression", "damage"),
    [
        ("raw", "file ends early"),
        ("packbits", "file ends early"),
        ("packbits", "strip ends early"),
        ("tiff_lzw", "file ends early"),
        ("tiff_lzw", "strip ends early"),
        ("tiff_lzw", "zeros"),
        ("tiff_adobe_deflate", "file ends early"),
        ("tiff_adobe_deflate", "strip ends early"),
        ("tiff_adobe_deflate", "zeros"),
    ],
)
def test_a_damaged_tiff_is_told(tmp_path, compression, damage):
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    whole = io.BytesIO()
    Image.fromarray(picture).save(whole, "TIFF", compression=compression)
    data, path = whole.getvalue(), tmp_path / "a.tif"
    path.write_bytes(data)
    np.testing.assert_array_equal(load_image(path)[:, :, ::-1], picture)
    start, length = (struct.unpack_from("<I", data, strip_entry(data, tag))[0] for tag in (273, 279))
    if damage == "file ends early":
        data = data[: start + length // 2] if start + length == len(data) else data[:-1000]
    elif damage == "strip ends early":
        at = strip_entry(data, 279)
        data = data[:at] + struct.pack("<I", length // 2) + data[at + 4 :]
    else:
        data = data[: start + 4000] + bytes(400) + data[start + 4400 :]
    path.write_bytes(data)
    with pytest.raises(UserError, match=r"a\.tif: (the image is damaged|not a readable image)"):
        load_image(path)


def strip_entry(data, tag):
    """Place of the value of a TIFF's entry for its only strip: StripOffsets (273) or StripByteCounts (279)."""
    return data.index(struct.pack("<HHI", tag, 4, 1)) + 8


@pytest.mark.parametrize("kind", ["TIFF", "WEBP", "PNG"])
def test_a_file_of_several_images_is_told(tmp_path, kind):
    """Of which the first alone had been read; a preview of another size is none of them."""
    first, second, small = (Image.new("RGB", size, at) for size, at in (((16, 12), 9), ((16, 12), 99), ((8, 6), 9)))
    first.save(tmp_path / "a", kind, save_all=True, append_images=[second])
    with pytest.raises(UserError, match="a: holds several images, of which only the first would be read"):
        load_image(tmp_path / "a")
    if kind == "TIFF":
        first.save(tmp_path / "a", kind, save_all=True, append_images=[small])
        assert load_image(tmp_path / "a").shape == (12, 16, 3)


def test_what_is_no_image_is_told(tmp_path):
    for data in (b"", b"GIF89a", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", bomb_png()[:20]):
        (tmp_path / "a.png").write_bytes(data)
        with pytest.raises(UserError, match="not a readable image"):
            load_image(tmp_path / "a.png")


def test_textures_have_the_same_limit(tmp_path):
    (tmp_path / "wall.png").write_bytes(bomb_png())
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Kd wall.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl w\nf 1/1 2/1 3/1\n")
    with pytest.raises(UserError, match="pixels; at most 160,000,000"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    "head", [b"#EXTM3U\n/etc/hostname\n", b"ffconcat version 1.0\nfile /etc/hostname\n", b"v=0\no=- 0 0\n"]
)
def test_a_playlist_is_no_video(tmp_path, head):
    (tmp_path / "a.mp4").write_bytes(head)
    with pytest.raises(UserError, match="neither an image nor a readable video"):
        open_video(tmp_path / "a.mp4")


def test_a_bomb_takes_no_memory(tmp_path):
    """In a process of its own, whose address space a decoded bomb would not fit in."""
    (tmp_path / "a.png").write_bytes(bomb_png())
    code = (
        "import resource, sys; from pathlib import Path; from uavbench.scenes.image_files import load_image\n"
        "from uavbench.trajectories.errors import UserError\n"
        "used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: load_image(Path(sys.argv[1]))\n"
        "except UserError: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.png")], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 50_000  # kB


def jpeg(**options):
    """A JPEG file of a smooth picture."""
    picture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (121, 163, 3), dtype=np.uint8), (0, 0), 2)
    buffer = io.BytesIO()
    Image.fromarray(picture).convert(options.pop("mode", "RGB")).save(buffer, "JPEG", **{"quality": 90, **options})
    return buffer.getvalue()


FORMS = {
    "plain": {},
    "grey": {"mode": "L"},
    "no subsampling": {"subsampling": 0, "quality": 100},
    "optimized": {"optimize": True, "quality": 40},
    "with restarts": {"restart_marker_rows": 1},
    "with many restarts": {"restart_marker_blocks": 3},
    "progressive": {"progressive": True},
}
END = b"\xff\xd9"


@pytest.mark.parametrize("form", FORMS)
def test_a_whole_jpeg_is_read_as_opencv_decodes_it(tmp_path, form):
    data = jpeg(**FORMS[form])
    for content in (data, data[:-2] + b"\xff\xff" + END, data + b"a maker's note"):
        (tmp_path / "a.jpg").write_bytes(content)
        np.testing.assert_array_equal(load_image(tmp_path / "a.jpg"), cv2.imdecode(np.frombuffer(data, np.uint8), 1))


DAMAGE = {
    "file ends early": lambda data, at: data[:at],
    "stream ends early": lambda data, at: data[:at] + END,
    "a lost packet": lambda data, at: data[:at] + data[at + 300 :],
    "zeros": lambda data, at: data[:at] + bytes(300) + data[at + 300 :],
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("form", FORMS)
def test_a_damaged_jpeg_is_told(tmp_path, form, damage):
    if form == "progressive" and damage in ("a lost packet", "zeros"):
        pytest.skip("of progressive files only missing scans are noticed")
    data, path = jpeg(**FORMS[form]), tmp_path / "a.jpg"
    for share in (0.3, 0.5, 0.7):
        path.write_bytes(DAMAGE[damage](data, int(share * len(data))))
        with pytest.raises(
            UserError, match=r"a\.jpg: (the image is damaged: .*; render or copy it|not a readable image)"
        ):
            load_image(path)
        with pytest.raises(UserError, match=r"a\.jpg: .*(damaged|not a readable)"):
            read_image(path, Camera.from_field_of_view(163, 121, 60.0))


def test_a_jpeg_of_scans_for_each_colour_is_followed():
    """As few cameras write it: one scan for each component, cut together from three grey files."""
    parts = [jpeg(mode="L", quality=quality) for quality in (90, 90, 90)]
    scans = [part[part.index(b"\xff\xda") : -2] for part in parts]
    frame = parts[0].index(b"\xff\xc0")
    tables = parts[0][2 : parts[0].index(b"\xff\xda")]
    head = parts[0][frame : frame + 10]  # marker, length, precision, size, components
    three = b"".join(bytes((number, 0x11, 0)) for number in (1, 2, 3))
    header = head[:2] + struct.pack(">H", 17) + head[4:9] + b"\x03" + three
    tables = tables.replace(parts[0][frame : frame + 13], header)
    named = [scan[:5] + bytes((number,)) + scan[6:] for number, scan in zip((1, 2, 3), scans, strict=True)]
    whole = b"\xff\xd8" + tables + b"".join(named) + END
    assert cv2.imdecode(np.frombuffer(whole, np.uint8), 1).shape == (121, 163, 3)
    assert jpeg_damage(whole) == ""
    assert jpeg_damage(b"\xff\xd8" + tables + b"".join(named[:2]) + END) == "its data end too soon"
    assert jpeg_damage(b"\xff\xd8" + tables + named[0] + named[1] + named[2][: len(named[2]) // 2] + END)


def test_restarts_that_are_missing_or_too_many_are_told():
    data = jpeg(restart_marker_rows=1)
    first = data.index(b"\xff\xd0", data.index(b"\xff\xda"))
    second, third = data.index(b"\xff\xd1", first), data.index(b"\xff\xd2", first)
    assert jpeg_damage(data[:first] + data[second:]) == "parts of its data are missing"
    assert jpeg_damage(data[:-2] + data[first:third] + END)


def test_a_damaged_texture_is_told(tmp_path):
    data = jpeg()
    (tmp_path / "wall.jpg").write_bytes(data[: len(data) // 2] + END)
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Kd wall.jpg\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl w\nf 1/1 2/1 3/1\n")
    with pytest.raises(UserError, match=r"a\.obj: .*wall\.jpg: the image is damaged"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("kind", ["png", "tiff", "webp"])
@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_alpha_darkens_no_image(tmp_path, kind, mode):
    if (kind, mode) == ("webp", "LA"):
        pytest.skip("WebP has colours alone")
    image = Image.new(mode, (8, 6), (200, 100) if mode == "LA" else (200, 200, 200, 100))
    image.save(tmp_path / f"a.{kind}", **({"lossless": True} if kind == "webp" else {}))
    for flags in (cv2.IMREAD_COLOR, cv2.IMREAD_GRAYSCALE):
        assert np.unique(load_image(tmp_path / f"a.{kind}", flags)).tolist() == [200]


def test_alpha_leaves_deep_colours_as_deep_as_they_are(tmp_path):
    samples = np.full((6, 8, 4), 65535, np.uint16)
    samples[..., :3] = 2048
    cv2.imwrite(str(tmp_path / "a.tiff"), samples)
    assert np.unique(load_image(tmp_path / "a.tiff", bits=12)).tolist() == [128]
