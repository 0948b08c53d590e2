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
        _target(
            "reports/metrics/align.py", "reports/test_metrics", "reports/test_straight_line", "reports/test_golden"
        ),
        _target("reports/metrics/association.py", "reports/test_association", "reports/test_golden"),
        _target("reports/uncertainty/nees.py", "reports/test_uncertainty"),
        _target("reports/uncertainty/consistency.py", "reports/test_uncertainty", "reports/test_pose_nees"),
        _target("reports/uncertainty/pose_nees.py", "reports/test_pose_nees"),
        _target(
            "reports/uncertainty/whitened_errors.py",
            "reports/test_whitened_errors",
            "reports/test_uncertainty",
            "reports/test_pose_nees",
        ),
        _target("reports/metrics/straight_line.py", "reports/test_straight_line"),
        *(_target(f"reports/many_runs/{name}.py", "reports/test_many_runs") for name in ("groups", "curves")),
        _target("reports/metrics/model_space.py", "reports/test_model_space"),
        _target("reports/metrics/sub_trajectories.py", "reports/test_sub_trajectories", "reports/test_golden"),
        _target("reports/metrics/quaternions.py", "reports/test_quaternions", "reports/test_metrics"),
        _target("reports/metrics/latency.py", "reports/test_tracking_and_latency"),
        _target("reports/scoring/coverage.py", "reports/test_tracking_and_latency", "reports/test_score"),
        _target("reports/closed_loop/measures.py", "reports/test_flight_score"),
        _target("reports/closed_loop/coverage.py", "reports/test_closed_loop_measures"),
    ),
    "statistics": (
        _target("reports/statistics/bootstrap.py", "reports/test_statistics"),
        _target("reports/statistics/losses.py", "reports/test_losses"),
        _target("reports/statistics/student.py", "reports/test_student"),
        _target("reports/statistics/proportion.py", "reports/test_closed_loop_measures"),
        _target("reports/statistics/repeats.py", "reports/test_repeats"),
        _target("reports/history/change_points.py", "reports/test_change_points"),
        _target("reports/history/evidence.py", "reports/test_change_points"),
        _target("reports/history/trend.py", "reports/test_change_points"),
    ),
    "gate": (
        _target("bench/gate/decision.py", "bench/test_gate_verdicts", "bench/test_gate"),
        _target(
            "bench/gate/paired_scores.py", "bench/test_gate_verdicts", "bench/test_gate", "bench/test_gate_baseline"
        ),
        _target("bench/gate/baseline.py", "bench/test_gate_baseline"),
    ),
    "own images": tuple(
        _target(
            f"bench/own_images/{name}.py",
            "bench/test_own_images",
            "bench/test_plausible_poses",
            "bench/test_import_command",
        )
        for name in ("conventions", "import_sequence", "plausible_poses", "true_poses")
    ),
    "exports": (
        *(
            _target(
                f"scenes/exports/{name}.py",
                "scenes/test_export_notes",
                "scenes/test_exports",
                "scenes/test_exports_by_own_readers",
            )
            for name in ("registry", "euroc", "bop", "notes")
        ),
        *(
            _target(f"scenes/exports/{name}.py", "scenes/test_reconstruction_exports", "scenes/test_cameras")
            for name in ("colmap", "nerfstudio", "surface_points")
        ),
        _target("scenes/exports/kalibr.py", "scenes/test_cameras", "scenes/test_rig_exports"),
        *(_target(f"scenes/exports/ros/{name}.py", "scenes/test_bag_exports") for name in ("bag_messages", "geodetic")),
        _target(
            "scenes/exports/kitti.py",
            "scenes/test_laser_exports",
            "scenes/test_exports",
            "scenes/test_exports_by_own_readers",
        ),
        *(
            _target(f"scenes/exports/{name}.py", "scenes/test_laser_exports")
            for name in ("laser_readings", "ros/laser_messages")
        ),
        *(_target(f"scenes/png/{name}.py", "scenes/test_png") for name in ("filters", "huffman", "matches")),
        _target("scenes/png/encoder.py", "scenes/test_png"),
        _target("trajectories/kernels/equal_bytes.py", "trajectories/test_equal_bytes"),
        _target("trajectories/trajectory_files/formats.py", "trajectories/test_formats"),
        _target("trajectories/trajectory_files/covariances.py", "trajectories/test_covariances"),
    ),
    "sensors": (
        _target("trajectories/camera_clock.py", "trajectories/test_camera_clock"),
        _target("trajectories/sensors/imu.py", "trajectories/test_inertial", "trajectories/test_sensors"),
        _target("trajectories/sensors/gnss.py", "trajectories/test_gnss", "trajectories/test_sensors"),
        _target("trajectories/sensors/barometer.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"),
        _target(
            "trajectories/sensors/optical_flow.py", "trajectories/test_flow_and_height", "trajectories/test_sensors"
        ),
        *(
            _target(f"trajectories/sensors/{name}.py", "trajectories/test_ranging", "trajectories/test_sensors")
            for name in ("lidar", "range_finder", "ranging")
        ),
        _target("trajectories/sensors/satellites.py", "trajectories/test_gnss", "trajectories/test_sensors"),
        _target("scenes/dataset/surfaces/surface_truth.py", "scenes/test_surface_truth"),
        *(
            _target(
                f"scenes/dataset/surfaces/{name}_kernels.py", "scenes/test_surface_files", "scenes/test_surface_truth"
            )
            for name in ("depth", "flow", "normal", "occlusion", "shown", "trace")
        ),
        _target(
            "scenes/rendering/antialiasing/facet_table.py", "scenes/test_surface_files", "scenes/test_surface_truth"
        ),
        *(
            _target(f"tracker/fusion/{name}.py", "tracker/test_fusion_measurements", "tracker/test_fusion")
            for name in ("measurements", "vehicle_filter")
        ),
    ),
    "gimbal": (
        *(
            _target(f"trajectories/gimbal/{name}.py", "trajectories/test_gimbal")
            for name in ("axes", "encoder", "encoders_in_flight", "gimbal", "motion", "pointing", "servo")
        ),
        *(
            _target(f"scenes/{name}.py", "scenes/test_gimbal_sequences")
            for name in ("dataset/gimbal_files", "exports/ros/gimbal_messages")
        ),
        _target("tracker/fusion/camera_on_body.py", "tracker/test_camera_on_body"),
    ),
    "noise": (
        _target("scenes/materials/procedural_texture.py", "scenes/test_noise"),
        _target("trajectories/kernels/lens.py", "trajectories/test_lens", uncompiled=True),
        _target("trajectories/reproducible_math.py", "trajectories/test_exact", uncompiled=True),
        _target("trajectories/wind/winds.py", "trajectories/test_wind"),
        _target("trajectories/wind/dryden.py", "trajectories/test_wind"),
    ),
    "hidden lines": (
        _target("tracker/visible_edges.py", "tracker/test_visible_edges", "scenes/test_hidden_lines"),
        _target("tracker/robust/edges/hidden_line_kernels.py", "tracker/test_occlusion", uncompiled=True),
        _target("trajectories/geometry/ray_triangle.py", "trajectories/test_obstacles", "tracker/test_occlusion"),
    ),
    "hashing": (
        _target("bench/runner/jobs.py", "bench/test_plan", "bench/test_job_keys"),
        *(
            _target(f"bench/inputs/{name}.py", "bench/test_named_files", "bench/test_content")
            for name in ("command_files", "elsewhere", "named_files", "plugin_files")
        ),
        *(
            _target(f"bench/inputs/observed/{name}.py", "bench/test_seen_inputs", "bench/test_odd_looks")
            for name in ("looks", "seen_inputs")
        ),
        _target("bench/inputs/content_hash.py", "bench/test_content_hash", "bench/test_content"),
        _target("bench/inputs/file_paths.py", "bench/test_file_paths", "bench/test_content"),
        _target("trajectories/sources/dependencies.py", "trajectories/test_sources", "bench/test_content"),
        _target("trajectories/sources/digests.py", "trajectories/test_sources", "bench/test_content"),
        _target("trajectories/sources/module_files.py", "trajectories/test_sources", "bench/test_content"),
        _target("trajectories/sources/parsed_source.py", "trajectories/test_sources", "bench/test_content"),
    ),
    "files": (
        *(
            _target(
                f"trajectories/files/{name}.py",
                "trajectories/test_listed",
                "trajectories/test_files",
                "trajectories/test_placing",
                "trajectories/test_renames",
                "trajectories/test_intact",
            )
            for name in ("listed", "origin", "placing", "seals", "temporary_names", "writing")
        ),
        _target("trajectories/files/intact.py", "trajectories/test_intact"),
        _target("bench/runner/written_files.py", "bench/test_written_files"),
        _target("bench/runner/output_folder.py", "bench/test_output_folder"),
    ),
    "reading": (
        _target("trajectories/files/reading.py", "trajectories/test_reading", "trajectories/test_intact"),
        _target("trajectories/files/tables.py", "trajectories/test_tables"),
        _target("trajectories/processes/reading_apart.py", "trajectories/test_reading_apart"),
        _target("trajectories/trajectory_files/number_lines.py", "trajectories/test_number_lines"),
        _target("bench/external/rows.py", "bench/test_external_rows"),
        _target("bench/external/kept_folder.py", "bench/test_kept_folder"),
    ),
    "processes": (_target("trajectories/processes/guard.py", "trajectories/test_guard"),),
}
