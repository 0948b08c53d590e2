"""Readers take anything: what is not right is a UserError, never another exception.

Each property runs 60 cases; 10,000 with UAVBENCH_NIGHTLY=1. They begin with valid files (tests/bench/mutations.py),
which a test reads as they are first: what the mutations change is past the header.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.bench.mutations import damaged_bytes, damaged_json, damaged_text
from uavbench.bench.config.suite import load_suite, load_tracker
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.external.rows import COVARIANCE_COLUMNS, POSE_HEADER, read_estimates
from uavbench.bench.gate.baseline import read_baseline
from uavbench.bench.gate.paired_scores import read_side, read_timing
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.structure_files import load_structure
from uavbench.scenes.dataset.table_files import read_table
from uavbench.scenes.dataset.verify import verify
from uavbench.scenes.model_files.model_reading import read as read_mesh
from uavbench.tracker.initialization import read_init
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.along import read_waypoints
from uavbench.trajectories.trajectory_files.formats import READERS, read_trajectory

CASES = 10_000 if os.environ.get("UAVBENCH_NIGHTLY") else 60
LENIENT = settings(
    max_examples=CASES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
POSE = "0.1,-0.2,3.5,0.5,0.5,-0.5,0.5"
UPPER = ",".join("1.0" if i == j else "0.0" for i in range(6) for j in range(i, 6))
BOX = trimesh.creation.box((1, 2, 3))
TRAJECTORIES = {
    "tum": "# t x y z\n0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n0.2 2 0 0 0 0 0 1\n",
    "euroc": "#ns\n1403636579763555584,0,0,0,1,0,0,0,5\n1403636579813555456,1,0,0,1,0,0,0,5\n",
    "kitti": "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n",
}
CAO = """V1
8 # points
0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
4 # lines
0 1 name=side
1 2
2 3
3 0
1
4 0 1 2 3
2
4 4 5 6 7 minPolygonAreaThreshold=50
4 0 1 5 4
1 # cylinders
0 4 0.5
1 # circles
0.5 4 5 6
"""
OBJ = BOX.export(file_type="obj", include_normals=False)
MODELS = {
    "cao": CAO,
    "obj": OBJ if isinstance(OBJ, str) else OBJ.decode(),
    "off": BOX.export(file_type="off"),
    "ply": BOX.export(file_type="ply", encoding="ascii").decode(),
    "stl": trimesh.exchange.stl.export_stl_ascii(BOX),
}
BINARY = {"stl": BOX.export(file_type="stl"), "ply": BOX.export(file_type="ply"), "glb": BOX.export(file_type="glb")}
SUITE = '{"sequences": ["a-s0"], "trackers": ["t"], "rates_hz": [15.0], "flights": "f"}'
TIMING = '{"runs": {"t@15hz": [{"sequence": "a", "seed": 0, "base_ms": 1.0, "head_ms": 2.0}]}}'
INIT = "points = [\n" + "".join(
    f"{{ model_m = [{x}, {y}, {z}], image_px = [{320 + 90 * x}, {240 + 80 * y + 9 * z}] }},\n"
    for x, y, z in [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]
) + "]\n"  # fmt: skip


def timing_in(folder):
    return read_timing(folder, folder.with_name("base"))


def expect_named(function, *arguments):
    try:
        function(*arguments)
    except UserError as error:
        assert str(error)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of the true poses of the trial sequence, with covariances, and their score."""
    sequence = Sequence.load(TRIAL)
    rows = [
        TrackResult(
            status="ok",
            cam_from_world=sequence.true_cam_from_world(k),
            covariance=1e-4 * np.eye(6),
            stage_ms={"total": 5.0},
        )
        for k in range(len(sequence))
    ]
    record = {
        "tracker": {"kind": "true", "parameters": {}}, "label": "true", "seed": 0, "versions": {},
        "rate_hz": float(sequence.info["rate_hz"]),
        "sequence": {"name": sequence.name, "content_hash": sequence.content_hash}, "errors": [],
        "cam_from_body": sequence.cam_from_body.matrix.tolist(), "content_hash": "h",
    }  # fmt: skip
    made = Results(record, np.arange(len(rows)), sequence.stamps_ns, tuple(rows))
    out = tmp_path_factory.mktemp("results") / "run"
    made.save(out)
    score(sequence, made).save(out / "score.json")
    return {path.name: path.read_text(encoding="utf-8") for path in out.iterdir()}


def put(folder, name, data):
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def test_what_is_mutated_is_valid(folder, results):
    for name, text in TRAJECTORIES.items():
        assert read_trajectory(put(folder, f"a.{name}", text))[1] == name
    for name, model in [*MODELS.items(), *BINARY.items()]:
        assert len(read_mesh(put(folder, f"a.{name}", model))[0].triangles) >= 12
    estimates = ",".join([*POSE_HEADER, *COVARIANCE_COLUMNS]) + f"\n1000,ok,{POSE},{UPPER}\n"
    found, faults = read_estimates(put(folder, "estimates.csv", estimates), [1000])
    assert not faults and found[0].covariance is not None
    assert read_side(put(folder, "suite.json", SUITE).parent).flights == "f"
    assert timing_in(put(folder, "timing.json", TIMING).parent)
    expect_named(read_init, put(folder, "init.toml", INIT), Camera.load(TRIAL / "camera.toml"))
    for name, text in results.items():
        put(folder, name, text)
    assert score(Sequence.load(TRIAL), Results.load(folder)).status == "complete"
    assert Score.load(folder / "score.json").consistency is not None


