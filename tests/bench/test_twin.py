"""The path-traced twin: Blender's camera is ours, its pictures lie where ours do, and what cannot be is refused."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.process_trees import wait_until, with_mark
from tests.hand_made import hand_made
from uavbench.bench.cli.main import main
from uavbench.bench.closed_loop.eye import eye
from uavbench.bench.config.suite import recorded_spec, suite_of
from uavbench.bench.third_party.visp import Visp
from uavbench.bench.trial.check import TRIAL
from uavbench.bench.twin import twin as twins
from uavbench.bench.twin.blender import find_blender
from uavbench.bench.twin.path_tracer import TracedScene
from uavbench.bench.twin.ranking import table
from uavbench.bench.twin.scene_files import blender_camera, blender_pose, lets_light_through, sky_light, write_scene
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.dataset.verify import compare, verify
from uavbench.scenes.exports.registry import export
from uavbench.scenes.generate import generate
from uavbench.scenes.rendering.radiance import decode
from uavbench.scenes.scene import build_scene
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.run import track_sequence
from uavbench.tracker.shang_shen.rapid import Rapid
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

CAMERA = {
    "width": 96,
    "height": 72,
    "horizontal_fov_deg": 65.0,
    "distortion_model": "radtan",
    "distortion": [-0.2, 0.05, 0.001, -0.001],
}
SEQUENCE = {
    "structure": {"kind": "box"},
    "environment": {"kind": "studio"},
    "flight": {"path": {"kind": "hand-pilot", "duration_s": 0.3}},
    "camera": CAMERA,
    "effects": [{"kind": "rolling-shutter"}, {"kind": "motion-blur"}, {"kind": "noise"}, {"kind": "drops"}],
    "annotations": ["depth", "mask", "edges"],
}


def spec_of(**changes):
    table = {"title": "a box", "rates_hz": [15.0], "trackers": {"hold": {"kind": "hold"}}}
    (spec,) = suite_of({**table, "sequences": {"box": {**SEQUENCE, **changes}}}, (), TRIAL / "suite.toml").sequences
    return spec


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered") / "box-s0"
    generate(spec_of(), folder, content_hash="of the test")
    return folder


@pytest.fixture
def blender():
    try:
        return find_blender()
    except UserError as error:
        pytest.skip(str(error))


def twin(*words):
    return CliRunner().invoke(main, ["twin", *map(str, words)])


def fake_blender(folder, monkeypatch, script):
    program = folder / "blender"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("UAVBENCH_BLENDER", str(program))


# --- the camera, without Blender ---------------------------------------------------------------------------------


def seen_by_blender(about, world_from_camera, points):
    """Pixels (n, 2) of points by Blender's parameters alone, as camera.c: the plane of view, then its share in it."""
    w, h = about["size"]
    ycor = about["aspect"][1] / about["aspect"][0]
    per_px = about["sensor_mm"] / about["lens_mm"] / w
    low = np.array([-0.5 * w + about["shift_x"] * w, -0.5 * ycor * h + about["shift_y"] * w]) * per_px
    high = low + np.array([w, ycor * h]) * per_px
    local = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(world_from_camera).T
    share = (local[:, :2] / -local[:, 2:3] - low) / (high - low)
    return np.column_stack([share[:, 0] * w, (1 - share[:, 1]) * h]) - 0.5


@pytest.mark.parametrize(("fx", "fy"), [(300.0, 300.0), (300.0, 250.0), (250.0, 330.0)])
def test_blenders_camera_sees_every_point_at_the_same_pixel(fx, fy):
    camera = Camera(320, 200, fx, fy, 171.3, 88.4)
    cam_from_world = Pose.exp(np.array([0.3, -0.2, 0.5, 0.7, -1.1, 0.4]))
    rng = np.random.default_rng(1)
    seen = np.column_stack([rng.uniform(-1, 1, (50, 2)), rng.uniform(1, 5, 50)])
    points = cam_from_world.inverse().transform(seen)
    about = blender_camera(camera)
    assert min(about["aspect"]) == 1.0
    pixels = seen_by_blender(about, np.array(blender_pose(cam_from_world)), points)
    np.testing.assert_allclose(pixels, camera.project(seen), atol=1e-9)


