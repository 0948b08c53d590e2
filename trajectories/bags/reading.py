"""Guarded reading of ROS 2 bags: files are checked before they are opened, and every error names its cause."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavbench.trajectories.bags.library import reader, typestore
from uavbench.trajectories.bags.storages import SQLITE, check_chunks, check_database, path_for_rosbags
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import BAG, BAG_METADATA, IMAGE, MOST_MESSAGE_BYTES
from uavbench.trajectories.files.reading import opened

METADATA = "metadata.yaml"
"""File that makes a folder a rosbag2 bag."""
STORAGES = (".mcap", ".db3")
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
COMPRESSED = (".zst", ".zstd", ".gz", ".lz4", ".bz2")
SHOWN_TOPICS = 30
"""Topics of a bag that an error lists."""
NS = 10**9


@dataclass(frozen=True)
class BagTopic:
    """A bag and the name of one of its topics, "" if none is given; written `FILE:/topic`."""

    bag: Path
    topic: str = ""

    def __str__(self) -> str:
        return f"{self.bag}:{self.topic}" if self.topic else str(self.bag)


@dataclass(frozen=True)
class Topic:
    """Type and number of the messages of a topic."""

    type: str
    messages: int


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag: its topics by name, its duration in ns, and its messages in the order of recording."""

    path: Path
    topics: dict[str, Topic]
    duration_ns: int
    reader: Any

    def of_types(self, types: tuple[str, ...]) -> list[str]:
        """Names of the topics that hold messages of one of these types."""
        return [name for name, topic in self.topics.items() if topic.type in types and topic.messages]

    def messages(self, topic: str, types: tuple[str, ...]) -> Iterator[Any]:
        """Messages of a topic that holds one of these types; UserError naming its topics, or the damaged message."""
        self.check(topic, types)
        connections = [each for each in self.reader.connections if each.topic == topic]
        number = 0
        try:
            for _, _, data in self.reader.messages(connections=connections):
                self._check_size(topic, number, len(data))
                yield typestore().deserialize_cdr(data, self.topics[topic].type)
                number += 1
        except UserError:
            raise
        except Exception as error:  # deserializing a damaged message may raise anything
            raise UserError(f"{self.path}: message {number} of {topic} is damaged: {_why(error)}") from None
        if not number:
            raise UserError(f"{self.path}: its index lists messages of {topic}, and it holds none; `mcap recover` it")

    def _check_size(self, topic: str, number: int, size: int) -> None:
        most = IMAGE.most_bytes if self.topics[topic].type in IMAGES else MOST_MESSAGE_BYTES
        if size > most:
            raise UserError(f"{self.path}: message {number} of {topic} has {size:,} bytes; at most {most:,} are read")

    def check(self, topic: str, types: tuple[str, ...]) -> None:
        """UserError listing the bag's topics unless `topic` is one that holds messages of one of these types."""
        if topic not in self.topics:
            raise UserError(f"{self.path}: has no topic {topic!r}; {self.listed()}")
        found = self.topics[topic]
        if found.type not in types:
            fitting = ", ".join(self.of_types(types)) or "none"
            raise UserError(
                f"{self.path}: {topic} has {found.type or 'messages of several types'}, not {' or '.join(types)}; "
                f"topics of such types: {fitting}; {self.listed()}"
            )
        if not found.messages:
            raise UserError(f"{self.path}: {topic} has no messages; {self.listed()}")

    def listed(self) -> str:
        """Topics of the bag as text, for errors."""
        shown = list(self.topics.items())[:SHOWN_TOPICS]
        lines = [f"{name} ({topic.type or 'several types'}, {topic.messages})" for name, topic in shown]
        more = f" and {len(self.topics) - len(shown)} more" if len(self.topics) > len(shown) else ""
        return f"the bag's topics: {', '.join(lines) or 'none'}{more}"


def bag_topic(given: Path) -> BagTopic | None:
    """Bag and topic of `FILE` or `FILE:/topic`, if FILE is a bag by its suffix or its metadata.yaml; None otherwise.

    UserError for a topic of a folder with several bags that no metadata.yaml joins.
    """
    text = str(given)
    if is_bag(given):
        return BagTopic(given)
    for place in (k for k, letter in enumerate(text) if letter == ":"):
        if not given.exists() and is_bag(bag := _file_in(Path(text[:place]))):
            topic = text[place + 1 :]
            return BagTopic(bag, topic if topic.startswith("/") else f"/{topic}")
    return None


