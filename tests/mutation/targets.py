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
        _target("reports/metrics/ape.py", "reports/test_golden", "reports/test_metrics"),
        _target("reports/metrics/rpe.py", "reports/test_metrics", "reports/test_golden"),
        _target("reports/metrics/align.py", "reports/test_metrics", "reports/test_golden"),
        _target("reports/metrics/association.py", "reports/test_association", "reports/test_golden"),
        _target("reports/uncertainty/nees.py", "reports/test_uncertainty"),
        _target("reports/uncertainty/consistency.py", "reports/test_uncertainty", "reports/test_pose_nees"),
        _target("reports/uncertainty/pose_nees.py", "reports/test_pose_nees"),
        _target("reports/metrics/straight_line.py", "reports/test_straight_line"),
        *(_target(f"reports/many_runs/{name}.py", "reports/test_many_runs") for name in ("groups", "curves")),
    ),
    "statistics": (_target("reports/statistics/bootstrap.py", "reports/test_statistics"),),
    "gate": (
        _target("bench/gate/decision.py", "bench/test_gate_verdicts", "bench/test_gate"),
        _target(
            "bench/gate/paired_scores.py", "bench/test_gate_verdicts", "bench/test_gate", "bench/test_gate_baseline"
        ),
        _target("bench/gate/baseline.py", "bench/test_gate_baseline"),
    ),
    "exports": (
        *(
            _target(f"scenes/exports/{name}.py", "scenes/test_exports", "scenes/test_exports_by_own_readers")
            for name in ("registry", "euroc", "bop", "notes")
        ),
        *(
            _target(f"scenes/exports/{name}.py", "scenes/test_reconstruction_exports")
            for name in ("colmap", "nerfstudio", "surface_points")
        ),
    ),
    "sensors": (
        _target("trajectories/sensors/imu.py", "trajectories/test_inertial", "trajectories/test_sensors"),
        _target("trajectories/sensors/gnss.py", "trajectories/test_gnss", "trajectories/test_sensors"),
        _target("trajectories/sensors/barometer.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"),
        _target(
            "trajectories/sensors/optical_flow.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"
        ),
    ),
    "noise": (
        _target("scenes/materials/procedural_texture.py", "scenes/test_noise"),
        _target("trajectories/reproducible_math.py", "trajectories/test_exact", uncompiled=True),
        _target("trajectories/wind/winds.py", "trajectories/test_wind"),
        _target("trajectories/wind/dryden.py", "trajectories/test_wind"),
    ),
    "hidden lines": (
        _target("tracker/visible_edges.py", "tracker/test_visible_edges", "scenes/test_hidden_lines"),
        _target("tracker/robust/edges/hidden_line_kernels.py", "tracker/test_occlusion", uncompiled=True),
    ),
    "hashing": (_target("bench/inputs/content_hash.py", "bench/test_content", "bench/test_content_hash"),),
}
