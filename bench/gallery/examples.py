"""Example sequence of each plug-in, from `examples.toml`, validated like a sequence of a suite."""

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


@dataclass(frozen=True)
class Example:
    """The sequence that shows a plug-in; own: the parameters of the plug-in that differ from its defaults."""

    spec: SequenceSpec
    own: Mapping[str, Any]


def example_of(key: str, kind: str) -> Example:
    """The example of the plug-in `kind`, which a sequence names under `key`; default parameters without an entry.

    UserError when the sequence in `examples.toml` is not valid.
    """
    tables = _tables()
    of_kind = dict(tables.get(key, {}).get(kind, {}))
    own = of_kind.pop("own", {})
    sequence: dict[str, Any] = {**tables["all"], **tables.get(key, {}).get("all", {}), **of_kind}
    plugin = {"kind": kind, **own}
    if key == "path":
        sequence["flight"] = {**sequence.get("flight", {}), "path": plugin}
    else:
        sequence[key] = [plugin] if key in MANY else plugin
    data = {
        "title": kind,
        "rates_hz": [15.0],
        "seeds": [0],
        "sequences": {kind: sequence},
        "trackers": {"hold": {"kind": "hold"}},
    }
    spec = suite_of(data, (), FILE).sequences[0]
    assert isinstance(spec, SequenceSpec)
    return Example(spec, own)


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
