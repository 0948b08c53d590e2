"""Standard streams that are closed, full, or whose reader has left: a command does its work, and says what is lost."""

import os
import subprocess
import sys

import pytest

from uavbench.bench.trial.check import TRIAL

UAVBENCH = f"{sys.executable} -m uavbench"
FULL = "No space left on device"


def in_shell(line, folder):
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, capture_output=True, text=True, check=False, env={**os.environ}, timeout=120
    )


@pytest.fixture
def export(tmp_path):
    return f"{UAVBENCH} export {TRIAL} --format tum --out {tmp_path}/made"


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full", ">&-", ">&- 2>&-", "<&-", "<&- >&- 2>&-", "2> >(true)"])
def test_a_command_does_its_work_where_a_stream_cannot_be_written(streams, export, tmp_path):
    done = in_shell(f"{export} {streams}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "made" / "groundtruth.txt").is_file()


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full"])
def test_a_suite_is_run_without_standard_error(streams, tmp_path):
    done = in_shell(f"{UAVBENCH} render tiny --jobs 1 --out {tmp_path}/out {streams}", tmp_path)
    assert done.returncode == 0, done.stdout
    assert (tmp_path / "out" / "sequences" / "box-s0" / "sequence.json").is_file()


def test_a_full_standard_output_is_told_once_the_work_is_done(export, tmp_path):
    done = in_shell(f"{export} >/dev/full", tmp_path)
    assert done.returncode == 1 and f"standard output: {FULL}" in done.stderr and "Traceback" not in done.stderr
    assert (tmp_path / "made" / "groundtruth.txt").is_file()


@pytest.mark.parametrize(
    ("words", "code"), [("--help", 1), ("run --help", 1), ("--version", 1), ("list", 1), (f"verify {TRIAL}", 2)]
)
def test_whatever_cannot_be_printed_is_told(words, code, tmp_path):
    done = in_shell(f"{UAVBENCH} {words} >/dev/full", tmp_path)
    assert done.returncode == code and done.stderr.count("\n") == 1 and f"standard output: {FULL}" in done.stderr


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full", ">&- 2>&-"])
def test_a_mistake_keeps_its_exit_code_where_it_cannot_be_told(streams, tmp_path):
    for words in ("run nosuch", "--nosuch", "render tiny --nosuch"):
        assert in_shell(f"{UAVBENCH} {words} {streams}", tmp_path).returncode == 2


def test_files_are_written_though_the_reader_of_the_output_left_before(tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_bytes((TRIAL / "groundtruth.csv").read_bytes())
    evaluate = f"{UAVBENCH} evaluate {TRIAL} a.csv b.csv --out made"
    done = in_shell(f"({evaluate}; echo $? >code) | true", tmp_path)
    assert (tmp_path / "made" / "index.html").is_file(), done.stderr
    assert (tmp_path / "code").read_text() == "1\n" and done.stderr == ""


def test_what_a_library_says_does_not_go_into_a_file_of_ours(tmp_path):
    """The first file that is opened would get the number of the closed standard error."""
    says = "import os; file = open('poses', 'w'); os.write(2, b'warning'); file.write('1 2 3'); file.close()"
    start = "from uavbench.trajectories.processes.standard_streams import open_closed_streams as o; o();"
    in_shell(f'{sys.executable} -c "{start} {says}" <&- 2>&-', tmp_path)
    assert (tmp_path / "poses").read_text() == "1 2 3"


def test_a_script_renders_without_standard_error(tmp_path):
    done = in_shell(f"{sys.executable} -c \"import uavbench as ub; ub.render('tiny', out='out')\" 2>&-", tmp_path)
    assert done.returncode == 0 and (tmp_path / "out" / "sequences" / "box-s0").is_dir()


def test_a_verdict_that_nobody_reads_is_none(tmp_path):
    in_shell(f"({UAVBENCH} verify {TRIAL}; echo $? >code) | true", tmp_path)
    assert (tmp_path / "code").read_text() == "2\n"


FORGIVE = "from uavbench.trajectories.processes.standard_streams import forgive_lost_output as f; f()"


@pytest.mark.parametrize("options", ["", "-u"])
def test_what_is_said_before_a_sudden_end_is_seen(options, tmp_path):
    says = "import os, sys; print('why', file=sys.stderr); os._exit(3)"
    done = in_shell(f'{sys.executable} {options} -c "{FORGIVE}; {says}"', tmp_path)
    assert done.returncode == 3 and done.stderr == "why\n"


def test_a_file_that_a_script_opened_in_the_place_of_standard_error_stays_its_own(tmp_path):
    says = "import sys; print('warning', file=sys.stderr); file.write('1 2 3'); file.close()"
    in_shell(f"{sys.executable} -c \"file = open('poses', 'w'); {FORGIVE}; {says}\" 2>&-", tmp_path)
    assert (tmp_path / "poses").read_text() == "1 2 3"


def test_an_output_of_no_descriptor_stays_as_it_is(tmp_path):
    says = "assert sys.stdout is mine; print('x'); sys.stdout = sys.__stdout__; print(mine.buffer.getvalue())"
    mine = "import io, sys; sys.stdout = mine = io.TextIOWrapper(io.BytesIO(), write_through=True)"
    done = in_shell(f'{sys.executable} -c "{mine}; {FORGIVE}; {says}"', tmp_path)
    assert done.stdout == "b'x\\n'\n", done.stderr
