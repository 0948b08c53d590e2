"""Error rates of the gate, from real reruns: `python -m uavbench.bench.gate.validation SUITE_FOLDER --out DIR`.

SUITE_FOLDER holds rendered sequences (`uavbench render gate`). Every tracker of the suite runs on each of them
`--reruns` times, each time with another random stream and, with --new-noise, other camera noise added to each frame. A
comparison uses two different reruns of every tracker, sequence and seed, one for the baseline and one for the results.
Both are of the same code, so every failure is a false alarm. Then a regression is injected into one tracker's results:
the error of every estimate, as a twist, is multiplied by a factor; or, with --worse LABEL.PARAMETER=VALUE, by real runs
with a worse setting, whose true effect is measured over all reruns. Scoring and gate are those that users run.
"""

import json
import math
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import numpy as np

from uavbench.bench.config.suite import Suite, load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.gate.decision import Finding, Margins, compare_sides, overall
from uavbench.bench.gate.paired_scores import ERRORS, Key, Measured, Side
from uavbench.bench.said import say
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Image, Tracker
from uavbench.tracker.results import Results
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

VALIDATION = "validation of the gate"
FACTORS = (1.05, 1.10)
Scores = dict[str, dict[Key, list[Measured]]]
"""Name of a variant -> measured values of the reruns of each tracker, sequence and seed."""


@dataclass(frozen=True)
class Variant:
    """A tracker of the suite, with one worse parameter (`setting`) or unchanged ("")."""

    label: str
    tracker: Tracker
    reruns: int
    setting: str = ""

    @property
    def name(self) -> str:
        """`lsd`, `lsd inlier_px=2`."""
        return f"{self.label} {self.setting}".strip()


@dataclass(frozen=True, eq=False)
class NewNoise(Sequence):
    """A sequence with Gaussian noise of sigma grey levels added to each frame, another draw for each rerun."""

    rerun: int = 0
    sigma: float = 0.0

    def image(self, frame: int) -> Image:
        """BGR image (h, w, 3) with its new noise."""
        image = super().image(frame)
        noise = stream(self.rerun, "validate-gate", "noise", str(frame)).normal(0.0, self.sigma, image.shape)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def rerun(variant: Variant, folder: Path, rate_hz: float, seed: int, sigma: float, out: Path) -> None:
    """Write the missing scores of the reruns of one sequence, plain and with each regression injected."""
    sequence = Sequence.load(folder)
    parts = (sequence.folder, sequence.info, sequence.camera, sequence.structure, sequence.stamps_ns, sequence.files)
    for number in range(variant.reruns):
        factors = (1.0,) if variant.setting else (1.0, *FACTORS)
        paths = [score_path(out, folder.name, worse_by(variant.name, factor), number) for factor in factors]
        if all(path.exists() for path in paths):
            continue
        seen = NewNoise(*parts, rerun=number, sigma=sigma) if sigma else sequence
        results = track_sequence(variant.tracker, seen, rate_hz=rate_hz, seed=1000 * seed + number)
        results = replace(results, record={**results.record, "seed": seed, "label": variant.label})
        for factor, path in zip(factors, paths, strict=True):
            score(sequence, worsened(results, sequence, factor)).save(path)


def worse_by(name: str, factor: float) -> str:
    """Name of a variant whose errors were multiplied."""
    return name if factor == 1.0 else f"{name} +{factor - 1:.0%}"


def score_path(out: Path, sequence: str, name: str, number: int) -> Path:
    """File of the score of one rerun."""
    return out / "scores" / sequence / name / f"{number}.json"


def worsened(results: Results, sequence: Sequence, factor: float) -> Results:
    """The results with each estimate's error, as a twist from the ground truth, times a factor."""
    if factor == 1.0:
        return results
    rows = []
    for frame, row in zip(results.frames.tolist(), results.rows, strict=True):
        ground_truth = sequence.true_cam_from_world(frame)
        if row.cam_from_world is not None:
            error = (row.cam_from_world @ ground_truth.inverse()).log()
            row = replace(row, cam_from_world=Pose.exp(factor * error) @ ground_truth)
        rows.append(row)
    return replace(results, rows=tuple(rows))


