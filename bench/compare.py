"""Two versions of the repository on the same frames: `uavbench compare BASE_REF HEAD_REF`.

The frames are rendered once, by the uavbench that runs. Then both versions' trackers run on them in turn, base and
head and head and base, several times over, so that whatever else the machine does meets both alike; of each frame's
times the smallest counts. The scores are computed by one version, the running one, and the gate decides.
"""

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from bench.config import Suite, load_suite
from bench.content import content_hash
from bench.gate import Margins
from bench.gate_reports import pronounce
from bench.suite_files import suite_file
from bench.verbs import Where, bring_up_to
from reports.score import score
from scenes.sequence import Sequence
from tracker.results import Results
from trajectories.errors import UserError
from trajectories.files import write_text

SIDES = ("base", "head")
LEAST_MS = 0.05
"""Times below this are alike: their ratio says nothing."""


@dataclass(frozen=True)
class Version:
    """One version at work: its commit, and the process that runs its trackers."""

    commit: str
    server: "subprocess.Popen[str]"

    def track(self, ask: dict[str, Any]) -> dict[str, Any]:
        """The server's answer to one request; UserError when it is gone."""
        assert self.server.stdin is not None and self.server.stdout is not None
        try:
            self.server.stdin.write(json.dumps(ask) + "\n")
            self.server.stdin.flush()
            answer: dict[str, Any] = json.loads(self.server.stdout.readline())
        except (OSError, ValueError):
            raise UserError(
                f"version {self.commit} cannot run trackers for comparison: it ended, or has no bench/track_server.py"
            ) from None
        return answer


def compare(refs: tuple[str, str], suite_name: str, out: Path, repeats: int, margins: Margins, workers: int) -> int:
    """Compare two versions; the gate's exit code, 1 when the frames cannot be rendered."""
    out = out.resolve()
    file = suite_file(suite_name).resolve()
    suite = load_suite(file)
    for ref in refs:  # before the rendering: that takes minutes
        commit_of(ref)
    code = bring_up_to("render", str(file), out / "head", Where(workers=workers))
    if code:
        return code
    with ExitStack() as stack:
        versions = {side: stack.enter_context(version(ref)) for side, ref in zip(SIDES, refs, strict=True)}
        click.echo(f"base {versions['base'].commit}, head {versions['head'].commit}, {repeats} repeats", err=True)
        times, unknown = run_in_turn(versions, suite, file, out, repeats)
    for label, why in unknown.items():
        click.echo(f"not compared, unknown to the base: {label} ({why})", err=True)
    known = [label for label in suite.trackers if label not in unknown]
    if not known:
        raise UserError("the base knows none of the suite's trackers")
    runs = {f"{label}@{rate:g}hz": why for label, why in unknown.items() for rate in suite.rates_hz}
    for side in SIDES:
        describe(out / side, suite, known, {run: f"unknown to the base: {why}" for run, why in runs.items()})
        score_all(out, side, suite, known)
    write_text(out / "head" / "timing.json", json.dumps({"runs": smallest(times, known)}, indent=1) + "\n")
    return pronounce(out / "head", out / "base", margins, out / "gate")


Times = dict[tuple[str, str, str, int, str], list[list[float]]]
"""(label, run, sequence, seed, side) -> per repeat the time of each frame in ms."""


