"""Bags made to fill the memory or the disk, or to never end, are refused, and quickly."""

import resource
import sqlite3
import struct
import tempfile

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from tests.bench.test_bags import bag, refused, rows, tum, written  # noqa: F401
from uavbench.tracker.images.bag_images import bag_rate_hz
from uavbench.trajectories.bags.reading import BagTopic
from uavbench.trajectories.errors import UserError

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
    squeezed = zstandard.ZstdCompressor().compress(record(15, bytes(size - 9)))
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


BEGIN = MAGIC + record(1, string(b"ros2") + string(b""))
END = record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
TOPIC = record(3, struct.pack("<H", 1) + string(b"nav_msgs/msg/Odometry") + string(b"ros2msg") + string(b""))
TOPIC += record(4, struct.pack("<HH", 1, 1) + string(b"/odom") + string(b"cdr") + string(b""))
HOLE = 40 << 30


def claims(kind, size):
    """The beginning of a record of any size."""
    return bytes([kind]) + struct.pack("<Q", size)


CHUNK = struct.pack("<QQQI", 0, 9, 100, 0) + string(b"zstd")


@pytest.mark.parametrize(
    ("begin", "told"),
    [
        (MAGIC + claims(1, HOLE - 100), "a record claims 42,949,672,860 bytes"),
        (BEGIN + claims(3, HOLE - 200), "a record claims"),
        (BEGIN + TOPIC + claims(6, HOLE - 400), "a record claims"),
        (BEGIN + TOPIC, "an empty record at byte"),
        (BEGIN + TOPIC + claims(128, 7), "an empty record at byte"),
    ],
)
def test_a_file_with_a_hole_fills_neither_memory_nor_time(tmp_path, tum, begin, told):  # noqa: F811
    path = tmp_path / "hole.mcap"
    with path.open("wb") as file:
        file.write(begin)
        file.truncate(HOLE)
        file.seek(HOLE)
        file.write(END)
    assert told in refused("evaluate", f"{path}:/odom", tum)


def test_an_indexed_chunk_that_claims_more_than_there_is_memory_is_refused(tmp_path, tum):  # noqa: F811
    path = tmp_path / "hole.mcap"
    data = BEGIN + claims(6, HOLE) + CHUNK + struct.pack("<Q", HOLE)
    where, length = len(BEGIN), HOLE
    index = TOPIC + record(
        8,
        struct.pack("<QQQQ", 0, 9, where, length)
        + string(struct.pack("<HQ", 1, where + length))
        + struct.pack("<Q", 31)
        + string(b"zstd")
        + struct.pack("<QQ", HOLE, 100),
    )
    with path.open("wb") as file:
        file.write(data)
        file.truncate(2 * HOLE)
        file.seek(2 * HOLE - len(index))
        file.write(index + record(2, struct.pack("<QQI", 2 * HOLE - len(index), 0, 0)) + MAGIC)
    assert "bytes" in refused("evaluate", f"{path}:/odom", tum)


def test_a_topic_whose_messages_the_index_alone_has_is_refused(tmp_path, tum):  # noqa: F811
    """Chunks that end before they begin: none of their messages counts."""
    path = tmp_path / "empty.mcap"
    forwards, backwards = struct.pack("<QQ", 0, 9), struct.pack("<QQ", 9, 0)
    path.write_bytes(chunked(1, twice=False, together=True).replace(forwards, backwards, 2))  # in chunk and index
    assert "it holds none" in refused("evaluate", f"{path}:/odom", tum)


@pytest.mark.parametrize(
    ("whole", "damaged"),
    [
        ("name: /odom", "name: [1]"),
        ("type: nav_msgs/msg/Odometry", "type: [1]"),
        *(("message_count: 40", f"message_count: {count}") for count in ("x", "", "-1", ".nan", "1" + 400 * "0")),
        *(("nanoseconds: ", f"nanoseconds: {more}") for more in ("x", 400 * "9")),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "track"])
def test_metadata_of_wrong_types_are_a_users_mistake(tmp_path, tum, whole, damaged, command):  # noqa: F811
    folder = written(tmp_path / "bag", {"/odom": rows()})
    text = (folder / "metadata.yaml").read_text()
    assert whole in text
    (folder / "metadata.yaml").write_text(text.replace(whole, damaged))
    if command == "evaluate":
        assert "not a readable bag" in refused("evaluate", f"{folder}:/odom", tum)
    else:
        with pytest.raises(UserError, match="not a readable bag"):
            bag_rate_hz(BagTopic(folder, "/odom"))


def fold(path, levels):
    """Make the table of messages a tree of a few pages whose every branch is the next one: 120 to the power of rows."""
    with sqlite3.connect(path) as opened:
        opened.execute("DROP INDEX timestamp_idx")
        (root,) = opened.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
        (size,) = opened.execute("PRAGMA page_size").fetchone()
    data = bytearray(path.read_bytes())
    top = data[(root - 1) * size : root * size]
    below = int.from_bytes(top[8:12], "big") if top[0] == 5 else root  # an interior page names its last child
    for level in range(levels):
        page = bytearray(struct.pack(">BHHHBI", 5, 0, 120, size - 600, 0, below).ljust(size, b"\0"))
        for k in range(120):
            page[12 + 2 * k : 14 + 2 * k] = struct.pack(">H", size - 5 * (k + 1))
            page[size - 5 * (k + 1) : size - 5 * k] = struct.pack(">IB", below, k + 1)
        if level < levels - 1:
            data += page
            below = len(data) // size
        else:
            data[(root - 1) * size : root * size] = page
    data[28:32] = struct.pack(">I", len(data) // size)
    path.write_bytes(data)


def test_a_database_whose_pages_point_to_each_other_is_refused(tmp_path, tum):  # noqa: F811
    folder = written(tmp_path / "bag", {"/odom": rows() * 5}, StoragePlugin.SQLITE3)
    fold(folder / "bag.db3", 5)
    for given in (folder, folder / "bag.db3"):
        assert "not a readable bag" in refused("evaluate", f"{given}:/odom", tum)


def test_a_message_that_is_no_image_has_a_size(tmp_path, tum):  # noqa: F811
    folder = written(tmp_path / "bag", {"/odom": rows(child="x" * (17 << 20))[:1]})
    assert "at most 16,777,216 are read" in refused("evaluate", f"{folder}:/odom", tum)