def test_a_uniform_sky_lights_a_floor_as_brightly_as_it_is():
    sky = np.zeros((64, 128, 3), dtype=np.uint8)
    sky[:32] = (255, 128, 0)
    np.testing.assert_allclose(sky_light(sky), np.square(np.array([255, 128, 0]) / 255), rtol=1e-9)


def test_a_room_lets_light_in_and_its_floor_does_not():
    indoor = build_scene(spec_of(environment={"kind": "indoor"}))
    through = [part for part in indoor.unlit if lets_light_through(part)]
    assert through and all(part.instance == 0 and part.vertices[:, 2].max() > 1 for part in through)
    assert any(part.instance == 0 and not lets_light_through(part) for part in indoor.unlit)


def test_the_scene_is_written_without_baked_light(tmp_path):
    scene = build_scene(spec_of(environment={"kind": "indoor"}))
    write_scene(scene, tmp_path)
    about = json.loads((tmp_path / "scene.json").read_text())
    assert len(about["parts"]) == len(scene.unlit)
    for part, told in zip(scene.unlit, about["parts"], strict=True):
        written = np.fromfile(tmp_path / f"{told['name']}.vertices", "<f4").reshape(-1, 3)
        np.testing.assert_array_equal(written, part.vertices.astype(np.float32))
        assert ("tint" in told["arrays"]) == (part.tint is not None)
        if told["texture"]:
            assert cv2.imread(str(tmp_path / told["texture"]), cv2.IMREAD_UNCHANGED).shape == part.texture.shape


def test_a_spec_comes_back_from_its_record(tmp_path):
    for name in ("box", "wall", "bridge"):
        spec = spec_of(structure={"kind": name}, clutter=[{"kind": "trees"}])
        assert recorded_spec(json.loads(json.dumps(described(spec))), tmp_path / "sequence.json") == spec


# --- what a site adds -----------------------------------------------------------------------------------------------

DETAILS = {
    "clouds": {"cloud_shadow": 0.5, "cloud_size_m": 15.0, "wind_m_s": 5.0},
    "water": {"wet": 0.7},
    "dirt": {"dirt": 1.0},
}


def outdoors(**site):
    """A building on asphalt."""
    environment = {"kind": "outdoor", "ground": "asphalt", "site": site}
    return build_scene(spec_of(structure={"kind": "building"}, environment=environment))


def test_the_water_the_dirt_and_the_clouds_of_a_site_are_written(tmp_path):
    scene = outdoors(**DETAILS["clouds"], **DETAILS["water"], **DETAILS["dirt"])
    write_scene(scene, tmp_path)
    about = json.loads((tmp_path / "scene.json").read_text())
    for part, told in zip(scene.unlit, about["parts"], strict=True):
        assert [part.film is None, part.soil is None] == [told["film"] is None, told["soil"] is None]
        assert ("soil_uv" in told["arrays"]) == (part.soil is not None)
    wet, soiled = ([each for each in about["parts"] if each[kind]] for kind in ("film", "soil"))
    assert wet and soiled and any(each["stands"] for each in wet)
    for name, texture in (
        (wet[0]["film"], next(part.film.texture for part in scene.unlit if part.film is not None)),
        (soiled[0]["soil"], next(part.soil for part in scene.unlit if part.soil is not None)),
        (about["clouds"]["texture"], scene.light.clouds.texture),
    ):
        np.testing.assert_array_equal(cv2.imread(str(tmp_path / name))[..., ::-1], texture)


def views(scene, program):
    """Linear radiance (2, h, w) of a facade in the sun and the ground before it, 2 s on: drawn, and path traced."""
    low, _ = scene.built.structure.bounds
    camera = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
    eye = np.add(low, [-6.0, -12.0, 10.0])
    ahead = np.add(low, [3.0, -1.0, 1.5]) - eye
    axis = ahead / np.linalg.norm(ahead)
    right = np.cross(axis, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(axis, right), axis])
    pose = Pose(rotation, -rotation @ eye)
    with scene.renderer(64, 48) as drawn, TracedScene(scene, program, 16).renderer(64, 48) as traced:
        images = [each.color(pose, camera, 2.0) for each in (drawn, traced)]
    return np.array([cv2.GaussianBlur(np.square(image / 255.0), (0, 0), 1.0).mean(axis=2) for image in images])


