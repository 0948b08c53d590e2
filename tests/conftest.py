"""The order of the tests, a core for each of the processes that run them, and Hypothesis without wall-clock limits."""

import ctypes
import gc
import os

import pytest
from hypothesis import settings

KEPT_BYTES = {"MALLOC_MMAP_THRESHOLD_": (-3, 1 << 25), "MALLOC_TRIM_THRESHOLD_": (-1, 1 << 30)}
"""Sizes of glibc's mallopt(3), with their numbers there: arrays get memory that others gave back, of which the kernel
would clear each page anew, a tenth of the time of the tests. Of the first, 32 MB is the largest that glibc takes."""
for name, (number, size) in KEPT_BYTES.items():
    os.environ.setdefault(name, str(size))  # of the processes that the tests start
    if hasattr(C := ctypes.CDLL(None), "mallopt"):
        C.mallopt(number, size)

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")

# Each of several processes has a core of its own, and so have the commands that it starts: they start one worker, which
# takes seconds of processor time, unless a test asks for more. And NumPy, which counts the cores when it is imported
# (by a conftest.py further down), starts no threads that spin while they wait for a core that they do not have.
if worker := os.environ.get("PYTEST_XDIST_WORKER"):
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[int(worker.removeprefix("gw")) % len(cores)]})


def pytest_configure(config):
    """Have `--dist loadfile` keep the order below: its own, by how many tests a file has, puts the longest last."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


SHARED = ("tests/reports/", "tests/bench/test_challenge_")
"""Beginnings of the paths of files that share what takes long to make, such as a report with all its figures."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Have `--dist loadfile` give files that share something to one worker, which makes it once."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Families(LoadFileScheduling):
        def _split_scope(self, nodeid):
            return next((start for start in SHARED if nodeid.startswith(start)), super()._split_scope(nodeid))

    return Families(config, log)


def pytest_collection_modifyitems(items):
    """Files with slow tests come first, of them those of minutes, so that no worker begins a long one when the others
    are nearly done.
    """
    seconds = {}
    for item in items:
        for mark in item.iter_markers("slow"):
            seconds[item.path] = max(seconds.get(item.path, 0), mark.kwargs.get("seconds", 10))
    items.sort(key=lambda item: -seconds.get(item.path, 0))


def pytest_collection_finish():
    """Leave the thousands of tests and their modules out of each garbage collection from here on."""
    gc.collect()
    gc.freeze()
