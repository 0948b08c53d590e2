"""The optional library rosbags, with decompression limited to the declared sizes and YAML without aliases."""

import importlib
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import BAG_METADATA, MOST_CHUNK_BYTES

DISTRIBUTION = "ROS2_JAZZY"
"""ROS 2 distribution of the message definitions: that of the metadata that bags are written with; later ones have the
same fields. Of the types that are written or read, Humble lacks `variance` of Range."""


def rosbags(module: str) -> Any:
    """A module of rosbags; UserError with the install command when rosbags is not installed."""
    try:
        return importlib.import_module(f"rosbags.{module}")
    except ImportError:
        raise UserError("reading and writing ROS bags needs rosbags: pip install 'uavbench[bags]'") from None


@cache
def typestore() -> Any:
    """Type store that serializes and deserializes ROS 2 messages."""
    types = rosbags("typesys")
    return types.get_typestore(types.Stores[DISTRIBUTION])


@cache
def reader() -> Any:
    """The reader class of rosbags with limits: MCAP chunks are decompressed up to their declared size, files never.

    rosbags itself decompresses a whole chunk before it compares sizes, and a compressed file to disk before it is
    checked; it allocates whatever a record claims; and it expands YAML aliases, with which a small file can expand
    without bound.
    """
    storage, folder, metadata = (rosbags(f"rosbag2.{name}") for name in ("storage_mcap", "reader", "metadata"))
    storage.DECOMPRESSORS.update({"": _stored, "zstd": _zstd, "lz4": _lz4})
    storage.read_exact, storage.skip_sized = _of_at_most(storage.read_exact), _of_content(storage)
    folder.zstd = _NoFile
    folder.YAML = metadata.YAML = _plain_yaml()
    return rosbags("rosbag2").Reader


class _NoFile:
    """Replaces the decompressor of compressed files and messages, which are not supported."""

    @staticmethod
    def open(*_: Any) -> Any:
        raise UserError(
            "its files are compressed (zstd by file), which is not supported; convert it with `ros2 bag convert`"
        )


def _plain_yaml() -> Any:
    """A reader of YAML without aliases, of limited size."""
    yaml, composer = importlib.import_module("ruamel.yaml"), importlib.import_module("ruamel.yaml.composer")

    class Tree(composer.Composer):  # type: ignore[misc,name-defined]
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.parser.check_event(yaml.events.AliasEvent):
                raise ValueError("its YAML has an alias, which bag metadata never contain")
            return super().compose_node(parent, index)

    class Plain(yaml.YAML):  # type: ignore[misc,name-defined]
        def __init__(self, **options: Any) -> None:
            super().__init__(**options)
            self.Composer = Tree

        def load(self, stream: Any) -> Any:
            if len(stream) > BAG_METADATA.most_bytes:
                raise ValueError(
                    f"its YAML has {len(stream):,} characters; at most {BAG_METADATA.most_bytes:,} are read"
                )
            return super().load(stream)

    return Plain


def _of_at_most(read_exact: Callable[[Any, int], bytes]) -> Callable[[Any, int], bytes]:
    """Reads the bytes of a record, of which a file with holes can claim any number."""
    return lambda file, size: read_exact(file, _checked(size))


def _of_content(storage: Any) -> Callable[[Any], None]:
    """Skips a record of an unknown kind; one without content is refused: a hole in a file is read as billions of them.

    Every record of the format has content.
    """

    def skip_sized(file: Any) -> None:
        (size,) = struct.unpack("<Q", storage.read_exact(file, 8))
        if not size:
            raise ValueError(f"an empty record at byte {file.tell() - 9:,}")
        storage.skip_exact(file, size)

    return skip_sized


def _stored(data: bytes, size: int) -> bytes:
    return data


def _zstd(data: bytes, size: int) -> bytes:
    zstd = rosbags("rosbag2.storage_mcap").zstd
    return bytes(zstd.ZstdDecompressor().decompress(data, max_length=_checked(size) + 1))


def _lz4(data: bytes, size: int) -> bytes:
    frame = importlib.import_module("lz4.frame")
    return bytes(frame.LZ4FrameDecompressor().decompress(data, max_length=_checked(size) + 1))


def _checked(size: int) -> int:
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"a record claims {size:,} bytes; at most {MOST_CHUNK_BYTES:,} are read")
    return size
