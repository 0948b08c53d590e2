"""Mistakes that both files share, so that they agree with each other: the order of quaternions, the unit of stamps."""

from pathlib import Path

import numpy as np
import pytest

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.trajectories.trajectory import Trajectory

ORDER = "no line that names their columns"
UNIT = "in another unit than that of their format"


def rows(seed: int, order: str = "xyzw", unit: float = 1e9, step_s: float = 0.05, decimals: int = 0) -> str:
    """Poses of one flight with noise of a seed; the stamps count 1 / unit s from a late epoch."""
    rng, t = np.random.default_rng(seed), np.arange(200)
    q = np.column_stack([np.cos(t / 90), 0.5 * np.sin(t / 90), 0.6 * np.sin(t / 90), np.sin(t / 90)])
    q += rng.normal(0, 0.01, q.shape)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    p = np.column_stack([np.cos(t / 30), np.sin(t / 40), t / 100]) + rng.normal(0, 0.02, (200, 3))
    text = ""
    for k in range(200):
        cells = [f"{(1000 + step_s * k) * unit:.{decimals}f}", *(f"{v:.9f}" for v in p[k])]
        text += " ".join([*cells, *(f"{q[k]['wxyz'.index(c)]:.9f}" for c in order)]) + "\n"
    return text


def doubts(folder: Path, first: str, second: str, **options: str) -> list[str]:
    (folder / "truth.txt").write_text(first)
    (folder / "run.txt").write_text(second)
    return evaluate_files(folder / "truth.txt", folder / "run.txt", **options).record["doubts"]


def test_files_that_both_leave_the_order_of_quaternions_open_are_doubted(tmp_path: Path) -> None:
    """Read w first, files that are w last have the right angles between them, and wrong motions."""
    (found,) = doubts(tmp_path, rows(0), rows(1))
    assert ORDER in found and "rotations and RPE are wrong" in found
    read = evaluate_files(tmp_path / "truth.txt", tmp_path / "run.txt")
    first, second = (tmp_path / name for name in ("truth.tum", "run.tum"))
    first.write_text(rows(0, unit=1.0, decimals=9))
    second.write_text(rows(1, unit=1.0, decimals=9))
    right = evaluate_files(first, second)
    assert read.ate["rotation_deg"].rmse == pytest.approx(right.ate["rotation_deg"].rmse, rel=1e-6)
    assert read.rpe and right.rpe
    assert read.rpe["translation_m"].rmse != pytest.approx(right.rpe["translation_m"].rmse, rel=1e-5)
    assert not right.record["doubts"]


def test_an_order_that_is_told_is_not_doubted(tmp_path: Path) -> None:
    head = "#timestamp x y z qw qx qy qz\n"
    one, other = rows(0, "wxyz"), rows(1, "wxyz")
    assert not doubts(tmp_path, head + one, other)
    assert not doubts(tmp_path, one, head + other)
    assert not doubts(tmp_path, one, other, reference_format="euroc")
    assert not doubts(tmp_path, one, other, estimate_format="euroc")


@pytest.mark.parametrize(
    ("unit", "decimals", "step_s"), [(1e6, 0, 0.05), (1e6, 0, 0.1), (1e3, 0, 0.05), (1e3, 3, 0.05)]
)
def test_stamps_of_both_in_another_unit_are_doubted(tmp_path: Path, unit: float, decimals: int, step_s: float) -> None:
    """Milli- and microseconds: of EuRoC 50 us apart or less, of TUM 50 s apart."""
    first, second = (rows(seed, "xyzw", unit, step_s, decimals) for seed in (0, 1))
    assert any(UNIT in line for line in doubts(tmp_path, first, second))


@pytest.mark.parametrize(("unit", "decimals", "step_s"), [(1.0, 9, 0.001), (1.0, 9, 2.0), (1.0, 9, 0.05)])
def test_usual_rates_are_not_doubted(tmp_path: Path, unit: float, decimals: int, step_s: float) -> None:
    first, second = (rows(seed, "xyzw", unit, step_s, decimals) for seed in (0, 1))
    assert not any(UNIT in line for line in doubts(tmp_path, first, second))


def test_one_pose_has_no_rate(tmp_path: Path) -> None:
    line = rows(0, unit=1.0, decimals=9).splitlines()[0]
    assert not any(UNIT in each for each in doubts(tmp_path, line, line))


def test_arrays_have_an_order(tmp_path: Path) -> None:
    text = rows(0, unit=1.0, decimals=9)
    table = np.array([line.split() for line in text.splitlines()], dtype=float)
    way = Trajectory(np.rint(table[:, 0] * 1e9).astype(np.int64), table[:, 1:4], table[:, [7, 4, 5, 6]])
    assert not evaluate_files(way, way).record["doubts"]
