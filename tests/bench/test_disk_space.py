"""The bytes that `--dry-run` tells of a sequence are those that it then has, within a quarter."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from uavbench.bench.config.suite import suite_of
from uavbench.bench.disk_space.image_bytes import image_bytes
from uavbench.bench.disk_space.sequence_bytes import MEASURED, sequence_bytes
from uavbench.scenes.camera_path import mounted_path
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.generate import generate
from uavbench.scenes.png.encoder import png
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.structures.registry import STRUCTURES
from uavbench.trajectories.simulation.flight import fly

ALL = ["depth", "mask", "edges", "flow", "normals"]
IRIS = {"kind": "iris"}
SUN = {"kind": "outdoor", "sun_azimuth_deg": -60.0}
ORBIT = {"kind": "orbit", "distance_m": 8.0, "height_m": 4.0, "turns": 0.02, "speed_m_s": 1.5}
ALONG = {"kind": "girder-follow", "distance_m": 6.0, "height_m": 4.0, "stretch_m": [-9.0, -7.0], "speed_m_s": 1.0}
RIGHT = {"name": "right", "camera": {"width": 256, "height": 192}, "mount": {"offset_m": [0.0, -0.1, 0.0]}}
SCENES = {
    "box": {
        "structure": {"kind": "box"},
        "environment": {"kind": "indoor"},
        "flight": {"path": {"kind": "hand-pilot", "duration_s": 2.0}},
    },
    "bridge": {
        "structure": {"kind": "bridge"},
        "environment": SUN,
        "flight": {"airframe": IRIS, "path": ALONG},
    },
    "building": {
        "structure": {"kind": "building"},
        "environment": SUN,
        "flight": {"airframe": IRIS, "path": ORBIT},
    },
}
SWITCHED_ON = {
    "nothing": {},
    "noise": {"effects": [{"kind": "noise"}]},
    "all": {"annotations": ALL, "effects": [{"kind": "noise"}]},
    "a stereo rig": {"annotations": ALL, "cameras": [RIGHT]},
    "a view from above": {"mount": {"pitch_deg": -30.0}},
    "a lidar": {"sensors": [{"kind": "lidar-2d", "rate_hz": 20.0}]},
    "little": {"camera": {"width": 64, "height": 48}},
    "little, and all": {"camera": {"width": 64, "height": 48}, "annotations": ALL, "effects": [{"kind": "noise"}]},
    "little, and a backdrop": {"camera": {"width": 96, "height": 72}, "environment": {"kind": "studio"}},
    "a gimbal": {"camera": {"width": 96, "height": 72}, "mount": {"kind": "gimbal", "encoder": {"rate_hz": 500.0}}},
}
CASES = [
    *(("box", on) for on in SWITCHED_ON),
    ("bridge", "all"),
    ("bridge", "a stereo rig"),
    ("building", "nothing"),
    ("building", "a stereo rig"),
    ("building", "a view from above"),
    ("bridge", "little"),
    ("building", "little, and all"),
]


def spec_of(scene, **switched):
    table = {**SCENES[scene], "camera": {"width": 256, "height": 192}, "rate_hz": 5.0, **switched}
    suite = {"title": "bytes", "rates_hz": [1.0], "seeds": [0], "trackers": {"hold": {"kind": "hold"}}}
    (spec,) = suite_of({**suite, "sequences": {scene: table}}, (), Path("bytes.toml")).sequences
    return spec


@pytest.mark.slow(seconds=30)
@pytest.mark.parametrize(("scene", "on"), CASES)
def test_a_sequence_takes_the_bytes_that_were_told(tmp_path, scene, on):
    spec = spec_of(scene, **SWITCHED_ON[on])
    generate(spec, tmp_path / "made", content_hash="of the test")
    made = Sequence.load(tmp_path / "made")
    seconds = len((made.folder / "flight.csv").read_text().splitlines()) / 100
    taken = sum(path.stat().st_size for path in made.folder.rglob("*") if path.is_file())
    assert sequence_bytes(spec, len(made), seconds) == pytest.approx(taken, rel=0.25)


NOISE = {"kind": "noise"}
CHANGED = {
    "noise, compressed": [NOISE, {"kind": "jpeg"}],
    "compressed hard": [{"kind": "jpeg", "quality": 40}],
    "much noise": [{"kind": "noise", "full_well_e": 1500.0}],
    "little noise, hardly compressed": [
        {"kind": "noise", "full_well_e": 40000.0, "read_noise_e": 3.0},
        {"kind": "jpeg", "quality": 95},
    ],
    "an analog link": [NOISE, {"kind": "analog-link"}],
    "a clean analog link": [
        {"kind": "analog-link", "snow": 0.0, "bursts_per_frame": 0.0, "dropouts_per_frame": 0.0},
    ],
    "exposure": [{"kind": "auto-exposure"}, NOISE],
    "a longer exposure": [{"kind": "exposure", "stops": 1.5}, NOISE],
    "a shorter exposure": [{"kind": "exposure", "stops": -2.0}, NOISE],
    "a colour filter": [NOISE, {"kind": "colour-filter"}],
    "sharp processing": [NOISE, {"kind": "colour-filter", "demosaicing": "gradient-corrected"}, {"kind": "sharpening"}],
    "sharpened, compressed": [NOISE, {"kind": "sharpening"}, {"kind": "jpeg"}],
}


@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize("on", CHANGED)
@pytest.mark.parametrize("scene", ["box", "building"])
def test_images_take_the_bytes_that_are_told_of_noise_and_compression(clean_frames, on, scene):
    """Of frames by the effects themselves, from the clean and the noisy bytes of the same frames."""
    clean, noisy, taken = (clean_frames[scene](effects) for effects in ([], [NOISE], CHANGED[on]))
    effects = spec_of(scene, effects=CHANGED[on]).effects
    assert image_bytes(clean, noisy, effects) == pytest.approx(taken, rel=0.08)


@pytest.fixture(scope="module")
def clean_frames():
    """For each scene, the mean bytes per pixel of two frames with effects."""
    with ExitStack() as stack:
        yield {scene: taken_by(scene, stack) for scene in ("box", "building")}


def taken_by(scene, stack):
    spec = spec_of(scene, camera={"width": 640, "height": 480})
    built = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, built.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, 0)
    path = mounted_path(flight, lambda _: spec.mount.at_rest.cam_from_body)
    renderer = stack.enter_context(built.renderer(pinhole.width, pinhole.height))
    ideal = ideal_camera(renderer, camera, pinhole, lens, path, 0.0)

    def taken(effects):
        source = with_effects(ideal, spec_of(scene, effects=effects).effects, 0)
        images = [encode(source.image(time_ns)) for time_ns in (0, 900_000_000)]
        return sum(len(png(image)) for image in images) / (len(images) * 640 * 480)

    return taken


def test_of_the_cramer_rao_bounds_every_one_counts():
    spec = spec_of("box")
    bounds = [
        sequence_bytes(replace(spec, crlb_every=every), 100, 1.0) - sequence_bytes(spec, 100, 1.0) for every in (1, 4)
    ]
    assert bounds[0] == pytest.approx(4 * bounds[1]) and bounds[0] > 100 * 400


@pytest.mark.parametrize("name", ALL)
def test_each_annotation_counts_for_each_camera(name):
    one, two = spec_of("bridge"), spec_of("bridge", cameras=[RIGHT])
    more = [
        sequence_bytes(replace(spec, annotations=(name,)), 100, 1.0) - sequence_bytes(spec, 100, 1.0)
        for spec in (one, two)
    ]
    assert more[0] > 0
    assert more[1] == pytest.approx(2 * more[0])


def test_a_contact_sheet_has_a_dozen_images_and_is_less_of_a_plain_backdrop():
    spec = spec_of("box", camera={"width": 64, "height": 48})
    studio = replace(spec, environment=spec_of("box", environment={"kind": "studio"}).environment)
    noisy = spec_of("box", camera={"width": 64, "height": 48}, environment={"kind": "studio"}, **SWITCHED_ON["noise"])
    told = [sequence_bytes(spec, frames, 1.0) for frames in (1, 2, 12, 13, 14)]
    each, after = told[1] - told[0], told[4] - told[3]
    assert told[2] - told[1] == pytest.approx(10 * each) and told[3] - told[2] == pytest.approx(after)
    assert each - after > 3 * after  # a frame of 64x48 has 4 kB, on the sheet 20
    assert sequence_bytes(studio, 12, 1.0) < 0.6 * sequence_bytes(noisy, 12, 1.0) < sequence_bytes(spec, 12, 1.0)


def test_frames_further_apart_have_more_flow_and_a_studio_less_of_an_image():
    def flow_at(hz):
        spec = replace(spec_of("building"), rate_hz=hz)
        return sequence_bytes(replace(spec, annotations=("flow",)), 100, 1.0) - sequence_bytes(spec, 100, 1.0)

    assert 2 * flow_at(15.0) < flow_at(1.0) < 3 * flow_at(15.0)  # measured: 2.6
    studio = spec_of("building", environment={"kind": "studio"})
    assert sequence_bytes(studio, 1000, 1.0) < 0.2 * sequence_bytes(spec_of("building"), 1000, 1.0)


def test_all_structures_but_files_are_measured():
    assert set(MEASURED) == {cls for kind, cls in STRUCTURES.items() if kind != "mesh"}
