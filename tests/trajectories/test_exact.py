"""The same bits whatever code NumPy and its BLAS choose for the processor."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavbench.trajectories import reproducible_math as exact

OLD_PROCESSOR = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR", "OPENBLAS_CORETYPE": "Nehalem"}
"""An x86-64 of 2008 as far as NumPy and OpenBLAS can tell; elsewhere the names mean nothing and change nothing."""
FLY = """
import hashlib
import numpy as np
from uavbench.trajectories.vehicle.registry import AIRFRAMES
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.paths.around import FigureEight, Orbit
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.wind.winds import Dryden

corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (0.0, 0.3)])
box = ObstacleMesh(corners, np.array([[0, 1, 3], [4, 6, 7], [0, 4, 5], [2, 3, 7], [0, 2, 6], [1, 5, 7]]))
digest = hashlib.sha256()
sensors = (Imu(), FlowDeck(), Barometer(), Gnss())
for path in (HandPilot(duration_s=3.0), Orbit(turns=0.2), FigureEight(loops=1)):
    flight = fly(FlightSpec(path=path, wind=Dryden(near_gain=1.0)), Mount(pitch_deg=-20.0, yaw_deg=3.0), box, 5)
    for values in (flight.positions_m, flight.quaternions_wxyz, flight.velocities_m_s, flight.accelerations_m_s2):
        digest.update(np.ascontiguousarray(values).tobytes())
    for table in measure(sensors, flight, box, 5).values():
        digest.update(np.ascontiguousarray(table.values).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_a_flight_and_its_sensors_are_the_same_on_another_processor() -> None:
    hashes = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", FLY],
            env=os.environ | env,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for env in ({}, OLD_PROCESSOR)
    ]
    assert len(hashes[0].strip()) == len(hashlib.sha256().hexdigest())
    assert hashes[0] == hashes[1]


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_functions_are_numpys_to_the_last_bits(x: float, y: float) -> None:
    for ours, theirs in [
        (exact.sin, np.sin), (exact.cos, np.cos), (exact.tan, np.tan), (exact.tanh, np.tanh), (exact.exp, np.exp),
        (exact.expm1, np.expm1),
    ]:  # fmt: skip
        np.testing.assert_allclose(ours(x), theirs(x), rtol=1e-14, atol=1e-300)
    np.testing.assert_allclose(exact.arctan2(y, x), np.arctan2(y, x), rtol=1e-14, atol=1e-300)
    np.testing.assert_allclose(exact.hypot(x, y), np.hypot(x, y), rtol=1e-14)
    np.testing.assert_allclose(exact.log(abs(x) + 1e-3), np.log(abs(x) + 1e-3), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(exact.power(abs(x) + 1e-3, y), np.power(abs(x) + 1e-3, y), rtol=1e-13)


def test_shapes_are_kept() -> None:
    x = np.arange(12.0).reshape(3, 4)
    assert exact.sin(x).shape == (3, 4)
    assert exact.sin(x.T).tolist() == exact.sin(x).T.tolist()
    assert exact.sin(1.0).shape == ()
    assert exact.arctan2(x, np.ones(4)).shape == (3, 4)


def test_products_lengths_and_inverses() -> None:
    rng = np.random.default_rng(0)
    A, B, v = rng.normal(size=(5, 3, 3)), rng.normal(size=(5, 3, 3)), rng.normal(size=3)
    np.testing.assert_allclose(exact.product(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(exact.product(A, v), A @ v, atol=1e-14)
    np.testing.assert_allclose(exact.product(A[0], B[0, :, :2]), A[0] @ B[0, :, :2], atol=1e-14)
    np.testing.assert_allclose(exact.length(A), np.linalg.norm(A, axis=-1), rtol=1e-15)
    for n in (1, 3, 4):
        M = rng.normal(size=(n, n)) - np.eye(n)[::-1] * 3
        np.testing.assert_allclose(exact.inverse(M) @ M, np.eye(n), atol=1e-12)
    np.testing.assert_array_equal(exact.inverse(np.eye(3)), np.eye(3))
    np.testing.assert_array_equal(exact.inverse(np.array([[0.0, 2.0], [4.0, 0.0]])), [[0.0, 0.25], [0.5, 0.0]])
    for singular in (np.ones((3, 3)), 2 * np.ones((2, 2)), np.zeros((1, 1))):
        with pytest.raises(ValueError, match="singular"):
            exact.inverse(singular)


def test_a_small_pivot_costs_no_accuracy() -> None:
    """Without the greatest of its column as pivot, 1e-17 would leave nothing of what stands below it."""
    M = np.array([[1e-17, 1.0, 2.0], [1.0, 1.0, 1.0], [3.0, 1.0, 7.0]])
    np.testing.assert_allclose(exact.inverse(M) @ M, np.eye(3), atol=1e-12)
