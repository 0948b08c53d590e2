"""The values of `robust`: each says its unit and where it comes from, and what follows from another one is none."""

import ast
import math
import re
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from annotated_types import Unit

from uavbench.bench.reference import field_docs
from uavbench.tracker.robust.config import RobustConfig

ROOT = Path(__file__).parents[2]
UNITS = (
    "px",
    "px2",
    "grey",
    "grey2",
    "px_grey",
    "s",
    "s2",
    "1_s",
    "rad",
    "deg",
    "texels",
    "ranges_s2",
    "rad_s2",
    "log10",
)
"""Units that a name ends in, or begins with."""
SOURCE = re.compile(r"\b(Chosen (on|for)|Measured|Physical)\b|\([A-Z][^()]+ (19|20)\d\d\)")


def values(config: type) -> dict[str, Any]:
    """Annotated type and text of each value of a config class and of those in it, by its path."""
    hints, texts = get_type_hints(config, include_extras=True), field_docs(config)
    found: dict[str, Any] = {}
    for field in fields(config):
        if is_dataclass(hints[field.name]):
            found |= {f"{field.name}.{below}": value for below, value in values(hints[field.name]).items()}
        else:
            found[field.name] = (hints[field.name], texts[field.name])
    return found


VALUES = values(RobustConfig)


@pytest.mark.parametrize("path", VALUES)
def test_every_value_says_where_it_comes_from(path: str) -> None:
    assert SOURCE.search(VALUES[path][1]), VALUES[path][1]


@pytest.mark.parametrize("path", VALUES)
def test_every_value_has_a_unit(path: str) -> None:
    hint, _ = VALUES[path]
    name = path.rpartition(".")[2]
    in_name = any(name.endswith(f"_{unit}") or name.startswith(f"{unit}_") for unit in UNITS)
    in_type = any(isinstance(limit, Unit) for limit in getattr(hint, "__metadata__", ()))
    assert in_name or in_type
    assert not (in_name and in_type), "one of them is wrong"


def test_a_support_is_good_that_leads_the_least_one() -> None:
    config = RobustConfig()
    assert config.loss.min_support < config.good_support < 1.0
    assert config.good_support == config.loss.min_support + config.relocalization.lead


def test_fewer_than_forty_values_are_left() -> None:
    assert len(VALUES) < 40


def test_what_follows_from_a_value_follows_it() -> None:
    config = RobustConfig()
    estimator = replace(config.solver.estimator, coarse_widths_px=(10.0, 4.0))
    assert (estimator.separate_px, estimator.fine_half_px) == (10.0, 6.0)
    assert estimator.fine_widths_px == (5.0, 2.0, 2.0, 2.0)
    finer = replace(config.relocalization, search=replace(config.relocalization.search, view_step_rad=0.08))
    assert finer.found_sigma == pytest.approx(0.5 * config.relocalization.found_sigma)
    truncated = replace(config.relocalization.search, truncation_px=10.0)
    assert truncated.step_part == pytest.approx(2.0 * config.relocalization.search.step_part)
    slower = replace(config, motion=replace(config.motion, acceleration_ranges_s2=0.75))
    assert slower.slow_s == pytest.approx(2.0 * config.slow_s)
    assert replace(config, motion=replace(config.motion, acceleration_ranges_s2=0.0)).slow_s == math.inf
    surer = replace(config.relocalization, lead=2.0 * config.relocalization.lead)
    assert surer.lead_of_rivals == pytest.approx(2.0 * config.relocalization.lead_of_rivals)
    assert surer.sigma_cost == pytest.approx(2.0 * config.relocalization.sigma_cost)


def test_colours_are_learned_up_to_the_residual_of_most_influence() -> None:
    estimator = RobustConfig().solver.estimator
    r, c = np.linspace(0.0, 1.5, 15001), estimator.fine_widths_px[-1]
    assert estimator.trusted_px == pytest.approx(r[np.argmax(r * (1 - (r / c) ** 2) ** 2)], abs=2e-4)


def test_every_value_is_read_by_the_tracker() -> None:
    sources = (ROOT / "tracker" / "robust").rglob("*.py")
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in sources]
    read = {node.attr for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert sorted({path.rpartition(".")[2] for path in VALUES} - read) == []
