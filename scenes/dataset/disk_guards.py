"""Guards of a dataset folder: disk errors and path traversal become a UserError."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from uavbench.trajectories.errors import NO_SPACE, DiskError, UserError


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn a disk error while writing `folder` (full, read-only, no permission) into a UserError or DiskError.

    One of a file elsewhere, as of a missing one that a user's effect reads, names that file.
    """
    try:
        yield
    except OSError as error:
        if _is_of_a_file_elsewhere(error, folder):
            raise DiskError.of(error, f"{error.filename}: {error.strerror}; check this path") from None
        advice = "free space or choose another folder" if error.errno in NO_SPACE else "choose another folder"
        why = f"{folder}: cannot be written: {error.strerror or error}; {advice}"
        raise DiskError.of(error, why) from None


def _is_of_a_file_elsewhere(error: OSError, folder: Path) -> bool:
    """Whether the file of an error is neither in a folder nor beside it, where the folder is made.

    An error of a copy into the folder names the file that is copied first.
    """
    name = error.filename
    if not isinstance(name, str) or error.filename2 is not None:
        return False
    return not Path(name).absolute().is_relative_to(folder.absolute().parent)


def inside(folder: Path, name: str) -> Path:
    """Path of a file of a dataset, with links resolved; UserError when it is outside the dataset's folder."""
    try:
        path = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise UserError(f"{folder}: {name!r} is not a file name: {error}") from None
    if not path.is_relative_to(folder.resolve()):
        raise UserError(f"{folder}: its file {name!r} points outside the folder; do not trust this dataset")
    return path
