"""Parameters of a user's plug-in of every type that a dataclass may have, in keys of results and in records."""

import importlib
import itertools
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from uavbench.bench.config.suite import load_tracker
from uavbench.bench.inputs.content_hash import content_hash, contents
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.protocols.restarting import run_from_anchors
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.run import parameters, track_sequence
from uavbench.trajectories.errors import UserError

PLUGIN = """
import enum
from dataclasses import dataclass, field
from pathlib import Path
import numpy as np

class Mode(enum.Enum):
    fast = "fast"
    exact = "exact"

class Net:
    pass

@dataclass(frozen=True)
class Mine:
    {name}: {type} = {default}
    def start(self, structure, camera, cam_from_world, rng): ...
    def build(self, rng): ...
"""
names = (f"parameters_of_test_{number}" for number in itertools.count())


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Makes a tracker of a module with one parameter, and of a value of it in TOML."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "code").mkdir()
    monkeypatch.syspath_prepend(tmp_path / "code")

    def make(parameter, value=None):
        module = next(names)
        name, annotation, default = parameter
        text = PLUGIN.format(name=name, type=annotation, default=default)
        (tmp_path / "code" / f"{module}.py").write_text(text)
        more = "" if value is None else f"{name} = {value}\n"
        (tmp_path / "tracker.toml").write_text(f'kind = "{module}:Mine"\n{more}')
        importlib.invalidate_caches()
        return load_tracker(tmp_path / "tracker.toml")

    return make


@pytest.mark.parametrize(
    "parameter, value, shown",
    [
        (("weights", "Path", "Path()"), '"a.bin"', "a.bin"),
        (("mode", "Mode", "Mode.fast"), '"exact"', "exact"),
        (("names", "frozenset[str]", "frozenset()"), '["b", "a"]', ["a", "b"]),
        (("steps", "int", "np.int64(3)"), None, 3),
        (("gains", "tuple", "(np.float32(0.5), 1)"), None, [0.5, 1]),
    ],
)
def test_a_parameter_is_in_the_key_and_in_the_record(mine, tmp_path, parameter, value, shown):
    (tmp_path / "a.bin").write_text("1")
    one, another = mine(parameter, value), mine(parameter)
    assert json.loads(json.dumps(parameters(one)))[parameter[0]] == shown
    assert len(content_hash(one)) == 64
    assert value is None or content_hash(one) != content_hash(type(one)())
    assert parameters(another).keys() == {parameter[0]}


@pytest.mark.parametrize(
    "parameter, value, where",
    [
        (("weights", "str", '""'), '"net.bin"', "net.bin"),
        (("weights", "str", '""'), '"net.bin"', "code/net.bin"),
        (("weights", "str", '""'), '"net.bin"', "code/nets/net.bin"),
        (("weights", "Path", "Path()"), '"nets/net.bin"', "nets/net.bin"),
        (("nets", "tuple[str, ...]", "()"), '["a.bin", "net.bin"]', "net.bin"),
        (("net_files", "list[str]", "field(default_factory=list)"), '["net.bin"]', "net.bin"),
        (("nets", "dict[str, str]", "field(default_factory=dict)"), '{ first = "net.bin" }', "net.bin"),
        (("weights_file", "Path", "Path()"), '"net.bin"', "net.bin"),
    ],
)
def test_a_file_that_a_parameter_names_enters_under_whatever_key(mine, tmp_path, parameter, value, where):
    one = mine(parameter, value)
    for text in ("1", "2"):
        (tmp_path / where).parent.mkdir(exist_ok=True)
        (tmp_path / where).write_text(text)
        keys = content_hash(one), contents(one)
        (tmp_path / "beside.bin").write_text(text)
        assert (content_hash(one), contents(one)) == keys
        if text == "1":
            first = keys
    assert first[0] != keys[0]
    assert first[1] != keys[1]


def test_a_text_that_names_a_folder_or_no_file_names_nothing(mine, tmp_path):
    (tmp_path / "out").mkdir()
    for value in ('"out"', '""', f'"{"x" * 300}"', '"fast"', '"a\\u0000b"'):
        one = mine(("mode", "str", '""'), value)
        before = content_hash(one)
        (tmp_path / "out" / f"{len(value)}.txt").write_text("1")
        assert content_hash(one) == before


def test_what_a_plugin_computes_of_its_parameters_is_in_no_record(mine):
    """An array counts in the key by its content, and anything else by what it is made of."""
    one = mine(("table", "np.ndarray", "field(init=False)"))
    unset = content_hash(one)
    object.__setattr__(one, "table", np.ones(3))
    ones = content_hash(one)
    object.__setattr__(one, "table", np.zeros(3))
    assert len({unset, ones, content_hash(one)}) == 3
    object.__setattr__(one, "table", object())
    assert content_hash(one) == unset
    assert parameters(one) == {}


def test_a_parameter_that_no_record_can_hold_is_named(mine):
    with pytest.raises(UserError, match=r":Mine: `net` is of type Net, which no record can hold; give numbers"):
        content_hash(mine(("net", "Net", "field(default_factory=Net)")))


@dataclass
class Itself:
    """A tracker that is its own run."""

    gain: float = 4.0
    seen: list[int] = field(default_factory=list)
    pose: Any = None

    def start(self, structure, camera, cam_from_world, rng):
        self.pose = cam_from_world
        self.gain *= 0.5
        return self

    def track(self, image, stamp_ns):
        self.seen.append(stamp_ns)
        return TrackResult(status="ok" if self.gain == 2.0 else "lost", cam_from_world=self.pose)


def test_what_a_run_writes_to_its_tracker_is_in_no_record_and_no_other_run():
    tracker, sequence = Itself(), Sequence.load(TRIAL)
    results = track_sequence(tracker, sequence, rate_hz=15.0, seed=0)
    again = run_from_anchors(tracker, sequence, rate_hz=15.0, seed=0, every_s=0.2)
    for record in (results.record, again.results.record):
        assert record["tracker"]["parameters"] == {"gain": 4.0, "seen": [], "pose": None}
        assert record["errors"] == []
    assert results.ok.all()
