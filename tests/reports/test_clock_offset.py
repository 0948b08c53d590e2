"""`uavbench evaluate` tells of an offset between the clocks of two trajectories, and of rows that are one too far."""

from pathlib import Path

import numpy as np
import pytest

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_kitti, write_tum

T = np.arange(0, 60, 0.05)
NOISE_M = np.random.default_rng(0).normal(0, 0.002, (len(T), 3))


def flown(seconds: np.ndarray, late_s: float = 0.0, lever_m: float = 0.0) -> Trajectory:
    """A loop at stamps that are late_s beside its times, of a point lever_m ahead of the vehicle's."""
    yaw = 0.3 * seconds
    way = np.column_stack([3 * np.cos(seconds / 4), 2 * np.sin(seconds / 4), 0.3 * np.sin(seconds)])
    ahead = lever_m * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    q = np.column_stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)])
    return Trajectory(np.round((seconds + late_s) * 1e9).astype(np.int64), way + ahead, q)


def moved(way: Trajectory, by_m: np.ndarray) -> Trajectory:
    return Trajectory(way.stamps_ns, way.positions_m + by_m, way.quaternions_wxyz)


TRUTH = flown(np.arange(0, 60, 0.01))


@pytest.mark.parametrize("align", ["none", "se3", "origin"])
@pytest.mark.parametrize("late_s", [0.5, -12.0, 0.04])
def test_the_offset_of_another_clock_is_told(late_s: float, align: str) -> None:
    estimate = moved(flown(T, late_s), NOISE_M)
    found = evaluate_files(TRUTH, estimate, align=align)
    (said,) = [doubt for doubt in found.record["doubts"] if "--t-offset" in doubt]
    given_s = float(said.split("--t-offset ")[1].split(";")[0])
    assert given_s == pytest.approx(-late_s, abs=0.01)
    with_offset = evaluate_files(TRUTH, estimate, align=align, t_offset_s=given_s)
    assert with_offset.record["doubts"] == []
    assert with_offset.ate["translation_m"].rmse < 0.5 * found.ate["translation_m"].rmse
    told = evaluate_files(TRUTH, estimate, align=align, t_offset_s=1.0).record["doubts"]
    assert float(told[-1].split("--t-offset ")[1].split(";")[0]) == pytest.approx(-late_s, abs=0.01)


@pytest.mark.parametrize("align", ["none", "se3"])
@pytest.mark.parametrize(
    "estimate",
    [
        pytest.param(moved(flown(T), NOISE_M), id="noise"),
        pytest.param(moved(flown(T), NOISE_M + np.array([0.1, 0, 0])), id="a constant error"),
        pytest.param(flown(T, lever_m=0.2), id="another point of the vehicle"),
        pytest.param(moved(flown(T), np.maximum(T - 30, 0)[:, None] * [0.2, 0, 0]), id="drift"),
        pytest.param(flown(T, 0.001), id="rounded stamps"),
        pytest.param(flown(T[:10], 0.5), id="few poses"),
    ],
)
def test_other_errors_are_not_put_down_to_the_clocks(estimate: Trajectory, align: str) -> None:
    assert not any("clocks" in doubt for doubt in evaluate_files(TRUTH, estimate, align=align).record["doubts"])


def test_straight_flight_at_one_speed_is_not_put_down_to_the_clocks() -> None:
    p, still = np.column_stack([T, 0 * T, 0 * T]), np.tile([1.0, 0, 0, 0], (len(T), 1))
    way = Trajectory(np.round(T * 1e9).astype(np.int64), p, still)
    assert evaluate_files(way, moved(way, np.array([0.2, 0, 0]))).record["doubts"] == []


def test_rows_that_do_not_begin_with_the_same_frame_are_told(tmp_path: Path) -> None:
    every = flown(T)
    for name, rows in (("truth", slice(0, -2)), ("estimate", slice(2, None))):
        write_kitti(
            Trajectory(every.stamps_ns[rows], every.positions_m[rows], every.quaternions_wxyz[rows]),
            tmp_path / f"{name}.txt",
        )
    (said,) = evaluate_files(tmp_path / "truth.txt", tmp_path / "estimate.txt").record["doubts"]
    assert "rows were paired with those +2 on" in said
    assert "--t-offset" not in said
    write_tum(every, tmp_path / "truth.tum")
    write_kitti(every, tmp_path / "every.txt")
    assert evaluate_files(tmp_path / "truth.tum", tmp_path / "every.txt").record["doubts"] == []


@pytest.mark.parametrize("align", ["none", "se3"])
@pytest.mark.parametrize(("given_hz", "true_hz"), [(30.0, 20.0), (25.0, 30.0), (30.0, 15.0)])
def test_images_that_were_taken_for_ones_of_another_rate_are_told(given_hz: float, true_hz: float, align: str) -> None:
    frames = np.arange(int(60 * min(given_hz, true_hz)))
    true = flown(frames / true_hz)
    noisy = true.positions_m + np.random.default_rng(0).normal(0, 0.002, true.positions_m.shape)
    taken = Trajectory(np.round(frames / given_hz * 1e9).astype(np.int64), noisy, true.quaternions_wxyz)
    (said,) = [doubt for doubt in evaluate_files(TRUTH, taken, align=align).record["doubts"] if "--rate-hz" in doubt]
    assert f"if its stamps were {given_hz / true_hz:.4g} times as far" in said


def test_another_scale_of_a_straight_flight_is_no_other_rate() -> None:
    p, still = np.column_stack([T, 0 * T, 0 * T]), np.tile([1.0, 0, 0, 0], (len(T), 1))
    way = Trajectory(np.round(T * 1e9).astype(np.int64), p, still)
    scaled = Trajectory(way.stamps_ns, p / 1.2, still)
    assert evaluate_files(way, scaled).record["doubts"] == []


@pytest.mark.parametrize("align", ["none", "se3", "sim3"])
def test_a_vehicle_at_rest_before_and_after_its_flight_is_no_other_clock(align: str) -> None:
    """Shifted to where the vehicle rests, an alignment with scale would shrink the estimate, and all errors, to 0."""
    at = flown(T)
    rest = np.clip(np.arange(len(T)) - 400, 0, 400)
    positions_m, quaternions = at.positions_m[rest], at.quaternions_wxyz[rest]
    rng = np.random.default_rng(1)
    stamps_ns = flown(T).stamps_ns
    truth = Trajectory(stamps_ns, positions_m + rng.normal(0, 1e-5, NOISE_M.shape), quaternions)
    rough = Trajectory(stamps_ns, positions_m + rng.normal(0, 0.3, NOISE_M.shape), quaternions)
    assert evaluate_files(truth, rough, align=align).record["doubts"] == []
    late = Trajectory(stamps_ns + 800_000_000, positions_m + NOISE_M, quaternions)
    (said,) = evaluate_files(truth, late, align=align).record["doubts"]
    assert "give --t-offset -0." in said
