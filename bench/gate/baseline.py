"""A baseline as one file that can be committed, written by `uavbench gate RESULTS --baseline FILE --update`.

It holds only the numbers that the gate compares, for the flights of one suite, without frames and results. It is
compared with newly rendered frames, possibly of another machine or newer code; the resulting random differences are
part of the spread that the gate measures, so its margins are wider. It contains a hash of its content and must not be
edited.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from uavbench.bench.gate.paired_scores import Key, Measured, Side, known
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import SETTINGS
from uavbench.trajectories.files.origin import owning
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.files.writing import write_text

DIGITS = 6
"""Significant digits of the numbers: finer than any margin."""


def write_baseline(side: Side, path: Path) -> None:
    """Write the measured values of a suite's folder; UserError when a run is missing, or a replayed one crashed."""
    broken = {key: run.crash for key, run in side.runs.items() if run.crash and not side.is_flown}
    for key, why in {**side.faults, **broken}.items():
        raise UserError(f"no baseline of {key[0]} on {key[1]}, seed {key[2]}: {why}")
    rows = [
        [
            *key,
            _rounded(run.coverage),
            {metric: _rounded(value) for metric, value in known(run.errors).items()},
            *([run.crash] if run.crash else []),
        ]
        for key, run in sorted(side.runs.items())
    ]
    how = next((dict(run.how) for run in side.runs.values()), {})
    body = {"flights": side.flights, "how": how, "runs": rows}
    lines = ",\n".join(f"  {json.dumps(row)}" for row in rows)
    text = (
        f'{{\n "sha256": "{_digest(body)}",\n "flights": {json.dumps(side.flights)},\n "how": {json.dumps(how)},\n'
        f' "runs": [\n{lines}\n ]\n}}\n'
    )
    with owning([path] if _is_baseline(path) else []):
        write_text(path, text)


def read_baseline(path: Path, flights: str) -> Side:
    """The baseline of a file; UserError when it was edited, or is of other flights than these."""
    body = read_json(path, limit=SETTINGS)
    anew = f"create it again with `uavbench gate RESULTS --baseline {path} --update`"
    if body.pop("sha256", None) != _digest(body):
        raise UserError(f"{path}: this baseline was edited or is incomplete; move it away, and {anew}")
    if not flights or body.get("flights") != flights:
        raise UserError(f"{path}: the suite's flights have changed since it was made; {anew}")
    try:
        runs: dict[Key, Measured] = {
            (str(run), str(sequence), int(seed)): Measured(
                coverage=float(coverage),
                errors={str(k): float(v) for k, v in errors.items()},
                crash=str(crash[0]) if crash else "",
                how=dict(body["how"]),
            )
            for run, sequence, seed, coverage, errors, *crash in body["runs"]
        }
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise UserError(f"{path}: this is not a baseline ({error}); {anew}") from None
    return Side(runs, {}, flights)


def _is_baseline(path: Path) -> bool:
    """Whether a file is an unedited baseline, by the hash of its content."""
    try:
        body = read_json(path)
        return bool(body.pop("sha256", None) == _digest(body))
    except (UserError, OSError, ValueError, AttributeError):
        return False


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _digest(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
