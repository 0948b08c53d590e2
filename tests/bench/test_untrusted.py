"""Configs, models, airframes and datasets of others read nothing outside of their folders."""

import json
import os
import re

import pytest

from bench.check import TRIAL
from bench.config import load_suite, load_tracker
from bench.config_paths import FREE
from scenes.exports import export
from scenes.mesh_file import read as read_mesh
from scenes.sequence import Sequence, inside
from trajectories.airframe_file import read_airframe
from trajectories.airframes import Crazyflie
from trajectories.errors import UserError
from trajectories.mount import Mount

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
    with pytest.raises(UserError, match=r"file=\.\.\.> names another file"):
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
    with pytest.raises(UserError, match="leads out of the folder"):
        export(Sequence.load(folder), "tum", tmp_path / "out")