def is_bag(path: Path) -> bool:
    """Whether a file has a bag's suffix, or a folder holds a metadata.yaml."""
    suffixes = path.suffixes[-2:]
    if path.is_dir():
        return (path / METADATA).is_file()
    return path.suffix in (*STORAGES, ".bag") or (len(suffixes) == 2 and suffixes[0] in STORAGES)


def _file_in(path: Path) -> Path:
    """The only bag file in a folder without metadata.yaml, as in an export; otherwise the path itself.

    UserError for several, which may be the parts of one recording.
    """
    if not path.is_dir() or is_bag(path):
        return path
    files = [file for file in path.iterdir() if is_bag(file)]
    if len(files) > 1:
        raise UserError(
            f"{path}: holds {len(files)} bags, and no {METADATA} that joins the parts of a recording; write it with "
            f"`ros2 bag reindex {path}`, or name one, as {min(files)}:/topic"
        )
    return files[0] if files else path


@contextmanager
def opened_bag(path: Path) -> Iterator[Bag]:
    """An open bag; UserError naming the file when it is not a bag, truncated, too large, or compressed."""
    _check_files(path)
    with ExitStack() as stack:
        place = stack.enter_context(path_for_rosbags(path))
        bag = reader()(place)
        try:
            bag.open()
            stack.callback(bag.close)
            check_chunks(bag)
            found = Bag(path, _topics(bag), _whole(bag.duration), bag)
        except UserError as error:
            raise UserError(f"{path}: {error}") from None
        except Exception as error:  # a damaged index, or metadata of wrong types, may raise anything
            why = _why(error).replace(str(place), str(path))
            raise UserError(
                f"{path}: not a readable bag: {why}; if its recording was cut short, `ros2 bag reindex` or "
                "`mcap recover` may repair it"
            ) from None
        yield found


def stamp_ns(header: Any) -> int:
    """Time of a message's header, in whole ns."""
    return int(header.stamp.sec) * NS + int(header.stamp.nanosec)


def _topics(bag: Any) -> dict[str, Topic]:
    if bag.compression_mode:
        raise UserError(
            f"its messages or files are compressed ({bag.compression_format} by {bag.compression_mode}), which "
            "is not supported; use `ros2 bag convert` to remove it, or .mcap with its own compression"
        )
    for each in bag.connections:
        if each.ext.serialization_format != "cdr":
            raise UserError(
                f"{each.topic} is serialized as {each.ext.serialization_format!r}; only CDR, the format of "
                "ROS 2, is supported"
            )
    return {str(name): Topic(str(topic.msgtype or ""), _whole(topic.msgcount)) for name, topic in bag.topics.items()}


def _whole(value: Any) -> int:
    """A count or duration in ns as metadata give it; ValueError when it is not a whole number of 63 bits."""
    if not (isinstance(value, int) and 0 <= value < 1 << 63):
        raise ValueError("one of its counts or durations is not a whole number")
    return value


def _check_files(path: Path) -> None:
    """Raise UserError unless every file of a bag is a regular file in its folder and not too large."""
    if path.suffix == ".bag":
        raise UserError(f"{path}: is a ROS 1 bag; convert it: rosbags-convert --src {path} --dst {path.stem}")
    if path.suffix in COMPRESSED:
        raise UserError(f"{path}: is compressed as a whole, which is not supported; run `zstd -d` on it first")
    if not path.is_dir():
        _check_storage(path)
        return
    with opened(path / METADATA, BAG_METADATA, inside=path):
        pass
    for file in path.iterdir():  # files of any name, because the metadata may list any
        if file.is_symlink() or not file.is_dir():
            _check_storage(file, path)


def _check_storage(path: Path, folder: Path | None = None) -> None:
    with opened(path, BAG, inside=folder) as handle:
        head = handle.read(len(SQLITE))
    if head == SQLITE:
        check_database(path)


def _why(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
