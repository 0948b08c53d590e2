"""A real Dask scheduler with two workers on loopback, one of them killed; Slurm's shards as local jobs of submitit.

The extras `uavbench[dask]` and `uavbench[slurm]` are needed.
"""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

import dask
import pytest

from tests.bench.process_trees import wait_until
from tests.bench.small_suites import small_suite
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to, run_shard
from uavbench.bench.runner.executors import dask_pool
from uavbench.bench.runner.graph import Job, run_graph
from uavbench.bench.runner.slurm import run_shards
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text

pytestmark = [pytest.mark.ci, pytest.mark.slow]
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Slow:
    """Logs its beginning, sleeps, writes its marker, logs its end; one that `dies` kills its first worker instead."""

    marker: Path
    dies: bool = False

    def __call__(self, content_hash, on_step):
        with (self.marker.parent / "begun.log").open("a") as log:
            log.write(f"{self.marker.stem} {os.getpid()}\n")
        if self.dies and (self.marker.parent / "begun.log").read_text().count(f"{self.marker.stem} ") == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.1)
        write_text(self.marker, json.dumps({"content_hash": content_hash}))
        with (self.marker.parent / "ended.log").open("a") as log:
            log.write(f"{self.marker.stem}\n")


class Mistaken:
    """A job that a user's mistake ends."""

    def __call__(self, content_hash, on_step):
        raise UserError("the path leaves the room")


def jobs_in(folder, count):
    return [
        Job(verb="track", name=f"j{i}", work=Slow(folder / f"j{i}.json", dies=i == 8), marker=folder / f"j{i}.json",
            content_hash=content_hash(i))
        for i in range(count)
    ]  # fmt: skip


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler, and its two worker processes."""
    where = tmp_path / "scheduler.json"
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{Path(__file__).parent}"}
    started = [_dask(environment, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", where)]
    try:
        assert wait_until(lambda: where.exists() and where.read_text())
        address = json.loads(where.read_text())["address"]
        for _ in range(2):
            started.append(_dask(environment, "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"))
        from distributed import Client

        with Client(address) as client:
            client.wait_for_workers(2, timeout=120)
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def _dask(environment, *arguments):
    command = [sys.executable, "-m", "dask", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def test_a_killed_worker_loses_nothing_and_nothing_is_done_twice(cluster, tmp_path):
    address, workers = cluster
    (tmp_path / "suite.json").write_text("{}")
    jobs = jobs_in(tmp_path, 20)
    with dask_pool(address, 2, tmp_path) as (executor, progress):
        outcome = run_graph(jobs, executor, progress)
    assert wait_until(lambda: sorted(str(worker.poll()) for worker in workers) == ["-9", "None"])
    assert outcome.failed == {}
    assert {job.name for job in outcome.done} == {job.name for job in jobs}
    assert all(job.fresh for job in jobs)
    ended = (tmp_path / "ended.log").read_text().split()
    assert sorted(ended) == sorted(job.name for job in jobs), "each job ended once"
    begun = [line.split() for line in (tmp_path / "begun.log").read_text().splitlines()]
    assert len({pid for name, pid in begun if name == "j8"}) == 2, "another worker took its job over"


def test_a_users_mistake_on_a_local_dask_cluster_shows_no_traceback(tmp_path, capfd):
    (tmp_path / "suite.json").write_text("{}")
    job = Job(verb="track", name="j", work=Mistaken(), marker=tmp_path / "j.json", content_hash=content_hash(1))
    with dask_pool("local", 1, tmp_path) as (executor, progress):
        outcome = run_graph([job], executor, progress)
    assert outcome.failed == {"j": "the path leaves the room"}
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_worker_that_may_run_the_old_text_of_a_plugin_is_refused(cluster, tmp_path):
    address, _ = cluster
    (tmp_path / "suite.json").write_text("{}")
    module = tmp_path / "plugin_of_the_cluster_test.py"
    module.write_text("NUMBER = 1\n")
    with dask_pool(address, 2, tmp_path) as (executor, _):
        assert executor.submit(number_of, tmp_path).result(timeout=60) == 1
    module.write_text("NUMBER = 2\n")
    refused = pytest.raises(UserError, match=r"may run an older plugin_of_the_cluster_test\.py.*restart it")
    with refused, dask_pool(address, 2, tmp_path):
        pass


def number_of(folder):
    sys.path.insert(0, str(folder))
    return import_module("plugin_of_the_cluster_test").NUMBER


def test_a_suite_on_a_local_dask_cluster_is_the_suite_on_local_processes(tmp_path):
    suite = small_suite(tmp_path)
    assert bring_up_to("score", str(suite), tmp_path / "dask", ExecutionOptions(workers=2, dask="local")) == 0
    assert bring_up_to("score", str(suite), tmp_path / "here", ExecutionOptions(workers=1)) == 0
    for name in sorted((tmp_path / "here").glob("results/*/*/frames.csv")):
        there = tmp_path / "dask" / name.relative_to(tmp_path / "here")
        assert there.read_bytes() == name.read_bytes()


def test_no_scheduler_there_is_a_users_mistake(tmp_path):
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(UserError, match="dask scheduler"),
        dask_pool("tcp://127.0.0.1:9", 1, tmp_path),
    ):
        pass


def test_shards_as_jobs_of_a_queue_then_the_rest_here(tmp_path):
    suite = small_suite(tmp_path)
    out = tmp_path / "out"
    shard = partial(run_shard, "score", str(suite), out)
    assert run_shards(shard, out, 2, ("timeout_min=10",), cluster="local") == 0
    assert len(list(out.glob("results/*/*/score.json"))) == 2
    assert bring_up_to("score", str(suite), out, ExecutionOptions(workers=1)) == 0
    with pytest.raises(UserError, match="key=value"):
        run_shards(shard, out, 2, ("partition",), cluster="local")
