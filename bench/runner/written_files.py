"""Records of jobs: `made/` in a suite's folder holds the size, times and digest of every file that a job wrote.

They also hold the inputs that the job was seen to use beyond its key.

A job counts as done only while all of its files are unchanged. The record is written before the work begins, without a
content hash, so that a killed job never counts as done; it keeps the names, so that damaged output can be replaced.
"""

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from uavbench.bench.inputs.content_hash import carried_hash
from uavbench.bench.inputs.observed.seen_inputs import SeenInputs
from uavbench.reports.run_folder import RECORDS
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker, tree
from uavbench.trajectories.files.origin import owning, refuse_foreign
from uavbench.trajectories.files.writing import noting, write_text

Seen = Callable[[Path, int], SeenInputs]
"""Inputs that a job was seen to use, by the suite's folder and the time in ns when it began."""


@dataclass(frozen=True)
class Stamp:
    """A file as it was written: size in bytes, mtime and ctime in ns, sha256."""

    size: int
    mtime_ns: int
    ctime_ns: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "Stamp":
        """Stamp of a file."""
        with path.open("rb") as handle:
            digest = hashlib.file_digest(handle, "sha256").hexdigest()
            about = os.fstat(handle.fileno())
        return cls(about.st_size, about.st_mtime_ns, about.st_ctime_ns, digest)

    def now(self, path: Path) -> "Stamp | None":
        """Current stamp of the file, None when changed or missing; its content is read only if the times differ."""
        try:
            about = path.lstat()
            if not stat.S_ISREG(about.st_mode) or about.st_size != self.size:
                return None
            if (about.st_mtime_ns, about.st_ctime_ns) == (self.mtime_ns, self.ctime_ns):
                return self
            found = Stamp.of(path)
        except OSError:
            return None
        return found if found.sha256 == self.sha256 else None


@dataclass(frozen=True)
class Record:
    """Files that a job wrote, by their names in the suite's folder; content_hash is "" until the job is done.

    inputs: what the job was seen to use that the hash does not hold.
    """

    content_hash: str = ""
    files: Mapping[str, Stamp] = field(default_factory=dict)
    inputs: SeenInputs = field(default_factory=SeenInputs)

    @classmethod
    def read(cls, path: Path) -> "Record":
        """Read a record; an empty one when the file is missing or incomplete."""
        try:
            about = json.loads(path.read_text(encoding="utf-8"))
            files = {name: Stamp(*stamp) for name, stamp in about["files"].items()}
            inputs = SeenInputs.read(about["inputs"]) if "inputs" in about else SeenInputs()
            return cls(str(about["content_hash"]), files, inputs)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return cls()

    def write(self, path: Path) -> None:
        """Write the record, completely or not at all."""
        files = {name: (stamp.size, stamp.mtime_ns, stamp.ctime_ns, stamp.sha256) for name, stamp in self.files.items()}
        more = {} if self.inputs == SeenInputs() else {"inputs": asdict(self.inputs)}
        text = json.dumps({"content_hash": self.content_hash, "files": files, **more}, indent=1)
        write_text(path, f"{text}\n", kind="record of a job")


