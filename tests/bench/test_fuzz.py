"""Readers take anything: what is not right is a UserError, never another exception.

Each property runs 100 cases; 10,000 with UAVBENCH_NIGHTLY=1. Half of the cases are valid files with a piece cut out,
doubled or replaced, which get further than noise does.
"""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.check import TRIAL
from bench.config import load_suite, load_tracker
from bench.external_rows import POSE_HEADER, read_estimates
from bench.gate_scores import read_side, read_timing
from bench.suite_files import suite_file
from scenes.camera import Camera
from scenes.mesh_file import read as read_mesh
from scenes.model_files import load_structure
from scenes.sequence import Sequence
from scenes.tables import read_table
from tracker.results import Results
from trajectories.errors import UserError
from trajectories.formats import read_trajectory

CASES = 10_000 if os.environ.get("UAVBENCH_NIGHTLY") else 100
LENIENT = settings(
    max_examples=CASES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
POSE_ROW = "1000,ok,0.1,-0.2,3.5,0.5,0.5,-0.5,0.5\n"
TUM = "0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n0.2 2 0 0 0 0 0 1\n"
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
CORNERS = ("0 0 0", "1 0 0", "0 1 0", "0 0 1")
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
LOOPS = ("outer loop\n" + "".join(f"vertex {CORNERS[k]}\n" for k in face) + "endloop\n" for face in FACES)
STL = "solid t\n" + "".join(f"facet normal 0 0 0\n{loop}endfacet\n" for loop in LOOPS) + "endsolid t\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
)
OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
CAO = """V1
4
0 0 0
1 0 0
0 1 0
0 0 1
0
0
4
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 2
0
0
"""
MESHES = {".obj": OBJ, ".stl": STL, ".ply": PLY, ".off": OFF, ".cao": CAO}
"""A tetrahedron in every format."""
JSON = '{"sequences": ["a-s0"], "trackers": ["t"], "rates_hz": [15.0], "runs": {"t": [{"sequence": "a"}]}}'


def damaged(valid: str):
    """Bytes: noise, or a valid file with a slice of it replaced."""
    data = valid.encode()
    place = st.integers(0, len(data))
    piece = st.one_of(
        st.binary(max_size=12),
        st.sampled_from(
            [b"nan", b"inf", b"-1", b"1e999", b"[", b"{", b'"', b"\n", b",", b" ", b"\x00", b"\xff", b"= ="]
        ),
        st.integers().map(lambda n: str(n).encode()),
    )
    cut = st.tuples(place, place, piece).map(lambda t: data[: min(t[:2])] + t[2] + data[max(t[:2]) :])
    small = st.tuples(place, st.integers(0, 3), piece).map(lambda t: data[: t[0]] + t[2] + data[t[0] + t[1] :])
    return st.one_of(st.binary(max_size=200), cut, small)


def expect_named(function, *arguments):
    try:
        function(*arguments)
    except UserError as error:
        assert str(error)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


def put(folder, name, data):
    path = folder / name
    path.write_bytes(data)
    return path


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@LENIENT
@given(data=damaged(read(suite_file("tiny"))))
def test_suites(folder, data):
    expect_named(load_suite, put(folder, "suite.toml", data))


@LENIENT
@given(data=damaged('kind = "external"\ncommand = ["true"]\ntimeout_s = 1.0\nmemory_mb = 100\n'))
def test_trackers(folder, data):
    expect_named(load_tracker, put(folder, "tracker.toml", data))


@LENIENT
@given(data=damaged(read(TRIAL / "camera.toml")))
def test_cameras(folder, data):
    expect_named(Camera.load, put(folder, "camera.toml", data))


@LENIENT
@given(data=damaged(",".join(POSE_HEADER) + "\n" + POSE_ROW))
def test_estimates(folder, data):
    results, _ = read_estimates(put(folder, "estimates.csv", data), [0, 1000, 2000])
    assert len(results) == 3


@LENIENT
@given(data=damaged(read(TRIAL / "frames.csv")))
def test_tables(folder, data):
    expect_named(read_table, put(folder, "frames.csv", data), ["frame", "stamp_ns", "file"])


@LENIENT
@given(data=damaged(read(TRIAL / "model.obj")), edges=damaged(read(TRIAL / "edges.csv")))
def test_models_of_sequences(folder, data, edges):
    put(folder, "model.obj", data)
    put(folder, "edges.csv", edges)
    expect_named(load_structure, folder)


@LENIENT
@given(name=st.sampled_from(["sequence.json", "frames.csv", "truth.csv", "camera.toml", "edges.csv"]), data=st.data())
def test_sequences(folder, name, data):
    trial = folder / "trial"
    trial.mkdir(exist_ok=True)
    for item in TRIAL.iterdir():
        if item.is_file():
            put(trial, item.name, item.read_bytes())
    put(trial, name, data.draw(damaged(read(TRIAL / name))))

    def use():
        sequence = Sequence.load(trial)
        return sequence.truth, sequence.cam_from_body, sequence.name

    expect_named(use)


@LENIENT
@given(data=damaged(TUM), suffix=st.sampled_from([".tum", ".txt", ".csv"]))
def test_trajectories(folder, data, suffix):
    expect_named(read_trajectory, put(folder, f"trajectory{suffix}", data))


@LENIENT
@given(st.data(), st.sampled_from(list(MESHES)))
def test_meshes(folder, data, suffix):
    expect_named(read_mesh, put(folder, f"mesh{suffix}", data.draw(damaged(MESHES[suffix]))))


@pytest.mark.parametrize("suffix", MESHES)
def test_meshes_that_are_damaged_are_whole_before(folder, suffix):
    """Else the damage would never get further than the first line."""
    pieces = read_mesh(put(folder, f"whole{suffix}", MESHES[suffix].encode()))
    assert sum(len(piece.triangles) for piece in pieces) == 4


@LENIENT
@given(data=damaged(JSON))
def test_json_of_results(folder, data):
    put(folder, "suite.json", data)
    expect_named(read_side, folder)
    put(folder, "timing.json", data)
    expect_named(read_timing, folder)
    put(folder, "record.json", data)
    expect_named(Results.load, folder)
