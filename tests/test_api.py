"""The API: what a notebook cell does, what it accepts, and what it does not load."""

import doctest
import importlib
import inspect
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import uavbench as ub
from tests.reports.drawn import make_sequence, results_of, true_rows
from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.scoring.score import score
from uavbench.tracker.baselines.hold import Hold
from uavbench.trajectories.trajectory_files.formats import write_tum

ROOT = Path(__file__).parent.parent
HEAVY = ("numpy", "numba", "mujoco", "OpenGL", "pyrender", "matplotlib", "pandas", "scipy", "cv2", "pydantic")
EVALUATED = """
import sys, numpy as np, uavbench as ub
t = np.arange(9.0)
a = np.column_stack([t, t, t**2, 0 * t, 0 * t, 0 * t, 0 * t, 1 + 0 * t])
ub.evaluate(a, a, align="se3").frames()
print(*sorted(sys.modules))
"""


def loaded(code, folder):
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def curve(n=40):
    t = np.arange(n) / 10
    turn = t / 4
    zero = np.zeros(n)
    return np.column_stack([t, np.cos(t), np.sin(t), t, zero, zero, np.sin(turn), np.cos(turn)])


def forms(values, folder):
    """The same trajectory in every form that `evaluate` takes."""
    stamps_ns = np.rint(values[:, 0] * 1e9).astype(np.int64)
    trajectory = ub.Trajectory(stamps_ns, values[:, 1:4], values[:, [7, 4, 5, 6]])
    write_tum(trajectory, folder / f"{len(list(folder.iterdir()))}.tum")
    path = max(folder.iterdir(), key=lambda p: int(p.stem))
    table = pd.DataFrame(values, columns=["time_s", "px_m", "py_m", "pz_m", "qx", "qy", "qz", "qw"])
    stamped = table.assign(stamp_ns=stamps_ns).drop(columns="time_s")
    return [path, str(path), trajectory, values, table, stamped]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A finished run: two sequences by two trackers, scored."""
    folder = tmp_path_factory.mktemp("run")
    for seed in (0, 1):
        sequence = make_sequence(folder / "sequences" / f"drawn-s{seed}", 30, f"drawn-s{seed}", seed)
        for label, offset_m in (("near", 0.01), ("far", 0.2)):
            results = results_of(sequence, true_rows(sequence, offset_m))
            results = replace(results, record={**results.record, "label": label, "seed": seed})
            results.save(folder / "results" / sequence.name / f"{label}@15hz")
            score(sequence, results).save(folder / "results" / sequence.name / f"{label}@15hz" / "score.json")
    return folder


def test_every_name_is_there_and_documented():
    assert set(ub.__all__) <= set(dir(ub))
    for name in ub.__all__:
        thing = getattr(ub, name)
        assert inspect.getdoc(thing), name
    with pytest.raises(AttributeError, match="evaluat"):
        ub.evaluat  # noqa: B018


LIBRARY_PATH = "uavbench.trajectories.processes.library_path"
BEFORE_OPENCV = {"uavbench.trajectories", "uavbench.trajectories.processes", LIBRARY_PATH}
"""What has to be there before any module imports OpenCV."""


def test_importing_it_loads_nothing_heavy(tmp_path):
    names = loaded("import sys, uavbench; dir(uavbench); print(*sorted(sys.modules))", tmp_path)
    assert not names & set(HEAVY)
    assert {name for name in names if name.startswith("uavbench.")} == BEFORE_OPENCV


def test_evaluating_loads_no_tracker_no_renderer_and_no_simulator(tmp_path):
    names = loaded(EVALUATED, tmp_path)
    assert "uavbench.reports.evaluation.api" in names
    assert not names & {"mujoco", "OpenGL", "pyrender", "matplotlib", "trimesh", "pydantic"}
    trackers = {name for name in names if name.startswith("uavbench.tracker.")}
    assert trackers <= {"uavbench.tracker.versions"}


def test_it_leaves_the_backend_of_a_notebook_alone(tmp_path):
    code = "import matplotlib as m; m.use('svg'); import uavbench; uavbench.figures; print(m.get_backend())"
    assert loaded(code, tmp_path) == {"svg"}


@pytest.mark.parametrize("name", [name for name in ub.__all__ if name not in ("Frame", "Sequence", "UserError")])
def test_each_part_of_the_api_has_an_example_that_runs(name, folder):
    """`folder` in an example is that of a finished run."""
    module = importlib.import_module(f"uavbench.{ub.HOMES[name]}")
    thing = module if name == "figures" else getattr(module, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(thing, name, module)
    example.globs["folder"] = folder
    assert len(example.examples) > 1
    assert not any(doctest.SKIP in part.options for part in example.examples)
    assert not doctest.DocTestRunner().run(example).failed


def test_every_form_of_a_trajectory_evaluates_alike(tmp_path):
    true, wrong = curve(), curve() + np.array([0, 0.1, 0, 0.2, 0, 0, 0, 0])
    wanted = np.sqrt(0.1**2 + 0.2**2)
    for a in forms(true, tmp_path):
        for b in forms(wrong, tmp_path):
            found = ub.evaluate(a, b)
            assert found.ate["translation_m"].rmse == pytest.approx(wanted)
            assert found.rpe["translation_m"].rmse == pytest.approx(0, abs=1e-9)
    assert ub.evaluate(true, wrong, align="se3").ate["translation_m"].rmse < 1e-6


def test_the_table_of_a_tracker_is_read_as_its_file_is(folder):
    sequence, results = folder / "sequences" / "drawn-s0", folder / "results" / "drawn-s0" / "far@15hz"
    by_file = evaluate_files(sequence, results / "frames.csv", mount=sequence)
    table = pd.read_csv(results / "frames.csv")
    assert ub.evaluate(sequence, table, mount=sequence).ate == by_file.ate


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (np.zeros((3, 7)), r"the estimate: has the shape \(3, 7\); give \(n, 8\)"),
        (np.zeros((0, 8)), "the estimate: has the shape"),
        (np.ma.masked_equal(np.eye(8), 1.0), "the estimate: has masked values; leave their rows out"),
        (np.eye(8) * 1j, "the estimate: holds complex numbers"),
        (np.zeros((3, 8)), "the estimate: row 0: quaternion"),
        (np.where(np.arange(8) == 0, np.nan, curve()), "the estimate: row 0: nan is not a time"),
        (curve()[::-1], "the estimate: row 1: stamp is not later than"),
        (pd.DataFrame(curve()), "the estimate: a DataFrame of poses has the columns stamp_ns"),
        ("nowhere.tum", "nowhere.tum"),
        (None, "the estimate: has the shape"),
    ],
)
def test_a_mistake_names_the_side_and_what_is_wrong(given, told):
    with pytest.raises(ub.UserError, match=told):
        ub.evaluate(curve(), given)


def test_a_sequence_that_is_given_in_place_of_its_folder_is_named(folder):
    with pytest.raises(ub.UserError, match="the reference: is a sequence; give its `ground_truth`"):
        ub.evaluate(ub.open_sequence(folder / "sequences" / "drawn-s0"), curve())


def test_a_table_of_complex_numbers_is_refused_as_an_array_is():
    table = pd.DataFrame(curve(), columns=["time_s", "px_m", "py_m", "pz_m", "qx", "qy", "qz", "qw"])
    with pytest.raises(ub.UserError, match="the estimate: holds complex numbers"):
        ub.evaluate(curve(), table.assign(py_m=table.py_m + 1j))


@pytest.mark.parametrize(("scale", "told"), [(1.0, None), (1000.0, "1,000 times those of the reference: are both in")])
def test_a_likely_mistake_is_a_warning(scale, told):
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        found = ub.evaluate(curve(), curve() * [1, scale, scale, scale, 1, 1, 1, 1])
    assert [str(each.message) for each in heard] == found.record["doubts"]
    assert (told is None and not heard) or told in str(heard[0].message)
    assert all(each.filename == __file__ for each in heard)


@pytest.mark.parametrize("wrong", [None, "millimetres", "behind", "beside"])
def test_a_pose_at_which_the_model_is_out_of_sight_is_a_warning(folder, wrong):
    drawn = folder / "sequences" / "drawn-s0"
    given = ub.open_sequence(drawn)[0].cam_from_world.matrix.copy()
    if wrong == "millimetres":
        given[:3, 3] *= 1000
    elif wrong == "behind":
        given[2, 3] *= -1
    elif wrong == "beside":
        given[0, 3] += 100
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        ub.start("hold", drawn / "model.obj", drawn / "camera.toml", given)
    assert [str(each.message)[:45] for each in heard] == ["cam_from_world: at this pose the image shows "] * bool(wrong)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("delta", "1"), ("delta", True), ("delta", [1]), ("delta", 1j), ("t_offset_s", "0"), ("t_offset_s", True),
        ("max_difference_s", "0.1"), ("all_pairs", "no"), ("ignore_frames", "no"), ("mode", 1), ("mode", ["evo"]),
        ("mount", 1), ("plot", 1), ("reference_format", 1), ("align", 1), ("unit", ["s"]),
    ],
)  # fmt: skip
def test_an_option_of_another_type_is_named(option, value):
    with pytest.raises(ub.UserError, match=rf"^(unknown )?{option} "):
        ub.evaluate(curve(), curve(), **{option: value})


@pytest.mark.parametrize("form", [curve, lambda: pd.DataFrame(curve()), lambda: curve().tolist()])
@pytest.mark.parametrize("side", ["reference", "estimate"])
def test_a_format_of_what_is_no_file_is_refused(side, form):
    """Rows of EuRoC, w first, had been read as those of TUM, w last, whatever format was named."""
    given = {"reference": curve(), "estimate": curve()} | {side: form()}
    with pytest.raises(ub.UserError, match=f"the {side}: {side}_format = 'euroc' is of a file, and no file is given"):
        ub.evaluate(**given, **{f"{side}_format": "euroc"})


def test_options_that_are_none_have_their_defaults(tmp_path):
    given = {"mode": None, "t_offset_s": None, "ignore_frames": None, "delta": 10**30, "plot": str(tmp_path / "a.png")}
    found = ub.evaluate(curve(), curve(), **given)
    assert found.record["mode"] == "uavbench" and found.rpe is None and (tmp_path / "a.png").is_file()


@pytest.mark.parametrize("value", [1, None, b"out", ["out"]])
@pytest.mark.parametrize("name", ["open_sequence", "load_scores", "load_runs", "render"])
def test_a_folder_or_a_suite_that_is_no_path_is_named(name, value):
    with pytest.raises(ub.UserError, match=r"^(folder|suite) = .*: must be a path"):
        getattr(ub, name)(value)


def test_sequences_that_are_no_table_are_told():
    with pytest.raises(ub.UserError, match="sequences"):
        ub.render({"sequences": 1})
    with pytest.raises(ub.UserError, match=r"^out = 1: must be a path"):
        ub.render("tiny", out=1)


@pytest.mark.parametrize("angle", [0, 180, 200, -10, float("nan"), "90", None, True])
def test_an_angle_that_no_camera_has_is_refused(angle):
    with pytest.raises(ValueError, match=r"horizontal_deg = .*: must be an angle between 0 and 180"):
        ub.Camera.from_field_of_view(640, 480, angle)


def test_errors_pose_by_pose_and_their_drawing():
    found = ub.evaluate(curve(), curve() + np.array([0, 0.3, 0, 0, 0, 0, 0, 0]))
    table = found.frames()
    assert list(table)[:4] == ["stamp_ns", "time_s", "position_error_m", "rotation_error_deg"]
    assert np.allclose(table["position_error_m"], 0.3)
    assert np.allclose(table["estimate_x_m"] - table["reference_x_m"], 0.3)
    _, axes = plt.subplots()
    assert found.plot(axes) is axes
    assert np.allclose(axes.lines[0].get_ydata(), 0.3)
    assert found.plot(quantity="path") is not axes
    with pytest.raises(ub.UserError, match="quantity"):
        found.plot(quantity="positoin")
    with pytest.raises(ub.UserError, match="unknown what 'ATE'"):
        ub.figures.sweep([], what="ATE")
    plt.close("all")


def test_scores_are_a_tidy_table(folder):
    table = ub.load_scores(folder)
    assert list(table.columns[:6]) == ["sequence", "flight", "tracker", "rate_hz", "seed", "status"]
    assert len(table) == 4
    runs = {(run.sequence.name, run.score.label): run for run in ub.load_runs(folder)}
    for row in table.itertuples():
        kept = runs[row.sequence, row.tracker].score
        assert row.ate_none_translation_rmse_m == kept.ate["none"].translation_m.rmse
        assert row.rpe_1s_rotation_median_deg == kept.rpe["1 s"].rotation_deg.median
        assert row.tracking_success == kept.tracking.success
    assert {"ate_none_translation_sse_m2", "ate_none_translation_n"} <= set(table)
    with pytest.raises(ub.UserError, match="has no scores"):
        ub.load_scores(folder / "sequences")
    (folder / "scores.csv").write_text("")
    with pytest.raises(ub.UserError, match=r"scores.csv: is a file; give the folder of the run"):
        ub.load_scores(folder / "scores.csv")
    (folder / "scores.csv").unlink()


def test_errors_frame_by_frame_of_a_run(folder):
    run = next(run for run in ub.load_runs(folder) if run.score.label == "near")
    table = run.frames()
    assert len(table) == len(run.errors)
    assert table["success"].mean() == run.score.tracking.success
    assert table["position_error_m"].median() == pytest.approx(run.score.ate["none"].translation_m.median)


ON_AXES = ["errors_over_time", "success_curves", "paths_from_above", "nees_over_time", "segment_counts"]
ON_A_FIGURE = ["error_panels", "accuracy_and_coverage", "paths", "error_against_distance", "pose_components"]


@pytest.mark.parametrize("name", ON_AXES)
def test_a_figure_of_one_panel_draws_on_the_axes_given(folder, name):
    runs = ub.load_runs(folder)[:2]
    _, (left, right) = plt.subplots(1, 2)
    given = runs[0] if name == "segment_counts" else runs
    assert getattr(ub.figures, name)(given, axes=right) is right
    assert right.get_xlabel()
    assert not left.get_xlabel()
    plt.close("all")


@pytest.mark.parametrize("name", ON_A_FIGURE)
def test_a_figure_of_several_panels_draws_on_a_part_of_a_figure(folder, name):
    runs = ub.load_runs(folder)[:2]
    figure = plt.figure(layout="constrained")
    above, below = figure.subfigures(2, 1)
    given = runs[0] if name == "pose_components" else runs
    assert getattr(ub.figures, name)(given, figure=below) is below
    assert below.axes
    assert not above.axes
    figure.canvas.draw()
    plt.close("all")


def test_figures_of_statistics_and_what_they_refuse(folder):
    runs = ub.load_runs(folder)
    assert ub.figures.win_table(runs).get_title()
    assert ub.figures.mean_ranks(runs).texts
    for draw in (ub.figures.errors_over_time, ub.figures.paths, ub.figures.error_over_bound):
        with pytest.raises(ub.UserError, match="one sequence"):
            draw(runs)
    with pytest.raises(ub.UserError, match="two trackers"):
        ub.figures.win_table(runs[:1])
    with pytest.raises(ub.UserError, match="no runs"):
        ub.figures.success_curves([])
    plt.close("all")


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda runs: ub.figures.success_curves("out/box"), "str is no run to draw; give those of uavbench.load_runs"),
        (lambda runs: ub.figures.segment_counts(runs), r"give one run, as runs\[0\], not 4"),
        (lambda runs: ub.figures.pose_components(runs), r"give one run, as runs\[0\], not 4"),
        (lambda runs: ub.figures.flight_of(runs[0]), r"ScoredRun is no sequence; give one, as runs\[0\]\.sequence"),
        (lambda runs: ub.figures.success_curves(runs, plt.figure()), "axes is Figure; give one matplotlib Axes"),
        (lambda runs: ub.figures.paths(runs[:2], plt.figure().subplots()), "figure is Axes; give a matplotlib Figure"),
        (lambda runs: ub.figures.by_attribute(at_two_rates(runs)), "give the runs at one rate, these are at 20, 5 Hz"),
        (lambda runs: ub.figures.win_table(at_two_rates(runs)), "give the runs at one rate, these are at 20, 5 Hz"),
        (lambda runs: ub.figures.mean_ranks(at_two_rates(runs)), "give the runs at one rate, these are at 20, 5 Hz"),
    ],
)
def test_what_cannot_be_drawn_together_is_told(folder, draw, told):
    with pytest.raises(ub.UserError, match=told):
        draw(ub.load_runs(folder))
    plt.close("all")


def at_two_rates(runs):
    rates = (20.0, 5.0)
    return [replace(run, score=replace(run.score, rate_hz=rates[k % 2])) for k, run in enumerate(runs)]


def test_runs_are_drawn_from_any_iterable_and_one_alone(folder):
    runs = ub.load_runs(folder)[:2]
    lines = len(ub.figures.errors_over_time(runs).lines)
    assert len(ub.figures.errors_over_time(run for run in runs).lines) == lines
    assert len(ub.figures.success_curves(run for run in runs).lines) == len(ub.figures.success_curves(runs).lines) > 1
    assert ub.figures.success_curves(runs[0]).lines
    plt.close("all")


def test_a_dict_is_rendered_and_its_frames_have_their_truth(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flight = {"path": {"kind": "hand-pilot", "duration_s": 0.2}}
    box = {
        "structure": {"kind": "box"}, "environment": {"kind": "indoor"}, "flight": flight, "rate_hz": 15.0,
        "camera": {"width": 160, "height": 120, "horizontal_fov_deg": 65.0}, "annotations": ["depth", "mask", "edges"],
    }  # fmt: skip
    (sequence,) = ub.render({"sequences": {"box": box}})
    assert sequence.folder == tmp_path / "out" / "suite" / "sequences" / "box-s0"
    for k, frame in enumerate(sequence):
        assert frame.image.shape == (120, 160, 3)
        assert frame.stamp_ns == sequence.stamps_ns[k]
        body = sequence.cam_from_body @ frame.world_from_body.inverse()
        assert np.allclose(body.matrix, frame.cam_from_world.matrix)
        middle = frame.cam_from_world.transform(sequence.structure.bounds.mean(axis=0, keepdims=True))[0, 2]
        assert (frame.mask == 1).any()
        assert frame.depth_m[frame.mask == 1].min() < middle
        assert frame.edges.shape[1] == 7
    assert k == len(sequence) - 1
    assert sequence[-1].number == k
    with pytest.raises(IndexError):
        sequence[k + 1]
    assert [(type(frame), frame.number) for frame in sequence[0:2]] == [(ub.Frame, 0), (ub.Frame, 1)]
    assert [frame.number for frame in sequence[::-1]] == [*range(k, -1, -1)]
    assert np.array_equal(sequence[-1:][0].image, sequence[k].image) and sequence[k + 1 :] == []
    assert sequence[np.int64(1)].number == sequence[np.array(1)].number == 1
    assert type(sequence[np.int64(-1)].number) is int
    for bad in (True, 1.0, None, "0", (0, 1), [0], np.True_, slice("a", None)):
        with pytest.raises(TypeError):
            sequence[bad]
    with pytest.raises(IndexError, match=rf"sequence\[{-k - 2}\]: .* has {k + 1} frames"):
        sequence[-k - 2]
    again = ub.open_sequence(str(sequence.folder))
    assert np.array_equal(again[0].image, sequence[0].image)
    run = ub.start("hold", sequence.structure, sequence.camera, sequence[0].cam_from_world)
    assert [run.track(frame.image, frame.stamp_ns).status for frame in again] == ["ok"] * len(again)


def test_sequences_of_a_dict_may_have_any_rates(tmp_path):
    """None is tracked, so none needs a rate in common with another."""
    flight, camera = {"path": {"kind": "hover", "duration_s": 0.2}}, {"width": 64, "height": 48}
    one = {"structure": {"kind": "box"}, "environment": {"kind": "studio"}, "flight": flight, "camera": camera}
    rates = {"default": {}, "ten": {"rate_hz": 10.0}, "odd": {"rate_hz": 29.97}}
    made = ub.render({"sequences": {name: one | more for name, more in rates.items()}}, out=tmp_path / "out")
    assert [(sequence.info["rate_hz"], len(sequence)) for sequence in made] == [(15.0, 4), (10.0, 3), (29.97, 6)]


def test_mistakes_of_a_dict_are_told_at_once():
    with pytest.raises(ub.UserError, match=r"5 mistakes(.*\n)*.*mean 'structure'(.*\n)*.*mean 'seeds'"):
        ub.render({"sequences": {"box": {"struct": {"kind": "box"}}}, "seed": [1]})


def test_start_reads_files_and_refuses_what_it_cannot_use(folder):
    drawn = folder / "sequences" / "drawn-s0"
    first = ub.open_sequence(drawn).initial_cam_from_world
    run = ub.start("hold", drawn / "model.obj", drawn / "camera.toml", first.matrix)
    image = ub.open_sequence(drawn)[0].image
    assert np.allclose(run.track(image, 0).cam_from_world.matrix, first.matrix)
    with pytest.raises(ub.UserError, match="robust"):
        ub.start("robst", drawn / "model.obj", drawn / "camera.toml", first)
    with pytest.raises(ub.UserError, match="cam_from_world: "):
        ub.start("hold", drawn / "model.obj", drawn / "camera.toml", np.zeros((4, 4)))
    with pytest.raises(ub.UserError, match=r"nothing\.obj"):
        ub.start("hold", drawn / "nothing.obj", drawn / "camera.toml", first)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"tracker": None}, r"tracker is None; give a name, or an object with its parameters, as Robust\(\)"),
        ({"tracker": Hold}, "tracker is <class .*Hold'>; give a name, or an object with its parameters"),
        ({"model": np.eye(3)}, "structure is ndarray; give a Structure"),
        ({"camera": np.eye(3)}, "camera is ndarray; give a Camera"),
        ({"cam_from_world": ub.Pose(2 * np.eye(3), np.zeros(3))}, "its rows are not orthonormal"),
        ({"cam_from_world": np.eye(4) * (1 + 0j)}, "cam_from_world: holds complex numbers"),
        ({"cam_from_world": np.ma.masked_equal(np.eye(4), 1.0)}, "cam_from_world: has masked values"),
        ({"cam_from_world": [[10**400] * 4] * 4}, "cam_from_world: "),
        ({"seed": -1}, "seed = -1: must be a whole number from 0 on"),
        ({"seed": "0"}, "seed = '0': must be a whole number from 0 on"),
    ],
)
def test_start_refuses_inputs_of_another_kind_by_name(folder, change, told):
    """For a tracker of one's own, too: it gets what docs/my-tracker.md says, or is not started."""
    sequence = ub.open_sequence(folder / "sequences" / "drawn-s0")
    own = SimpleNamespace(start=lambda *inputs: pytest.fail(f"was started with {inputs}"))
    given = {"model": sequence.structure, "camera": sequence.camera, "cam_from_world": np.eye(4)}
    with pytest.raises(ub.UserError, match=told):
        ub.start(**{"tracker": own, **given, **change})


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"fx": 0.8, "fy": 0.8, "cx": 0.5, "cy": 0.5}, "camera: fx = 0.8 px is too short"),
        ({"cx": 0.5, "cy": 0.5}, "camera: cx = 0.5, cy = 0.5 are shares of the image's size; give them in pixels"),
        ({"distortion_model": "radtan", "distortion": (-1.5, 0.0, 0.0, 0.0)}, "camera: .* the lens folds over before"),
    ],
)
def test_start_refuses_a_camera_of_a_script_as_it_does_that_of_a_file(folder, change, told):
    sequence = ub.open_sequence(folder / "sequences" / "drawn-s0")
    camera = replace(sequence.camera, **change)
    with pytest.raises(ub.UserError, match=told):
        ub.start("hold", sequence.structure, camera, sequence.initial_cam_from_world)


