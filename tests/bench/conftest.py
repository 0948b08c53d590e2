"""A packed challenge that the tests of packages and of submissions share, and what spares processes and figures."""

import base64
from contextlib import nullcontext

import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main

CONTEST = """
title = "A title that tells the place"
rates_hz = [15.0, 5.0]
seeds = [770177017, 770277027]
start = { kind = "coarse-guess" }
[sequences.quarry]
structure = { kind = "box" }
mount = { pitch_deg = -20.0, offset_m = [0.03, 0.01, -0.02] }
environment = { kind = "studio" }
deviation = { scale_percent = 1.0 }
flight.path = { kind = "hand-pilot", duration_s = 0.4 }
flight.wind = { kind = "dryden" }
effects = [{ kind = "noise" }]
sensors = [{ kind = "imu", gyro_bias_rad_s = 0.1, accel_bias_m_s2 = 0.3 }, { kind = "gnss" }]
annotations = ["depth", "mask"]
camera = { width = 96, height = 72, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""


def in_this_process(_):
    """In place of `local_pool`: the jobs run here. A worker would import all that they need again."""
    from uavbench.bench.runner.executors import Pool
    from uavbench.bench.runner.render_suite import InProcess

    return nullcontext(Pool(InProcess(), None))


def in_one_process(*arguments):
    """Result of a command on a suite, whose jobs run in this process."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)
        return CliRunner().invoke(main, list(map(str, arguments)))


SKETCHES = {
    "pdf": b"%PDF-1.4\n%%EOF\n",
    "png": base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2FAAAAABJRU5ErkJggg=="
    ),
}
"""What stands in a file of a figure that is sketched: a PDF without a page, and one pixel."""


@pytest.fixture
def sketched(monkeypatch):
    """Figures are drawn and their numbers written, but not laid out, nor is their picture made, which takes most of the
    time of a report: for tests of when a report is written, and by whom, that look at no figure.
    """
    sketch(monkeypatch)


def sketch(patched):
    """See `sketched`; for fixtures of a module, which have a MonkeyPatch of their own."""
    patched.setattr("uavbench.reports.style.lay_out", lambda figure: None)
    patched.setattr("matplotlib.figure.Figure.savefig", lambda _, to, *, format, **how: to.write(SKETCHES[format]))


def packed(suite, out, *more):
    """Result of `uavbench pack`, whose jobs run in this process."""
    given = ["pack", str(suite), "--without-truth", "--out", str(out), *map(str, more)]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("uavbench.bench.challenge.pack.local_pool", in_this_process)
        return CliRunner().invoke(main, given)


@pytest.fixture(scope="session")
def challenge(tmp_path_factory):
    """Folder of a suite, `contest.toml`, its package, `participants`, and the organizer's half, `kept`."""
    folder = tmp_path_factory.mktemp("challenge")
    (folder / "contest.toml").write_text(CONTEST)
    done = packed(folder / "contest.toml", folder / "participants", "--truth", folder / "kept", "--private-suite")
    assert done.exit_code == 0, done.output
    return folder
