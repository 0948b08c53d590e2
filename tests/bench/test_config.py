"""Suites: what is right becomes specs, what is wrong is told all at once, with file, key path and nearest name."""

import json
from pathlib import Path

import pytest

from uavbench.bench.config.suite import load_suite, suite_model
from uavbench.bench.config.suite_files import SUITES, suite_file, suite_names
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.scenes.dataset.spec_record import described
from uavbench.trajectories.errors import UserError

GOOD = """
title = "test"
rates_hz = [15.0]

[sequences.box]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hand-pilot", duration_s = 2.0 }
effects = [{ kind = "noise" }]

[trackers]
hold = { kind = "hold" }
"""


def suite(tmp_path, text):
    path = tmp_path / "suite.toml"
    path.write_text(text)
    return path


def mistakes(tmp_path, text):
    with pytest.raises(UserError) as caught:
        load_suite(suite(tmp_path, text))
    first, *rest = str(caught.value).split("\n")
    assert str(tmp_path / "suite.toml") in first
    return [line.strip() for line in rest] or [first]


@pytest.mark.parametrize("name", suite_names())
def test_every_suite_that_comes_along_is_valid(name):
    loaded = load_suite(suite_file(name))
    assert loaded.sequences
    assert loaded.trackers


def toml(value):
    """A value as TOML has it inline; a key without a value is left out."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items() if item is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value)


@pytest.mark.parametrize("name", [name for name in suite_names() if name != "real-cube"])
def test_what_a_dataset_says_of_its_config_makes_it_again(tmp_path, name, monkeypatch):
    monkeypatch.setenv("UAVBENCH_DATA", str(SUITES))  # where the files lie that its config names
    for spec in load_suite(suite_file(name)).sequences[:: len(load_suite(suite_file(name)).sequences) // 3 or 1]:
        table = described(spec)
        told = {"title": "again", "seeds": [table.pop("seed")], "rates_hz": [1.0]}
        told |= {"sequences": {table.pop("name").rpartition("-s")[0]: table}, "trackers": {"hold": {"kind": "hold"}}}
        text = "\n".join(f"{key} = {toml(value)}" for key, value in told.items())
        assert load_suite(suite(tmp_path, text)).sequences == (spec,)


def test_a_suite_becomes_specs(tmp_path):
    loaded = load_suite(suite(tmp_path, "seeds = [0, 7]" + GOOD))
    assert [(s.name, s.seed) for s in loaded.sequences] == [("box-s0", 0), ("box-s7", 7)]
    assert loaded.sequences[0].flight.path.duration_s == 2.0
    assert loaded.rates_hz == (15.0,)


def test_three_mistakes_are_told_at_once(tmp_path):
    text = GOOD.replace("duration_s = 2.0", "duraton_s = 2.0").replace('"hold" }', '"hodl" }')
    text = text.replace("rates_hz = [15.0]", "rates_hz = [-1.0]")
    told = mistakes(tmp_path, text)
    assert len(told) == 3
    assert any("sequences.box.flight.path.duraton_s" in m and "did you mean 'duration_s'" in m for m in told)
    assert any("trackers.hold.kind" in m and "did you mean 'hold'" in m for m in told)
    assert any("rates_hz[0]" in m and "greater than 0" in m for m in told)


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("duration_s = 2.0", 'duration_s = "2 s"', "sequences.box.flight.path.duration_s", "number"),
        ("duration_s = 2.0", "duration_s = -2.0", "sequences.box.flight.path.duration_s", "greater than 0"),
        ("duration_s = 2.0", "duration_s = nan", "sequences.box.flight.path.duration_s", "finite"),
        ('structure = { kind = "box" }', "structure = {}", "sequences.box.structure", "`kind` is missing"),
        ('structure = { kind = "box" }\n', "", "sequences.box.structure", "missing"),
        ('kind = "noise"', 'kind = "nosie"', "sequences.box.effects[0].kind", "did you mean 'noise'"),
        (
            "effects =",
            "camera.width = 160_000_000\neffects =",
            "sequences.box.camera.width",
            "less than or equal to 16384",
        ),
        ("effects =", "camera = { width = 16_384, height = 16_384 }\neffects =", "sequences.box.camera", "160,000,000"),
        ("effects =", "camera.fx_px = 300.0\neffects =", "sequences.box.camera", "give all of fx_px"),
        (
            "effects =",
            "camera = { fx_px = 300, fy_px = 300, cx_px = 319.5, cy_px = 239.5, horizontal_fov_deg = 60 }\neffects =",
            "sequences.box.camera",
            "either fx_px, fy_px, cx_px, cy_px, or horizontal_fov_deg, not both",
        ),
        (
            "effects =",
            "flight.control = { attitude_1_s2 = [-422.0, 422.0, 273.0] }\neffects =",
            "sequences.box.flight.control.attitude_1_s2[0]",
            "greater than 0",
        ),
        (
            "effects =",
            'flight.wind = { kind = "steady", speed_m_s = 10000.0 }\neffects =',
            "sequences.box.flight.wind.speed_m_s",
            "less than or equal to 100, got 10000.0",
        ),
        (
            "effects =",
            'flight.wind = { kind = "gust", every_s = 1e-9 }\neffects =',
            "sequences.box.flight.wind.every_s",
            "greater than or equal to 0.1",
        ),
        (
            "effects =",
            'flight.wind = { kind = "dryden", height_m = 1e300 }\neffects =',
            "sequences.box.flight.wind.height_m",
            "less than or equal to 305",
        ),
        (
            "effects =",
            'flight.wind = { kind = "steady", from_deg = 1e300 }\neffects =',
            "sequences.box.flight.wind.from_deg",
            "less than or equal to 3600",
        ),
        (
            "effects =",
            "flight.control = { velocity_1_s = 1e9 }\neffects =",
            "sequences.box.flight.control.velocity_1_s",
            "less than or equal to 500",
        ),
        (
            "effects =",
            "mount = { pitch_deg = 1e9 }\neffects =",
            "sequences.box.mount.pitch_deg",
            "less than or equal to 3600",
        ),
        ('"indoor" }', '"outdoor", grain = 0.5 }', "sequences.box.environment.grain", "less than or equal to 0.3"),
        ('"indoor" }', '"outdoor", grain = -0.1 }', "sequences.box.environment.grain", "greater than or equal to 0"),
        (
            '"indoor" }',
            '"outdoor", ground_patches = 0.7 }',
            "sequences.box.environment.ground_patches",
            "less than or equal to 0.6",
        ),
        ('"indoor" }', '"indoor", sharp_textures = "very" }', "sequences.box.environment.sharp_textures", "boolean"),
        ("[sequences.box]", '[sequences."../box"]', 'sequences."../box"', "cannot be a name: use lower-case letters"),
        ("[sequences.box]", '[sequences.".."]', 'sequences.".."', "cannot be a name: use lower-case letters"),
        (
            "effects =",
            'clutter = [{ kind = "people", nearest_m = 9, furthest_m = 1 }]\neffects =',
            "sequences.box.clutter[0]",
            "nearest_m 9 is not below furthest_m 1; lower",
        ),
        (
            "effects =",
            'clutter = [{ kind = "trees", nearest_m = 2, furthest_m = 2 }]\neffects =',
            "sequences.box.clutter[0]",
            "nearest_m 2 is not below furthest_m 2; lower",
        ),
        (
            "effects =",
            'clutter = [{ kind = "lookalikes", nearest_m = 3, furthest_m = 2 }]\neffects =',
            "sequences.box.clutter[0]",
            "nearest_m 3 is not below furthest_m 2; lower",
        ),
        (
            "effects =",
            'sensors = [{ kind = "flow", least_range_m = 5, greatest_range_m = 4 }]\neffects =',
            "sequences.box.sensors[0]",
            "least_range_m 5 is not below greatest_range_m 4; swap",
        ),
        (
            "effects =",
            'flight.airframe = { kind = "crazyflie", min_thrust_n = 0.2, max_thrust_n = 0.1 }\neffects =',
            "sequences.box.flight.airframe",
            "min_thrust_n 0.2 is not below max_thrust_n 0.1; swap",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "drops", lost = 0.6, repeated = 0.5 }',
            "sequences.box.effects[0]",
            "lost 0.6 and repeated 0.5 are together more than all frames; lower one",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "rolling-shutter" }, { kind = "noise" }, { kind = "rolling-shutter", readout_ms = 5 }',
            "sequences.box: effects[2]: ",
            "is of the kind of effects[0], of which only one would count; remove one",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "motion-blur" }, { kind = "motion-blur" }',
            "sequences.box: effects[1]: ",
            "is of the kind of effects[0], of which only one would count; remove one",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "auto-exposure" }, { kind = "noise" }, { kind = "exposure", stops = 1 }',
            "sequences.box: effects[2]: ",
            "contradicts effects[0], since both set the exposure; remove one",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "sharpening", amount = 0, radius_px = 2 }',
            "sequences.box.effects[0]",
            "radius_px 2 has no effect: amount is 0",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "colour-filter", pattern = "RGBG" }',
            "sequences.box.effects[0].pattern",
            "RGGB",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "rolling-shutter", readout_ms = 67 }',
            "sequences.box: effects[0].readout_ms 67",
            "longer than the 66.7 ms of a frame at rate_hz 15; lower",
        ),
        (
            '{ kind = "noise" }',
            '{ kind = "motion-blur", exposure_ms = 67 }',
            "sequences.box: effects[0].exposure_ms 67",
            "longer than the 66.7 ms of a frame at rate_hz 15; lower",
        ),
        (
            "effects =",
            "clock.jitter_ms = 27\neffects =",
            "sequences.box: clock.jitter_ms 27",
            "more than 26.7, 0.4 of a period at rate_hz 15; lower",
        ),
        (
            "effects =",
            'cameras = [{ name = "right" }]\neffects =',
            "sequences.box: cameras[0].name 'right'",
            "has mount, lens and offset_s of the main camera, and sees the same; give",
        ),
        (
            "effects =",
            'cameras = [{ name = "a", offset_s = 0.01 }, { name = "b", offset_s = 0.01 }]\neffects =',
            "sequences.box: cameras[1].name 'b'",
            "has mount, lens and offset_s of cameras[0], and sees the same; give",
        ),
        (
            "effects =",
            "camera = { fx_px = 300, fy_px = 300, cx_px = 80000, cy_px = 239.5 }\neffects =",
            "sequences.box.camera: cx_px 80000",
            "more than 85 degrees from the optical axis",
        ),
        (
            "effects =",
            'camera = { distortion_model = "plumb_bob", distortion = [0.1, 0, 0, 0, 0] }\neffects =',
            "sequences.box.camera.distortion_model",
            "'plumb_bob' is 'radtan' here",
        ),
        (
            "effects =",
            'sensors = { kind = "imu" }\neffects =',
            "sequences.box.sensors",
            "must be a list, in square brackets, also of one item",
        ),
        ("title", 'loops = "filter"\ntitle', "loops", "must be tables with names, as [loops.NAME], got 'filter'"),
        ("effects =", 'sensors = ["imu"]\neffects =', "sequences.box.sensors[0]", 'a table, as { kind = "imu" }'),
        ("effects =", "camera = 3\neffects =", "sequences.box.camera", "must be a table, in braces, got 3"),
        ("title", "titel", "titel", "did you mean 'title'"),
        ("rates_hz = [15.0]", "rates_hz = [15.0]\nsensors = []", "sensors", "did you mean 'sequences.NAME.sensors'"),
        (
            "effects =",
            "seeds = [1, 2]\neffects =",
            "sequences.box.seeds",
            "'seeds' is a key of the suite: write it above",
        ),
        ("rates_hz = [15.0]", "rates_hz = [30.0]", "rates_hz", "more than the 15 Hz"),
    ],
)
def test_each_mistake_names_its_key(tmp_path, old, new, key, told):
    assert any(m.startswith(key) and told in m for m in mistakes(tmp_path, GOOD.replace(old, new)))


@pytest.mark.parametrize(
    "lines",
    [
        'clutter = [{ kind = "lookalikes", nearest_m = 2, furthest_m = 2 }]',
        'effects = [{ kind = "drops", lost = 0.9, repeated = 0.1 }]',
        'effects = [{ kind = "noise" }, { kind = "noise", full_well_e = 400.0 }, { kind = "jpeg" }, { kind = "jpeg" }]',
        'effects = [{ kind = "auto-exposure" }, { kind = "auto-exposure", lag_s = 0 }]',
        'effects = [{ kind = "exposure", stops = -8 }, { kind = "sharpening" }, { kind = "sharpening" }]',
        'effects = [{ kind = "rolling-shutter", readout_ms = 66.6 }, { kind = "motion-blur", exposure_ms = 66.6 }]',
        "clock.jitter_ms = 26.6",
        'cameras = [{ name = "right", offset_s = 0.01 }, { name = "far", mount = { offset_m = [0.0, -0.1, 0.0] } }]',
        "camera.horizontal_fov_deg = 169.9",
        'sensors = [{ kind = "lidar-2d", elevations_deg = [-3.0, 5.0] }]',
    ],
)
def test_what_is_just_possible_is_taken(tmp_path, lines):
    assert load_suite(suite(tmp_path, GOOD.replace('effects = [{ kind = "noise" }]', lines))).sequences


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("rates_hz = [15.0]", "seeds = [0, 3, 0, 0]\nrates_hz = [15.0]", ["seeds[2]: 0", "seeds[3]: 0"]),
        ("rates_hz = [15.0]", "rates_hz = [15.0, 14.9999999, 1]", ["rates_hz[1]: 14.9999999"]),
        ("rates_hz = [15.0]", "rates_hz = [3, 15.0, 3.0]", ["rates_hz[2]: 3"]),
        (
            "rates_hz = [15.0]",
            "rates_hz = [15.0, 14.9]",
            ["rates_hz[1]: 14.9 Hz has stride 1"],
        ),
        (
            "rates_hz = [15.0]",
            "rates_hz = [7.5, 5, 7.45]",
            ["rates_hz[2]: 7.45 Hz has stride 2"],
        ),
        ("rates_hz = [15.0]", 'rates_hz = [15.0]\nprotocols = ["reset", "reset"]', ["protocols[1]: 'reset'"]),
        ("[sequences.box]", "[sequences.Box]", ["sequences.Box"]),
        ("hold =", "hold = { kind = 'hold' }\nHold =", ["trackers.Hold"]),
        ("hold =", "'hold ' =", ['trackers."hold "']),
    ],
)
def test_what_would_count_twice_or_share_a_folder_is_refused(tmp_path, old, new, told):
    lines = mistakes(tmp_path, GOOD.replace(old, new))
    assert len(lines) == len(told)
    for line, start in zip(lines, told, strict=True):
        assert line.startswith(start)


@pytest.mark.parametrize(
    ("rate_hz", "choice"), [(13.5, "15 or 7.5"), (10.0, "15 or 7.5"), (8.5, "15 or 7.5"), (6.0, "7.5 or 5")]
)
def test_a_rate_that_no_stride_of_the_sequence_has_is_refused(tmp_path, rate_hz, choice):
    """It would be scored as that rate, and be another: 10 Hz were 7.5."""
    text = GOOD.replace("rates_hz = [15.0]", f"rates_hz = [15.0, {rate_hz}]")
    (line,) = mistakes(tmp_path, text)
    assert line == (
        f"rates_hz[1]: {rate_hz:g} Hz: sequence box-s0 has 15 Hz, of which every k-th frame is tracked, k a whole "
        f"number; choose {choice} Hz"
    )


@pytest.mark.parametrize("rate_hz", [15.0, 7.5, 5.0, 3.0, 1.0, 2.143, 4.0, 0.98])
def test_a_rate_that_a_stride_has_is_taken(tmp_path, rate_hz):
    path = suite(tmp_path, GOOD.replace("rates_hz = [15.0]", f"rates_hz = [{rate_hz}]"))
    assert load_suite(path).rates_hz == (rate_hz,)


def test_a_flight_in_closed_loop_exposes_at_any_rate_up_to_the_sequences(tmp_path):
    flown = GOOD.replace("rates_hz = [15.0]", "rates_hz = [14.0, 13.5]") + "[loop]\n"
    assert load_suite(suite(tmp_path, flown)).rates_hz == (14.0, 13.5)
    assert mistakes(tmp_path, flown.replace("13.5", "15.5")) == [
        "rates_hz[1]: 15.5 Hz is more than the 15 Hz of sequence box-s0"
    ]


@pytest.mark.parametrize("seeds", ["", "seeds = [4, 5]\n"])
def test_a_sequence_under_a_second_name_would_count_twice(tmp_path, seeds):
    head, _, rest = GOOD.partition("[sequences.box]")
    body, trackers, after = rest.partition("[trackers]")
    twice = f"{seeds}{head}[sequences.box]{body}[sequences.again]{body}{trackers}{after}"
    assert mistakes(tmp_path, twice) == ["sequences.again: equals box except for its name; remove one"]
    other = f"{seeds}{head}[sequences.box]{body}[sequences.again]{body}rate_hz = 30.0\n{trackers}{after}"
    path = tmp_path / "suite.toml"
    path.write_text(other)
    assert {spec.name.partition("-")[0] for spec in load_suite(path).sequences} == {"box", "again"}


def test_what_is_there_twice_is_told_with_the_other_mistakes(tmp_path):
    text = GOOD.replace("rates_hz = [15.0]", "seeds = [1, 1]\nrates_hz = [15.0, 15]").replace("title", "titel")
    assert len(mistakes(tmp_path, text)) == 4


@pytest.mark.parametrize("text", ["title = ", "\x00", "[a]\n[a]"])
def test_a_broken_file_is_one_clear_error(tmp_path, text):
    assert "TOML" in mistakes(tmp_path, text)[0]


def test_a_missing_file_and_a_misspelt_suite_are_named():
    with pytest.raises(UserError, match=r"nowhere\.toml: no such file"):
        load_suite(Path("nowhere.toml"))
    with pytest.raises(UserError, match="did you mean 'paper'"):
        suite_file("papr")


def test_the_schema_is_json_and_knows_the_kinds():
    text = json.dumps(suite_model().model_json_schema())
    assert '"hand-pilot"' in text
    assert '"lsd"' in text


def test_the_content_hash_sees_every_parameter_and_nothing_else(tmp_path):
    one, same = (load_suite(suite(tmp_path, GOOD)).sequences[0] for _ in range(2))
    other = load_suite(suite(tmp_path, GOOD.replace("2.0", "2.5"))).sequences[0]
    assert content_hash(one) == content_hash(same) != content_hash(other)


def test_a_users_own_plugin_is_taken_by_module_and_attribute(tmp_path, monkeypatch):
    (tmp_path / "mine_for_test.py").write_text(
        "from dataclasses import dataclass\n"
        "@dataclass(frozen=True)\n"
        "class Mine:\n"
        "    gain: float = 1.0\n"
        "    def start(self, structure, camera, cam_from_world, rng): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    text = GOOD.replace('kind = "hold"', 'kind = "mine_for_test:Mine", gain = 2.0')
    assert load_suite(suite(tmp_path, text)).trackers["hold"].gain == 2.0
    missing = text.replace("mine_for_test", "not_there")
    one = mistakes(tmp_path, missing)
    assert len(one) == 1
    assert "trackers.hold.kind: plug-in 'not_there:Mine' cannot be imported" in one[0]
    first, second = mistakes(tmp_path, missing.replace('kind = "box"', 'kind = "nor_here:Box"'))
    assert "structure.kind: plug-in 'nor_here:Box' cannot be imported" in first
    assert second.startswith("trackers.hold.kind: plug-in 'not_there:Mine' cannot be imported")


def test_a_plug_in_without_the_method_of_its_place_is_told_so(tmp_path, monkeypatch):
    """It was called an unknown kind, with a list of those that come with the program."""
    (tmp_path / "half.py").write_text(
        "from dataclasses import dataclass\n@dataclass(frozen=True)\nclass Mine:\n    a: int = 1\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    text = GOOD.replace('{ kind = "hold" }', '{ kind = "half:Mine" }').replace("hand-pilot", "half:Mine")
    path, tracker = mistakes(tmp_path, text.replace(", duration_s = 2.0", ""))
    assert path.endswith("path.kind: plug-in 'half:Mine' cannot be used here: its class Mine has no method `plan`")
    assert tracker.endswith("hold.kind: plug-in 'half:Mine' cannot be used here: its class Mine has no method `start`")


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("flight.wind", '{ kind = "dryden", near_m = 3.0 }', "near_m 3 has no effect: near_gain is 0"),
        ("flight.wind", '{ kind = "gust", gust_m_s = 0.0, hold_s = 9.0 }', "hold_s 9 has no effect: gust_m_s is 0"),
        (
            "flight.wind",
            '{ kind = "steady", speed_m_s = 0.0, from_deg = 9.0 }',
            "from_deg 9 has no effect: speed_m_s is 0",
        ),
        ("sensors", '[{ kind = "baro", drift_s = 9.0 }]', "drift_s 9 has no effect: drift_pa is 0"),
        ("sensors", '[{ kind = "gnss", slow_s = 9.0, slow_m = 0.0 }]', "slow_s 9 has no effect: slow_m is 0"),
        (
            "sensors",
            '[{ kind = "range-finder", noise_m = 0.1, far_noise_m = 0.1, far_m = 9.0 }]',
            "far_m 9 has no effect: noise_m and far_noise_m are both 0.1",
        ),
        ("deviation", "{ displaced_m = 0.1 }", "displaced_m 0.1 has no effect: displaced_share is 0"),
        ("clutter", '[{ kind = "people", walking = 0.0, speed_m_s = 2.0 }]', "speed_m_s 2 has no effect: walking is 0"),
        (
            "effects",
            '[{ kind = "analog-link", bursts_per_frame = 0, dropouts_per_frame = 0, burst_rows = 3 }]',
            "burst_rows 3 has no effect: bursts_per_frame is 0.0 and dropouts_per_frame is 0.0",
        ),
        (
            "environment",
            '{ kind = "outdoor", site = { cloud_size_m = 90.0 } }',
            "cloud_size_m 90 has no effect: cloud_shadow is 0",
        ),
        (
            "mount",
            '{ kind = "gimbal", axes = "pitch", roll_axis = { damping = 0.5 } }',
            "roll_axis: axes = 'pitch' has no roll axis",
        ),
        (
            "flight.path",
            '{ kind = "waypoints", file = "way.csv", stop = false, dwell_s = 2.0 }',
            "dwell_s 2 has no effect: stop is false",
        ),
    ],
)
def test_a_key_that_changes_nothing_beside_the_others_is_refused(tmp_path, key, value, told):
    (tmp_path / "way.csv").write_text("x_m,y_m,z_m,yaw_deg\n-4,0,1,0\n-3,0,1,0\n")
    lines = [line for line in GOOD.splitlines() if not line.startswith(f"{key} =")]
    lines.insert(lines.index("[sequences.box]") + 1, f"{key} = {value}")
    (line,) = mistakes(tmp_path, "\n".join(lines))
    assert line.startswith(f"sequences.box.{key}") and told in line


LOOP = GOOD.replace("[trackers]", "[loop]\nOPTIONS\n\n[trackers]").replace(
    "effects =", 'sensors = [{ kind = "imu" }, { kind = "gnss" }, { kind = "flow" }]\neffects ='
)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ('estimator = "camera"\nprior = false', ["loop.prior: has no effect: no estimator is the filter, whose"]),
        ('estimator = "truth"\nfilter.gate = 0.9', ["loop.filter.gate: has no effect: no estimator is the filter"]),
        (
            'sensors = ["imu", "flow"]\nfilter.unclaimed_m = 0.1\nfilter.gate = 0.9',
            ["loop.filter.unclaimed_m: has no effect: the filter gets no poses"],
        ),
        (
            'sensors = ["camera", "imu"]\ngnss_outages_s = [[0.1, 0.2]]',
            ["loop.gnss_outages_s: has no effect: `sensors` names no GNSS"],
        ),
        ("filter = { camera_slow_share = 0.0, camera_slow_s = 9.0 }", ["loop.filter: camera_slow_s 9 has no effect"]),
        ('prior = false\n[loops.seen]\nestimator = "camera"', ["loop.prior: has no effect"]),
        (
            'prior = false\n[loops.seen]\nestimator = "camera"\nprior = false\n[loops.filtered]',
            ["loops.seen.prior: has no effect"],
        ),
        ('prior = false\nfilter.gate = 0.9\n[loops.seen]\nestimator = "camera"\n[loops.filtered]', []),
        ("prior = false\ngnss_outages_s = [[0.1, 0.2]]\nfilter.camera_bias_m = 0.1", []),
    ],
)
def test_a_key_of_a_loop_that_changes_nothing_is_refused(tmp_path, options, told):
    text = LOOP.replace("OPTIONS", options)
    lines = mistakes(tmp_path, text) if told else []
    assert len(lines) == len(told) and all(line.startswith(start) for line, start in zip(lines, told, strict=True))
    if not told:
        load_suite(suite(tmp_path, text))