@pytest.mark.parametrize("lost", [np.ma.masked_equal(np.zeros((2, 3)), 0.0), np.zeros((2, 3)) * 1j])
def test_a_pose_or_trajectory_drops_no_mask_and_no_imaginary_part(lost):
    with pytest.raises(ValueError, match=r"masked|complex"):
        ub.Trajectory(np.arange(2), lost, np.tile([1.0, 0, 0, 0], (2, 1)))
    with pytest.raises(ValueError, match=r"masked|complex"):
        ub.Pose(np.eye(3), lost[0])


def test_stamps_that_are_none_are_refused():
    """Seconds had been cut to whole nanoseconds, and times beyond 2^63 had become negative."""
    poses = [ub.Pose(np.eye(3), np.zeros(3))] * 2
    assert ub.Trajectory.from_poses([1, 2], poses).stamps_ns.tolist() == [1, 2]
    assert len(ub.Trajectory.from_poses([], [])) == 0
    upright = np.tile([1.0, 0, 0, 0], (2, 1))
    with pytest.raises(ValueError, match="stamps_ns must be integer nanoseconds"):
        ub.Trajectory.from_poses([0.5, 1.7], poses)
    with pytest.raises(ValueError, match=r"row 1: stamp is beyond 2\^63 ns"):
        ub.Trajectory(np.array([1, 2**63 + 1], dtype=np.uint64), np.zeros((2, 3)), upright)
    with pytest.raises(ValueError, match=r"stamps_ns has the shape \(2, 1\); give \(n,\)"):
        ub.Trajectory(np.array([[1], [2]]), np.zeros((2, 3)), upright)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["datetime64", "timedelta64"])
