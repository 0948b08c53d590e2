"""`uavbench.render`: renders the sequences of a suite and opens them."""

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, nullcontext
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

from uavbench.bench.config.suite import Suite, load_suite, plugins_named, suite_of
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.runner.commands import disown_stale_scores, disowned_if_ended, refuse_touched
from uavbench.bench.runner.executors import local_pool
from uavbench.bench.runner.graph import run_graph
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.output_folder import resolved, suite_folder
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import given_path
from uavbench.trajectories.processes.standard_streams import open_closed_streams

NOT_RENDERED: dict[str, Any] = {"title": "Sequences of a script", "trackers": {"hold": {"kind": "hold"}}}
"""Required keys of a suite besides its sequences, for suites of which only these are rendered."""
DICT = Path("suite")
"""Name of a suite given as a dict."""


def render(suite: str | Path | Mapping[str, Any], out: str | Path | None = None, *, workers: int = 1) -> list[Sequence]:
    """Render the sequences of a suite that are not there yet, and open them all.

    suite: a name that `uavbench list` shows, a TOML file, or a dict of such a file's content, of which `sequences` is
    sufficient; relative paths in a dict are resolved against the current folder. out: the suite's folder, by default
    `out/NAME`, `out/suite` for a dict. workers: 1 renders in this process; more need `if __name__ == "__main__":` in a
    script. Returns an iterable of `Sequence`, each an iterable of its frames: see `open_sequence`. UserError listing
    all errors of the suite, the reasons why sequences could not be rendered, or the files written while they were.

    >>> import uavbench as ub
    >>> box = {"structure": {"kind": "box"}, "environment": {"kind": "studio"}, "rate_hz": 10.0}
    >>> box["flight"] = {"path": {"kind": "hover", "duration_s": 0.2}}
    >>> box["camera"] = {"width": 64, "height": 48, "horizontal_fov_deg": 65.0}
    >>> for sequence in ub.render({"sequences": {"box": box}}, out=folder / "rendered"):
    ...     [frame.image.shape for frame in sequence][:2]
    [(48, 64, 3), (48, 64, 3)]
    """
    open_closed_streams()  # a script may run without standard error
    checked = _suite(suite)
    folder = resolved(given_path("out", out) if out is not None else Path("out") / checked.name)
    planned = partial(plan, checked, folder, last="render")
    jobs = planned()
    pool: AbstractContextManager[Any] = local_pool(workers) if workers > 1 else nullcontext((InProcess(), None))
    with suite_folder(folder, checked), disowned_if_ended(jobs, planned), pool as (executor, progress):
        disown_stale_scores(checked, folder, checked)
        outcome = run_graph(jobs, executor, progress)
        refuse_touched(jobs, planned, outcome.done)
    if outcome.failed:
        raise UserError("\n".join(f"{name}: {why}" for name, why in outcome.failed.items()))
    return [Sequence.load(job.marker.parent) for job in jobs]


class InProcess(Executor):
    """Executor that runs each call in this process, so that a script needs no `if __name__ == "__main__":`."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Future of a finished call."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def _suite(given: str | Path | Mapping[str, Any]) -> Suite:
    if not isinstance(given, Mapping):
        return load_suite(suite_file(str(given_path("suite", given))))
    usual_hz = {"sequences": SequenceSpec.rate_hz, "recordings": RecordingSpec.rate_hz}
    rates = [
        table.get("rate_hz", usual_hz[kind])
        for kind in usual_hz
        for table in _tables(given.get(kind))
        if isinstance(table, Mapping)
    ]
    data = {**NOT_RENDERED, "rates_hz": [_common_rate(rates)], **given}
    return suite_of(data, plugins_named(data, DICT), DICT)


def _tables(given: Any) -> list[Any]:
    """Tables of `sequences` or `recordings`; what is none is left to the suite's validation."""
    return list(given.values()) if isinstance(given, Mapping) else []


def _common_rate(rates_hz: list[Any]) -> float:
    """Highest rate that a stride of every sequence has; what is no rate is left to the suite's validation."""
    known = [Fraction(str(rate)) for rate in rates_hz if isinstance(rate, int | float) and 0 < rate < math.inf]
    denominator = math.lcm(*(rate.denominator for rate in known))
    return math.gcd(*(int(rate * denominator) for rate in known)) / denominator or SequenceSpec.rate_hz
