"""What is mutated, by group, and the test files that must notice."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """A file, the test files that belong to it, and whether its kernels run uncompiled."""

    file: str
    tests: tuple[str, ...]
    uncompiled: bool = False


def _target(file: str, *tests: str, uncompiled: bool = False) -> Target:
    return Target(file, tuple(f"tests/{name}.py" for name in tests), uncompiled)


GROUPS: dict[str, tuple[Target, ...]] = {
    "metrics": (
        _target("reports/ape.py", "reports/test_golden", "reports/test_metrics"),
        _target("reports/rpe.py", "reports/test_metrics", "reports/test_golden"),
        _target("reports/align.py", "reports/test_metrics", "reports/test_golden"),
        _target("reports/association.py", "reports/test_association", "reports/test_golden"),
        _target("reports/uncertainty.py", "reports/test_uncertainty"),
    ),
    "statistics": (_target("reports/statistics.py", "reports/test_statistics"),),
    "gate": (
        _target("bench/gate.py", "bench/test_gate_verdicts", "bench/test_gate"),
        _target("bench/gate_scores.py", "bench/test_gate_verdicts", "bench/test_gate", "bench/test_gate_baseline"),
        _target("bench/gate_baseline.py", "bench/test_gate_baseline"),
    ),
    "exports": (
        _target("scenes/exports.py", "scenes/test_exports"),
        _target("scenes/bop.py", "scenes/test_exports"),
    ),
    "sensors": (
        _target("trajectories/imu.py", "trajectories/test_inertial", "trajectories/test_sensors"),
        _target("trajectories/gnss.py", "trajectories/test_gnss", "trajectories/test_sensors"),
        _target("trajectories/barometer.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"),
        _target("trajectories/flow_deck.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"),
    ),
    "noise": (
        _target("scenes/noise.py", "scenes/test_noise"),
        _target("trajectories/exact.py", "trajectories/test_exact", uncompiled=True),
        _target("trajectories/wind.py", "trajectories/test_wind"),
        _target("trajectories/dryden.py", "trajectories/test_wind"),
    ),
    "hidden lines": (
        _target("tracker/visible_edges.py", "tracker/test_visible_edges"),
        _target("tracker/occlusion_kernels.py", "tracker/test_occlusion", uncompiled=True),
    ),
    "hashing": (_target("bench/content.py", "bench/test_content"),),
}
