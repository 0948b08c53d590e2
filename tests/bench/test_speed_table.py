"""The table of benchmarks against goals; a figure that is absent misses its goal."""

import ast
import tomllib

import pytest

from uavbench.bench.speed.table import SPEED, Verdict, against, speed, table
from uavbench.trajectories.errors import UserError


def test_goals():
    assert against(0.5, {}, {"at_most_s": 1.0}) == ("at most 1 s", Verdict.MET)
    assert against(1.5, {}, {"at_most_s": 1.0})[1] is Verdict.MISSED
    assert against(float("nan"), {}, {"at_most_s": 1.0})[1] is Verdict.MISSED
    assert against(1.0, {"fps": 30}, {"figure": "fps", "at_least": 25}) == ("fps 30, at least 25", Verdict.MET)
    assert against(1.0, {}, {"figure": "fps", "at_least": 25})[1] is Verdict.MISSED
    assert against(1.0, {"ratio": 2}, {"figure": "ratio", "at_most": 1})[1] is Verdict.MISSED
    assert against(1.0, {}, {}) == ("", Verdict.NONE)
    assert against(1.0, {"ratio": 2}, {}) == ("ratio 2", Verdict.NONE)


def test_what_is_absent_neither_meets_nor_misses_a_goal():
    goal = {"figure": "ratio", "at_most": 1}
    assert against(1.0, {"absent": "visp: not set up"}, goal) == ("absent: visp: not set up", Verdict.NONE)


@pytest.mark.parametrize(
    ("rounds", "verdict"),
    [
        ([1.95, 1.96, 1.97, 1.96], Verdict.MET),
        ([1.8, 1.81, 1.82, 1.81], Verdict.MISSED),
        ([1.8, 2.0, 1.85, 1.91], Verdict.OPEN),
    ],
)
def test_a_figure_of_several_rounds_is_judged_by_its_interval(rounds, verdict):
    assert against(1.0, {"times": rounds}, {"figure": "times", "at_least": 1.9})[1] is verdict
    text = against(1.0, {"times": [1.0, 3.0]}, {"figure": "times", "at_most": 1.0})[0]
    assert text == "times 2 +- 13, at most 1"  # t of one degree of freedom is 12.706


def test_table_lists_each_benchmark_and_says_whether_all_goals_are_met():
    one = {"name": "test_a[x]", "stats": {"min": 2e-3, "median": 3e-3}}
    lines, met = table([one], {"test_a": {"at_most_s": 1e-3}})
    assert not met
    assert "2 ms" in lines[1]
    assert lines[1].endswith("MISSED")
    assert table([one], {})[1]


def test_every_goal_is_of_a_benchmark_that_exists():
    goals = tomllib.loads((SPEED / "goals.toml").read_text(encoding="utf-8"))
    names = {
        node.name
        for path in SPEED.glob("test_speed_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    assert set(goals) <= names


def test_a_name_that_no_benchmark_has_is_told():
    pytest.importorskip("pytest_benchmark")
    with pytest.raises(UserError, match="--only nonesuch: no benchmark has such a name"):
        speed("nonesuch", None)
