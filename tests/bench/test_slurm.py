"""Slurm without Slurm: what its queue refuses, and why shards failed, as submitit tells it."""

import sys
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from tests.bench.small_suites import small_suite
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to
from uavbench.bench.runner.slurm import run_shards
from uavbench.trajectories.errors import UserError

LINE = "-" * 22
TRACE = f"""Job (task=0) failed during processing with trace:
{LINE}
Traceback (most recent call last):
  File "task.py", line 1, in run
UserError: results/a: does not fit the disk; make room

{LINE}
You can check full logs with 'job.stderr(0)' and 'job.stdout(0)'or at paths:
  - err"""
KILLED = f"""Job 7 (task: 0) with path 7_0_result.pkl
has not produced any output (state: OUT_OF_MEMORY)
Error stream produced:
{LINE}
slurmstepd: error: Detected 1 oom_kill event"""
SBATCH = "sbatch: error: invalid partition specified: shrot\nsbatch: error: Batch job submission failed"


class FailedJobError(RuntimeError):
    """As that of submitit."""


class Queue:
    """A cluster whose jobs fail as `told`, and which refuses all of them when that is empty."""

    cluster = "slurm"

    def __init__(self, told):
        self.told = told

    def update_parameters(self, **parameters):
        assert parameters

    @contextmanager
    def batch(self):
        yield
        if not self.told:
            raise FailedJobError(SBATCH)

    def submit(self, call, shard):
        told = self.told[int(shard[0]) - 1] if self.told else ""
        return SimpleNamespace(
            job_id=shard[0],
            paths=SimpleNamespace(stderr=f"logs/{shard[0]}.err"),
            done=lambda: True,
            exception=lambda: FailedJobError(told) if told else None,
            result=lambda: 0,
        )


@pytest.fixture
def queue(monkeypatch):
    """Function that puts a cluster in the place of submitit's, whose jobs fail as told."""

    def put(*told):
        module = SimpleNamespace(AutoExecutor=lambda folder, cluster: Queue(told))
        monkeypatch.setitem(sys.modules, "submitit", module)

    return put


def test_what_the_queue_refuses_is_told_without_a_traceback(queue, tmp_path):
    queue()
    with pytest.raises(UserError, match=r"--slurm: sbatch: error: invalid partition specified: shrot; sbatch"):
        run_shards(str, tmp_path, 2, ())


def test_why_a_shard_failed_is_told_with_its_log(queue, tmp_path, capsys):
    queue(TRACE, KILLED, "")
    assert run_shards(str, tmp_path, 3, ()) == 2
    told = capsys.readouterr().err
    assert "FAILED shard 1/3, job 1: UserError: results/a: does not fit the disk; make room (log: logs/1.err)" in told
    assert "FAILED shard 2/3, job 2: has not produced any output (state: OUT_OF_MEMORY) (log: logs/2.err)" in told


def test_nothing_is_put_into_a_folder_of_others_nor_into_the_queue(queue, tmp_path):
    queue()
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter.tex").write_text("mine")
    with pytest.raises(UserError, match=r"thesis: holds something other than uavbench's output: chapter\.tex"):
        bring_up_to("score", str(small_suite(tmp_path)), out, ExecutionOptions(slurm=2))
    assert [path.name for path in out.iterdir()] == ["chapter.tex"]


def test_an_option_of_slurm_without_slurm_runs_nothing_here(tmp_path):
    out, options = tmp_path / "out", ExecutionOptions(slurm_options=("slurm_partition=short",))
    with pytest.raises(UserError, match=r"--slurm-option slurm_partition=short: add --slurm N"):
        bring_up_to("score", str(small_suite(tmp_path)), out, options)
    assert not out.exists()
