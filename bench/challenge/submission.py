"""An untrusted submission to a challenge: one file for each sequence, of one run or of up to five.

    submission.toml                     name = "..."; without it the folder's name
    sequence-01.csv | sequence-01.tum   of one run, or
    run-1/sequence-01.csv ...           of several

Also accepted are `sequence-01/estimates.csv`, as an external tracker writes it, and
`sequence-01/estimate_world_from_cam.tum`, as `uavbench track --out sequence-01` does. Errors in the content become
named faults, and the frames concerned count as failed.
"""

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.reading import read_toml

ABOUT = "submission.toml"
MOST_RUNS = 5
MOST_NAMED = 20
"""Most unexpected files of a run that are named in faults; the rest are counted."""
LONGEST_NAME = 80
FORMS = ("{}.csv", "{}.tum", "{}/estimates.csv", "{}/estimate_world_from_cam.tum")
"""Accepted names of the file of a sequence."""
RUN = re.compile(r"run-[1-9][0-9]{0,3}")
FAULTS = {
    "no-file": "a sequence without a file counts as failed; send one file for each sequence of the package",
    "two-files": "the first one is scored; send one file for each sequence",
    "foreign-file": "it is not read; send one file for each sequence, and submission.toml; runs are run-1 ... run-5",
    "unreadable": "the sequence counts as failed",
    "no-frame": "the sequence counts as failed; repeat the stamps of frames.csv",
    "bad-rows": "frames without a valid row count as failed; of several rows of a frame the first one is scored",
    "doubtful": "it is scored as it is; CSV: cam_from_model, m, qw first; TUM: the camera in the model, m, qw last",
}
"""Name of each fault of a submission -> its consequence and remedy."""


@dataclass(frozen=True)
class Fault:
    """One fault of a submission: its name in FAULTS, the file, and what is wrong."""

    name: str
    where: str
    what: str

    def __str__(self) -> str:
        return one_line(f"[{self.name}] {self.where}: {self.what}; {FAULTS[self.name]}")


@dataclass(frozen=True)
class Submission:
    """A submission: its name, the file of each sequence by run, and the faults of its folders."""

    name: str
    runs: Mapping[str, Mapping[str, Path]]
    faults: tuple[Fault, ...]


def find_submission(folder: Path, sequences: Collection[str]) -> Submission:
    """The files of a submission to a challenge of these sequences.

    UserError for a missing folder, no file of any sequence, more than MOST_RUNS runs, or single files beside runs.
    """
    if folder.is_symlink() or not folder.is_dir():
        raise UserError(f"{folder}: is not a folder; give the folder of a submission")
    name = _name(folder)
    here = set(_names(folder))
    runs = sorted((each for each in here if RUN.fullmatch(each)), key=lambda each: int(each[4:]))
    if len(runs) > MOST_RUNS:
        raise UserError(f"{folder}: has {len(runs)} runs; a submission has at most {MOST_RUNS}")
    faults: list[Fault] = []
    found = {run: _files(folder / run, f"{run}/", sequences, faults) for run in runs}
    single = _files(folder, "", sequences, faults, also={ABOUT, *runs})
    if runs and single:
        raise UserError(
            f"{folder}: has files next to its runs ({next(iter(single.values())).name}); put them into a run"
        )
    found = found or {"run-1": single}
    if not any(found.values()):
        expected = ", ".join(form.format(min(sequences)) for form in FORMS)
        raise UserError(f"{folder}: holds no file of any sequence ({expected}); is it a submission to this challenge?")
    return Submission(name, found, tuple(faults))


def _name(folder: Path) -> str:
    path = folder / ABOUT
    if not os.path.lexists(path):
        return one_line(folder.resolve().name)[:LONGEST_NAME]
    name = read_toml(path, inside=folder).get("name")
    if not (isinstance(name, str) and 0 < len(one_line(name)) <= LONGEST_NAME):
        raise UserError(f'{path}: expected name = "...", of 1 to {LONGEST_NAME} characters')
    return one_line(name)


def _files(
    folder: Path, where: str, sequences: Collection[str], faults: list[Fault], also: Collection[str] = ()
) -> dict[str, Path]:
    """File of each sequence in the folder of a run; missing and unexpected files become faults."""
    if folder.is_symlink() or not folder.is_dir():
        faults.append(Fault("unreadable", where, "is not a folder"))
        return {}
    found: dict[str, Path] = {}
    for name in sequences:
        paths = [folder / form.format(name) for form in FORMS if os.path.lexists(folder / form.format(name))]
        if paths:
            found[name] = paths[0]
        if len(paths) > 1:
            faults.append(Fault("two-files", where + name, " and ".join(str(p.relative_to(folder)) for p in paths)))
    known = {form.format(name).split("/")[0] for form in FORMS for name in sequences} | set(also)
    foreign = [name for name in _names(folder) if name not in known]
    faults += [Fault("foreign-file", where + name, "does not belong to a submission") for name in foreign[:MOST_NAMED]]
    if foreign[MOST_NAMED:]:
        faults.append(Fault("foreign-file", where, f"and {len(foreign[MOST_NAMED:]):,} more files"))
    return found


def _names(folder: Path) -> Iterator[str]:
    try:
        with os.scandir(folder) as entries:
            yield from sorted(entry.name for entry in entries)
    except OSError as error:
        raise UserError(f"{folder}: cannot be read: {error.strerror or error}") from None
