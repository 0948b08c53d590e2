"""Speed of flight simulation: seconds of flight per second of one core.

`pytest bench/speed/test_speed_trajectories.py --benchmark-only`; the last one uses every core.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.around import Hover, Orbit
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.wind.winds import Dryden

CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (0.0, 0.3)])
BOX = ObstacleMesh(CORNERS, np.array([[0, 1, 3], [4, 6, 7], [0, 4, 5], [2, 3, 7], [0, 2, 6], [1, 5, 7]]))
WINDY = FlightSpec(path=Hover(duration_s=60.0), wind=Dryden())
COUNT = 24


def whole_flight(seed: int, spec: FlightSpec = WINDY) -> float:
    """Fly and measure; the duration of the flight in s."""
    flight = fly(spec, Mount(), BOX, seed)
    measure((Imu(),), flight, BOX, seed)
    return float(flight.stamps_ns[-1]) / 1e9


def test_a_minute_with_wind_and_imu(benchmark: Any) -> None:
    """Controller, Dryden wind and IMU on one core."""
    whole_flight(0)
    benchmark.pedantic(whole_flight, args=(0,), rounds=5)
    benchmark.extra_info["times_real_time"] = 60.0 / benchmark.stats.stats.min


def test_a_minute_near_a_structure(benchmark: Any) -> None:
    """The same on an orbit with turbulence that grows near the structure."""
    spec = FlightSpec(path=Orbit(turns=2.0), wind=Dryden(near_gain=1.0))
    seconds = whole_flight(0, spec)
    benchmark.pedantic(whole_flight, args=(0, spec), rounds=5)
    benchmark.extra_info["times_real_time"] = seconds / benchmark.stats.stats.min


def test_a_hand_flown_flight(benchmark: Any) -> None:
    """The flight of suite `paper`, without its images."""
    spec = FlightSpec(path=HandPilot(duration_s=40.0))
    whole_flight(0, spec)
    benchmark.pedantic(whole_flight, args=(0, spec), rounds=5)
    benchmark.extra_info["times_real_time"] = 40.0 / benchmark.stats.stats.min


def test_many_flights_on_every_core(benchmark: Any) -> None:
    """Flights of one minute on all cores, extrapolated to a thousand of them."""
    cores = len(os.sched_getaffinity(0))
    whole_flight(0)
    with ProcessPoolExecutor(cores) as pool:
        list(pool.map(whole_flight, range(cores)))

        def fly_many() -> float:
            start = time.perf_counter()
            list(pool.map(whole_flight, range(COUNT)))
            return time.perf_counter() - start

        seconds = benchmark.pedantic(fly_many, rounds=2)
    benchmark.extra_info["cores"] = cores
    benchmark.extra_info["thousand_flights_minutes"] = seconds / COUNT * 1000 / 60