@LENIENT
@given(data=damaged_text(read(suite_file("tiny"))))
def test_suites(folder, data):
    expect_named(load_suite, put(folder, "suite.toml", data))


@LENIENT
@given(
    data=damaged_text(
        'kind = "external"\ncommand = [ "true" , "x" ]\nmode = "stream"\ntimeout_s = 1.0\n'
        "memory_mb = 100\nstart_timeout_s = 2.0\n"
    )
)
def test_trackers(folder, data):
    expect_named(load_tracker, put(folder, "tracker.toml", data))


@LENIENT
@given(data=damaged_text(read(TRIAL / "camera.toml")))
def test_cameras(folder, data):
    expect_named(Camera.load, put(folder, "camera.toml", data))


@LENIENT
@given(data=damaged_text(INIT))
def test_first_poses(folder, data):
    expect_named(read_init, put(folder, "init.toml", data), Camera.load(TRIAL / "camera.toml"))


@LENIENT
@given(data=damaged_text("x_m,y_m,z_m,yaw_deg\n1,2,3,0\n2,2,3,90\n3,2,3,0\n"))
def test_waypoints(folder, data):
    expect_named(read_waypoints, put(folder, "way.csv", data))


@LENIENT
@given(
    data=damaged_text(
        ",".join([*POSE_HEADER, *COVARIANCE_COLUMNS]) + f"\n0,lost\n1000,ok,{POSE},{UPPER}\n2000,ok,{POSE},{UPPER}\n"
    )
)
def test_estimates(folder, data):
    found, _ = read_estimates(put(folder, "estimates.csv", data), [0, 1000, 2000])
    assert len(found) == 3


@LENIENT
@given(data=damaged_text(read(TRIAL / "frames.csv")))
def test_tables(folder, data):
    expect_named(read_table, put(folder, "frames.csv", data), ["frame", "stamp_ns", "file"])


@LENIENT
@given(data=damaged_text(read(TRIAL / "model.obj")), edges=damaged_text(read(TRIAL / "edges.csv")))
def test_models_of_sequences(folder, data, edges):
    put(folder, "model.obj", data)
    put(folder, "edges.csv", edges)
    expect_named(load_structure, folder)


@LENIENT
@given(
    name=st.sampled_from(
        ["sequence.json", "manifest.json", "frames.csv", "groundtruth.csv", "camera.toml", "edges.csv"]
    ),
    data=st.data(),
)
def test_sequences(folder, name, data):
    trial = folder / "trial"
    trial.mkdir(exist_ok=True)
    for item in TRIAL.iterdir():
        if item.is_file():
            put(trial, item.name, item.read_bytes())
    damaged = damaged_json if name.endswith(".json") else damaged_text
    put(trial, name, data.draw(damaged(read(TRIAL / name))))

    def use():
        sequence = Sequence.load(trial)
        return sequence.ground_truth, sequence.cam_from_body, sequence.name, sequence.content_hash

    expect_named(use)
    expect_named(verify, trial)


@LENIENT
@given(name=st.sampled_from(list(READERS)), data=st.data(), told=st.booleans())
def test_trajectories(folder, name, data, told):
    path = put(folder, f"trajectory.{name}", data.draw(damaged_text(TRAJECTORIES[name])))
    expect_named(read_trajectory, path, name if told else None)


@pytest.mark.parametrize("kind", list(MODELS))
@LENIENT
@given(data=st.data())
def test_models(folder, kind, data):
    expect_named(read_mesh, put(folder, f"model.{kind}", data.draw(damaged_text(MODELS[kind]))))


@pytest.mark.parametrize("kind", list(BINARY))
@LENIENT
@given(data=st.data())
def test_binary_models(folder, kind, data):
    expect_named(read_mesh, put(folder, f"model.{kind}", data.draw(damaged_bytes(BINARY[kind]))))


@LENIENT
@given(data=st.data())
def test_gltf(folder, data):
    scene = BOX.export(file_type="gltf")
    for name, content in scene.items():
        put(folder, name, content)
    expect_named(read_mesh, put(folder, "model.gltf", data.draw(damaged_json(scene["model.gltf"].decode()))))


@LENIENT
@given(suite=damaged_json(SUITE), timing=damaged_json(TIMING))
def test_json_of_suites(folder, suite, timing):
    put(folder, "suite.json", suite)
    expect_named(read_side, folder)
    put(folder, "timing.json", timing)
    expect_named(timing_in, folder)


@LENIENT
@given(data=damaged_json(read(Path(str(suite_file("tiny"))).parents[1] / "baselines" / "gate-small.json")))
def test_baselines(folder, data):
    flights = json.loads(read(Path(str(suite_file("tiny"))).parents[1] / "baselines" / "gate-small.json"))["flights"]
    expect_named(read_baseline, put(folder, "baseline.json", data), flights)


@LENIENT
@given(name=st.sampled_from(["record.json", "frames.csv", "times.csv", "score.json"]), data=st.data())
def test_results(folder, results, name, data):
    run = folder / "run"
    run.mkdir(exist_ok=True)
    for each, text in results.items():
        put(run, each, text)
    damaged = damaged_json if name.endswith(".json") else damaged_text
    put(run, name, data.draw(damaged(results[name])))

    def use():
        score(Sequence.load(TRIAL), Results.load(run)).save(run / "again.json")

    expect_named(use)
    expect_named(Score.load, run / "score.json")
