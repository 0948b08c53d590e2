"""The pool of spawned workers: a worker that dies costs the job that killed it, and no other."""

import gc
import json
import os
import signal
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from tests.bench.process_trees import wait_until
from uavbench.bench.inputs import plugin_files
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.executors import local_pool
from uavbench.bench.runner.graph import Job, run_graph, run_job
from uavbench.trajectories.files.writing import write_text


@dataclass(frozen=True)
class Write:
    """Writes its marker, and a line per attempt; kills its worker first as often as told."""

    marker: Path
    deaths: int = 0

    def __call__(self, content_hash, on_step):
        log = self.marker.with_suffix(".log")
        with log.open("a") as handle:
            handle.write("attempt\n")
        if len(log.read_text().splitlines()) <= self.deaths:
            os.kill(os.getpid(), signal.SIGKILL)
        on_step(1, 1)
        write_text(self.marker, json.dumps({"content_hash": content_hash}, indent=1) + "\n", kind="output")


def imported():
    return set(sys.modules)


def job(folder, name, deaths=0, needs=()):
    marker = folder / f"{name}.json"
    work = Write(marker, deaths)
    return Job(verb="track", name=name, work=work, marker=marker, content_hash=content_hash(name), needs=needs)


def test_a_worker_collects_garbage_but_not_what_it_imported():
    with local_pool(1) as (pool, _):
        assert pool.submit(gc.isenabled).result()
        assert pool.submit(gc.get_freeze_count).result() > 100_000
        assert "uavbench.bench.runner.tasks" in pool.submit(imported).result()


def test_a_worker_that_dies_once_costs_nothing_and_one_that_always_dies_its_own_job_only(tmp_path):
    jobs = [job(tmp_path, f"good-{i}") for i in range(8)]
    jobs.insert(3, job(tmp_path, "once", deaths=1))
    jobs.insert(5, job(tmp_path, "always", deaths=99))
    jobs.append(job(tmp_path, "after", needs=(jobs[5],)))
    with local_pool(2) as (pool, progress):
        outcome = run_graph(jobs, pool, progress)
    assert {j.name for j in outcome.done} == {"once", *(f"good-{i}" for i in range(8))}
    assert set(outcome.failed) == {"always", "after"}
    assert "worker process died" in outcome.failed["always"]
    assert len((tmp_path / "always.log").read_text().splitlines()) in (1, 2, 3), "it may come to a dead worker"


def second_worker(first):
    """Its process; the first one that is called waits."""
    if first.exists():
        return os.getpid()
    try:
        first.write_text(str(os.getpid()))
        time.sleep(600)
    finally:
        first.with_suffix(".cleaned").touch()


def stubborn_worker(first):
    """The same, by code that catches everything."""
    if first.exists():
        return os.getpid()
    try:
        first.write_text(str(os.getpid()))
        time.sleep(600)
    except BaseException:
        first.with_suffix(".cleaned").touch()
    return 0


@pytest.mark.parametrize("call", [second_worker, stubborn_worker])
def test_a_worker_that_is_terminated_cleans_up_and_ends_and_its_call_is_made_again(tmp_path, call):
    """Of a pool that is broken every other worker is terminated, in mid-call: one that went on would be awaited."""
    first = tmp_path / "pid"
    with local_pool(1) as (pool, _):
        result = pool.submit(call, first)
        assert wait_until(lambda: first.exists() and first.read_text())
        os.kill(int(first.read_text()), signal.SIGTERM)
        assert result.result(timeout=60) not in (0, int(first.read_text()))
    assert first.with_suffix(".cleaned").exists()


def test_a_worker_that_dies_ends_the_others_in_mid_call(tmp_path):
    first = tmp_path / "pid"
    with local_pool(2) as (pool, _):
        results = [pool.submit(second_worker, first)]
        assert wait_until(lambda: first.exists() and first.read_text())
        results.append(pool.submit(os._exit, 3))
        assert results[0].result(timeout=60) != int(first.read_text())
        with pytest.raises(BrokenProcessPool):
            results[1].result(timeout=60)


def test_a_pool_that_ends_while_it_is_replaced_closes_each_of_its_pipes_once(monkeypatch):
    """Closed twice, the number would be that of another file of this process by the second time."""
    closed = []

    def slowly(connection):
        closed.append(connection)
        os.close(connection.fileno())
        time.sleep(0.1)

    with local_pool(1) as (pool, _):
        with pytest.raises(BrokenProcessPool):
            pool.submit(os._exit, 3).result(timeout=60)
        monkeypatch.setattr(Connection, "_close", slowly)
    monkeypatch.undo()
    assert closed and len(closed) == len({id(connection) for connection in closed})


def test_the_module_that_a_suite_names_is_imported_in_workers_too(tmp_path, monkeypatch):
    """It may change what it takes from another one, whose class alone would be found again by pickle."""
    (tmp_path / "as_it_was.py").write_text(
        "from dataclasses import dataclass\n"
        "@dataclass(frozen=True)\n"
        "class Work:\n"
        "    marker: object\n"
        "    told = 'as it was'\n"
        "    def __call__(self, content_hash, on_step):\n"
        "        self.marker.write_text(self.told)\n"
    )
    (tmp_path / "tuned.py").write_text("from as_it_was import Work\nWork.told = 'tuned'\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(plugin_files, "loaded", {})
    work = import_module("tuned").Work
    plugin_files.loaded |= {"tuned": frozenset(), "of_another_suite": frozenset()}
    marker = tmp_path / "out" / "marker.txt"
    marker.parent.mkdir()
    one = Job(verb="track", name="one", work=work(marker), marker=marker, content_hash="abc")
    with local_pool(1) as (pool, progress):
        assert run_graph([one], pool, progress).done == [one]
    assert marker.read_text() == "tuned"
    for name in ("tuned", "as_it_was"):
        monkeypatch.delitem(sys.modules, name)


def test_an_error_comes_back_as_it_was_raised():
    with local_pool(1) as (pool, _):
        assert isinstance(pool.submit(int, "x").exception(timeout=60), ValueError)
        assert pool.submit(int, "7").result(timeout=60) == 7
        with pytest.raises(BrokenProcessPool):
            pool.submit(os._exit, 3).result(timeout=60)
        assert pool.submit(int, "8").result(timeout=60) == 8


def test_a_job_done_by_a_lost_worker_is_not_done_twice(tmp_path):
    one = job(tmp_path, "one")
    for _ in range(2):
        run_job(Plugins(), one.name, one.work, one.made)
    assert len((tmp_path / "one.log").read_text().splitlines()) == 1