def variants(suite: Suite, reruns: int, worse: tuple[str, ...]) -> list[Variant]:
    """The suite's trackers, and those with a worse setting, which run half as often; UserError on a wrong setting."""
    found = [Variant(label, tracker, reruns) for label, tracker in suite.trackers.items()]
    for word in worse:
        label, _, setting = word.partition(".")
        parameter, _, value = setting.partition("=")
        try:
            tracker = suite.trackers[label]
            changed = {parameter: type(getattr(tracker, parameter))(value)}
        except (KeyError, AttributeError, ValueError) as error:
            raise UserError(
                f"--worse {word}: write LABEL.PARAMETER=VALUE of a tracker of the suite ({error})"
            ) from None
        found.append(Variant(label, replace(tracker, **changed), -(-reruns // 2), setting))  # type: ignore[type-var]
    return found


def run_all(suite: Suite, folder: Path, every: list[Variant], sigma: float, jobs: int, out: Path) -> None:
    """Run all reruns that have no score yet."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        tasks = [
            pool.submit(rerun, v, folder / "sequences" / s.name, suite.rates_hz[0], s.seed, sigma, out)
            for s in suite.sequences
            for v in every
        ]
        for task in tasks:
            task.result()


def read_all(suite: Suite, every: list[Variant], out: Path) -> Scores:
    """All scores, by variant."""
    found: Scores = {}
    for variant in every:
        for name in [variant.name] + [worse_by(variant.name, f) for f in FACTORS if not variant.setting]:
            found[name] = {
                (f"{variant.label}@{suite.rates_hz[0]:g}hz", spec.name.rpartition("-s")[0], spec.seed): [
                    Measured.of(Score.load(score_path(out, spec.name, name, number)))
                    for number in range(variant.reruns)
                ]
                for spec in suite.sequences
            }
    return found


def comparison(scores: Scores, labels: list[str], changed: str, rng: np.random.Generator, m: Margins) -> list[Finding]:
    """Findings of one comparison of different reruns of everything, with one tracker's results of the variant changed.

    With "" nothing is changed.
    """
    base: dict[Key, Measured] = {}
    head: dict[Key, Measured] = {}
    for label in labels:
        others = scores[changed] if changed.split(" ")[0] == label else scores[label]
        for key, reruns in scores[label].items():
            one = int(rng.integers(len(reruns)))
            free = [k for k in range(len(others[key])) if k != one] or [0]
            base[key], head[key] = reruns[one], others[key][free[int(rng.integers(len(free)))]]
    return compare_sides(Side(base), Side(head), {}, m)


def true_changes(scores: Scores, label: str, changed: str) -> dict[str, float]:
    """By metric: the change of its geometric mean over all sequences, from all reruns."""
    found = {}
    for metric in ERRORS:
        logs = [
            np.mean([math.log(one.errors[metric]) for one in scores[changed][key]])
            - np.mean([math.log(one.errors[metric]) for one in scores[label][key]])
            for key in scores[label]
        ]
        found[metric] = math.expm1(float(np.mean(logs)))
    return found


def measured(scores: Scores, labels: list[str], changed: str, comparisons: int, margins: Margins) -> dict[str, float]:
    """Shares of the verdicts over many comparisons, and the true changes."""
    rng = stream(0, "validate-gate", changed)
    verdicts = [overall(comparison(scores, labels, changed, rng, margins)) for _ in range(comparisons)]
    shares = {verdict: verdicts.count(verdict) / comparisons for verdict in ("pass", "inconclusive", "fail")}
    return {
        **shares,
        **(true_changes(scores, changed.split(" ")[0], changed) if changed else dict.fromkeys(ERRORS, 0.0)),
    }


def table(rows: Mapping[str, Mapping[str, float]]) -> str:
    """Markdown table of the measured rates."""
    lines = ["| changed | " + " | ".join(f"true change of {m}" for m in ERRORS) + " | pass | inconclusive | fail |"]
    lines.append("|---" * (len(ERRORS) + 4) + "|")
    for name, row in rows.items():
        cells = [f"{row[m]:+.1%}" for m in ERRORS] + [f"{row[v]:.1%}" for v in ("pass", "inconclusive", "fail")]
        lines.append(f"| {name or 'nothing'} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Trial:
    """Parameters of the validation.

    reruns: of each tracker on each sequence; new_noise: sigma in grey levels of the noise added in each; comparisons:
    for each change, by a gate of this margin.
    """

    reruns: int
    new_noise: float
    comparisons: int
    margin: float


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
@click.option("--suite", default="gate", show_default=True)
@click.option(
    "--reruns", type=click.IntRange(2), default=6, show_default=True, help="Runs of each tracker on each sequence."
)
@click.option("--worse", multiple=True, metavar="LABEL.PARAMETER=VALUE", help="A setting that the gate should detect.")
@click.option("--new-noise", default=0.0, show_default=True, help="Additional camera noise, in grey levels.")
@click.option("--comparisons", default=1000, show_default=True, help="For each change.")
@click.option("--margin", default=0.01, show_default=True)
@click.option("--jobs", default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True)
def main(folder: Path, suite: str, worse: tuple[str, ...], jobs: int, out: Path, **numbers: Any) -> None:
    """Run the missing reruns, then print the rates of the gate's verdicts."""
    trial = Trial(**numbers)
    try:
        loaded = load_suite(suite_file(suite))
        every = variants(loaded, trial.reruns, worse)
    except UserError as error:
        raise click.ClickException(str(error)) from None
    run_all(loaded, folder, every, trial.new_noise, jobs, out)
    scores = read_all(loaded, every, out)
    labels = list(loaded.trackers)
    rows = {}
    for changed in ["", *(name for name in scores if name not in labels)]:
        rows[changed] = measured(scores, labels, changed, trial.comparisons, Margins(error=trial.margin))
        say(table({changed: rows[changed]}).splitlines()[-1])
    write_text(out / "validation.md", table(rows), kind=VALIDATION)
    text = json.dumps({**asdict(trial), "measured": rows}, indent=1)
    write_text(out / "validation.json", f"{text}\n", kind=VALIDATION)


if __name__ == "__main__":
    main()
