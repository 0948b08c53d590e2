"""Example sequence of each plug-in, from `examples.toml`, validated like a sequence of a suite."""

import inspect
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from uavbench.bench.config.suite import suite_of
from uavbench.scenes.spec import SequenceSpec

FILE = Path(__file__).with_name("examples.toml")
MANY = ("clutter", "effects", "sensors")
"""Keys of a sequence that hold a list of plug-ins."""
OPTIONS = {"sites": ("environment", "site"), "conditions": ("environment",), "cameras": (), "annotations": ()}
"""Tables of `examples.toml` that show parameters in place of plug-ins -> the table of a sequence that has them."""


@dataclass(frozen=True)
class Example:
    """The sequence that shows a plug-in or parameters; own: its parameters that differ from the defaults."""

    spec: SequenceSpec
    own: Mapping[str, Any]
    about: str


def example_of(key: str, kind: str, plugin: type) -> Example:
    """The example of the plug-in `kind`, which a sequence names under `key`; default parameters without an entry.

    UserError when the sequence in `examples.toml` is not valid.
    """
    sequence, own = _sequence(key, kind)
    named = {"kind": kind, **own}
    if key == "path":
        sequence["flight"] = {**sequence.get("flight", {}), "path": named}
    else:
        sequence[key] = [named] if key in MANY else named
    about = inspect.cleandoc(plugin.__doc__ or "").split("\n\n")[0]
    return Example(_spec(kind, sequence), own, " ".join(about.split()))


def options(key: str) -> Mapping[str, Example]:
    """Examples of parameters by name: `sites`, `conditions`, `cameras`, `annotations`; see OPTIONS."""
    found = {}
    for name in _tables()[key]:
        if name != "all":
            sequence, own = _sequence(key, name)
            about = sequence.pop("about")
            found[name] = Example(_spec(name, _within(sequence, OPTIONS[key], own)), own, about)
    return found


def _within(sequence: Mapping[str, Any], path: tuple[str, ...], own: Mapping[str, Any]) -> dict[str, Any]:
    """Table of a sequence with more keys in the table that a path leads to."""
    if not path:
        return {**sequence, **own}
    head, *rest = path
    return {**sequence, head: _within(sequence.get(head, {}), tuple(rest), own)}


def _sequence(key: str, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Table of a sequence, and the own parameters of what it shows."""
    tables = _tables()
    of_name = dict(tables.get(key, {}).get(name, {}))
    own = of_name.pop("own", {})
    return {**tables["all"], **tables.get(key, {}).get("all", {}), **of_name}, own


def _spec(name: str, sequence: Mapping[str, Any]) -> SequenceSpec:
    data = {
        "title": name,
        "rates_hz": [sequence.get("rate_hz", 15.0)],
        "seeds": [0],
        "sequences": {name: {key: value for key, value in sequence.items() if key != "about"}},
        "trackers": {"hold": {"kind": "hold"}},
    }
    spec = suite_of(data, (), FILE).sequences[0]
    assert isinstance(spec, SequenceSpec)
    return spec


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
