"""Configs, models, airframes and datasets of others read nothing outside of their folders."""

import json
import os
import re
import shutil

import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite, load_tracker
from uavbench.bench.external.job_folder import write_frames
from uavbench.bench.gate.baseline import read_baseline
from uavbench.bench.inputs.file_paths import FREE
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.scoring.score import Score
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.disk_guards import inside
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import export
from uavbench.scenes.model_files.model_reading import read as read_mesh
from uavbench.tracker.initialization import read_init
from uavbench.tracker.results import Results
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.along import read_waypoints
from uavbench.trajectories.trajectory_files.formats import read_trajectory
from uavbench.trajectories.vehicle.airframe_file import read_airframe
from uavbench.trajectories.vehicle.airframes import Crazyflie

SUITE = """
title = "Files"
rates_hz = [15.0]
[sequences.a]
structure = {{ kind = "mesh", path = {mesh} }}
environment = {{ kind = "indoor" }}
flight.airframe = {{ kind = "file", path = {airframe} }}
flight.path = {{ kind = "waypoints", file = {waypoints} }}
[trackers]
mine = {{ kind = "external", command = ["python3", "track.py"], input_files = [{weights}] }}
"""
NAMES = {"mesh": "hall.obj", "airframe": "mine.toml", "waypoints": "flight/way.csv", "weights": "net.bin"}
KEYS = {
    "mesh": "sequences.a.structure.path",
    "airframe": "sequences.a.flight.airframe.path",
    "waypoints": "sequences.a.flight.path.file",
    "weights": "trackers.mine.input_files",
}


@pytest.fixture
def folders(tmp_path):
    """A folder with all that the suite names, and one beside it with the same."""
    for folder in (tmp_path / "suite", tmp_path / "elsewhere"):
        (folder / "flight").mkdir(parents=True)
        for name in (*NAMES.values(), "track.py"):
            (folder / name).write_text("x")
    return tmp_path / "suite", tmp_path / "elsewhere"


def written(folder, **names):
    path = folder / "suite.toml"
    path.write_text(SUITE.format(**{key: json.dumps(str(name)) for key, name in {**NAMES, **names}.items()}))
    return path


def test_files_beside_the_config_are_found_there(folders):
    suite = load_suite(written(folders[0]))
    assert suite.sequences[0].structure.path == str(folders[0] / "hall.obj")
    assert suite.sequences[0].flight.path.file == str(folders[0] / "flight/way.csv")
    assert suite.trackers["mine"].command == ("python3", str(folders[0] / "track.py"))
    assert suite.trackers["mine"].input_files == (str(folders[0] / "net.bin"),)


@pytest.mark.parametrize("key", list(NAMES))
@pytest.mark.parametrize("way", ["up", "absolute", "link"])
def test_a_config_that_names_a_file_outside_of_its_folder_is_refused(folders, key, way, monkeypatch):
    folder, elsewhere = folders
    name = {"up": f"../elsewhere/{NAMES[key]}", "absolute": elsewhere / NAMES[key], "link": "linked"}[way]
    (folder / "linked").symlink_to(elsewhere / NAMES[key])
    with pytest.raises(UserError, match=rf"{re.escape(KEYS[key])}: .* lies outside of .*{FREE}="):
        load_suite(written(folder, **{key: name}))
    monkeypatch.setenv(FREE, os.pathsep.join(["/nowhere", str(elsewhere)]))
    load_suite(written(folder, **{key: name}))


RECORDED = """
title = "Recorded"
rates_hz = [15.0]
[recordings.a.source]
kind = "files"
images_path = "images"
model_file = "hall.obj"
camera_file = "net.bin"
init_file = "net.bin"
[trackers]
hold = { kind = "hold" }
"""


@pytest.mark.parametrize("name", ["1.png", "more/1.png", "more"])
def test_an_image_of_a_recording_that_lies_elsewhere_is_refused(folders, name, monkeypatch):
    folder, elsewhere = folders
    (folder / "images" / "more").mkdir(parents=True)
    (folder / "images" / "0.png").write_text("x")
    (folder / "images" / "link.png").symlink_to("0.png")
    (folder / "suite.toml").write_text(RECORDED)
    load_suite(folder / "suite.toml")
    (folder / "images" / name).parent.mkdir(exist_ok=True)
    if name == "more":
        (folder / "images" / "more").rmdir()
    (folder / "images" / name).symlink_to(elsewhere / "net.bin")
    with pytest.raises(UserError, match=r"recordings\.a\.source\.images_path: .*net\.bin lies outside of"):
        load_suite(folder / "suite.toml")
    monkeypatch.setenv(FREE, str(elsewhere))
    load_suite(folder / "suite.toml")


