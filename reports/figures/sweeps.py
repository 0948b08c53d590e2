"""Figures of a sweep: scores over the parameter in which the sequences of a suite differ.

Conventions: the sequences of a suite are a sweep when their configs differ in one number only, apart from seeds and
names.
"""

from collections.abc import Iterator, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from uavbench.reports.figures.distributions import draw_sweep
from uavbench.reports.figures.figure_files import Drawn, save_panel
from uavbench.reports.scoring.repeated_seeds import counted
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.pose import Array

What = Literal["ate", "success"]
LEAST_VALUES = 3
"""Fewest values of a sweep; two are a comparison."""


@dataclass(frozen=True)
class Swept:
    """The swept parameter of a suite: its dotted key in the config, and its value by name of the sequence."""

    key: str
    values: Mapping[str, float]


def swept(sequences: ListOf[Sequence]) -> Swept | None:
    """The parameter that the sequences sweep; None unless their configs differ in exactly one number.

    It must have LEAST_VALUES values or more.
    """
    configs = {s.name: dict(leaves(s.info.get("config") or {})) for s in sequences}
    for config in configs.values():
        for own in ("name", "seed"):
            config.pop(own, None)
    keys = {key for config in configs.values() for key in config}
    differing = [key for key in keys if len({repr(config.get(key)) for config in configs.values()}) > 1]
    if len(differing) != 1:
        return None
    found = {name: config.get(differing[0]) for name, config in configs.items()}
    values = {name: float(v) for name, v in found.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    if len(values) < len(configs) or len(set(values.values())) < LEAST_VALUES:
        return None
    return Swept(differing[0], values)


def sweep(runs: ListOf[ScoredRun], found: Swept, what: What, stem: Path) -> list[Path]:
    """Write `draw_sweep_of` as files at a stem; their paths."""
    return save_panel(partial(draw_sweep_of, runs, found, what), stem, 2.2)


def draw_sweep_of(runs: ListOf[ScoredRun], found: Swept, what: What, panel: Axes) -> Drawn:
    """ATE position in cm, or success in percent, over the swept parameter, per tracker at the highest rate."""
    fast = [run for run in counted(runs) if run.score.rate_hz == max(r.score.rate_hz for r in runs)]
    colours = {run.score.label: run.colour for run in fast}
    curves: dict[str, dict[float, list[Array]]] = {}
    for label in colours:
        group = [run for run in fast if run.score.label == label]
        for value in sorted(set(found.values.values())):
            numbers = [_percent_or_cm(run, what) for run in group if found.values[run.sequence.name] == value]
            known = np.array([number for number in numbers if number is not None])
            if len(known):
                curves.setdefault(label, {})[value] = [known]
    name = found.key.rpartition(".")[2]
    metric = "ATE position (cm)" if what == "ate" else "within 5 cm, 5 deg (%)"
    return draw_sweep(curves, colours, panel, swept=name, metric=metric, share=what == "success")


def _percent_or_cm(run: ScoredRun, what: What) -> float | None:
    if what == "success":
        return 100 * run.score.tracking.success
    error = run.score.ate["none"].translation_m
    return None if error is None else 100 * error.rmse


class Leaf(NamedTuple):
    """A scalar of a config, and the dotted path of its key."""

    path: str
    value: Any


def leaves(value: Any, path: str = "") -> Iterator[Leaf]:
    """Every scalar of a nested config, in the order of its keys."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from leaves(item, f"{path}[{k}]")
    else:
        yield Leaf(path, value)
