"""The library rosbags, where it is installed, held to the sizes that a bag claims."""

import importlib
from functools import cache
from typing import Any

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MOST_CHUNK_BYTES

DISTRIBUTION = "ROS2_HUMBLE"
"""Whose definitions of messages are taken: the oldest that is maintained; later ones have the same fields."""


def rosbags(module: str) -> Any:
    """A module of rosbags; UserError saying how to install it."""
    try:
        return importlib.import_module(f"rosbags.{module}")
    except ImportError:
        raise UserError("reading and writing ROS bags needs rosbags: pip install 'uavbench[bags]'") from None


@cache
def typestore() -> Any:
    """Definitions of ROS 2 messages, by which they become bytes and again messages."""
    types = rosbags("typesys")
    return types.get_typestore(types.Stores[DISTRIBUTION])


@cache
def reader() -> Any:
    """The class that reads a bag; no chunk of an MCAP file is inflated beyond what it claims.

    rosbags itself inflates a chunk as a whole before it compares sizes, so that a small file could fill the memory.
    """
    storage = rosbags("rosbag2.storage_mcap")
    storage.DECOMPRESSORS.update({"": _stored, "zstd": _zstd, "lz4": _lz4})
    return rosbags("rosbag2").Reader


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
        raise ValueError(f"a chunk claims {size:,} bytes; at most {MOST_CHUNK_BYTES:,} are read")
    return size
