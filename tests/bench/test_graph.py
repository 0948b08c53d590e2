"""The job graph: fresh jobs stay, failures stay local, what needs a failed job is not done."""

import json
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path

import pytest

from uavbench.bench.inputs.content_hash import carried_hash, content_hash
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.graph import Job, run_graph, run_job
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder, write_text

LIST = Marker("list.json", "list")


@dataclass
class Note:
    marker: Path
    order: list[str] = field(default_factory=list)
    error: Exception | None = None

    def __call__(self, content_hash, on_step):
        if self.error:
            raise self.error
        self.order.append(self.marker.stem)
        write_text(self.marker, json.dumps({"content_hash": content_hash}))


def job(folder, name, needs=(), order=None, error=None, enters=0):
    marker = folder / f"{name}.json"
    work = Note(marker, order if order is not None else [], error)
    return Job(verb="track", name=name, work=work, marker=marker, content_hash=content_hash(name, enters), needs=needs)


@pytest.fixture
def pool():
    with ThreadPoolExecutor(2) as executor:
        yield executor


def test_jobs_run_after_what_they_need_and_a_second_run_does_nothing(tmp_path, pool):
    order = []
    a = job(tmp_path, "a", order=order)
    b = job(tmp_path, "b", needs=(a,), order=order)
    c = job(tmp_path, "c", needs=(b,), order=order)
    assert [j.name for j in run_graph([a, b, c], pool).done] == ["a", "b", "c"]
    assert order == ["a", "b", "c"]
    again = run_graph([a, b, c], pool)
    assert again.done == []
    assert len(again.fresh) == 3


def test_a_failure_leaves_independent_jobs_alone(tmp_path, pool):
    bad = job(tmp_path, "bad", error=UserError("frame 3: truncated"))
    after = job(tmp_path, "after", needs=(bad,))
    last = job(tmp_path, "last", needs=(after,))
    other = job(tmp_path, "other")
    outcome = run_graph([bad, after, last, other], pool)
    assert [j.name for j in outcome.done] == ["other"]
    assert outcome.failed["bad"] == "frame 3: truncated"
    assert "bad" in outcome.failed["after"]
    assert "after" in outcome.failed["last"]
    assert outcome.tracebacks == {}


def test_a_fault_that_is_no_users_mistake_keeps_its_traceback(tmp_path, pool):
    outcome = run_graph([job(tmp_path, "bad", error=ZeroDivisionError("oops"))], pool)
    assert "ZeroDivisionError: oops" in outcome.failed["bad"]
    assert "Traceback" in outcome.tracebacks["bad"]


class TwoPartError(Exception):
    """One that pickles, and cannot be made again from what was pickled."""

    def __init__(self, what, where):
        super().__init__(f"{what} at {where}")


class Leak:
    """Work that raises it."""

    def __call__(self, content_hash, on_step):
        raise TwoPartError("a leak", "the roof")


def test_an_exception_that_cannot_cross_processes_fails_its_job_alone(tmp_path):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        bad, good = replace(job(tmp_path, "bad"), work=Leak()), job(tmp_path, "good")
        outcome = run_graph([bad, good], pool)
    assert outcome.failed.keys() == {"bad"}
    assert re.fullmatch(r"TwoPartError: a leak at the roof \(.*test_graph\.py:\d+ in __call__\)", outcome.failed["bad"])
    assert [j.name for j in outcome.done] == ["good"]


def test_a_stale_result_is_made_again(tmp_path, pool):
    run_graph([job(tmp_path, "a", enters=1)], pool)
    newer = job(tmp_path, "a", enters=2)
    assert not newer.fresh
    assert [j.name for j in run_graph([newer], pool).done] == ["a"]
    assert carried_hash(tmp_path / "a.json") == newer.content_hash


