"""The benchmarks of bench/speed against their goals: `uavbench speed`."""

import json
import math
import os
import statistics
import sys
import tomllib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.origin import refuse_foreign_file
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.processes.guard import Guard, finished

SPEED = Path(__file__).parent
BENCHMARKS = "times of benchmarks"
NONE_SELECTED = 5
"""Exit code of pytest when no test is selected."""


def speed(only: str, save: Path | None) -> int:
    """Run the benchmarks whose name contains `only` and print the table; 1 when one failed or missed its goal, else 0.

    save: file for pytest-benchmark's results. UserError when it holds something else, or the benchmarks did not run.
    """
    if save is not None:
        refuse_foreign_file(save, BENCHMARKS)
        try_place(save)
    goals = tomllib.loads((SPEED / "goals.toml").read_text(encoding="utf-8"))
    with Guard("uavbench-speed-") as guard:
        file = guard.folder / "speed.json"
        arguments = [
            "-q",
            "--benchmark-only",
            "--benchmark-disable-gc",
            f"--benchmark-json={file}",
            "-p",
            "no:cacheprovider",
        ]
        where = ["-c", os.devnull, f"--rootdir={guard.folder}", "--import-mode=importlib", str(SPEED)]
        command = [sys.executable, "-m", "pytest", *where, *arguments, *(["-k", only] if only else [])]
        found_by = os.pathsep.join(path for path in sys.path if path)
        ours = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
        done = finished(guard, command, {**ours, "PYTHONPATH": found_by})
        try:
            results = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            if done.code == NONE_SELECTED:
                raise UserError(f"--only {only}: no benchmark has such a name; without it all are run") from None
            raise UserError(
                f"the benchmarks did not run (they need `pip install 'uavbench[speed]'`): {done.last}"
            ) from None
        if save is not None:
            write_text(save, json.dumps(results, indent=1) + "\n", kind=BENCHMARKS)
    lines, met = table(results["benchmarks"], goals)
    say(f"{results['machine_info']['cpu'].get('brand_raw', 'unknown processor')}; least and median of the rounds")
    say("\n".join(lines))
    if done.code:
        say("\n".join(line for line in done.out.splitlines() if line.startswith(("FAILED", "ERROR"))), err=True)
    return 0 if met and done.code == 0 else 1


class SpeedTable(NamedTuple):
    """Lines of the table, and whether no goal is missed."""

    lines: list[str]
    all_met: bool


def table(benchmarks: list[dict[str, Any]], goals: dict[str, dict[str, Any]]) -> SpeedTable:
    """The table of pytest-benchmark's results; goals: of goals.toml, by name of the benchmark."""
    lines = [f"{'benchmark':<62} {'least':>11} {'median':>11}  {'goal':<50} verdict"]
    all_met = True
    for one in sorted(benchmarks, key=lambda b: str(b["name"])):
        stats = one["stats"]
        text, verdict = against(stats["min"], one.get("extra_info", {}), goals.get(str(one["name"]).split("[")[0], {}))
        all_met &= verdict is not Verdict.MISSED
        times = f"{seconds(stats['min']):>11} {seconds(stats['median']):>11}"
        lines.append(f"{one['name']:<62} {times}  {text:<50} {verdict}")
    return SpeedTable(lines, all_met)


class Verdict(StrEnum):
    """Result of a measurement against a goal; NONE without a goal, or where the reference is absent."""

    MET = "met"
    MISSED = "MISSED"
    OPEN = "not decidable"
    NONE = ""


class Judged(NamedTuple):
    """A goal as text, and the verdict of a measurement against it."""

    goal: str
    verdict: Verdict


def against(least_s: float, extra: dict[str, Any], goal: dict[str, Any]) -> Judged:
    """Verdict on a benchmark's minimum time in s, or on a figure in its `extra`, against a goal of goals.toml."""
    if "absent" in extra:
        return Judged(f"absent: {extra['absent']}", Verdict.NONE)
    if "at_most_s" in goal:
        verdict = Verdict.MET if least_s <= goal["at_most_s"] else Verdict.MISSED
        return Judged(f"at most {seconds(goal['at_most_s'])}", verdict)
    if "figure" in goal:
        found = Interval.of(extra.get(goal["figure"], float("nan")))
        sort, limit = ("at least", goal["at_least"]) if "at_least" in goal else ("at most", goal["at_most"])
        return Judged(f"{goal['figure']} {found}, {sort} {limit:g}", found.held_against(sort, limit))
    return Judged(", ".join(f"{name} {Interval.of(value)}" for name, value in extra.items()), Verdict.NONE)


@dataclass(frozen=True)
class Interval:
    """Mean of a figure over its rounds, and half the width of its 95 % interval (Student's t), 0 for a single round."""

    mean: float
    half: float = 0.0

    @classmethod
    def of(cls, figure: float | list[float]) -> "Interval":
        """Interval of a single value, or of one value per round (two at least)."""
        if not isinstance(figure, list):
            return cls(float(figure))
        from scipy.stats import t  # takes a second, and most tables have no rounds

        error = statistics.stdev(figure) / math.sqrt(len(figure))
        return cls(statistics.fmean(figure), float(t.ppf(0.975, len(figure) - 1)) * error)

    def held_against(self, sort: str, limit: float) -> Verdict:
        """MET or MISSED when the whole interval lies on one side of the limit, else OPEN: more rounds are needed."""
        margin = self.mean - limit if sort == "at least" else limit - self.mean
        if margin >= self.half:
            return Verdict.MET
        return Verdict.OPEN if margin > -self.half else Verdict.MISSED

    def __str__(self) -> str:
        return f"{self.mean:.3g} +- {self.half:.2g}" if self.half else f"{self.mean:.3g}"


def seconds(value: float) -> str:
    """A time in s as text with a unit from ns to s."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"
