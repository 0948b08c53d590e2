"""Whether two files leave open in which order their quaternions are, which no comparison of the two can tell.

Eight columns whose first one counts nanoseconds are read as EuRoC's, w first. Programs that write nanoseconds before
the columns of TUM, w last, give the same angles between rotations where both files are read wrongly, so that the
rotations look right without an alignment; those after one, and all motions, are wrong.
"""

from collections.abc import Iterator

from uavbench.reports.evaluation.find_trajectory import Found
from uavbench.trajectories.trajectory_files.named_columns import names_all_columns
from uavbench.trajectories.trajectory_files.number_lines import comments


def doubts_of_order(reference: Found, estimate: Found, formats: tuple[str | None, str | None]) -> Iterator[str]:
    """A sentence where both files are read as EuRoC's for their stamps alone; formats: those that the user gave."""
    if all(_guessed(found, given) for found, given in zip((reference, estimate), formats, strict=True)):
        yield (
            "both files have stamps in nanoseconds and no line that names their columns, so that their quaternions are "
            "read w first, as EuRoC's. If they are w last, as TUM's, rotations and RPE are wrong: write the stamps in "
            "seconds. If they are w first, say so by --reference-format euroc or a first line #timestamp x y z qw qx "
            "qy qz"
        )


def _guessed(found: Found, given: str | None) -> bool:
    """Whether the order of a file's quaternions is told by its stamps alone."""
    return found.format == "euroc" and given is None and not names_all_columns(comments(found.file))
