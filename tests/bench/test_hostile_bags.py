"""Bags made to fill the memory or the disk, or to never end, are refused, and quickly."""

import resource
import sqlite3
import struct
import tempfile

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from tests.bench.test_bags import bag, refused, rows, tum, written  # noqa: F401

MAGIC = b"\x89MCAP0\r\n"
METADATA = """
rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  relative_file_paths: [{name}]
  duration: {{nanoseconds: 1}}
  starting_time: {{nanoseconds_since_epoch: 0}}
  message_count: 0
  topics_with_message_count: []
  compression_format: {format}
  compression_mode: {mode}
"""


@pytest.fixture
def database(tmp_path):
    """A bag of SQLite with odometry: its folder, and what changes its database."""
    folder = written(tmp_path / "bag", {"/odom": rows()}, StoragePlugin.SQLITE3)

    def change(*lines):
        with sqlite3.connect(folder / "bag.db3") as opened:
            for line in lines:
                opened.execute(line)

    return folder, change


ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT count(*) AS schema_version FROM c"


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["DROP TABLE schema", f"CREATE VIEW schema AS {ENDLESS}"], "view or virtual table 'schema'"),
        (["CREATE VIRTUAL TABLE other USING fts5(x)"], "view or virtual table 'other'"),
        (["ALTER TABLE topics ADD COLUMN big AS (hex(zeroblob(400000000)))"], "'topics' has a generated column"),
        (["ALTER TABLE messages ADD COLUMN big TEXT GENERATED ALWAYS AS (hex(1))"], "'messages' has a generated"),
    ],
)
@pytest.mark.parametrize("as_file", [True, False])
def test_a_database_that_works_something_out_is_refused(database, tum, lines, told, as_file):  # noqa: F811
    folder, change = database
    change(*lines)
    assert told in refused("evaluate", folder / "bag.db3" if as_file else folder, tum)


def test_a_name_that_sqlite_would_read_as_another_is_refused(database, tum):  # noqa: F811
    folder, _ = database
    for name in ("a%2Fb.db3", "a?mode=rwc.db3", "a#b.db3"):
        (folder / name).write_bytes((folder / "bag.db3").read_bytes())
        assert "rename" in refused("evaluate", folder / name, tum)


def test_a_storage_of_any_name_that_is_a_link_is_refused(database, tum, tmp_path):  # noqa: F811
    folder, _ = database
    (tmp_path / "secret").write_bytes((folder / "bag.db3").read_bytes())
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("bag.db3", "readings"))
    (folder / "readings").symlink_to(tmp_path / "secret")
    assert "points outside the folder" in refused("evaluate", folder, tum)


def test_a_compressed_file_is_not_unpacked(tmp_path, tum, monkeypatch):  # noqa: F811
    folder = tmp_path / "bag"
    folder.mkdir()
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    (folder / "metadata.yaml").write_text(METADATA.format(name="bomb.zstd", format="zstd", mode="file"))
    (folder / "bomb.zstd").write_bytes(zstandard.ZstdCompressor().compress(bytes(1 << 20)) * 4096)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_oublock
    assert "ros2 bag convert" in refused("evaluate", folder, tum)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_oublock - before < 1 << 16  # blocks of 512 bytes
    assert not list((tmp_path / "tmp").iterdir())


def laughs(levels):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, levels)]
    return "\n".join(lines)


def merged(levels):
    lines = ["b0: &b0 {x: 1}"]
    lines += [f"b{k}: &b{k} {{<<: [{', '.join([f'*b{k - 1}'] * 10)}]}}" for k in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    "text",
    [
        laughs(12) + METADATA.format(name="bag.db3", format="*a11", mode="file"),
        merged(12) + METADATA.format(name="bag.db3", format="zstd", mode="none"),
        "[" * 100_000,
        "- " * 100_000,
        "x: " + "y" * (1 << 21),
        "rosbag2_bagfile_information: !!python/object/apply:os.system [touch pwned]",
    ],
)
def test_metadata_that_grow_are_refused(database, tum, tmp_path, monkeypatch, text):  # noqa: F811
    folder, _ = database
    monkeypatch.chdir(tmp_path)
    (folder / "metadata.yaml").write_text(text)
    assert "bag" in refused("evaluate", folder, tum)
    assert not (tmp_path / "pwned").exists()


def test_the_quality_of_service_that_grows_is_refused(database, tum):  # noqa: F811
    folder, change = database
    text = f"{merged(12)}\nz: *b11"
    change(f"UPDATE topics SET offered_qos_profiles = '{text}'")
    assert "alias" in refused("evaluate", folder / "bag.db3", tum)


def record(kind, body):
    return bytes([kind]) + struct.pack("<Q", len(body)) + body


def string(text):
    return struct.pack("<I", len(text)) + text


def chunked(count, *, twice, together):
    """An MCAP file whose index has so many chunks of 100 MB each, the same one or others, at one time or in turn."""
    size = 100 << 20
    squeezed = zstandard.ZstdCompressor().compress(bytes(size))
    data = MAGIC + record(1, string(b"ros2") + string(b""))
    index = record(3, struct.pack("<H", 1) + string(b"nav_msgs/msg/Odometry") + string(b"ros2msg") + string(b""))
    index += record(4, struct.pack("<HH", 1, 1) + string(b"/odom") + string(b"cdr") + string(b""))
    for k in range(count):
        if not (twice and k):
            start, first = len(data), 0 if together else 10 * k
            body = struct.pack("<QQQI", first, first + 9, size, 0) + string(b"zstd") + struct.pack("<Q", len(squeezed))
            data += record(6, body + squeezed)
        place = struct.pack("<QQQQ", first, first + 9, start, len(data) - start)
        offsets = string(struct.pack("<HQ", 1, len(data)))
        sizes = struct.pack("<QQ", len(squeezed), size)
        index += record(8, place + offsets + struct.pack("<Q", 31) + string(b"zstd") + sizes)
    index += record(11, struct.pack("<QHIIIIQQ", count, 1, 1, 0, 0, count, 0, 9) + string(struct.pack("<HQ", 1, count)))
    return data + index + record(2, struct.pack("<QQI", len(data), 0, 0)) + MAGIC


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"twice": True, "together": True}, "lists a chunk twice"),
        ({"twice": False, "together": True}, "simultaneous chunks declare more than"),
    ],
)
def test_chunks_that_fill_the_memory_together_are_refused(tmp_path, tum, how, told):  # noqa: F811
    (tmp_path / "bomb.mcap").write_bytes(chunked(11, **how))
    assert told in refused("evaluate", f"{tmp_path / 'bomb.mcap'}:/odom", tum)


def test_a_message_that_is_no_image_has_a_size(tmp_path, tum):  # noqa: F811
    folder = written(tmp_path / "bag", {"/odom": rows(child="x" * (17 << 20))[:1]})
    assert "at most 16,777,216 are read" in refused("evaluate", f"{folder}:/odom", tum)
