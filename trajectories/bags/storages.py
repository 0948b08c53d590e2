"""A bag's storage: its path for rosbags, SQLite tables without computed content, MCAP chunks that fit into memory."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MOST_CHUNK_BYTES

SQLITE = b"SQLite format 3\0"
"""Magic bytes of an SQLite database."""
OF_A_URI = "?#%"
"""Characters that rosbags does not escape when it puts a path into a URI: SQLite would open another file."""
UNTRUSTED = "which recordings do not have; do not trust this file"


@contextmanager
def path_for_rosbags(path: Path) -> Iterator[Path]:
    """A path of the same file or folder that has no character of OF_A_URI in the folders above, valid in the context.

    The folder of a file, or of what does not exist yet, must exist.
    """
    if not any(letter in str(path) for letter in OF_A_URI):
        yield path
        return
    whole = path.is_dir()
    handle = os.open(path if whole else path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        folder = Path(f"/proc/self/fd/{handle}")
        yield folder if whole else folder / path.name
    finally:
        os.close(handle)


def check_database(path: Path) -> None:
    """Raise UserError unless a database is sound and has plain tables only.

    Views and generated columns can be of any size, and so can a table of a few pages that point to each other.
    """
    if found := [letter for letter in OF_A_URI if letter in path.name]:
        raise UserError(f"{path}: a name with {found[0]!r} cannot be opened; rename the file")
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1", uri=True)) as database:
            for kind, name, sql in database.execute("SELECT type, name, substr(sql, 1, 40) FROM sqlite_master"):
                if kind == "view" or "VIRTUAL" in str(sql).upper().split():
                    raise UserError(f"{path}: holds the view or virtual table {name!r}, {UNTRUSTED}")
                hidden = database.execute("SELECT count(*) FROM pragma_table_xinfo(?) WHERE hidden > 1", (name,))
                if kind == "table" and hidden.fetchone()[0]:
                    raise UserError(f"{path}: its table {name!r} has a generated column, {UNTRUSTED}")
            (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
            if found != "ok":
                raise UserError(f"{path}: not a readable bag: {' '.join(found.split())}; `sqlite3` may `.recover` it")
    except sqlite3.Error as error:
        raise UserError(f"{path}: not a readable bag: {error}") from None


def check_chunks(bag: Any) -> None:
    """UserError when an open MCAP file lists a chunk twice, or simultaneous chunks that exceed MOST_CHUNK_BYTES."""
    for storage in getattr(bag.storage, "storages", [bag.storage]):
        chunks = getattr(storage, "chunks", [])
        if len({chunk.chunk_start_offset for chunk in chunks}) < len(chunks):
            raise UserError(f"lists a chunk twice, {UNTRUSTED}")
        changes = [(chunk.message_start_time, chunk.uncompressed_size) for chunk in chunks]
        changes += [(chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in chunks]
        held = 0
        for _, change in sorted(changes):
            held += change
            if held > MOST_CHUNK_BYTES:
                raise UserError(
                    f"its simultaneous chunks declare more than {MOST_CHUNK_BYTES:,} bytes in total; rewrite "
                    "it in time order"
                )
