"""Time to score trajectories, and to score, bootstrap and plot a whole study."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uavbench.bench.speed.drawn import make_sequence, results_of, true_rows
from uavbench.bench.speed.rounds import absent
from uavbench.reports.evaluation.evaluation import evaluate
from uavbench.reports.evaluation.options import Options
from uavbench.reports.figures.ranking import critical_difference, win_table
from uavbench.reports.report import ReportInputs, write_report
from uavbench.reports.scoring.runs import ReportEntry
from uavbench.reports.scoring.score import score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.statistics.bootstrap import compare_pairs, ranks
from uavbench.reports.style import house_style
from uavbench.reports.tables.summary_table import summary_table
from uavbench.reports.tables.writers import write_tables
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory

POSES = 100_000


def pair(n: int = POSES) -> tuple[Trajectory, Trajectory]:
    """An orbit at 100 Hz, and an estimate of it with noise, jittered stamps and 5 % of its poses dropped."""
    rng = np.random.default_rng(0)
    stamps = np.arange(n) * 10_000_000
    s = stamps / 1e9
    p = np.column_stack([4 * np.cos(0.2 * s), 4 * np.sin(0.2 * s), 2 + 0.3 * np.sin(0.9 * s)])
    q = np.column_stack([np.cos(0.1 * s), 0 * s, 0.1 * np.sin(0.3 * s), np.sin(0.1 * s)])
    q /= np.linalg.norm(q, axis=1)[:, None]
    q_noisy = q + rng.normal(0, 0.003, q.shape)
    q_noisy /= np.linalg.norm(q_noisy, axis=1)[:, None]
    kept = rng.random(n) > 0.05
    jittered = stamps + rng.integers(-1_000_000, 1_000_000, n)
    estimate = Trajectory(jittered[kept], (p + rng.normal(0, 0.01, p.shape))[kept], q_noisy[kept])
    return Trajectory(stamps, p, q), estimate


@pytest.mark.parametrize("align", ["none", "se3"])
def test_ate_and_rpe_with_association(benchmark: Any, align: Any) -> None:
    """Association, ATE and RPE of translation and rotation."""
    reference, estimate = pair()
    found = benchmark.pedantic(evaluate, (reference, estimate, Options(align=align)), rounds=9, warmup_rounds=1)
    assert found.ate["translation_m"].n > 0.94 * POSES


def test_evo_on_the_same_poses(benchmark: Any) -> None:
    """The oracle evo on the same poses, with equal results: association, APE and RPE of translation and rotation."""
    if importlib.util.find_spec("evo") is None:
        absent(benchmark, "evo, which is not installed")
        return
    metrics, sync, poses = (importlib.import_module(f"evo.core.{name}") for name in ("metrics", "sync", "trajectory"))

    def run() -> list[float]:
        both = [poses.PoseTrajectory3D(t.positions_m, t.quaternions_wxyz, t.stamps_ns / 1e9) for t in pair()]
        matched = sync.associate_trajectories(*both, max_diff=0.01)
        rmse = []
        for relation in (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg):
            for metric in (metrics.APE(relation), metrics.RPE(relation, delta=1, delta_unit=metrics.Unit.frames)):
                metric.process_data(matched)
                rmse.append(float(metric.get_statistic(metrics.StatisticsType.rmse)))
        return rmse

    ape_m, rpe_m, ape_deg, rpe_deg = benchmark.pedantic(run, rounds=1)
    ours = evaluate(*pair(), Options(association="evo"))
    assert ours.rpe is not None
    found = [ours.ate["translation_m"], ours.rpe["translation_m"], ours.ate["rotation_deg"], ours.rpe["rotation_deg"]]
    np.testing.assert_allclose([f.rmse for f in found], [ape_m, rpe_m, ape_deg, rpe_deg], rtol=1e-9)


def test_a_study_scored_bootstrapped_and_plotted(benchmark: Any, tmp_path: Path) -> None:
    """20 sequences x 10 seeds x 6 trackers: all runs scored, a table with intervals, ranks and wins plotted."""
    sequence = make_sequence(tmp_path / "arc", 60)
    rng = np.random.default_rng(0)
    true = true_rows(sequence)
    runs = []
    for k in range(6):
        for number in range(20):
            for seed in range(10):
                rows = [_noisy(row, rng, 0.01 * (k + 1)) for row in true]
                made = results_of(sequence, rows)
                runs.append((f"tracker-{k}", f"sequence-{number}", seed, made))

    def study() -> None:
        scored = []
        for label, name, seed, results in runs:
            found = replace(score(sequence, results), label=label, sequence=name, seed=seed)
            scored.append(found)
        write_tables(summary_table(score_frame(s.to_json() for s in scored)), tmp_path / "summary")
        names = list(dict.fromkeys(s.run for s in scored))
        values = {
            name: [
                np.array(
                    [1 - s.tracking.success_auc for s in scored if s.run == name and s.sequence == f"sequence-{q}"]
                )
                for q in range(20)
            ]
            for name in names
        }
        colours = {name: k for k, name in enumerate(names)}
        with house_style():
            flat = {name: np.concatenate(v) for name, v in values.items()}
            critical_difference(ranks(flat), colours, tmp_path / "ranks", "area over the success curve")
            win_table(names, compare_pairs(values), tmp_path / "wins", "area over the success curve")

    benchmark.pedantic(study, rounds=1)
    assert (tmp_path / "wins.pdf").exists()


def test_a_report_of_240_runs(benchmark: Any, tmp_path: Path) -> None:
    """10 flights x 4 seeds x 3 trackers x 2 rates, from files to the page."""
    entries = write_study(tmp_path, flights=10, seeds=4, trackers=3)
    assert len(entries) == 240
    benchmark.pedantic(write_report, (tmp_path / "report", ReportInputs("240 runs", entries)), rounds=1)
    assert (tmp_path / "report" / "index.html").exists()


def test_a_report_of_one_flight_of_40_s(benchmark: Any, tmp_path: Path) -> None:
    """One flight of 600 frames x 4 trackers x 2 rates, as in the demo."""
    entries = write_study(tmp_path, flights=1, seeds=1, trackers=4, frames=600)
    benchmark.pedantic(write_report, (tmp_path / "report", ReportInputs("one flight", entries)), rounds=1)
    assert (tmp_path / "report" / "index.html").exists()


def write_study(folder: Path, *, flights: int, seeds: int, trackers: int, frames: int = 45) -> list[ReportEntry]:
    """Sequences, results at 15 and 1 Hz of trackers with different noise, and scores, in the folders of a suite."""
    rng = np.random.default_rng(0)
    entries = []
    for flight in range(flights):
        for seed in range(seeds):
            name = f"flight{flight}-s{seed}"
            sequence = make_sequence(folder / "sequences" / name, frames, name=name, seed=seed)
            true = true_rows(sequence)
            for k in range(trackers):
                for rate_hz in (15.0, 1.0):
                    rows = [_noisy(row, rng, 0.01 * (k + 1)) for row in true[:: round(15 / rate_hz)]]
                    made = results_of(sequence, rows, rate_hz)
                    made = replace(made, record={**made.record, "label": f"tracker-{k}", "seed": seed})
                    out = folder / "results" / name / f"tracker-{k}@{rate_hz:g}hz"
                    made.save(out)
                    score(sequence, made).save(out / "score.json")
                    entries.append(ReportEntry(sequence.folder, out, out / "score.json"))
    return entries


def _noisy(row: TrackResult, rng: np.random.Generator, sigma_m: float) -> TrackResult:
    assert row.cam_from_world is not None
    moved = Pose(np.eye(3), rng.normal(0, sigma_m, 3)) @ row.cam_from_world
    return TrackResult(status="ok", cam_from_world=moved, stage_ms={"total": 5.0})