@pytest.mark.slow
def test_a_sites_details_darken_the_same_places_as_in_the_renderer(blender):
    plain = views(outdoors(), blender)
    for name, site in DETAILS.items():
        drawn, traced = views(outdoors(**site), blender) / plain
        assert drawn.min() < 0.85, name
        assert np.corrcoef(drawn.ravel(), traced.ravel())[0, 1] > 0.95, name
        assert abs(drawn.mean() - traced.mean()) < 0.03, name


# --- what cannot be ----------------------------------------------------------------------------------------------


def refused(result, *words):
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for word in words:
        assert word in result.output


def test_an_absent_blender_is_told_as_absent(sequence, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    refused(twin(sequence, "--out", tmp_path / "t"), "not installed", "apt-get install blender")
    monkeypatch.setenv("UAVBENCH_BLENDER", str(tmp_path / "nowhere"))
    refused(twin(sequence, "--out", tmp_path / "t"), "not installed", "nowhere")
    assert not (tmp_path / "t").exists()


def test_a_blender_that_is_too_old_or_none_is_named(sequence, tmp_path, monkeypatch):
    fake_blender(tmp_path, monkeypatch, "echo 'Blender 2.83.5'; echo '  build date: 2020'")
    refused(twin(sequence, "--out", tmp_path / "t"), "2.83.5", "too old", "at least 3.1")
    monkeypatch.delenv("UAVBENCH_BLENDER")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    refused(twin(sequence, "--out", tmp_path / "t"), str(tmp_path / "blender"), "too old", "apt-get install blender")
    fake_blender(tmp_path, monkeypatch, "echo 'no display' >&2; exit 3")
    refused(twin(sequence, "--out", tmp_path / "t"), "prints no version", "no display")


def test_the_last_words_of_a_blender_that_fails_are_told(sequence, tmp_path, monkeypatch):
    script = 'case "$1" in --version) echo "Blender 3.4.1";; *) seq 100 >&2; echo "out of memory" >&2; exit 11;; esac'
    fake_blender(tmp_path, monkeypatch, script)
    refused(twin(sequence, "--out", tmp_path / "t"), "exit code 11", "out of memory", "99")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blender"]


def test_what_has_no_spec_is_refused(sequence, tmp_path):
    refused(twin(TRIAL, "--out", tmp_path / "t"), "no `config`")
    recorded = hand_made(shutil.copytree(sequence, tmp_path / "recorded"))
    for change, words in (
        ({"initial_cam_from_world": np.eye(4).tolist()}, "recordings"),
        ({"twin": {"of": "box-s0"}}, "is itself a twin"),
        ({"config": {"structure": {"kind": "os:system"}}}, "unknown kind 'os:system'"),
    ):
        info = json.loads((sequence / "sequence.json").read_text()) | change
        (recorded / "sequence.json").write_text(json.dumps(info))
        refused(twin(recorded, "--out", tmp_path / "t"), words)


def test_more_than_every_frame_is_refused(sequence, tmp_path):
    frames = len(Sequence.load(sequence))
    refused(twin(sequence, "--every", frames + 1, "--out", tmp_path / "t"), f"has {frames} frames")
    refused(twin(sequence, "--every", 0, "--out", tmp_path / "t"), "--every")


def test_no_other_folder_becomes_a_twin(sequence, tmp_path):
    other = shutil.copytree(sequence, tmp_path / "other")
    before = {path: path.read_bytes() for path in sorted(other.rglob("*")) if path.is_file()}
    refused(twin(sequence, "--out", other), "not as `twin of a sequence`")
    refused(twin(other, "--out", other), "lies in the sequence itself")
    refused(twin(other, "--out", other / "twin"), "lies in the sequence itself")
    assert before == {path: path.read_bytes() for path in sorted(other.rglob("*")) if path.is_file()}


def test_a_sequence_of_another_version_is_refused(sequence, tmp_path, monkeypatch):
    fake_blender(tmp_path, monkeypatch, "echo 'Blender 3.4.1'")
    other = hand_made(shutil.copytree(sequence, tmp_path / "other"))
    head, *rows = (other / "groundtruth.csv").read_text().splitlines()
    cells = rows[1].split(",")
    cells[2] = repr(float(cells[2]) + 1e-3)
    (other / "groundtruth.csv").write_text("\n".join([head, rows[0], ",".join(cells), *rows[2:]]) + "\n")
    refused(twin(other, "--out", tmp_path / "t"), "builds or flies it differently")


def test_trackers_rank_on_both_and_an_absent_one_does_not(tmp_path, monkeypatch):
    monkeypatch.setenv("UAVBENCH_THIRD_PARTY", str(tmp_path))
    trial = Sequence.load(TRIAL)
    lines = list(table({"hold": Hold(), "visp": Visp(), "rapid": Rapid()}, trial, trial))
    cells = {line.split("`")[1]: [cell.strip() for cell in line.split("|")[2:-1]] for line in lines[2:5]}
    assert cells["hold"][:3] == cells["hold"][3:] and cells["rapid"][:3] == cells["rapid"][3:]
    assert {cells["hold"][2], cells["rapid"][2]} == {"1", "2"}
    assert float(cells["hold"][0]) > 1 and cells["hold"][1] == "100"
    assert "absent" in cells["visp"][0] and "third-party setup visp" in cells["visp"][0]
    assert lines[-1].strip() == "The rankings agree."


# --- a program in Blender's place, which draws all black ----------------------------------------------------------

BLACK = """
import json, sys
from pathlib import Path
print('{"denoiser": ""}', flush=True)
for line in sys.stdin:
    asked = json.loads(line)
    width, height = asked["camera"]["size"]
    Path(asked["file"]).write_bytes(bytes(16 * width * height))
    print("{}", flush=True)
"""
HOSTILE = {
    "a link to a sensor elsewhere": ("imu.csv", "link"),
    "a link to a device": ("imu.csv", "device"),
    "a pipe": ("notes.txt", "pipe"),
    "a link to a depth elsewhere": ("depth/000000.png", "link"),
    "no depth": ("depth/000001.png", "nothing"),
    "rows elsewhere": ("row_poses.npy", "link"),
    "rows that lie about their size": ("row_poses.npy", "lie"),
    "rows of another size": ("row_poses.npy", "other"),
    "rows that are none": ("row_poses.npy", "text"),
    "rows that are an archive": ("row_poses.npy", "archive"),
}


@pytest.fixture
def black(tmp_path, monkeypatch):
    (tmp_path / "black.py").write_text(BLACK)
    script = (
        f'case "$1" in --version) echo "Blender 3.4.1";; *) exec {sys.executable} -S {tmp_path / "black.py"};; esac'
    )
    fake_blender(tmp_path, monkeypatch, script)


def test_what_does_not_depend_on_the_renderer_is_copied(black, sequence, tmp_path):
    done = twin(sequence, "--every", 2, "--out", tmp_path / "t")
    assert done.exit_code == 0, done.output
    assert verify(tmp_path / "t").ok
    assert (tmp_path / "t" / "imu.csv").read_bytes() == (sequence / "imu.csv").read_bytes()
    rows, all_rows = (np.load(folder / "row_poses.npy") for folder in (tmp_path / "t", sequence))
    np.testing.assert_array_equal(rows, all_rows[::2])


@pytest.mark.parametrize("name", ["frames/000001.png", "imu.csv"])
def test_a_twin_that_lacks_a_file_is_not_up_to_date(black, sequence, tmp_path, name):
    words = (sequence, "--every", 2, "--out", tmp_path / "t")
    assert twin(*words).exit_code == 0
    (tmp_path / "t" / name).unlink()
    assert twin(*words).exit_code == 0
    assert verify(tmp_path / "t").ok


@pytest.fixture(scope="module")
def with_surfaces(tmp_path_factory):
    """A sequence with flow and normals, a stereo pair and bounds, of which one frame was lost."""
    folder = tmp_path_factory.mktemp("surfaces") / "box-s0"
    further = {
        "annotations": ["flow", "normals"],
        "cameras": [{"name": "right", "camera": CAMERA, "mount": {"offset_m": [0.0, -0.1, 0.0]}}],
        "crlb_every": 2,
        "flight": {"path": {"kind": "hand-pilot", "duration_s": 0.5}},
        "effects": [{"kind": "drops", "lost": 0.3}],
    }
    generate(spec_of(**further), folder, content_hash="of the test")
    return folder


def test_normals_and_flow_are_the_sequences_to_the_byte(black, with_surfaces, tmp_path):
    given = Sequence.load(with_surfaces)
    assert np.ptp(np.diff(given.stamps_ns)) > 1e6, "a frame was lost, and flow leads past it"
    done = twin(with_surfaces, "--out", tmp_path / "t")
    assert done.exit_code == 0, done.output
    made = Sequence.load(tmp_path / "t")
    assert made.stamps_ns.tolist() == given.stamps_ns.tolist()
    for kind, count in (("normals", len(given)), ("flow", len(given) - 1), ("occlusion", len(given) - 1)):
        files = sorted(path.name for path in (made.folder / kind).iterdir())
        assert len(files) == count
        assert all((made.folder / kind / f).read_bytes() == (given.folder / kind / f).read_bytes() for f in files)
    assert made[len(made) - 1].flow_px is None and made[0].flow_px is not None


def test_what_is_not_in_a_twin_is_told_in_one_line(black, with_surfaces, sequence, tmp_path):
    whole, third, plain = (
        twin(folder, "--every", every, "--out", tmp_path / f"{folder.parent.name}-{every}")
        for folder, every in ((with_surfaces, 1), (with_surfaces, 3), (sequence, 2))
    )
    told = "crlb.csv (bounds of the images of uavbench's renderer); cameras right (a twin is of the main camera)"
    assert whole.stderr.splitlines()[-1] == f"not in the twin: {told}"
    (line,) = (line for line in third.stderr.splitlines() if line.startswith("not in the twin"))
    assert line.startswith("not in the twin: flow and occlusion (to the next frame") and line.endswith(told)
    assert "not in the twin" not in plain.stderr
    made, given = (Sequence.load(folder) for folder in (Path(third.stdout.strip()), with_surfaces))
    assert [path.name for path in made.folder.iterdir() if path.name in ("flow", "occlusion", "cameras")] == []
    np.testing.assert_array_equal(made[1].normals, given[3].normals)


WRONG = {
    "no answer": ("print('{oops')", "answered"),
    "an endless line": ("print('{' + 'x' * 100000)", "answered"),
    "no image": ("pass", "view.f32: no such file"),
    "the last image": ("if first: write()", "view.f32: no such file"),
    "half an image": ("write(2)", "bytes, or values"),
    "no numbers": ("write(1, float('nan'))", "values that are not numbers"),
    "another file": ("os.symlink('/etc/hostname', file)", "view.f32"),
    "a pipe": ("os.mkfifo(file)", "view.f32: is not a regular file"),
    "a device": ("os.symlink('/dev/zero', file)", "view.f32: is not a regular file"),
    "the end": ("os.mkfifo('pipe'); os.rename('pipe', 'stderr.txt'); sys.exit(4)", "exit code 4"),
}
WRONG_BLENDER = """
import array, json, os, sys
print(json.dumps({"denoiser": ""}), flush=True)
first = True
for line in sys.stdin:
    request = json.loads(line)
    file, (width, height) = request["file"], request["camera"]["size"]
    def write(part=1, value=0.0):
        open(file, "wb").write(array.array("f", [value] * (4 * width * height // part)).tobytes())
    CHANGE
    first = False
    print("{}", flush=True)
"""


@pytest.mark.parametrize("how", WRONG)
def test_an_answer_of_another_program_is_refused(sequence, tmp_path, monkeypatch, how):
    change, word = WRONG[how]
    (tmp_path / "wrong.py").write_text(WRONG_BLENDER.replace("CHANGE", change))
    run = f"exec {sys.executable} -S {tmp_path / 'wrong.py'}"
    fake_blender(tmp_path, monkeypatch, f'case "$1" in --version) echo "Blender 3.4.1";; *) {run};; esac')
    refused(twin(sequence, "--out", tmp_path / "t"), word)
    assert not (tmp_path / "t").exists()


def test_a_blender_that_never_tells_its_version_is_refused_and_ended(sequence, tmp_path, monkeypatch):
    mark = f"OF_THE_TEST_{tmp_path}"
    fake_blender(tmp_path, monkeypatch, f"MARK={mark} sleep 600 & MARK={mark} exec sleep 600")
    monkeypatch.setattr("uavbench.bench.twin.blender.VERSION_S", 0.5)
    refused(twin(sequence, "--out", tmp_path / "t"), "--version did not end within 0.5 s")
    assert wait_until(lambda: not with_mark(mark))


@pytest.mark.parametrize("how", HOSTILE)
def test_no_file_from_elsewhere_gets_into_a_twin(black, sequence, tmp_path, how):
    name, what = HOSTILE[how]
    given = shutil.copytree(sequence, tmp_path / "given")
    path, secret = given / name, tmp_path / "secret"
    path.unlink(missing_ok=True)
    secret.write_bytes(b"secret")
    match what:
        case "link":
            path.symlink_to(secret)
        case "device":
            path.symlink_to("/dev/zero")
        case "pipe":
            os.mkfifo(path)
        case "lie":
            head = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 72, 7)}
            with path.open("wb") as file:
                np.lib.format.write_array_header_1_0(file, head)
        case "other":
            np.save(path, np.zeros((3, 2)))
        case "text":
            path.write_text("not an array")
        case "archive":
            with path.open("wb") as file:
                np.savez(file, np.zeros(3))
    refused(twin(given, "--out", tmp_path / "t"), name)
    assert not (tmp_path / "t").exists()


