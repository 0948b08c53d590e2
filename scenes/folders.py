"""Care with a user's disk: nothing foreign is replaced, and a full disk is told as such."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trajectories.errors import UserError


def refuse_foreign(folder: Path, marker: str) -> None:
    """UserError when `folder` exists, is not empty, and has no file `marker` that shows it to be one of ours."""
    if folder.is_file():
        raise UserError(f"{folder}: is a file; name a folder to write to")
    if folder.is_dir() and not (folder / marker).is_file() and any(folder.iterdir()):
        raise UserError(f"{folder}: holds something else (no {marker} in it); name an empty or a new folder")


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn an error of the disk while writing `folder` (full, read-only, not allowed) into a UserError."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be written: {error.strerror or error}; free space or name another folder"
        ) from None
