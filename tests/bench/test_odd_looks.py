"""Odd names, links and moments neither make a job fail nor make it stale while nothing changed."""

import os
import subprocess
import sys

import pytest

from tests.bench.test_seen_inputs import apart, done, far, job_of  # noqa: F401, fixtures
from uavbench.bench.inputs.observed import seen_inputs

ODD = {
    "a text for a name": "def read():\n    try: open('{' + 'x' * 5000)\n    except OSError: pass",
    "a null character": "def read():\n    try: open('a\\0b/c')\n    except ValueError: pass",
    "a circle of links": (
        "def read():\n    (FAR / 'l').is_symlink() or (FAR / 'l').symlink_to('l')\n"
        "    try: open(FAR / 'l' / 'x')\n    except OSError: pass"
    ),
    "bytes that are no text": "def read():\n    open(os.fsencode(FAR) + b'/\\xff', 'a').close()\n    os.listdir(FAR)",
    "a removed folder": (
        "def read():\n    at = os.getcwd()\n    os.mkdir(FAR / 'gone')\n    os.chdir(FAR / 'gone')\n"
        "    os.rmdir(FAR / 'gone')\n    exec(compile('open(os.devnull)', 'of/no.py', 'exec'))\n    os.chdir(at)"
    ),
    "code of a long name": "def read(): exec(compile('open(os.devnull)', FAR / ('x' * 5000), 'exec'))",
    "an error of the caller's own": (
        "class Own(Exception): pass\nclass Name:\n    def __fspath__(self): raise Own\n"
        "def read():\n    try: open(Name())\n    except Own: pass"
    ),
    "a path of odd things": "def read():\n    sys.path[:0] = [b'x', FAR, None]\n    open(FAR / 'a.txt')",
    "a list of the folder above": "def read(): glob.glob(str(HERE / '..' / 'out' / '*')), os.listdir(HERE.parent)",
}


@pytest.mark.parametrize("case", ODD)
def test_an_odd_look_is_no_failure_and_leaves_the_job_fresh(tmp_path, far, monkeypatch, case):  # noqa: F811
    monkeypatch.chdir(tmp_path)
    job = done(job_of(tmp_path / "out", "mine", ODD[case]))
    assert job.fresh
    (tmp_path / "out" / "more").write_text("1")
    assert job.fresh


def test_a_record_that_cannot_be_made_is_no_failure(tmp_path, far, monkeypatch):  # noqa: F811
    monkeypatch.setattr(seen_inputs, "_movable", None)
    assert done(job_of(tmp_path / "out", "mine", "def read(): open(FAR / 'a.txt')")).fresh


def test_jobs_that_number_their_logs_leave_each_other_fresh(tmp_path, far):  # noqa: F811
    reads = "def read(): open(FAR / f'{len(os.listdir(FAR))}.log', 'w').write('1')"
    jobs = [done(job_of(tmp_path / "out", name, reads)) for name in ("one", "two")]
    assert all(job.fresh for job in jobs)


def test_a_file_of_the_same_name_in_another_folder_of_the_path_does_not_count(tmp_path, far, monkeypatch):  # noqa: F811
    """Neither for a folder that a plug-in itself puts on the path, nor in a deeper current folder."""
    (tmp_path / "here" / "a.txt").write_text("1")
    reads = "def read():\n    sys.path.insert(0, str(FAR))\n    [open(at / ('a.' + 'txt')) for at in (FAR, HERE)]"
    job = done(job_of(tmp_path / "out", "mine", reads))
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(far)])
    deep = tmp_path / "deep" / "down" / "here"
    deep.mkdir(parents=True)
    (deep / "a.txt").write_text("2")
    monkeypatch.chdir(deep)
    assert job.fresh
    (tmp_path / "here" / "a.txt").write_text("2")
    assert not job.fresh


def test_results_behind_a_link_do_not_count(tmp_path, far):  # noqa: F811
    (tmp_path / "link").symlink_to(tmp_path)
    at = "(HERE.parent / 'link' / 'out')"
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "x").write_text("1")
    job = done(
        job_of(
            tmp_path / "out", "mine", f"def read(): [open(p) for p in {at}.iterdir() if p.is_file()], os.listdir({at})"
        )
    )
    (tmp_path / "out" / "x").write_text("2")
    (tmp_path / "out" / "y").write_text("2")
    assert job.fresh


def test_links_in_circles_are_not_followed(tmp_path, far):  # noqa: F811
    for name in ("one", "two"):
        (far / name).symlink_to(".")
    job = done(job_of(tmp_path / "out", "mine", "def read(): [*FAR.rglob('*.t' + 'xt')]"))
    assert job.fresh
    (far / "sub" / "d.txt").write_text("1")
    assert not job.fresh


def test_a_look_as_python_ends_is_not_told(tmp_path):
    (tmp_path / "late.py").write_text(
        "from uavbench.bench.inputs.observed import looks\nclass Late:\n"
        "    def __del__(self, open=open, name=__file__): open(name).close()\n"
        "looks.late = Late()\nlooks.watch()\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", "import late"], cwd=tmp_path, env={**os.environ}, capture_output=True, text=True
    )
    assert found.returncode == 0 and found.stderr == ""