def run_in_turn(
    versions: dict[str, Version], suite: Suite, file: Path, out: Path, repeats: int
) -> tuple[Times, dict[str, str]]:
    """Times of all runs, and why the base could not run a tracker; the results are in the folders of both sides."""
    tables = tomllib.loads(file.read_text(encoding="utf-8"))["trackers"]
    times: Times = {}
    unknown: dict[str, str] = {}
    for repeat in range(repeats):
        for number, spec in enumerate(suite.sequences):
            for label, rate_hz in [(label, rate) for label in suite.trackers for rate in suite.rates_hz]:
                run = f"{label}@{rate_hz:g}hz"
                for side in SIDES if (repeat + number) % 2 == 0 else SIDES[::-1]:
                    if label in unknown:
                        continue
                    ask = {
                        "suite": str(file),
                        "label": label,
                        "tracker": tables[label],
                        "rate_hz": rate_hz,
                        "seed": spec.seed,
                        "sequence": str(out / "head" / "sequences" / spec.name),
                        "out": str(out / side / "results" / spec.name / run),
                        "content_hash": content_hash(versions[side].commit, label, rate_hz, spec.seed, spec.name),
                    }
                    answer = versions[side].track(ask)
                    if "error" in answer and side == "base":
                        unknown[label] = str(answer["error"]).splitlines()[-1].strip()
                    elif "error" in answer:
                        raise UserError(f"head, {run} on {spec.name}: {answer['error']}")
                    else:
                        key = (label, run, spec.name, spec.seed, side)
                        times.setdefault(key, []).append([np.nan if t is None else t for t in answer["total_ms"]])
    return times, unknown


def smallest(times: Times, labels: list[str]) -> dict[str, list[dict[str, Any]]]:
    """By run, for each sequence: the median over the frames of each frame's smallest time on both sides.

    Trackers whose times nobody measured are left out.
    """
    runs: dict[str, list[dict[str, Any]]] = {}
    for label, run, name, seed, side in times:
        if side != "head" or label not in labels:
            continue
        median = [float(np.median(np.min(times[label, run, name, seed, s], axis=0))) for s in SIDES]
        base_ms, head_ms = np.maximum(median, LEAST_MS).tolist()
        if np.isfinite([base_ms, head_ms]).all():
            sequence = name.removesuffix(f"-s{seed}")
            row = {"sequence": sequence, "seed": seed, "base_ms": base_ms, "head_ms": head_ms}
            runs.setdefault(run, []).append(row)
    return runs


def describe(folder: Path, suite: Suite, labels: list[str], not_compared: dict[str, str]) -> None:
    """Write `suite.json` of what was compared, and why runs were not."""
    about = {
        "suite": suite.name,
        "title": suite.title,
        "sequences": [spec.name for spec in suite.sequences],
        "trackers": labels,
        "rates_hz": list(suite.rates_hz),
        "not_compared": not_compared,
    }
    write_text(folder / "suite.json", json.dumps(about, indent=1) + "\n")


def score_all(out: Path, side: str, suite: Suite, labels: list[str]) -> None:
    """Score the results of one side, with this version."""
    for spec in suite.sequences:
        sequence = Sequence.load(out / "head" / "sequences" / spec.name)
        for run in [f"{label}@{rate:g}hz" for label in labels for rate in suite.rates_hz]:
            results = out / side / "results" / spec.name / run
            score(sequence, Results.load(results)).save(results / "score.json")


@contextmanager
def version(ref: str) -> Iterator[Version]:
    """A version of the repository that the current folder is in, at work; `.` is the working tree as it stands."""
    with tempfile.TemporaryDirectory(prefix="uavbench-version-") as scratch:
        if ref == ".":
            commit, tree = commit_of(ref), Path(git("rev-parse", "--show-toplevel").decode().strip())
        else:
            commit, tree = commit_of(ref), Path(scratch)
            with tarfile.open(fileobj=io.BytesIO(git("archive", "--format=tar", commit))) as archive:
                archive.extractall(tree, filter="data")
        server = subprocess.Popen(
            [sys.executable, "-m", "bench.track_server"],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            yield Version(commit, server)
        finally:
            server.kill()
            server.communicate()


def commit_of(ref: str) -> str:
    """The short name of a version's commit; UserError when there is none such."""
    if ref == ".":
        return "working tree"
    return git("rev-parse", "--short", "--verify", f"{ref}^{{commit}}").decode().strip()


def git(*arguments: str) -> bytes:
    """Output of git; UserError with its own words when it fails."""
    try:
        done = subprocess.run(["git", *arguments], capture_output=True, check=True)
    except FileNotFoundError:
        raise UserError("compare needs git") from None
    except subprocess.CalledProcessError as error:
        words = error.stderr.decode(errors="replace").strip().splitlines()
        raise UserError(f"git {' '.join(arguments[:2])}: {words[-1] if words else 'failed'}") from None
    return done.stdout