@dataclass
class Meanwhile:
    """Reads what it needs while another version of it is written by somebody else."""

    marker: Path
    other: Job
    when: str

    def __call__(self, content_hash, on_step):
        text = self.other.marker.read_text() if self.when == "after" else ""
        run_job(Plugins(), self.other.name, self.other.work, self.other.made)
        about = {"content_hash": content_hash, "read": text or self.other.marker.read_text()}
        write_text(self.marker, json.dumps(about))


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_job_whose_need_another_process_replaces_is_never_fresh(tmp_path, pool, when):
    need, other = job(tmp_path, "need"), job(tmp_path, "need", enters=1)
    reader = job(tmp_path, "reader", needs=(need,))
    disturbed = replace(reader, work=Meanwhile(reader.marker, other, when))
    outcome = run_graph([need, disturbed], pool)
    assert "another process replaces" in outcome.failed["reader"]
    assert not reader.fresh
    assert [each.name for each in run_graph([need, reader], pool).done] == ["need", "reader"]
    assert reader.fresh


def test_a_job_does_not_start_on_the_output_of_another_version(tmp_path, pool):
    need, order = job(tmp_path, "need"), []
    run_graph([job(tmp_path, "need", enters=1)], pool)
    reader = job(tmp_path, "reader", order=order)
    with pytest.raises(UserError, match="another process replaces"):
        run_job(Plugins(), reader.name, reader.work, reader.made, (need.made,))
    assert order == [] and not reader.fresh


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"content_hash"', '{"other": 1}'])
def test_a_damaged_marker_is_not_fresh(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    assert not job(tmp_path, "a").fresh


def test_an_error_leaves_the_old_folder_whole_and_nothing_beside_it(tmp_path):
    target = tmp_path / "sequence"
    with new_folder(target, LIST) as folder:
        (folder / "old").touch()
    with pytest.raises(ZeroDivisionError), new_folder(target, LIST) as folder:
        (folder / "half").touch()
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.iterdir()] == ["sequence"]
    assert {p.name for p in target.iterdir()} == {"old", "list.json"}


def test_a_folder_takes_its_place_in_one_step(tmp_path):
    """It is renamed, not copied: who looks meanwhile never sees half of it."""
    for _ in range(2):  # where there is none, and where there is one
        with new_folder(tmp_path / "sequence", LIST) as folder:
            (folder / "file").touch()
            made = [folder.stat().st_ino, (folder / "file").stat().st_ino]
        found = [(tmp_path / name).stat().st_ino for name in ("sequence", "sequence/file")]
        assert found == made


def test_a_job_that_can_do_without_runs_last_and_is_made_again_when_all_is_there(tmp_path, pool):
    order = []
    bad = job(tmp_path, "bad", error=UserError("frame 3: truncated"))
    after = job(tmp_path, "after", needs=(bad,))
    good = job(tmp_path, "good", order=order)
    seen = []

    def without(failed):
        seen.append(dict(failed))
        return Note(tmp_path / "end.json", order)

    end = replace(job(tmp_path, "end", needs=(after, good), order=order), without=without)
    first = run_graph([bad, after, good, end], pool)
    assert order == ["good", "end"]
    assert set(first.failed) == set(seen[0]) == {"bad", "after"}
    assert not end.fresh
    again = run_graph([bad, after, good, end], pool)
    assert order == ["good", "end"], "the same failures give the same output, so it is left alone"
    assert set(again.failed) == {"bad", "after"}
    mended = job(tmp_path, "bad", order=order)
    after = job(tmp_path, "after", needs=(mended,), order=order)
    end = replace(end, needs=(after, good))
    assert not run_graph([mended, after, good, end], pool).failed
    assert order[2:] == ["bad", "after", "end"]
    assert end.fresh


def test_a_job_that_cannot_do_without_what_failed_fails(tmp_path, pool):
    bad = job(tmp_path, "bad", error=UserError("frame 3: truncated"))
    end = replace(job(tmp_path, "end", needs=(bad,)), without=lambda failed: None)
    assert set(run_graph([bad, end], pool).failed) == {"bad", "end"}
