"""Errors of the disk while a dataset is written, turned into a UserError."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from uavbench.trajectories.errors import UserError


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn an error of the disk while writing `folder` (full, read-only, not allowed) into a UserError."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be written: {error.strerror or error}; free space or name another folder"
        ) from None
