"""The benchmarks of bench/speed against their goals: `uavbench speed`."""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import click

from trajectories.errors import UserError
from trajectories.files import refuse_foreign_file, write_text

SPEED = Path(__file__).parent / "speed"


def speed(only: str, save: Path | None) -> int:
    """Run the benchmarks whose name holds `only` and print the table; 1 when one failed or missed its goal."""
    if save is not None:
        refuse_foreign_file(save)
    goals = tomllib.loads((SPEED / "goals.toml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "speed.json"
        arguments = [
            "-q",
            "--benchmark-only",
            "--benchmark-disable-gc",
            f"--benchmark-json={file}",
            "-p",
            "no:cacheprovider",
        ]
        command = [sys.executable, "-m", "pytest", str(SPEED), *arguments, *(["-k", only] if only else [])]
        done = subprocess.run(command, cwd=SPEED.parents[1], capture_output=True, text=True, check=False)
        try:
            results = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            words = (done.stdout + done.stderr).strip().splitlines()
            raise UserError(
                f"the benchmarks did not run (they need the group `dev`): {words[-1] if words else ''}"
            ) from None
        if save is not None:
            write_text(save, json.dumps(results, indent=1) + "\n", sealed=True)
    lines, met = table(results["benchmarks"], goals)
    click.echo(
        f"{results['machine_info']['cpu'].get('brand_raw', 'unknown processor')}; least and median of the rounds"
    )
    click.echo("\n".join(lines))
    if done.returncode:
        click.echo(
            "\n".join(line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))), err=True
        )
    return 0 if met and done.returncode == 0 else 1


def table(benchmarks: list[dict[str, Any]], goals: dict[str, dict[str, Any]]) -> tuple[list[str], bool]:
    """Lines of the table, and whether every goal is met."""
    lines = [f"{'benchmark':<62} {'least':>11} {'median':>11}  {'goal':<34} met"]
    all_met = True
    for one in sorted(benchmarks, key=lambda b: str(b["name"])):
        stats = one["stats"]
        text, met = against(stats["min"], one.get("extra_info", {}), goals.get(str(one["name"]).split("[")[0], {}))
        all_met &= met is not False
        said = {True: "yes", False: "NO", None: ""}[met]
        lines.append(f"{one['name']:<62} {seconds(stats['min']):>11} {seconds(stats['median']):>11}  {text:<34} {said}")
    return lines, all_met


def against(least_s: float, extra: dict[str, Any], goal: dict[str, Any]) -> tuple[str, bool | None]:
    """The goal in words and whether it is met; None without one, or where what it is held against is absent."""
    if "absent" in extra:
        return f"absent: {extra['absent']}", None
    if "at_most_s" in goal:
        return f"at most {seconds(goal['at_most_s'])}", least_s <= goal["at_most_s"]
    if "figure" in goal:
        value = float(extra.get(goal["figure"], float("nan")))
        if "at_least" in goal:
            return f"{goal['figure']} {value:.3g}, at least {goal['at_least']:g}", value >= goal["at_least"]
        return f"{goal['figure']} {value:.3g}, at most {goal['at_most']:g}", value <= goal["at_most"]
    return ", ".join(f"{name} {value:.3g}" for name, value in extra.items()), None


def seconds(value: float) -> str:
    """A time with its unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"