OPEN = """
import sys, time
from uavbench.trajectories.processes.guard import Guard
from uavbench.bench.twin.blender import Blender, opened
with Guard("uavbench-twin-") as guard, opened(Blender(sys.argv[1], "3.4.1"), guard, 1):
    print(guard.folder, flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_blender_ends_with_us_and_leaves_nothing(tmp_path, monkeypatch, how):
    mark = f"OF_THE_TEST_{tmp_path}"
    script = f"{sys.executable} -c 'import time; time.sleep(600)' & echo '{{\"denoiser\": \"\"}}'; sleep 600"
    fake_blender(tmp_path, monkeypatch, f"MARK={mark} export MARK\n{script}")
    owner = subprocess.Popen(
        [sys.executable, "-c", OPEN, str(tmp_path / "blender")], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    )
    folder = Path(owner.stdout.readline().decode().strip())
    assert folder.is_dir() and wait_until(lambda: len(with_mark(mark)) >= 2)
    owner.send_signal(how)
    owner.communicate()
    assert wait_until(lambda: not with_mark(mark) and not folder.exists())


# --- with Blender ------------------------------------------------------------------------------------------------


def outline_places(image, edges, mask):
    """Place (n,) of the light's step across the outline, px beside the true one, for each BLOCK px along it.

    Where half of the light within REACH px to either side would lie if it came in one step, which no sampling shifts.
    """
    light, across, found = decode(image).mean(axis=2), np.linspace(-REACH, REACH, 25), []
    for _, u0, v0, u1, v1, _, _ in edges:
        length = float(np.hypot(u1 - u0, v1 - v0))
        along = np.array([u1 - u0, v1 - v0]) / length
        places = np.array([u0, v0]) + np.arange(6, length - 6)[:, None] * along
        lines = places[:, None] + across[:, None] * np.array([-along[1], along[0]])
        for block in np.array_split(lines.astype(np.float32), max(1, len(lines) // BLOCK)) if len(lines) else ():
            inside = cv2.remap(mask, block, None, cv2.INTER_NEAREST)
            sides = inside[:, :5].mean(), inside[:, -5:].mean()
            if sorted(sides) == [0, 1]:
                seen = cv2.remap(light, block, None, cv2.INTER_LINEAR).mean(axis=0)
                low, high = seen[:4].mean(), seen[-4:].mean()
                found.append(REACH - 2 * REACH * (seen.mean() - low) / (high - low))
    return np.array(found)


REACH, BLOCK = 3.0, 8


@pytest.mark.ci
@pytest.mark.slow
def test_edges_and_light_of_a_twin_lie_where_ours_do(blender, tmp_path):
    near = {"width": 160, "height": 120, "horizontal_fov_deg": 30.0}
    generate(spec_of(effects=[], camera=near, annotations=["mask", "edges"]), tmp_path / "ours", content_hash="test")
    ours = Sequence.load(tmp_path / "ours")
    done = twin(ours.folder, "--every", len(ours), "--samples", 32, "--out", tmp_path / "twin")
    assert done.exit_code == 0, done.output
    traced = Sequence.load(tmp_path / "twin")
    assert traced[0].mask.tobytes() == ours[0].mask.tobytes()
    drawn, theirs = (outline_places(each[0].image, ours[0].edges, ours[0].mask) for each in (ours, traced))
    assert len(theirs) > 12
    assert np.median(np.abs(theirs)) < 0.1
    assert np.abs(np.median(theirs)) < 0.05
    assert np.median(np.abs(theirs - drawn)) < 0.1
    box = cv2.erode((ours[0].mask == 1).astype(np.uint8), np.ones((5, 5))) > 0
    around = cv2.dilate((ours[0].mask == 1).astype(np.uint8), np.ones((5, 5))) == 0
    light, same = (decode(each[0].image) for each in (traced, ours))
    np.testing.assert_allclose(light[around].mean(axis=0), same[around].mean(axis=0), atol=0.002)
    assert (np.abs(light[box].mean(axis=0) / same[box].mean(axis=0) - 1) < 0.25).all()  # its sides take no extra light


@pytest.mark.ci
@pytest.mark.slow
def test_a_twin_is_a_sequence_like_any_other_the_same_twice(blender, sequence, tmp_path):
    given = Sequence.load(sequence)
    for name in ("twin", "again"):
        done = twin(sequence, "--every", 2, "--samples", 2, "--out", tmp_path / name)
        assert done.exit_code == 0, done.output
    assert verify(tmp_path / "twin").ok
    assert compare(tmp_path / "twin", tmp_path / "again").method == "hash"
    made = Sequence.load(tmp_path / "twin")
    assert made.stamps_ns.tolist() == given.stamps_ns[::2].tolist()
    for frame in made:
        of = given[2 * frame.number]
        np.testing.assert_array_equal(frame.world_from_body.matrix, of.world_from_body.matrix)
        assert frame.mask.tobytes() == of.mask.tobytes() and frame.depth_m.tobytes() == of.depth_m.tobytes()
        np.testing.assert_array_equal(frame.edges[:, :6], of.edges[:, :6])
        assert frame.image.tobytes() != of.image.tobytes()
    for name in ("model.obj", "edges.csv", "camera.toml", "flight.csv", "imu.csv"):
        assert (made.folder / name).read_bytes() == (sequence / name).read_bytes()
    rows, all_rows = (np.load(folder / "row_poses.npy") for folder in (made.folder, sequence))
    np.testing.assert_array_equal(rows, all_rows[::2])
    told = made.info["twin"]
    assert told["of"] == given.name and told["content_hash"] == given.content_hash
    assert told["renderer"] == f"Blender {blender.version}, Cycles on the CPU" and told["samples"] == 2
    assert len(track_sequence(Rapid(), made, rate_hz=7.5, seed=0).frames) == len(made)
    export(made, "euroc", tmp_path / "euroc")
    assert twin(sequence, "--every", 3, "--samples", 1, "--out", tmp_path / "twin").exit_code == 0  # over our own
    refused(twin(tmp_path / "twin", "--out", tmp_path / "of-a-twin"), "is itself a twin")


def test_a_twin_of_a_sequence_that_is_written_meanwhile_is_not_kept(black, sequence, tmp_path):
    given = shutil.copytree(sequence, tmp_path / "given")
    script = tmp_path / "black.py"
    script.write_text(BLACK.replace("print('{", f"Path({str(given / 'imu.csv')!r}).touch()\nprint('{{", 1))
    done = twin(given, "--every", 4, "--out", tmp_path / "t")
    assert done.exit_code == 2 and "changed while it was in use: imu.csv; the twin was not written" in done.output
    assert not (tmp_path / "t").exists()
    script.write_text(BLACK)
    assert twin(given, "--every", 4, "--out", tmp_path / "t").exit_code == 0


def test_all_code_that_a_twin_is_rendered_with_is_in_its_key(monkeypatch):
    asked = []
    monkeypatch.setattr(twins, "code_hash", lambda *packages: asked.extend(packages))
    monkeypatch.setattr(twins, "content_hash", lambda *parts: "")
    told = SimpleNamespace(name="a", content_hash="b", images_hash="c", version="4.5")
    twins._provenance(told, None, twins.Tracing(), told)
    assert eye.__module__.split(".")[1:3] == ["bench", "closed_loop"]  # which exposes the frames
    assert {"trajectories", "scenes", "bench/twin", "bench/closed_loop"} <= {*asked}
