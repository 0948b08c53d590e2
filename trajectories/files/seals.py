"""Seals: a file written by uavbench ends with its kind and the digest of its content, which proves its origin.

A seal is a comment in the file's own format. An edited or foreign file has no valid seal. The kind says in words what
the file is (`camera calibration`), so that a product never takes the place of one of another kind.
"""

import hashlib
import re
import struct
import zlib
from pathlib import Path

SEAL = b"uavbench-made-"
COMMENTS = {
    ".toml": (b"# ", b"\n"),
    ".obj": (b"# ", b"\n"),
    ".txt": (b"# ", b"\n"),
    ".md": (b"<!-- ", b" -->\n"),
    ".xml": (b"<!-- ", b" -->\n"),
    ".html": (b"<!-- ", b" -->\n"),
    ".pdf": (b"% ", b"\n"),
    ".tex": (b"% ", b"\n"),
}
"""Opening and closing of a comment, by file suffix."""
TABLE = ".csv"
"""Suffix of tables, which other programs may expect without comments: sealed like `.txt`, on request only."""
IEND = bytes.fromhex("0000000049454e44ae426082")
"""The last chunk of every PNG file."""
TAIL_BYTES = 300
"""Bytes at the end of a file that are searched for a seal."""
PATTERN = re.compile(SEAL + rb"([0-9a-f]{64})(.*)", re.DOTALL)
KIND = re.compile(rb"([a-z][a-z -]*); (?:beside [0-9a-f]{64} )?\Z")
"""The kind and the digest of the file beside, which stand before a seal; the first versions wrote no kind."""


def seal_table(path: Path, kind: str) -> None:
    """Append a seal to a CSV file whose bytes differ from run to run."""
    opening, closing = COMMENTS[".txt"]
    _close(path, path.read_bytes() + opening + _named(kind), closing)


def seal(path: Path, kind: str, beside: Path | None = None) -> None:
    """Append a seal to a file, which also covers the content of `beside`; formats without comments stay unchanged.

    kind: lower-case letters, spaces and hyphens.
    """
    data = path.read_bytes()
    about = _named(kind) + (b"" if beside is None else _beside(beside))
    if path.suffix == ".json" and data.endswith(b"\n}\n"):
        _close(path, data[:-3] + b',\n "made_by": "' + about, b'"\n}\n')
    elif path.suffix == ".png" and data.endswith(IEND):
        head = b"tEXtComment\0" + about
        length = len(head) - 4 + len(SEAL) + 64
        before = data[: -len(IEND)] + struct.pack(">I", length) + head
        chunk = head + _seal_of(before)
        path.write_bytes(before + _seal_of(before) + struct.pack(">I", zlib.crc32(chunk)) + IEND)
    elif path.suffix in COMMENTS:
        opening, closing = COMMENTS[path.suffix]
        _close(path, data + opening + about, closing)


def is_sealed(path: Path) -> bool:
    """Whether this is a regular file, not a link, with a valid seal; of a file without one only the end is read."""
    return sealed_kind(path) is not None


def is_seal_broken(path: Path) -> bool:
    """Whether a file ends with a seal that is not valid: it was edited or damaged since it was written."""
    return _has_seal(path) and not is_sealed(path)


def sealed_kind(path: Path) -> str | None:
    """Kind of a sealed file, "" where an earlier version wrote none; None for a file that `is_sealed` refuses."""
    try:
        if path.is_symlink() or not _has_seal(path):
            return None
        data = path.read_bytes()
    except OSError:
        return None
    before, _, _ = data.rpartition(SEAL)
    found = PATTERN.fullmatch(data[len(before) :])
    if found is None or found[1] != _digest(before) or not _closes(path.suffix, found[2]):
        return None
    kind = KIND.search(before[-TAIL_BYTES:])
    return kind[1].decode("ascii") if kind else ""


def is_sealed_with(path: Path, beside: Path) -> bool:
    """Whether a file's seal is valid, and covers the content of `beside`."""
    try:
        return is_sealed(path) and not beside.is_symlink() and _beside(beside) + SEAL in path.read_bytes()
    except OSError:
        return False


def _has_seal(path: Path) -> bool:
    """Whether a seal, valid or not, stands at the end of a regular file."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as handle:
            handle.seek(max(0, path.stat().st_size - TAIL_BYTES))
            return SEAL in handle.read()
    except OSError:
        return False


def _named(kind: str) -> bytes:
    return f"{kind}; ".encode("ascii")


def _beside(path: Path) -> bytes:
    return b"beside " + hashlib.sha256(path.read_bytes()).hexdigest().encode() + b" "


def _close(path: Path, before: bytes, closing: bytes) -> None:
    path.write_bytes(before + _seal_of(before) + closing)


def _closes(suffix: str, after: bytes) -> bool:
    """Whether only the closing of the comment follows a seal."""
    if suffix == ".png":
        return len(after) == 4 + len(IEND) and after.endswith(IEND)
    known = COMMENTS | {TABLE: COMMENTS[".txt"]}
    return after == (b'"\n}\n' if suffix == ".json" else known.get(suffix, (b"", b"-"))[1])


def _seal_of(before: bytes) -> bytes:
    return SEAL + _digest(before)


def _digest(before: bytes) -> bytes:
    return hashlib.sha256(before).hexdigest().encode()
