"""`uavbench evaluate` tells of other moving axes and of another point after an alignment, of mirrors and of z down."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.trajectories.trajectory import Trajectory

T = np.arange(0, 20, 0.05)
PATH = np.column_stack([3 * np.cos(T / 4), 2 * np.sin(T / 4), 0.3 * np.sin(T)])
TURNS = Rotation.from_euler("zyx", np.column_stack([0.3 * T, 0.3 * np.sin(T), 0.2 * np.cos(2 * T)]))
RNG = np.random.default_rng(1)
NOISE_M = RNG.normal(0, 0.01, PATH.shape)
OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
Z_DOWN = Rotation.from_euler("x", 180, degrees=True)


def way(p: np.ndarray, turns: Rotation) -> Trajectory:
    return Trajectory(np.round(T * 1e9).astype(np.int64), p, turns.as_quat()[:, [3, 0, 1, 2]])


TRUTH = way(PATH, TURNS)


def told(estimate: Trajectory, align: str, truth: Trajectory = TRUTH) -> str:
    return "\n".join(evaluate_files(truth, estimate, align=align).record["doubts"])


@pytest.mark.parametrize("align", ["se3", "sim3"])
def test_poses_of_the_camera_against_those_of_the_body_are_told_after_an_alignment(align: str) -> None:
    said = told(way(PATH + NOISE_M + TURNS.apply([0.2, 0, 0.05]), TURNS * OPTICAL), align)
    assert "after the alignment the rotations" in said and "one of the camera and the other of the body" in said
    assert "moved by the same 0.2" in said


@pytest.mark.parametrize("align", ["none", "se3", "yaw", "origin"])
def test_another_point_of_the_vehicle_is_told_with_its_place(align: str) -> None:
    said = told(way(PATH + NOISE_M + TURNS.apply([0.3, -0.1, 0.05]), TURNS), align)
    x, y, z = (float(text) for text in said.partition("the same ")[2].partition(" m in")[0].split(", "))
    assert [x, y, z] == pytest.approx([0.3, -0.1, 0.05], abs=0.02)


@pytest.mark.parametrize("align", ["none", "se3", "sim3", "yaw", "origin"])
@pytest.mark.parametrize("mirrored", [PATH * [1, -1, 1], PATH[:, [1, 0, 2]], -PATH])
def test_a_mirrored_world_is_told(mirrored: np.ndarray, align: str) -> None:
    assert "in a mirror: is one world left-handed" in told(way(mirrored + NOISE_M, TURNS), align)


def test_a_world_with_z_down_is_told() -> None:
    estimate = way(Z_DOWN.apply(PATH + NOISE_M), Z_DOWN * TURNS * Z_DOWN)
    assert "would fit if world and moving axes of one file had z down" in told(estimate, "none")


@pytest.mark.parametrize("align", ["none", "se3", "yaw", "origin"])
@pytest.mark.parametrize(
    "estimate",
    [
        pytest.param(way(PATH + NOISE_M, TURNS), id="noise"),
        pytest.param(way(PATH + np.cumsum(RNG.normal(0, 0.004, PATH.shape), 0), TURNS), id="drift"),
        pytest.param(way(2 * PATH + NOISE_M, TURNS), id="another scale"),
        pytest.param(way(PATH + NOISE_M + [0.1, 0, 0.2], TURNS), id="a constant error"),
        pytest.param(way(PATH + NOISE_M / 10 + TURNS.apply([0.0, 0, 0.01]), TURNS), id="a small error of the tracker"),
    ],
)
def test_other_errors_leave_no_doubt(estimate: Trajectory, align: str) -> None:
    assert told(estimate, align) == ""


@pytest.mark.parametrize("align", ["none", "se3"])
def test_a_plane_has_no_mirror_and_one_attitude_no_other_point(align: str) -> None:
    level = Rotation.identity(len(T))
    assert told(way(PATH + NOISE_M + [0.1, 0, 0.2], level), align, way(PATH, level)) == ""
    flat = PATH * [1, 1, 0]
    assert "mirror" not in told(way(flat * [1, -1, 1], TURNS), align, way(flat, TURNS))


@pytest.mark.parametrize("align", ["none", "se3", "sim3"])
@pytest.mark.parametrize("size", [0.0, 1e-16, 1e-13, 1e-9])
def test_round_off_is_no_offset_and_no_mirror(size: float, align: str) -> None:
    """On a level circle a later pose is an earlier one turned: round-off is left, larger or smaller by chance."""
    circle = np.column_stack([np.cos(T / 4), np.sin(T / 4), 0 * T])
    turns = Rotation.from_euler("z", (T / 4)[:, None])
    for seed, scale in product(range(20), (1.0, 0.01, 0.3) if align == "sim3" else (1.0,)):
        noise_m = np.random.default_rng(seed).normal(0, size, (len(T), 3))
        assert told(way(scale * (circle + noise_m), turns), align, way(circle, turns)) == ""
