"""Whether two files of uavbench are of one sequence and of one clock, by the records beside them.

The stamps of all sequences begin at 0, so that the poses of one pair with the ground truth of any other.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from uavbench.reports.evaluation.find_trajectory import Clock
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.intact import refuse_damaged

OURS = re.compile(r"(groundtruth|flight|frames)\.csv|(estimate|groundtruth)_world_from_(body|cam)\.tum")
"""Names of the files with poses in the folder of a sequence or of results."""
SAME_TIME_S = 1e-6
"""Difference of offsets that is none."""


def doubts_of_clocks(reference: Clock | None, estimate: Clock | None, offset_s: float) -> Iterator[str]:
    """A sentence where one file has the cameras' stamps, the other the body's, and offset_s is not what lies between.

    offset_s: added to the stamps of the estimate.
    """
    if reference is None or estimate is None or reference.of_body == estimate.of_body:
        return
    shift_s = (reference.shift_ns or estimate.shift_ns) / 1e9 * (1 if reference.of_body else -1)
    if abs(shift_s - offset_s) > SAME_TIME_S:
        body, cameras = ("reference", "estimate") if reference.of_body else ("estimate", "reference")
        yield (
            f"the stamps of the {body} are those of the body's clock, as of its IMU, those of the {cameras} of the "
            f"cameras': give --t-offset {shift_s:g}, which is added to those of the estimate"
        )


class OfSequence(NamedTuple):
    """Name of the sequence that a file is of, the hash of its content, and the record that says so."""

    name: str
    content_hash: str
    record: Path


def doubts_of_sequence(reference: Path, estimate: Path) -> Iterator[str]:
    """A sentence where the records beside two files name different sequences, or different versions of one."""
    true, given = sequence_of(reference), sequence_of(estimate)
    if true is None or given is None or true.content_hash == given.content_hash:
        return
    if true.name != given.name:
        yield (
            f"the estimate is of the sequence {given.name} ({given.record}), the reference of {true.name} "
            f"({true.record}): are these the files to be compared?"
        )
    else:
        yield (
            f"the estimate is of another version of the sequence {given.name} than the reference ({given.record}, "
            f"{true.record}): was it rendered again since? Track it again"
        )


def sequence_of(file: Path) -> OfSequence | None:
    """The sequence that a file of uavbench is of; None for other files, and where no record names it.

    UserError for a record of ours that was changed since; files of others beside it tell nothing.
    """
    if not OURS.fullmatch(file.name):
        return None
    for record in (file.with_name("sequence.json"), file.with_name("record.json")):
        try:
            about = read_json(record)
        except UserError:
            refuse_damaged(record)
            continue
        of = about.get("sequence") if record.name == "record.json" else about
        if isinstance(of, dict) and of.get("name") and of.get("content_hash"):
            return OfSequence(str(of["name"]), str(of["content_hash"]), record)
    return None
