"""Failures on the page: the failed runs by tracker, the baselines last."""

from collections.abc import Iterable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass

from uavbench.reports.scoring.coverage import failures
from uavbench.reports.scoring.runs import ScoredRun

BASELINES = ("hold",)
"""Kinds of tracker that are baselines: they fail by design."""


@dataclass(frozen=True)
class Failure:
    """One failed run: sequence, status, description, link to its first failed frame ("" for none), errors, doubts."""

    sequence: str
    status: str
    text: str
    link: str
    errors: tuple[str, ...]


@dataclass(frozen=True)
class FailedTracker:
    """Failures of one tracker at one rate, or of all baselines; status: the worst; shown: unfolded by default."""

    title: str
    status: str
    text: str
    runs: tuple[Failure, ...]
    shown: bool


UNFOLDED = 3
"""Most failures of a tracker that are shown unfolded."""


def failed_trackers(runs: ListOf[ScoredRun], pages: Mapping[str, str]) -> list[FailedTracker]:
    """All trackers with failed runs, worst first, then the baselines together; pages: by name of the sequence."""
    failed = [(run, failure) for run in worst_first(runs) if (failure := failure_of(run, runs, pages)) is not None]
    found = []
    for name in dict.fromkeys(run.name for run, _ in failed if not is_baseline(run)):
        few = [(run, failure) for run, failure in failed if run.name == name]
        of_tracker = [run for run in runs if run.name == name]
        found.append(_tracker(few[0][0].title, [failure for _, failure in few], of_tracker, unfolded=UNFOLDED))
    baseline = [(run, failure) for run, failure in failed if is_baseline(run)]
    if baseline:
        labels = ", ".join(dict.fromkeys(run.title for run, _ in baseline))
        every = [run for run in runs if is_baseline(run)]
        found.append(_tracker(f"Baseline: {labels}", [failure for _, failure in baseline], every, unfolded=0))
    return found


def _tracker(title: str, failed: list[Failure], runs: ListOf[ScoredRun], unfolded: int) -> FailedTracker:
    success = sum(run.score.tracking.success for run in runs) / len(runs)
    text = (
        f"{len(failed)} of {len(runs)} run{'s' if len(runs) > 1 else ''}; {100 * success:.1f} % of frames within 5 cm "
        "and 5\N{DEGREE SIGN}."
    )
    return FailedTracker(title, failed[0].status, text, tuple(failed), len(failed) <= unfolded)


def failure_of(run: ScoredRun, runs: ListOf[ScoredRun], pages: Mapping[str, str]) -> Failure | None:
    """Failure of a run; None for a run without one. runs: of the report, to link the run on its sequence's page."""
    begins, _ = failures(run.errors.success)
    if not len(begins) and run.score.status == "complete":
        return None
    tracking = run.score.tracking
    text = f"{100 * tracking.success:.1f} % of {tracking.frames} frames within 5 cm and 5\N{DEGREE SIGN}, "
    text += f"{100 * tracking.coverage:.1f} % with a pose. "
    link = ""
    if len(begins):
        times = f"{tracking.failures} time{'s' if tracking.failures != 1 else ''}"
        first, longest = tracking.time_to_first_loss_s, tracking.longest_failure_s
        text += f"Off target {times}, first at {first:.2f} s, longest for {longest:.2f} s."
        page = pages.get(run.sequence.name)
        frame = int(run.errors.frames[begins[0]])
        place = [other for other in runs if other.sequence is run.sequence].index(run)
        link = f"{page}#run={place}&frame={frame}" if page else ""
    told = (*run.score.errors[:3], *(f"doubt: {doubt}" for doubt in run.score.doubts))
    return Failure(run.sequence.name, status(run), text, link, told)


def status(run: ScoredRun) -> str:
    """Status of a run as shown: `off target` when every frame has a pose and some exceed 5 cm or 5 deg."""
    if run.score.status == "complete" and run.score.tracking.success < 1:
        return "off target"
    return run.score.status


def worst_first(runs: Iterable[ScoredRun]) -> list[ScoredRun]:
    """Runs, worst first: missing, crashed, then by increasing success."""
    first = {"missing": 0, "crashed": 1}
    return sorted(runs, key=lambda run: (first.get(run.score.status, 2), run.score.tracking.success))


def is_baseline(run: ScoredRun) -> bool:
    """Whether a run is of a baseline."""
    return run.results.record.get("tracker", {}).get("kind") in BASELINES


def own_runs(runs: ListOf[ScoredRun]) -> list[ScoredRun]:
    """The runs that are not of a baseline; all of them when there are no others."""
    return [run for run in runs if not is_baseline(run)] or list(runs)