def test_times_that_are_no_numbers_are_no_seconds(kind, unit):
    """The numbers of timedeltas in ms had been taken for seconds."""
    names = ["time_s", "px_m", "py_m", "pz_m", "qx", "qy", "qz", "qw"]
    table = pd.DataFrame(curve(), columns=names).assign(time_s=np.arange(40).astype(f"{kind}[{unit}]"))
    with pytest.raises(ub.UserError, match=rf"time_s has the type {kind}.*; give seconds, or stamp_ns = "):
        ub.evaluate(table, table)


def both_times(start_ns=1_403_636_580_838_555_574):
    """Poses with stamps in ns, and the same times in s as 64-bit numbers."""
    table = pd.DataFrame(curve(), columns=["time_s", "px_m", "py_m", "pz_m", "qx", "qy", "qz", "qw"])
    stamps_ns = start_ns + np.arange(40) * 10**8
    return table.assign(time_s=stamps_ns / 1e9, stamp_ns=stamps_ns)


def test_the_invalid_row_of_a_tracked_table_is_that_of_the_table():
    table = both_times().drop(columns="time_s").assign(status=["lost", "lost", *["ok"] * 38])
    table.loc[7, "qw"] = 9.0
    with pytest.raises(ub.UserError, match="the estimate: row 7: quaternion"):
        ub.evaluate(both_times(), table)