def test_all_files_outside_are_told_at_once_with_the_other_mistakes(folders):
    path = written(folders[0], mesh="../elsewhere/hall.obj", airframe="/etc/hostname")
    path.write_text(path.read_text().replace("title", "titel"))
    with pytest.raises(UserError, match="4 mistakes"):
        load_suite(path)
    (folders[0] / "tracker.toml").write_text('kind = "external"\ncommand = ["true"]\ninput_files = ["/etc/hostname"]\n')
    with pytest.raises(UserError, match=r"tracker\.input_files: /etc/hostname lies outside"):
        load_tracker(folders[0] / "tracker.toml")


@pytest.mark.parametrize(
    ("model", "text"),
    [
        ("a.obj", "mtllib ../elsewhere/a.mtl\n"),
        ("a.obj", "mtllib here.mtl\n"),
        ("a.gltf", '{"buffers": [{"uri": "../elsewhere/a.bin"}]}'),
    ],
)
def test_a_model_that_refers_to_a_file_elsewhere_is_refused(folders, model, text):
    folder, elsewhere = folders
    (folder / model).write_text(text)
    (folder / "here.mtl").write_text("newmtl a\nmap_Kd ../elsewhere/secret.png\n")
    for name in ("a.mtl", "a.bin", "secret.png"):
        (elsewhere / name).write_text("secret")
    with pytest.raises(UserError, match="not in the folder of the model"):
        read_mesh(folder / model)


@pytest.mark.parametrize(
    "element", ['<include file="/etc/hostname"/>', '<asset><mesh name="m" file="/etc/hostname"/></asset>']
)
def test_an_airframe_that_names_another_file_is_refused(tmp_path, element):
    path = tmp_path / "vehicle.xml"
    text = Crazyflie().build(Mount())
    path.write_text(text)
    read_airframe(path, Mount())
    path.write_text(text.replace("<worldbody>", f"{element}<worldbody>"))
    with pytest.raises(UserError, match=r"file=\.\.\.> refers to another file"):
        read_airframe(path, Mount())


@pytest.mark.parametrize("name", ["../secret.png", "/etc/hostname", "frames/../../secret.png", "link.png"])
def test_a_dataset_that_names_a_file_outside_of_itself_is_refused(tmp_path, name):
    folder = tmp_path / "sequence"
    folder.mkdir()
    for item in TRIAL.iterdir():
        if item.is_file():
            (folder / item.name).write_bytes(item.read_bytes())
    (tmp_path / "secret.png").write_text("secret")
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    frames = (folder / "frames.csv").read_text()
    assert inside(folder, "frames/0.png") == folder.resolve() / "frames/0.png"
    (folder / "frames.csv").write_text(frames.replace(Sequence.load(TRIAL).files[0], name))
    with pytest.raises(UserError, match="points outside the folder"):
        export(Sequence.load(folder), "tum", tmp_path / "out")


@pytest.fixture
def dataset(tmp_path):
    """A whole sequence and results on it, beside a secret."""
    folder = tmp_path / "sequence"
    shutil.copytree(TRIAL, folder)
    (folder / "imu.csv").write_text("stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2\n0,0,0,0,0,0,0\n")
    (tmp_path / "secret").write_text("secret")
    return folder


def use(folder):
    """All that reads a sequence: tracking, scoring, exporting, giving it to a program."""
    sequence = Sequence.load(folder)
    images = [sequence.image(k) for k in range(len(sequence))]
    job = folder.parent / "job"
    job.mkdir()
    write_frames(job, sequence, [0])
    for name in ("euroc", "tum", "kitti", "bop", "mcap"):
        export(sequence, name, folder.parent / name)
    return images, sequence.ground_truth, (job / "imu.csv").read_text().splitlines()


def test_the_dataset_is_good_as_it_is(dataset):
    images, _, imu = use(dataset)
    assert len(images) == 10 and len(imu) == 2


FILES = [
    "sequence.json",
    "camera.toml",
    "model.obj",
    "edges.csv",
    "frames.csv",
    "groundtruth.csv",
    "imu.csv",
    "frames/000003.png",
]


WRONG = {
    "config": [1], "deviation": "x", "versions": [[]], "rate_hz": "15", "row_delay_ns": [1], "cam_from_body": [[1]],
    "timeshift_cam_imu_ns": 10**30, "format": "2", "sensors": [1], "cameras": {"left": 1},
}  # fmt: skip
"""By key of `sequence.json`: what is none of its values."""


