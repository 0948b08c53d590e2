"""`uavbench check` of a tracker in Python, in a process of its own, which the tracker's code may end or crash."""

from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from uavbench.bench.external.program import External
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.executors import local_pool
from uavbench.bench.third_party.tracker import ThirdPartyTracker
from uavbench.bench.trial.check import check
from uavbench.tracker.protocol import Tracker


def check_apart(tracker: Tracker, kept_folder: Path) -> Iterator[str]:
    """The findings of `check`, and `faulty` where the tracker ends its process; programs have one of their own."""
    if isinstance(tracker, External | ThirdPartyTracker):
        yield from check(tracker, kept_folder)
        return
    with local_pool(1) as pool:
        try:
            yield from pool.executor.submit(_findings, Plugins.here(), tracker, kept_folder).result()
        except BrokenProcessPool:
            yield (
                "faulty: the process that ran the tracker died: it was ended by code that the tracker calls (os._exit, "
                "a crash of a library), or ran out of memory"
            )


def _findings(plugins: Plugins, tracker: Tracker, kept_folder: Path) -> list[str]:
    plugins.enter()
    return list(check(tracker, kept_folder))
