"""The output folder of a suite: claimed by name, used by one process at a time."""

import fcntl
import hashlib
import json
import os
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from uavbench.bench.config.shard import Shard
from uavbench.bench.config.suite import Suite
from uavbench.bench.runner.written_files import Record, Stamp
from uavbench.bench.third_party.registry import absent
from uavbench.reports.run_folder import RECORDS, has_older_report
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import DamagedFileError, DiskError, UserError
from uavbench.trajectories.files.listed import Listed, Marker, tree
from uavbench.trajectories.files.origin import owning, refuse_foreign_file, refuse_within_whole
from uavbench.trajectories.files.seals import is_seal_broken, sealed_kind
from uavbench.trajectories.files.temporary_names import is_temporary, remove_leftovers
from uavbench.trajectories.files.writing import write_text

SUITE = "suite.json"
RESULTS = "results of a suite"
DEPTHS = {"sequences": 0, "results": 2, "restarts": 2, "flights": 2, "videos": 2, "failed": 1, "made": 4}
"""Folders in which files are written under temporary names, and the number of levels below."""
OLDER = (
    '<p role="alert" style="margin:0;max-width:none;padding:.6em 1em;background:#b00020;color:#fff;font-weight:bold">'
    "This page is of an earlier run: the scores or the suite have changed since. Write it again with "
    "<code>uavbench report</code>.</p>"
)
"""What is put at the top of a page that is left from an earlier run."""
GATE = "gate"
"""Folder of the verdict on the results, unless another one is named."""
VERDICT = "verdict of the gate"
VERDICT_FILES = ("gate.json", "gate.xml", "gate.md")
ELSEWHERE = Marker("verdicts.json", "verdicts of the gate in other folders")
"""The verdicts on the results, or with them as the baseline, that are in other folders."""
WORST = "worst"
WORST_MARKER = Marker("worst.json", "worst sequences of a gate")
"""The pictures beside a verdict."""


def resolved(folder: Path) -> Path:
    """The folder with links resolved; UserError for a dangling link, as to a disk that is not mounted, in its path."""
    for place in (folder, *folder.parents):
        if place.is_symlink() and not place.exists():
            raise UserError(f"{place}: is a dangling link; name another folder")
    return folder.resolve()


def refuse_foreign_folder(folder: Path, kind: str = RESULTS) -> None:
    """Raise UserError unless uavbench made the folder: then it has a `suite.json` with a seal of this kind."""
    refuse_within_whole(folder)
    if os.path.lexists(folder) and not folder.is_dir():
        raise UserError(f"{folder}: not a folder; name another one")
    if not folder.is_dir() or sealed_kind(folder / SUITE) == kind:
        return
    refuse_foreign_file(folder / SUITE, kind)
    for path in sorted(folder.iterdir()):
        early = path.name.startswith(".lock") or path.name == "slurm" or is_temporary(path.name)
        if not early and not sealed_kind(folder / SUITE) == kind:  # another shard may have written it meanwhile
            raise UserError(f"{folder}: holds something other than uavbench's output: {path.name}; name a new folder")


def remove_verdict(folder: Path) -> None:
    """Remove a verdict of the gate, with its pictures, that is no longer one on the results as they are.

    A file that was edited since stays. UserError for a folder that is checked
    as a whole, where no verdict may be.
    """
    refuse_within_whole(folder / VERDICT_FILES[0])
    for path in (folder / name for name in VERDICT_FILES):
        if sealed_kind(path) == VERDICT:
            path.unlink(missing_ok=True)  # another shard may have removed it meanwhile
    pictures = folder / WORST
    if pictures.is_symlink() or sealed_kind(pictures / WORST_MARKER.name) != WORST_MARKER.kind:
        return
    listed = Listed.of(pictures, WORST_MARKER)
    for name in [*tree(pictures)]:
        if listed.holds(pictures, name):
            (pictures / name).unlink(missing_ok=True)
    (pictures / WORST_MARKER.name).unlink(missing_ok=True)
    with suppress(OSError):  # it holds something else
        pictures.rmdir()


def note_verdict(folder: Path, verdict: Path) -> None:
    """Note in a suite's folder a verdict in another one, which is removed once the scores are made anew.

    In a folder that is not a suite's, or is read-only, nothing is noted. UserError as `noted_verdicts`.
    """
    if verdict.resolve() == (folder / GATE).resolve() or not sealed_kind(folder / SUITE):
        return
    found = _digest(verdict)
    noted = {**noted_verdicts(folder), str(verdict.resolve()): found}
    with suppress(OSError, UserError):
        note = {"folder": str(folder.resolve()), "verdicts": noted}
        write_text(folder / ELSEWHERE.name, json.dumps(note, indent=1) + "\n", kind=ELSEWHERE.kind)


def remove_verdicts(folder: Path) -> None:
    """Remove the verdicts on the results of a suite's folder: that in it, and those noted in it, if they still are it.

    One that cannot be removed stays. UserError as `noted_verdicts`.
    """
    remove_verdict(folder / GATE)
    for place, digest in noted_verdicts(folder).items():
        with suppress(OSError, UserError):
            if _digest(Path(place)) == digest:
                remove_verdict(Path(place))
    if sealed_kind(folder / ELSEWHERE.name) == ELSEWHERE.kind:
        (folder / ELSEWHERE.name).unlink(missing_ok=True)


