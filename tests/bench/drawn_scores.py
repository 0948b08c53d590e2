"""Folders of scores drawn at random, for the gate."""

import json

import numpy as np

from uavbench.reports.metrics.latency import Latency
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.reports.scoring.coverage import Tracking
from uavbench.reports.scoring.score import PoseErrors, Score


def summary(rmse):
    return ErrorSummary(rmse=rmse, mean=rmse, median=rmse, std=0.0, min=rmse, max=rmse, sse=rmse**2, n=10)


def make_score(sequence, seed, rmse, coverage=1.0, status="complete", frames="f", errors=()):
    pose = PoseErrors(translation_m=None if rmse is None else summary(rmse), rotation_deg=summary(1.0))
    track = Tracking(
        frames=100, with_pose=int(100 * coverage), coverage=coverage, success=1.0, success_auc=1.0, failures=0,
        failures_per_minute=0.0, time_to_first_loss_s=None, time_to_recover_s=None, longest_failure_s=0.0,
    )  # fmt: skip
    return Score(
        label="lsd", rate_hz=15.0, seed=seed, sequence=f"{sequence}-s{seed}", status=status, tracking=track,
        ate={"none": pose}, rpe={"1 s": pose}, latency={"total": Latency.of(np.ones(3))}, deadline_misses=0.0,
        errors=errors, record={"sequence": {"content_hash": f"{frames}{sequence}{seed}"}, "std_ddof": 0},
    )  # fmt: skip


def write(folder, scores, sequences=4, seeds=5, flights="these"):
    names = [f"s{i}-s{k}" for i in range(sequences) for k in range(seeds)]
    folder.mkdir(exist_ok=True)
    about = {"sequences": names, "trackers": ["lsd"], "rates_hz": [15.0], "flights": flights}
    (folder / "suite.json").write_text(json.dumps(about))
    for score in scores:
        score.save(folder / "results" / score.sequence / "lsd@15hz" / "score.json")
    return folder


def drawn(rng, factor=1.0, spread=0.02, sequences=4, seeds=5, **options):
    return [
        make_score(f"s{i}", k, (0.01 + 0.01 * i) * factor * np.exp(spread * rng.normal()), **options)
        for i in range(sequences)
        for k in range(seeds)
    ]