@dataclass(frozen=True)
class Place:
    """Output of a job: the suite's folder, the marker in it, and whether the marker's folder belongs to this job alone.

    lists: the list of that folder.
    """

    root: Path
    marker: Path
    lists: Marker | None = None

    @property
    def record(self) -> Path:
        """File of the record."""
        return self._record_of(self.marker.relative_to(self.root).as_posix())

    def is_whole(self, content_hash: str) -> bool:
        """Whether all files made for this hash exist unchanged."""
        return self.whole(content_hash) is not None

    def whole(self, content_hash: str) -> Record | None:
        """The record, if all files made for this hash exist unchanged.

        If only times differ, as after copying, the record is updated, so that the contents are compared only once.
        """
        record = Record.read(self.record)
        if record.content_hash != content_hash or not record.files:
            return None
        now = {name: stamp.now(self.root / name) for name, stamp in record.files.items()}
        whole = {name: stamp for name, stamp in now.items() if stamp is not None}
        if len(whole) < len(now):
            return None
        if whole != record.files:
            with suppress(OSError, UserError):  # a read-only folder
                replace(record, files=whole).write(self.record)
        return record

    @contextmanager
    def writing(self, content_hash: str, inputs: Seen = lambda *_: SeenInputs()) -> Iterator[None]:
        """Context that records the files written in it; inputs: called at its end with the folder and when it began."""
        before = Record.read(self.record)
        Record("", before.files).write(self.record)
        begin_ns = self.record.stat().st_ctime_ns  # by the clock of the files
        with owning(self._known(before)), noting() as written:
            try:
                yield
            except BaseException:  # what was written stays, and is known to be uavbench's
                if written:
                    Record("", {**before.files, **self._stamps(written)}).write(self.record)
                raise
        stamps = self._stamps({*written, self.marker.absolute()})
        Record(content_hash, stamps, inputs(self.root, begin_ns)).write(self.record)

    def disown(self) -> None:
        """Make the output stale; the files stay, and are known to be uavbench's."""
        Record("", Record.read(self.record).files).write(self.record)

    def is_of_other_inputs(self, content_hash: str) -> bool:
        """Whether a job made the output of inputs that have another hash."""
        return Record.read(self.record).content_hash not in ("", content_hash)

    @property
    def is_disowned(self) -> bool:
        """Whether the output is known to be unfinished, or of inputs that changed meanwhile."""
        return self.record.is_file() and not Record.read(self.record).content_hash

    def refuse_foreign(self) -> None:
        """Raise UserError naming a file in the job's own folder that uavbench did not write."""
        folder = self.marker.parent
        if self.lists is None or not os.path.lexists(folder):
            return
        known = self._known(Record.read(self.record))
        if folder.is_dir() and not folder.is_symlink() and all(folder / name in known for name in tree(folder)):
            return
        with owning(known):
            refuse_foreign(folder, self.lists)

    def _stamps(self, paths: Iterable[Path]) -> dict[str, Stamp]:
        """Stamps of those files that lie where the marker does, by their names in the suite's folder."""
        root, here = self.root.absolute(), self.marker.parent.absolute()
        there = (path.absolute() for path in paths if path.absolute().is_relative_to(here) and path.exists())
        names = sorted(path.relative_to(root).as_posix() for path in there)
        return {name: Stamp.of(root / name) for name in names}

    def _known(self, record: Record) -> set[Path]:
        """Files of this record, and those in the job's own folder that belong to another job."""
        folder = self.marker.parent
        known = {self.root / name for name in record.files}
        if self.lists is not None and folder.is_dir() and not folder.is_symlink():
            within = folder.relative_to(self.root)
            others = [name for name in tree(folder) if folder / name not in known]
            known |= {folder / name for name in others if self._record_of((within / name).as_posix()).is_file()}
        return known

    def _record_of(self, marker: str) -> Path:
        return self.root / RECORDS / marker


@dataclass(frozen=True)
class Made:
    """Output of a job for the hash of its inputs."""

    place: Place
    content_hash: str

    @property
    def is_whole(self) -> bool:
        """Whether it was made for this hash and is unchanged since it was written."""
        return carried_hash(self.place.marker) == self.content_hash and self.place.is_whole(self.content_hash)

    @property
    def is_fresh(self) -> bool:
        """Whether it is whole, and the inputs that its job was seen to use beyond the hash are as they were."""
        if carried_hash(self.place.marker) != self.content_hash:
            return False
        record = self.place.whole(self.content_hash)
        return record is not None and record.inputs.are_unchanged(self.place.root)


def expect_whole(needs: Iterable[Made]) -> None:
    """Raise UserError naming an output that is not as it was made: another version of the suite may write there."""
    for need in needs:
        if not need.is_whole:
            raise UserError(
                f"{need.place.marker.parent}: another process replaces what this job reads; once that has ended, "
                "run the same command again, or give each version of a suite a folder of its own"
            )