def noted_verdicts(folder: Path) -> dict[str, str]:
    """Digest of the verdict in each folder that is noted; UserError when the note was damaged or edited.

    None in a copy of a folder that is still there: they are on the results of that one.
    """
    path = folder / ELSEWHERE.name
    if is_seal_broken(path):
        raise DamagedFileError(
            f"{path}: is damaged, or was edited since uavbench wrote it; remove it, and verdicts of the gate on these "
            "results, or with them as the baseline, in other folders: it noted where they lie"
        )
    if sealed_kind(path) != ELSEWHERE.kind:
        return {}
    note = read_json(path)
    of = Path(note.get("folder", folder))
    if of.resolve() != folder.resolve() and sealed_kind(of / ELSEWHERE.name) == ELSEWHERE.kind:
        return {}
    return {str(place): str(digest) for place, digest in note["verdicts"].items()}


def _digest(verdict: Path) -> str:
    """Digest of a verdict, "" where there is none."""
    path = verdict / VERDICT_FILES[0]
    return hashlib.sha256(path.read_bytes()).hexdigest() if sealed_kind(path) == VERDICT else ""


def mark_older_pages(folder: Path) -> None:
    """Say on each page of the report in a folder that it is of earlier scores, if it is.

    A page that was edited since stays, and one that cannot be written: the run tells what is wrong with the folder.
    """
    with suppress(OSError, UserError):
        if has_older_report(folder):
            _mark_pages(folder)


def _mark_pages(folder: Path) -> None:
    for path in (folder / RECORDS / name for name in ("report.json", "flights.json")):
        record = Record.read(path)
        marked = {}
        for name, stamp in record.files.items():
            page = folder / name
            if page.suffix != ".html" or stamp.now(page) is None or OLDER in (text := page.read_text(encoding="utf-8")):
                continue
            with owning({page}):
                write_text(page, text.replace("<body>", f"<body>\n{OLDER}", 1))
            marked[name] = Stamp.of(page)
        if marked:
            Record("", {**record.files, **marked}).write(path)


@contextmanager
def suite_folder(folder: Path, suite: Suite, shard: Shard | None = None, kind: str = RESULTS) -> Iterator[Path]:
    """The folder, created or reopened; UserError when it holds something other than this kind or is in use.

    Different shards of a suite may use one folder at the same time; other processes may not. Incomplete files of killed
    processes are removed before and after. An interrupt notes that what is done is kept.
    """
    refuse_foreign_folder(folder, kind)
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            locks = [stack.enter_context(_opened(folder / ".lock"))]
            if shard is not None:
                locks.append(stack.enter_context(_opened(folder / f".lock_{shard.number}_of_{shard.count}")))
        except OSError as error:
            why = f"{folder}: cannot be written: {error.strerror}; name another folder"
            raise DiskError.of(error, why) from None
        try:
            for lock, how in zip(locks, (fcntl.LOCK_SH if shard else fcntl.LOCK_EX, fcntl.LOCK_EX), strict=False):
                fcntl.flock(lock, how | fcntl.LOCK_NB)
        except OSError:
            raise UserError(
                f"{folder}: another uavbench process uses it; wait for its end or name another folder"
            ) from None
        refuse_foreign_folder(folder, kind)
        clean_leftovers(folder, alone=shard is None)
        try:
            _describe(folder, suite, kind)
            yield folder
        except KeyboardInterrupt as error:
            error.add_note("the same command goes on from here")
            raise
        finally:
            clean_leftovers(folder, alone=shard is None)
            mark_older_pages(folder)


def clean_leftovers(folder: Path, *, alone: bool) -> None:
    """Remove incomplete files of killed processes from a suite's folder; alone: no other process uses it."""
    remove_leftovers(folder, alone=alone)
    for name, depth in DEPTHS.items():
        _clean(folder / name, depth, alone)


def _clean(folder: Path, depth: int, alone: bool) -> None:
    remove_leftovers(folder, alone=alone)
    if not depth:
        return
    try:
        with os.scandir(folder) as entries:
            below = [Path(entry.path) for entry in entries if entry.is_dir() and not is_temporary(entry.name)]
    except (FileNotFoundError, NotADirectoryError):
        return
    for path in below:
        _clean(path, depth - 1, alone)


def _describe(folder: Path, suite: Suite, kind: str) -> None:
    """Write `suite.json` unless it is up to date, so that concurrent shards do not write it.

    A third-party tracker that is absent is not in it: it counts nowhere, nor does what it scored when it was there.
    """
    away = absent(suite.trackers)
    about = {
        "suite": suite.name,
        "title": suite.title,
        "sequences": [spec.name for spec in suite.sequences],
        "trackers": [label for label in suite.trackers if label not in away],
        "rates_hz": list(suite.rates_hz),
        "flights": suite.flights,
        **({"loops": list(suite.loops)} if suite.loops else {}),
    }
    text = json.dumps(about, indent=1) + "\n"
    path = folder / SUITE
    refuse_foreign_file(path, kind)
    if not (path.exists() and path.read_text(encoding="utf-8").startswith(text.removesuffix("\n}\n"))):
        if path.exists():  # of other trackers or sequences
            remove_verdicts(folder)
        write_text(path, text, kind=kind)


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    """Open a lock file, created if missing and never written to; OSError for a link, UserError for a device."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise UserError(f"{path}: is not a regular file; move it away or name another folder")
        yield handle
    finally:
        os.close(handle)
