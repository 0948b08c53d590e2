"""The order of the tests, a core for each of the processes that run them, and Hypothesis without wall-clock limits."""

import os

import pytest
from hypothesis import settings

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_configure(config):
    """Have `--dist loadfile` keep the order below: its own, by how many tests a file has, puts the longest last."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Files with slow tests come first, of them those of minutes, so that no worker begins a long one when the others
    are nearly done.
    """
    seconds = {}
    for item in items:
        for mark in item.iter_markers("slow"):
            seconds[item.path] = max(seconds.get(item.path, 0), mark.kwargs.get("seconds", 10))
    items.sort(key=lambda item: -seconds.get(item.path, 0))


@pytest.fixture(scope="module")
def one_core():
    """This process and the commands that it starts use one core, so that each command starts one worker.

    A worker takes seconds to start. Where another process runs tests beside this one, each has a core of its own.
    """
    cores = sorted(os.sched_getaffinity(0))
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    os.sched_setaffinity(0, {cores[worker % len(cores)]})
    yield
    os.sched_setaffinity(0, cores)
