"""Copy of a job folder whose program broke the protocol: what it wrote may have any name, size, depth and link."""

import shutil
import stat
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from uavbench.trajectories.errors import one_line, plain
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder, write_text

KEPT_MARKER = Marker("uavbench.json", "job of a faulty tracker")
"""File of a kept folder that lists the others."""
FAULTS_FILE = "faults.txt"
WORDS = ("stdout.txt", "stderr.txt")
OWN = (KEPT_MARKER.name, FAULTS_FILE, *WORDS, "tmp")
"""Names in a job folder that are not copied: the files that are written here, and the program's temporary files."""
MOST_BYTES = 1 << 24
"""Largest file that is kept, bytes; of the program's output, as much is kept."""
MOST_FILES = 20_000
"""Most files that are kept: the inputs and frames of ten minutes at 30 Hz."""
MOST_LEVELS = 16
"""Most nested folders that are kept; a job folder has two."""


def keep(folder: Path, kept: Path, faults: Sequence[object]) -> None:
    """Copy the job folder of a run with faults, and write these to faults.txt, with what could not be copied.

    Links are copied as links and never followed; the program's output is written with control characters escaped.
    """
    with new_folder(kept, KEPT_MARKER) as new:
        lines = [f"{fault}\n" for fault in faults]
        try:
            lines += [f"not kept: {what}\n" for what in _copy(folder, new)]
        except (OSError, shutil.Error) as error:  # removed or replaced, not readable, or a name too long
            lines.append(f"not all of the job folder could be kept: {one_line(str(error))[:300]}\n")
        write_text(new / FAULTS_FILE, "".join(lines))


def _copy(folder: Path, new: Path) -> list[str]:
    """Copy a job folder; what was left out."""
    if not stat.S_ISDIR(folder.lstat().st_mode):
        return ["the program replaced its job folder by something else"]
    worth = Worth(folder)
    shutil.copytree(folder, new, symlinks=True, dirs_exist_ok=True, ignore=worth)
    for name in WORDS:
        with suppress(FileNotFoundError):
            if stat.S_ISREG((folder / name).lstat().st_mode):
                with (folder / name).open("rb") as handle:
                    write_text(new / name, plain(handle.read(MOST_BYTES).decode("utf-8", errors="replace")))
    return worth.left_out


class Worth:
    """Which names of a folder `shutil.copytree` ignores; left_out: the limits that were reached."""

    def __init__(self, root: Path) -> None:
        self._root, self._files = root, 0
        self._reached: dict[str, None] = {}

    @property
    def left_out(self) -> list[str]:
        """What was not copied, for people."""
        return list(self._reached)

    def __call__(self, folder: str, names: list[str]) -> set[str]:
        """Names to leave out: files of ours, pipes, sockets and devices, and what is beyond the limits."""
        at = Path(folder)
        levels = len(at.relative_to(self._root).parts)
        return {name for name in names if (not levels and name in OWN) or not self._keeps(at / name, levels)}

    def _keeps(self, path: Path, levels: int) -> bool:
        found = path.lstat()
        if stat.S_ISDIR(found.st_mode):
            return self._within(levels < MOST_LEVELS, f"folders more than {MOST_LEVELS} levels deep")
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISLNK(found.st_mode)):
            return False
        if not self._within(found.st_size <= MOST_BYTES, f"files of more than {MOST_BYTES:,} bytes"):
            return False
        self._files += 1
        return self._within(self._files <= MOST_FILES, f"more than {MOST_FILES:,} files")

    def _within(self, is_within: bool, limit: str) -> bool:
        if not is_within:
            self._reached[limit] = None
        return is_within
