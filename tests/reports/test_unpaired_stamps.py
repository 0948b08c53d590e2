"""Poses that both files have, but at stamps too far apart to be paired, are told: they count against the coverage."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.trajectories.trajectory import Trajectory

SAID = "count as poses that are missing"
MOTION = "it is mostly this motion"


def circle(rate_hz: float, first_s: float = 0.0, gap_s: tuple[float, float] = (0.0, 0.0)) -> Trajectory:
    """Poses at a rate for 20 s of a circle, without those of a gap."""
    t = first_s + np.arange(0.0, 20.0, 1 / rate_hz)
    t = t[(t < gap_s[0]) | (t >= gap_s[1])]
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return Trajectory(np.rint(t * 1e9).astype(np.int64), np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), still)


@pytest.mark.parametrize("rate_hz", [30.0, 27.0])
@pytest.mark.parametrize("swapped", [False, True])
def test_rates_that_do_not_fit_are_told(rate_hz: float, swapped: bool) -> None:
    """Of 20 Hz and 30 Hz every second pose of the sparser file has its nearest one 17 ms away."""
    files = (circle(20.0), circle(rate_hz))
    first, second = files[::-1] if swapped else files
    found = evaluate_files(first, second)
    assert found.coverage < 0.6
    (said,) = [line for line in found.record["doubts"] if SAID in line]
    assert SAID in said and f"of 400 poses of the {'estimate' if swapped else 'reference'}" in said
    needed = float(said.split("--max-diff ")[1].split()[0])
    again = evaluate_files(first, second, max_difference_s=needed, association="evo-interpolated")
    assert again.coverage == pytest.approx(1.0, abs=0.01) and not again.record["doubts"]


@pytest.mark.parametrize(
    ("reference", "estimate"),
    [
        (circle(20.0), circle(20.0)),
        (circle(200.0), circle(30.0)),
        (circle(20.0), circle(40.0, first_s=0.004)),
        (circle(20.0), circle(20.0, gap_s=(3.0, 9.0))),
        (circle(20.0, gap_s=(3.0, 9.0)), circle(20.0)),
        (circle(20.0), circle(5.0)),
        (circle(20.0), circle(20.0, first_s=10.0)),
    ],
)
def test_frames_that_are_missing_leave_no_doubt(reference: Trajectory, estimate: Trajectory) -> None:
    assert not [line for line in evaluate_files(reference, estimate).record["doubts"] if SAID in line]


def test_a_difference_that_exceeds_the_limit_by_rounding_alone_is_told_with_a_larger_one() -> None:
    """Stamps 10 ms apart: as differences of seconds in 64 bits some are 0.010000000000000009."""
    first, second = circle(20.0), circle(20.0, first_s=0.01)
    (said,) = [line for line in evaluate_files(first, second).record["doubts"] if SAID in line]
    needed = float(said.split("--max-diff ")[1].split()[0])
    assert needed == pytest.approx(0.0101)
    assert evaluate_files(first, second, max_difference_s=needed).coverage == 1.0


@pytest.mark.parametrize("rate_hz", [20.0, 25.0])
def test_motion_between_the_stamps_of_pairs_is_told(rate_hz: float) -> None:
    """A true estimate whose poses are 4 ms later than those of the reference, at 1 m/s: 4 mm that are no error."""
    first, second = circle(rate_hz), circle(rate_hz, first_s=0.004)
    found = evaluate_files(first, second)
    assert found.ate["translation_m"].rmse == pytest.approx(0.004, rel=0.01)
    (said,) = [line for line in found.record["doubts"] if MOTION in line]
    assert "up to 4 ms apart" in said and "moves by 4 mm (rms)" in said
    again = evaluate_files(first, second, association="evo-interpolated")
    assert again.ate["translation_m"].rmse < 0.0006 and not again.record["doubts"]


def test_motion_that_is_little_of_the_error_and_an_offset_that_is_given_leave_no_doubt() -> None:
    first, second = circle(20.0), circle(20.0, first_s=0.004)
    noisy = Trajectory(
        second.stamps_ns,
        second.positions_m + np.random.default_rng(0).normal(0, 0.01, second.positions_m.shape),
        second.quaternions_wxyz,
    )
    late = Trajectory(first.stamps_ns + 4_000_000, first.positions_m, first.quaternions_wxyz)
    for found in (evaluate_files(first, noisy), evaluate_files(first, late, t_offset_s=-0.004)):
        assert not [line for line in found.record["doubts"] if MOTION in line]


def test_an_offset_is_taken_into_account(tmp_path: Path) -> None:
    found = evaluate_files(circle(20.0), circle(30.0, first_s=5.0), t_offset_s=-5.0)
    assert any(SAID in line for line in found.record["doubts"])


def test_the_command_tells_it(tmp_path: Path) -> None:
    for name, way in (("a.tum", circle(20.0)), ("b.tum", circle(30.0))):
        rows = zip(way.stamps_ns.tolist(), way.positions_m.tolist(), strict=True)
        (tmp_path / name).write_text("".join(f"{ns / 1e9:.9f} {x} {y} {z} 0 0 0 1\n" for ns, (x, y, z) in rows))
    done = CliRunner().invoke(main, ["evaluate", str(tmp_path / "a.tum"), str(tmp_path / "b.tum")])
    assert done.exit_code == 0 and "doubt: " in done.output and "--max-diff 0.016" in done.output, done.output


def test_the_poses_of_a_second_run_in_the_file_are_told_with_their_number() -> None:
    first, again = circle(20.0), circle(20.0)
    both = Trajectory(
        np.concatenate([first.stamps_ns, again.stamps_ns + 20_000_000_000]),
        np.concatenate([first.positions_m, again.positions_m]),
        np.concatenate([first.quaternions_wxyz, again.quaternions_wxyz]),
    )
    found = evaluate_files(first, both)
    (said,) = found.record["doubts"]
    assert "400 of 800 poses of the estimate are outside the time of the reference" in said
    assert "left out   poses of the estimate: 400 outside the time of the reference\n" in found.text()


def test_poses_that_pair_with_none_are_counted_in_the_text_without_a_doubt() -> None:
    found = evaluate_files(circle(20.0), circle(100.0))
    assert not found.record["doubts"] and found.record["pairs"] == 400
    assert found.record["left_out"] == {"outside": 3, "within": 1597}
    assert "left out   poses of the estimate: 3 outside the time of the reference, 1597 without a pair" in found.text()
    assert "left out" not in evaluate_files(circle(20.0), circle(20.0)).text()


@pytest.mark.parametrize("frames", [10, 60])
def test_images_that_were_tracked_at_another_rate_are_told(frames: int) -> None:
    """Frames of 15 Hz that were written as of 30 Hz: each pose is paired with that of another image."""
    way = circle(15.0)
    true = Trajectory(way.stamps_ns[:frames], way.positions_m[:frames], way.quaternions_wxyz[:frames])
    found = evaluate_files(true, Trajectory(true.stamps_ns // 2, true.positions_m, true.quaternions_wxyz))
    assert any("--rate-hz" in doubt for doubt in found.record["doubts"]), found.record["doubts"]
    assert not [doubt for doubt in evaluate_files(true, true).record["doubts"] if "--rate-hz" in doubt]
