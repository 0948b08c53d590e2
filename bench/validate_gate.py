"""How often the gate is wrong, from real reruns: `python -m bench.validate_gate SUITE_FOLDER --out DIR`.

SUITE_FOLDER holds rendered sequences (`uavbench render gate`). A tracker runs on each of them `--reruns` times, each
time with another stream of random numbers. A comparison takes two different reruns of every sequence and seed: one for
the baseline, one for the results. Both are of the same code, so whatever the gate calls worse is a false alarm. A
regression is injected by moving every estimate of the results away from the truth: its error, as a twist, times a
factor. All scores go through the same scoring and the same gate as anyone's.
"""

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import click
import numpy as np

from bench.config import load_suite, suite_file
from bench.gate import Finding, Margins, compare_sides, overall
from bench.gate_scores import Key, Side
from reports.score import Score, score
from scenes.sequence import Sequence
from tracker.base import Tracker
from tracker.results import Results
from tracker.run import track_sequence
from trajectories.files import write_text
from trajectories.pose import Pose
from trajectories.streams import stream

FACTORS = (1.0, 1.05, 1.10)


def rerun(tracker: Tracker, label: str, folder: Path, rate_hz: float, seed: int, reruns: int, out: Path) -> None:
    """Write the scores of the reruns of one sequence, plain and with each regression injected; what is there stays."""
    sequence = Sequence.load(folder)
    for number in range(reruns):
        paths = [out / folder.name / f"{number}-{factor}.json" for factor in FACTORS]
        if all(path.exists() for path in paths):
            continue
        results = track_sequence(tracker, sequence, rate_hz=rate_hz, seed=1000 * seed + number)
        results = replace(results, record={**results.record, "seed": seed, "label": label})
        for factor, path in zip(FACTORS, paths, strict=True):
            score(sequence, worsened(results, sequence, factor)).save(path)


def worsened(results: Results, sequence: Sequence, factor: float) -> Results:
    """The results with each estimate's error, as a twist from the truth, times a factor."""
    if factor == 1.0:
        return results
    rows = []
    for frame, row in zip(results.frames.tolist(), results.rows, strict=True):
        truth = sequence.true_cam_from_world(frame)
        if row.cam_from_world is not None:
            error = (row.cam_from_world @ truth.inverse()).log()
            row = replace(row, cam_from_world=Pose.exp(factor * error) @ truth)
        rows.append(row)
    return replace(results, rows=tuple(rows))


def comparison(
    scores: dict[Key, list[dict[float, Score]]], factor: float, rng: np.random.Generator, margins: Margins
) -> list[Finding]:
    """Findings of one comparison of two different reruns of everything."""
    base: dict[Key, Score] = {}
    head: dict[Key, Score] = {}
    for key, reruns in scores.items():
        one, other = rng.choice(len(reruns), size=2, replace=False)
        base[key], head[key] = reruns[one][1.0], reruns[other][factor]
    return compare_sides(Side(base, {}), Side(head, {}), {}, margins)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
@click.option("--suite", default="gate", show_default=True)
@click.option("--tracker", "label", default="lsd", show_default=True, help="Label in the suite.")
@click.option("--reruns", default=12, show_default=True, help="Runs of the tracker on each sequence.")
@click.option("--comparisons", default=400, show_default=True, help="For each factor.")
@click.option("--margin", default=0.01, show_default=True)
@click.option("--jobs", default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True)
def main(
    folder: Path, suite: str, label: str, reruns: int, comparisons: int, margin: float, jobs: int, out: Path
) -> None:
    """Run the tracker as often as needed, then say how often the gate calls what."""
    loaded = load_suite(suite_file(suite))
    tracker, rate_hz = loaded.trackers[label], loaded.rates_hz[0]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        tasks = [
            pool.submit(rerun, tracker, label, folder / "sequences" / s.name, rate_hz, s.seed, reruns, out)
            for s in loaded.sequences
        ]
        for task in tasks:
            task.result()
    scores: dict[Key, list[dict[float, Score]]] = {}
    for spec in loaded.sequences:
        read = [{f: Score.load(out / spec.name / f"{n}-{f}.json") for f in FACTORS} for n in range(reruns)]
        scores[read[0][1.0].run, spec.name.rpartition("-s")[0], spec.seed] = read
    margins = Margins(error=margin)
    shares: dict[str, dict[str, float]] = {}
    for factor in FACTORS:
        rng = stream(0, "validate-gate", str(factor))
        made = [comparison(scores, factor, rng, margins) for _ in range(comparisons)]
        verdicts = [overall(findings) for findings in made]
        share = {verdict: verdicts.count(verdict) / comparisons for verdict in ("pass", "fail", "inconclusive")}
        for metric in dict.fromkeys(finding.metric for finding in made[0]):
            changes = [f.change for findings in made for f in findings if f.metric == metric]
            share[f"std of the change, {metric}"] = float(np.std(changes))
            failed = sum(f.verdict == "fail" for findings in made for f in findings if f.metric == metric)
            share[f"fail, {metric}"] = failed / comparisons
        shares[str(factor)] = share
        click.echo(f"x {factor:.2f}: " + ", ".join(f"{name} {value:.4g}" for name, value in share.items()))
    about = {"reruns": reruns * len(scores), "comparisons": comparisons, "margin": margin, "share": shares}
    write_text(out / "validation.json", json.dumps(about, indent=1) + "\n")


if __name__ == "__main__":
    main()