@pytest.mark.parametrize("form", ["euroc", "tum", "colmap"])
@pytest.mark.parametrize("key", [*WRONG, "effects", "quaternion", "stamps"])
def test_a_dataset_that_says_what_none_does_is_a_users_mistake(tmp_path, form, key):
    folder = shutil.copytree(TRIAL, tmp_path / "trial")
    info = json.loads((folder / "sequence.json").read_text())
    info |= {key: WRONG[key]} if key in WRONG else {"config": {"effects": [1]}} if key == "effects" else {}
    (folder / "sequence.json").write_text(json.dumps(info))
    head, *rows = (folder / "groundtruth.csv").read_text().splitlines()
    if key == "quaternion":
        rows = [",".join([*row.split(",")[:5], "9", *row.split(",")[6:]]) for row in rows]
    elif key == "stamps":
        rows = rows[::-1]
        frames = (folder / "frames.csv").read_text().splitlines()
        (folder / "frames.csv").write_text("\n".join([frames[0], *frames[:0:-1]]) + "\n")
    (folder / "groundtruth.csv").write_text("\n".join([head, *rows]) + "\n")
    done = CliRunner().invoke(main, ["export", str(folder), "--format", form, "--out", str(tmp_path / "out")])
    assert done.exit_code == 2 and "Traceback" not in done.output, (done.output, done.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("target", ["outside", "/dev/zero", "pipe", "folder", "loop", "gone", "huge"])
def test_no_file_of_a_dataset_is_read_that_is_not_its_own(dataset, name, target):
    path = dataset / name
    whole = path.read_bytes()
    path.unlink()
    match target:
        case "outside":
            (dataset.parent / "secret").write_bytes(whole)
            path.symlink_to(dataset.parent / "secret")
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "huge":
            with path.open("wb") as handle:
                handle.truncate(1 << 42)
        case _:
            path.symlink_to({"loop": path.name, "gone": "nowhere"}.get(target, target))
    with pytest.raises(UserError, match=re.escape(name)):
        use(dataset)
    assert name != "imu.csv" or not (dataset.parent / "job" / "imu.csv").exists()


@pytest.mark.parametrize("name", ["record.json", "frames.csv", "times.csv", "score.json"])
@pytest.mark.parametrize("target", ["../secret", "/dev/zero"])
def test_no_file_of_results_is_read_that_is_not_its_own(tmp_path, name, target):
    run = tmp_path / "run"
    run.mkdir()
    (tmp_path / "secret").write_text("{}")
    for each in ("record.json", "frames.csv", "times.csv"):
        (run / each).write_text("{}")
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(target)
    with pytest.raises(UserError, match=r"points outside the folder|not a regular file|missing columns|differ from"):
        Results.load(run) if name != "score.json" else Score.load(run / name)


@pytest.mark.parametrize(
    "read",
    [
        load_suite,
        load_tracker,
        read_airframe,
        read_mesh,
        read_trajectory,
        read_waypoints,
        Camera.load,
        read_init,
        read_baseline,
    ],
)
@pytest.mark.parametrize("kind", ["/dev/zero", "pipe", "huge"])
def test_a_file_that_never_ends_is_refused_at_once(tmp_path, read, kind):
    path = tmp_path / ("a.obj" if read is read_mesh else "a.toml")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "huge":
        with path.open("wb") as handle:
            handle.truncate(1 << 42)
    else:
        path.symlink_to(kind)
    more = {read_airframe: [Mount()], read_init: [Sequence.load(TRIAL).camera], read_baseline: ["f"]}.get(read, [])
    with pytest.raises(UserError, match=r"not a regular file|has 4,398,046,511,104 bytes; "):
        read(path, *more)


PLY = """ply
format ascii 1.0
comment TextureFile {name}
element vertex 3
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0
1 0 0 0 1
0 1 0 1 0
3 0 1 2
"""
OBJ = "{indent}mtllib {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
GLTF = (
    '{{"asset": {{"version": "2.0"}}, "images": [{{"uri": "{name}"}}], '
    '"buffers": [{{"uri": "{name}", "byteLength": 1}}]}}'
)


@pytest.mark.parametrize("name", ["../elsewhere/a.png", "link.png", "{absolute}", "sub/../../elsewhere/a.png"])
@pytest.mark.parametrize(
    ("kind", "text"), [("ply", PLY), ("obj", OBJ), ("obj", OBJ.replace("{indent}", " \t")), ("gltf", GLTF)]
)
def test_no_reference_of_a_model_leads_out_of_its_folder(folders, name, kind, text, monkeypatch):
    folder, elsewhere = folders
    (folder / "sub").mkdir()
    (elsewhere / "a.png").write_bytes((TRIAL / "frames/000000.png").read_bytes())
    (folder / "link.png").symlink_to(elsewhere / "a.png")
    name = name.format(absolute=elsewhere / "a.png")
    (folder / f"model.{kind}").write_text(text.format(name=name, indent=""))
    opened = []
    real = os.open
    monkeypatch.setattr(os, "open", lambda path, *flags: opened.append(os.fspath(path)) or real(path, *flags))
    with pytest.raises(UserError, match=r"not in the folder of the model|points outside the folder"):
        read_mesh(folder / f"model.{kind}")
    (folder / f"model.{kind}").write_text(PLY.format(name="own.png"))
    assert all(str(folder) in path for path in opened)


def test_a_zip_of_a_model_is_none(tmp_path):
    for kind in (".3mf", ".zip", ".dae", ".xaml", ".3dxml", ".gz"):
        (tmp_path / f"a{kind}").write_bytes(b"PK\x03\x04")
        with pytest.raises(UserError, match=f"cannot read models of type {kind}"):
            read_mesh(tmp_path / f"a{kind}")
