"""Third-party trackers: absent ones are reported and never scored; those set up here keep the protocol."""

import json
import re
import shutil

import pytest

from tests.bench.test_end_to_end import uavbench
from uavbench.bench.config.suite import load_suite
from uavbench.bench.gate.decision import gate, overall
from uavbench.bench.runner.jobs import plan
from uavbench.bench.third_party import visp
from uavbench.bench.third_party.opencv_rapid import OpencvRapid
from uavbench.bench.third_party.rapid_runner import search_range
from uavbench.bench.third_party.registry import THIRD_PARTY, absent, setup, status
from uavbench.bench.third_party.visp import Visp
from uavbench.bench.trial.check import check
from uavbench.reports.run_folder import load_scores
from uavbench.trajectories.errors import UserError

SUITE = """
title = "With third-party trackers"
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hand-pilot", duration_s = 0.2 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
visp-klt = { kind = "visp", features = "klt" }
opencv-rapid = { kind = "opencv-rapid" }
"""


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    monkeypatch.setenv("UAVBENCH_THIRD_PARTY", str(tmp_path / "third-party"))
    return tmp_path


@pytest.mark.ci
def test_absent_peers_are_told_and_the_rest_runs(nowhere):
    (nowhere / "suite.toml").write_text(SUITE)
    done = uavbench("run", nowhere / "suite.toml", "--out", nowhere / "out", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert "absent: visp-klt: not set up on this machine; `uavbench third-party setup visp` does it" in done.stderr
    assert re.search(r"^\| opencv-rapid \|( absent \|)+$", done.stdout, re.MULTILINE)
    scores = json.loads((nowhere / "out" / "scores.json").read_text())
    assert {score["label"] for score in scores["scores"]} == {"hold"}
    assert set(scores["absent"]) == {"visp-klt", "opencv-rapid"}
    page = (nowhere / "out" / "index.html").read_text()
    assert re.search(r"<strong>visp-klt</strong> <span class=\"chip absent\">absent</span>", page)
    assert not list((nowhere / "out" / "results").glob("*/visp*"))
    assert not (nowhere / "out" / "failed").exists()


def test_a_peer_that_is_absent_counts_in_no_gate_and_in_no_table_of_scores(nowhere):
    """The gate failed for want of its numbers, and took those from before it went for those of this run."""
    (nowhere / "suite.toml").write_text(SUITE)
    assert uavbench("score", nowhere / "suite.toml", "--out", nowhere / "out", "--jobs", "1").returncode == 0
    theirs = nowhere / "out" / "results" / "box-s0" / "opencv-rapid@15hz" / "score.json"
    ours = theirs.parents[1] / "hold@15hz" / "score.json"
    for left in (False, True):
        if left:
            theirs.parent.mkdir()
            theirs.write_text(ours.read_text().replace('"hold"', '"opencv-rapid"'))
        findings = gate(nowhere / "out", nowhere / "out")
        assert {finding.run for finding in findings} == {"hold@15hz"}
        assert overall(findings) == "inconclusive", "of a single seed"
        assert set(load_scores(nowhere / "out").tracker) == {"hold"}


def test_a_peer_that_comes_makes_the_report_stale_and_its_version_the_results(nowhere):
    (nowhere / "suite.toml").write_text(SUITE)
    suite = load_suite(nowhere / "suite.toml")

    def hashes():
        return {job.name: job.content_hash for job in plan(suite, nowhere / "out")}

    before = hashes()
    OpencvRapid.mark({"opencv": "4.1"})
    first = hashes()
    assert set(first) - set(before) == {f"{verb} box-s0 opencv-rapid@15hz" for verb in ("track", "score")}
    assert [name for name in before if before[name] != first[name]] == ["report"]
    OpencvRapid.mark({"opencv": "4.2"})
    assert {name.split()[-1] for name, made in hashes().items() if first[name] != made} == {
        "opencv-rapid@15hz",
        "report",
    }


def test_a_peer_that_another_version_set_up_is_absent_until_it_is_set_up_again(nowhere, monkeypatch):
    """A runner compiled from another source went on to be run, and its results were taken as those of the new one."""
    Visp.mark({"visp": "3.5"})
    OpencvRapid.mark({"opencv": "4.1"})
    trackers = {"visp": Visp(), "opencv-rapid": OpencvRapid()}
    assert absent(trackers) == {}
    assert Visp().record["versions"] == {"visp": "3.5"}
    changed = nowhere / "visp_runner.cpp"
    changed.write_text(visp.SOURCE.read_text() + "// mended")
    with monkeypatch.context() as patched:
        patched.setattr(visp, "SOURCE", changed)
        patched.setattr("uavbench.bench.third_party.opencv_rapid.PACKAGES", ("numpy==99",))
        assert all("third-party setup" in why for why in absent(trackers).values()) and len(absent(trackers)) == 2
        with pytest.raises(UserError, match="another version of uavbench"):
            Visp().present()
        Visp.mark({"visp": "3.5"})
        assert set(absent(trackers)) == {"opencv-rapid"}
    (OpencvRapid.folder() / "versions.json").write_text("[]")
    assert "opencv-rapid" in absent(trackers)


def test_a_setup_that_fails_leaves_no_peer_that_counts_as_set_up(nowhere, monkeypatch):
    def made(place, **_):
        raise OSError("asked for")

    monkeypatch.setattr("venv.create", made)
    with pytest.raises(UserError, match="asked for"):
        setup("opencv-rapid")
    OpencvRapid.mark({"opencv": "4.1"})
    assert not OpencvRapid.absence()
    with pytest.raises(UserError, match="asked for"):
        setup("opencv-rapid")
    assert OpencvRapid.absence()


@pytest.mark.parametrize("name", list(THIRD_PARTY))
def test_a_peer_keeps_the_protocol_or_says_how_to_get_it(name, tmp_path):
    third_party = THIRD_PARTY[name]()
    if why := absent({"it": third_party}).get("it"):
        with pytest.raises(UserError, match=f"{name}: .*uavbench third-party setup {name}"):
            list(check(third_party, tmp_path / "kept"))
        assert any(line.startswith(name) and line.endswith(why) for line in status())
    else:
        assert list(check(third_party, tmp_path / "kept"))[-1] == "good: the tracker follows the protocol"
        assert third_party.record["versions"]


@pytest.mark.parametrize(("asked", "width", "px"), [(None, 640, 20), (None, 160, 5), (None, 32, 2), (12, 160, 12)])
def test_the_default_search_range_shrinks_with_the_image(asked, width, px):
    """20 px are a 32nd of the suites' images, and the whole box in those of `check`."""
    given = OpencvRapid(search_px=asked).command()[-2]
    assert search_range(int(given), width) == px


def test_visp_says_what_to_install(nowhere, monkeypatch):
    monkeypatch.setattr(visp, "_headers", lambda: None)
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    with pytest.raises(UserError, match=r"sudo apt-get install .* libvisp-dev"):
        setup("visp")
    assert Visp.absence()


@pytest.mark.parametrize("how", ["folder", "link", "file"])
def test_an_environment_of_another_is_not_cleared(nowhere, monkeypatch, how):
    def made(place, **_):
        raise OSError("asked for")

    monkeypatch.setattr("venv.create", made)
    with pytest.raises(UserError, match="asked for"):
        setup("opencv-rapid")
    with pytest.raises(UserError, match="asked for"):
        setup("opencv-rapid")  # over our own, begun and not ended
    place = nowhere / "third-party" / "opencv-rapid" / "venv"
    assert [path.name for path in place.iterdir()] == ["uavbench.json"]
    shutil.rmtree(place)
    theirs = place if how == "folder" else nowhere / "theirs"
    theirs.mkdir()
    (theirs / "thesis.tex").write_text("years of work")
    if how == "link":
        place.symlink_to(theirs)
    elif how == "file":
        place.write_text("years of work")
    with pytest.raises(UserError, match="move it away"):
        setup("opencv-rapid")
    assert (theirs / "thesis.tex").read_text() == "years of work" and place.exists()


def test_a_home_that_is_missing_is_not_made_for_a_peer(tmp_path, monkeypatch):
    for name in ("UAVBENCH_THIRD_PARTY", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with pytest.raises(UserError, match=r"home: is your home by HOME, and is missing; name a folder in UAVBENCH_THIRD"):
        setup("visp")
    assert not (tmp_path / "home").exists()


def test_an_unknown_peer_is_named(nowhere):
    with pytest.raises(UserError, match=r"unknown third-party tracker 'vips'.*visp"):
        setup("vips")


@pytest.mark.parametrize("name", sorted(THIRD_PARTY))
def test_tracking_images_by_a_peer_says_where_it_runs(tmp_path, name):
    """`unknown tracker 'visp'` is no answer right after it was set up."""
    done = uavbench(
        "track",
        name,
        "--images",
        str(tmp_path),
        "--model",
        "a.obj",
        "--camera",
        "a.toml",
        "--init",
        "b.toml",
        "--out",
        str(tmp_path / "out"),
    )
    assert done.returncode == 2 and f"{{ kind = {name!r} }}" in done.stderr, done.stderr
    assert "recordings.NAME" in done.stderr and not (tmp_path / "out").exists()