@pytest.mark.parametrize("tracked", [False, True])
def test_stamps_and_times_of_one_table_must_agree(tracked, tmp_path):
    """stamp_ns had counted without a word."""
    table = both_times().assign(**{"status": ["lost", *["ok"] * 39]} if tracked else {})
    wrong = table.assign(time_s=table["time_s"].where(table.index != 7, table["time_s"] + 0.01))
    with pytest.raises(ub.UserError, match=r"row 7: stamp_ns 1403636581538555574 and time_s .* differ; leave out"):
        ub.evaluate(both_times(), wrong)
    wrong.to_csv(tmp_path / "wrong.csv", index=False)
    with pytest.raises(ub.UserError, match=r"wrong.csv: line 9: stamp_ns 1403636581538555574 and time_s .* diff"):
        ub.evaluate(both_times(), tmp_path / "wrong.csv")
    with pytest.raises(ub.UserError, match="time_s nan differ"):
        ub.evaluate(both_times(), table.assign(time_s=np.nan))
    table.to_csv(tmp_path / "right.csv", index=False)
    first, counted = 0.1 * tracked, np.arange(40) / 10
    one = table.assign(time_s=np.where(table.index == 7, 9.0, counted))
    with pytest.raises(ub.UserError, match="row 7: stamp_ns 1403636581538555574 and time_s 9 differ"):
        ub.evaluate(both_times(), one)
    in_ms = table.assign(time_s=np.floor(table["time_s"] * 1e3) / 1e3)
    for right in (table, in_ms, table.assign(time_s=counted), table.assign(time_s=counted - first)):
        right.to_csv(tmp_path / "right.csv", index=False)
        for given in (right, tmp_path / "right.csv"):
            found = ub.evaluate(table, given)
            assert found.ate["translation_m"].rmse == 0.0
            assert len(found.frames()) == len(table) - tracked


@pytest.mark.parametrize(
    ("vertices", "triangles", "told"),
    [
        (np.eye(3), [[0, 1, 2.5]], r"the type float64; give \(m, 3\) integers"),
        (np.eye(3), [[0, 1, -1]], r"triangles\[0\] = \[0, 1, -1\]: there are 3 vertices, from 0 on"),
        (np.eye(3), [[0, 1, 2], [1, 2, 3]], r"triangles\[1\] = \[1, 2, 3\]: there are 3 vertices, from 0 on"),
        (np.eye(3), [[0, 1, 2, 0]], r"triangles has the shape \(1, 4\)"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], r"give \(n, 3\) finite numbers"),
        (np.eye(4), [[0, 1, 2]], r"vertices has the shape \(4, 4\)"),
        (np.eye(3), np.zeros((0, 3)), "none of its triangles has an area"),
    ],
)
def test_a_structure_of_no_mesh_is_refused(vertices, triangles, told):
    with pytest.raises(ValueError, match=told):
        ub.Structure.from_mesh(vertices, np.array(triangles))
