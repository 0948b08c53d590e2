"""Flights in closed loop: what the controller knows, what is repeatable, and what a bad tracker cannot do."""

import json
import re
import sys

import numpy as np
import pytest

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.ending import Judge
from uavbench.bench.closed_loop.fly import fly
from uavbench.bench.closed_loop.latency import Constant, Lognormal, Measured
from uavbench.bench.closed_loop.sensing import Sensors
from uavbench.bench.closed_loop.spec import CrashSpec, LoopSpec, Pilot
from uavbench.bench.closed_loop.trackers import Blind, GroundTruth
from uavbench.bench.external.program import External
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.measures import measure_flight
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import Noise
from uavbench.scenes.generate import generate
from uavbench.scenes.scene import obstacles_of
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.studio import Studio
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.around import Orbit
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.range_finder import RangeFinder
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.sensors.registry import named as named_sensors
from uavbench.trajectories.simulation.flight import FlightSpec
from uavbench.trajectories.simulation.flight import fly as fly_open_loop
from uavbench.trajectories.wind.winds import Gust

ORBIT = Orbit(distance_m=1.0, height_m=0.6, turns=0.02, speed_m_s=0.4)


def box(path=ORBIT, **more):
    """A short flight around a box, few pixels and no surroundings."""
    given = {
        "flight": FlightSpec(path=path),
        "camera": CameraSpec(width=160, height=120, horizontal_fov_deg=65.0),
        "sensors": (Imu(), Barometer()),
    }
    return SequenceSpec(name="box-s1", seed=1, structure=Box(), environment=Studio(), **{**given, **more})


def flown(spec, tracker, **loop):
    given = {"latency": Constant(0.0), **loop}
    return fly(spec, Pilot(label="it", tracker=tracker, rate_hz=spec.rate_hz, loop=LoopSpec(**given)))


class Watching:
    """A tracker that keeps what it is given in `seen` and says what `answers` says of each frame."""

    def __init__(self, answers=None):
        self.seen, self.answers = {"images": [], "samples": [], "expected": []}, answers

    def start(self, structure, camera, cam_from_world, rng, *, body):
        self.seen |= {"body": body, "camera": camera, "structure": structure}
        return WatchingRun(self)


class WatchingRun:
    def __init__(self, tracker):
        self.tracker = tracker

    def sense(self, samples):
        self.tracker.seen["samples"].append(samples)

    def predict(self, cam_from_world, covariance):
        self.tracker.seen["expected"].append((cam_from_world, covariance))

    def track(self, image, stamp_ns):
        self.tracker.seen["images"].append((stamp_ns, image.copy()))
        return self.tracker.answers(stamp_ns) if self.tracker.answers else TrackResult(status="lost")


# The loop


@pytest.mark.parametrize("path", [ORBIT, HandPilot(duration_s=1.0)], ids=["planned", "reacting"])
def test_the_truth_flies_the_open_loop_flight(path):
    spec = box(path)
    open_loop = fly_open_loop(spec.flight, spec.mount, obstacles_of(spec), spec.seed)
    found = flown(spec, GroundTruth(), estimator="truth")
    rows = found.path.stamps_ns // 2_000_000
    np.testing.assert_allclose(found.path.group("true_p_m"), open_loop.positions_m[rows], atol=1e-9)
    np.testing.assert_allclose(found.path.group("true_q"), open_loop.quaternions_wxyz[rows], atol=1e-9)
    assert found.record["flight"]["status"] == "completed"


def test_the_tracker_sees_in_flight_what_the_rendered_sequence_shows(tmp_path):
    spec = box(effects=(MotionBlur(), Noise()))
    generate(spec, tmp_path / "box", content_hash="x")
    sequence = Sequence.load(tmp_path / "box")
    tracker = Watching()
    flight = flown(spec, tracker, estimator="truth")
    images = tracker.seen["images"]
    assert [stamp for stamp, _ in images] == sequence.stamps_ns.tolist()
    assert (sequence.stamps_ns % 2_000_000 != 0).any()  # between control steps, too
    assert all(np.array_equal(image, sequence.image(i)) for i, (_, image) in enumerate(images))
    np.testing.assert_allclose(flight.groundtruth.positions_m, sequence.ground_truth.positions_m, atol=1e-9)
    np.testing.assert_allclose(flight.groundtruth.rotations, sequence.ground_truth.rotations, atol=1e-9)


def test_the_tracker_is_told_in_flight_what_the_rendered_sequence_tells(tmp_path):
    """Also how its shutter rolls, without which a tracker takes all rows for exposed at once."""
    lens = {"distortion_model": "radtan", "distortion": (-0.2, 0.05, 0.0, 0.0)}
    camera = CameraSpec(width=160, height=120, fx_px=120.0, fy_px=120.0, cx_px=80.0, cy_px=60.0, **lens)
    spec = box(effects=(RollingShutter(readout_ms=12.0),), camera=camera)
    generate(spec, tmp_path / "box", content_hash="x")
    sequence, tracker = Sequence.load(tmp_path / "box"), Watching()
    flight = flown(spec, tracker, estimator="truth")
    assert tracker.seen["camera"] == sequence.camera == flight.camera
    assert sequence.camera.readout_ms == pytest.approx(12.0)
    assert np.array_equal(tracker.seen["structure"].edge_segments, sequence.structure.edge_segments)
    assert np.array_equal(tracker.seen["body"].cam_from_body.matrix, sequence.cam_from_body.matrix)
    assert set(tracker.seen["body"].sensors) == {"imu", "baro"}


def test_sensors_in_flight_read_what_they_measure_of_the_whole_flight():
    sensors = (Imu(gyro_bias_rad_s=0.01), FlowDeck(), Barometer(drift_pa=2.0), Gnss(), Imu(rate_hz=333.0))
    spec = box(HandPilot(duration_s=1.3), sensors=sensors)
    obstacles = obstacles_of(spec)
    flight = fly_open_loop(spec.flight, spec.mount, obstacles, spec.seed)
    whole = measure(sensors, flight, obstacles, spec.seed)
    record = np.zeros((len(flight), 30))
    for name, columns in RECORD.items():
        record[:, columns] = getattr(flight, name)
    live = Sensors(spec, LoopSpec(), len(flight), obstacles, spec.mount.along(flight, np.zeros(3)))
    for row in range(len(flight)):
        live.read(record[: row + 1], row)  # nothing of what is to come is there to be read
    samples = live.upto(10**12)
    assert list(samples) == list(whole)
    for name, table in whole.items():
        assert np.array_equal(samples[name].stamps_ns, table.stamps_ns)
        expected = table.values[:, : samples[name].values.shape[1]]
        np.testing.assert_allclose(samples[name].values, expected, rtol=0, atol=1e-12)


def test_readings_and_body_reach_the_tracker_at_their_time():
    tracker = Watching()
    flown(box(sensors=(Imu(), Gnss())), tracker, gnss_outages_s=((0.3, 0.6),))
    given = tracker.seen
    assert set(given["body"].sensors) == {"imu", "gnss"}
    for (stamp, _), samples in zip(given["images"], given["samples"], strict=True):
        assert len(samples["imu"]) and samples["imu"].stamps_ns[-1] <= stamp
    gnss = [row for s in given["samples"] for row in zip(s["gnss"].stamps_ns, s["gnss"].values, strict=True)]
    assert [bool(np.isfinite(v).all()) for t, v in gnss if 0.3e9 <= t < 0.6e9] == [False]
    assert all(np.isfinite(v).all() for t, v in gnss if not 0.3e9 <= t < 0.6e9)


class Echoing(Watching):
    """A tracker that says what the filter expects, as if it had seen it there."""

    def start(self, structure, camera, cam_from_world, rng):
        return EchoingRun(self)


class EchoingRun(WatchingRun):
    sense = None

    def track(self, image, stamp_ns):
        pose, covariance = self.tracker.seen["expected"][-1]
        return TrackResult(status="ok", cam_from_world=pose, covariance=covariance)


ECHO = """
import sys
print("ready", flush=True)
for line in sys.stdin.buffer:
    kind, stamp, *words = line.decode().strip().split(",")
    if kind == "expected":
        expected = stamp + ",ok," + ",".join(words)
    if kind == "frame":
        width, height, channels = map(int, words)
        sys.stdin.buffer.read(width * height * channels)
        print(expected if expected.startswith(stamp) else stamp + ",lost", flush=True)
"""


def test_trackers_are_told_where_the_filter_expects_the_camera(tmp_path):
    """The prediction is the truth up to its own covariance, and a program gets the same numbers."""
    spec, tracker = box(sensors=(Imu(),)), Watching()
    silent = flown(spec, tracker)
    expected = tracker.seen["expected"]
    assert len(expected) == len(silent.results) > 5
    for i, (pose, covariance) in enumerate(expected):
        true = spec.mount.cam_from_body @ silent.groundtruth.pose(i).inverse()
        xi = (true @ pose.inverse()).log()
        assert xi @ np.linalg.solve(covariance, xi) < 30.0  # chi-square of 6: 4e-5
    python = flown(spec, Echoing())
    (tmp_path / "echo.py").write_text(ECHO)
    program = flown(spec, External(command=(sys.executable, str(tmp_path / "echo.py"))))
    assert program.results.ok.all()
    for one, other in zip(python.results.rows, program.results.rows, strict=True):
        np.testing.assert_allclose(one.cam_from_world.matrix, other.cam_from_world.matrix, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("loop", [{"prior": False}, {"estimator": "truth"}])
def test_nothing_is_expected_where_there_is_no_prior(loop):
    tracker = Watching()
    flown(box(), tracker, **loop)
    assert tracker.seen["images"] and not tracker.seen["expected"]


def test_the_controller_believes_what_the_tracker_says():
    """Poses that are 10 cm beside the truth move the vehicle by as much."""
    spec = box()
    first = flown(spec, GroundTruth())
    aside = Pose(np.eye(3), np.array([0.0, 0.0, 0.1]))
    truth = {t: first.groundtruth.pose(i) for i, t in enumerate(first.results.stamps_ns.tolist())}
    covariance = np.diag([1e-6] * 6)

    def lying(stamp_ns):
        pose = spec.mount.cam_from_body @ truth[stamp_ns].inverse() @ aside
        return TrackResult(status="ok", cam_from_world=pose, covariance=covariance)

    honest, lied = (measure_flight(f) for f in (first, flown(spec, Watching(lying), sensors=("imu", "camera"))))
    assert honest.success and honest.path_max_m < 0.05
    assert lied.path_max_m > 0.06


@pytest.mark.parametrize("estimator", ["filter", "camera"])
def test_a_vehicle_that_is_moving_at_the_first_frame_is_known_to_move_as_planned(estimator):
    """At 1 Hz there is no second pose for a second, in which 0.2 m/s unknown would be 0.2 m."""
    spec = box(path=HandPilot(duration_s=1.2), rate_hz=1.0)
    flight = flown(spec, GroundTruth(), estimator=estimator)
    path = flight.path
    true, estimated = path.group("true_v_m_s"), path.group("estimated_v_m_s")
    first = int(np.flatnonzero(np.isfinite(estimated[:, 0]))[0])
    assert np.linalg.norm(true[first]) > 0.1
    assert np.linalg.norm(estimated[first] - true[first]) < 0.05
    assert measure_flight(flight).path_max_m < 0.1


def test_without_a_filter_the_vehicle_flies_on_the_poses_as_they_are():
    """Poses of the truth carry it; ones that are 10 cm beside move the belief by as much at once."""
    spec = box()
    honest = flown(spec, GroundTruth(), estimator="camera")
    assert measure_flight(honest).success
    assert honest.innovations == []
    truth = {t: honest.groundtruth.pose(i) for i, t in enumerate(honest.results.stamps_ns.tolist())}
    aside = Pose(np.eye(3), np.array([0.0, 0.0, 0.1]))

    def jumps(stamp_ns):
        body = truth[stamp_ns] @ aside if stamp_ns > 0.5e9 else truth[stamp_ns]
        return TrackResult(status="ok", cam_from_world=spec.mount.cam_from_body @ body.inverse())

    moved = flown(spec, Watching(jumps), estimator="camera")
    error = moved.path.group("true_p_m") - moved.path.group("estimated_p_m")
    after = int(np.searchsorted(moved.path.stamps_ns, moved.results.stamps_ns[moved.results.stamps_ns > 0.5e9][0]))
    assert np.abs(error[: after - 1]).max() < 0.02
    assert 0.07 < np.abs(error[after + 1]).max() < 0.2


@pytest.mark.parametrize("estimator", ["filter", "camera"])
def test_an_imu_that_the_loop_does_not_name_changes_nothing(estimator):
    wild = Imu(
        gyro_noise_rad_s_sqrt_hz=0.1, accel_noise_m_s2_sqrt_hz=1.0, gyro_bias_rad_s=0.5, offset_m=(0.1, 0.0, 0.0)
    )
    named = tuple(named_sensors((Imu(), Imu())))
    paths = [
        flown(
            box(sensors=(unnamed, Imu())), GroundTruth(), estimator=estimator, sensors=("camera", named[1])
        ).path.group("estimated_p_m")
        for unnamed in (Imu(), wild)
    ]
    np.testing.assert_array_equal(*paths)


def test_a_constant_latency_gives_the_same_bytes_again(tmp_path):
    for name in ("a", "b"):
        flown(box(effects=(Noise(),)), Robust(), latency=Constant(50.0)).save(tmp_path / name)
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert {"path.csv", "frames.csv", "innovations.csv", "answers.csv", "record.json"} <= set(files)
    differ = [n for n in files if (tmp_path / "a" / n).read_bytes() != (tmp_path / "b" / n).read_bytes()]
    assert differ == ["record.json", "times.csv"], "the times, and the record's hash of them"
    a, b = (json.loads((tmp_path / name / "record.json").read_text()) for name in ("a", "b"))
    for record in (a, b):
        del record["files"]["times.csv"], record["made_by"]
    assert a == b
    again = Flown.load(tmp_path / "a")
    assert measure_flight(again) == measure_flight(Flown.load(tmp_path / "b"))


def test_answers_come_after_their_latency():
    found = flown(box(), Blind(), latency=Constant(120.0), estimator="truth")
    assert (found.answered_ns - found.results.stamps_ns == 120_000_000).all()
    drawn = [
        Lognormal(median_ms=80.0, spread=0.5).delay_ns(0.0, rng) / 1e6 for rng in [stream(0, "x")] for _ in range(500)
    ]
    assert np.median(drawn) == pytest.approx(80.0, rel=0.1)
    assert np.std(np.log(drawn)) == pytest.approx(0.5, rel=0.1)


def test_a_tracker_that_is_at_work_misses_frames():
    class Slow(Measured):
        def delay_ns(self, took_ms, rng):
            return 150_000_000

    found = flown(box(), Blind(), latency=Slow(), estimator="truth")
    assert (np.diff(found.results.stamps_ns) > 140_000_000).all()
    assert Measured(scale=2.0, more_ms=5.0).delay_ns(10.0, stream(0, "x")) == 25_000_000


def test_a_flight_that_ends_early_is_compared_with_as_much_of_the_same_flight_on_its_true_state():
    """On its true state it is the same flight, so that nothing is added, although the gusts come after its end."""
    wind = Gust(speed_m_s=0.0, gust_m_s=6.0, first_s=4.5, jitter_s=0.0, rise_s=0.3)
    spec = box(flight=FlightSpec(path=HandPilot(duration_s=3.0), wind=wind))
    whole, part = (
        measure_flight(flown(spec, Blind(), estimator="truth", **limit)) for limit in ({}, {"time_limit_s": 0.5})
    )
    assert part.status == "timed out" and whole.path_rms_m > 3 * part.path_rms_m
    for score in (whole, part):
        assert abs(score.path_added_m) < 0.05 * score.path_rms_m, "rows of 50 Hz, and of each step"


def test_a_tracker_begins_its_work_when_its_frame_is_exposed():
    class Quick(Measured):
        def delay_ns(self, took_ms, rng):
            return 20_000_000

    spec = box(effects=(RollingShutter(readout_ms=40.0), MotionBlur(exposure_ms=10.0)))
    found = flown(spec, Blind(), latency=Quick(), estimator="truth")
    assert (found.answered_ns - found.results.stamps_ns == 45_000_000).all(), "half of 40 ms and of 10 ms, then 20 ms"
    assert (np.diff(found.results.stamps_ns) < 70_000_000).all(), "it is done before the next frame is exposed"


def test_what_holds_nothing_strays():
    spec = box(Orbit(distance_m=1.0, height_m=0.6, turns=0.1, speed_m_s=0.5))
    held = measure_flight(flown(spec, Hold(), crash=CrashSpec(stray_m=0.4), corridor_m=0.2))
    assert not held.success
    assert measure_flight(flown(spec, GroundTruth(), corridor_m=0.2)).success


# Bad trackers

PROGRAM = """
import sys, time
from pathlib import Path
print("ready", flush=True)
bad, frames = sys.argv[1], 0
for line in sys.stdin.buffer:
    kind, *words = line.decode().strip().split(",")
    if kind != "frame":
        continue
    stamp, width, height, channels = map(int, words)
    sys.stdin.buffer.read(width * height * channels)
    frames += 1
    if frames == 4 and bad == "hangs":
        time.sleep(60)
    if frames == 4 and bad == "crashes":
        sys.exit(3)
    if frames == 4 and bad == "nan":
        print(f"{stamp},ok,nan,0,0,1,0,0,0", flush=True)
        continue
    answer = f"{stamp},ok,0,0,1,1,0,0,0\\n"
    if frames == 4 and bad == "twice" or frames >= 4 and bad == "repeats":
        answer += answer
    if frames == 4 and bad == "chatters":
        answer += "still here\\n"
    sys.stdout.write(answer)  # at once: what comes later may be heard before the next frame, or after it
    sys.stdout.flush()
"""


@pytest.mark.parametrize(("bad", "told"), [("hangs", "hung"), ("crashes", "crashed"), ("nan", "not-finite"),
                                           ("twice", "duplicate"), ("chatters", "unasked")])  # fmt: skip
def test_a_program_that_fails_in_flight_is_lost_and_told_with_its_time(tmp_path, bad, told):
    program = tmp_path / "tracker.py"
    program.write_text(PROGRAM)
    timeout_s = 4.0 if bad == "hangs" else 60.0
    tracker = External(command=(sys.executable, str(program), bad), timeout_s=timeout_s)
    found = flown(box(), tracker, estimator="truth")
    assert found.record["flight"]["status"] == "completed"
    assert len(found.record["errors"]) == 1
    assert told in found.record["errors"][0]
    frame = 4 if bad in ("twice", "chatters") else 3  # what is said beyond an answer is heard at the next frame
    assert found.record["errors"][0].startswith(f"t = {found.results.stamps_ns[frame] / 1e9:.3f} s")
    lost = np.flatnonzero(~found.results.ok).tolist()
    assert lost == ([frame] if bad in ("nan", "twice", "chatters") else list(range(frame, len(found.results))))


def test_each_fault_of_a_program_is_told_with_the_number_of_its_frame(tmp_path):
    """Every second frame is lost to the answer that was repeated before it, and is not sent; it counts all the same."""
    (tmp_path / "tracker.py").write_text(PROGRAM)
    tracker = External(command=(sys.executable, str(tmp_path / "tracker.py"), "repeats"))
    found = flown(box(), tracker, estimator="truth")
    stamps = found.results.stamps_ns.tolist()
    lost = np.flatnonzero(~found.results.ok).tolist()
    assert lost == list(range(4, len(stamps), 2))
    assert [error.partition(" '")[0] for error in found.record["errors"]] == [
        f"t = {stamps[k] / 1e9:.3f} s: [duplicate] frame {k} (stamp {stamps[k]}):" for k in lost
    ]


def test_a_fault_ends_the_flight_where_the_suite_says_so():
    ended = flown(box(), Watching(lambda t: 1 / 0 if t > 0.3e9 else TrackResult(status="lost")), on_fault="end",
                  estimator="truth")  # fmt: skip
    assert ended.record["flight"]["status"] == "stopped"
    assert 0.3 < ended.record["flight"]["ended_s"] < 0.4
    assert not measure_flight(ended).success


@pytest.mark.parametrize("answer", [
    lambda t: 1 / 0,
    lambda t: TrackResult(status="ok", cam_from_world=Pose(np.eye(3), np.array([np.nan, 0, 0]))),
], ids=["raises", "nan"])  # fmt: skip
def test_python_that_fails_in_flight_is_lost_and_told(answer):
    found = flown(box(), Watching(answer), sensors=("imu", "camera", "baro"))
    assert {r.status for r in found.results.rows} == {"lost"}
    assert len(found.record["errors"]) == len(found.results)
    assert found.record["errors"][0].startswith("t = 0.000 s: ")


# What is refused before the start


@pytest.mark.parametrize(("loop", "sensors", "told"), [
    (LoopSpec(sensors=("imu", "baro")), (Imu(), Barometer()), "no sensor can hold"),
    (LoopSpec(), (Barometer(),), "one IMU"),
    (LoopSpec(), (Imu(), Imu()), "one IMU"),
    (LoopSpec(sensors=("imu", "gps")), (Imu(), Gnss()), "unknown sensor"),
    (LoopSpec(), (Imu(offset_m=(0.1, 0.0, 0.0)),), "offset_m"),
    (LoopSpec(sensors=("imu", "gnss"), gnss_outages_s=((0.0, 1e9),)), (Imu(), Gnss()), "no sensor can hold"),
    (LoopSpec(sensors=("imu", "gnss"), gnss_outages_s=((0.0, 2.0),), time_limit_s=2.0), (Imu(), Gnss()), "no sensor"),
    (LoopSpec(latency=Constant(2500.0)), (Imu(),), "history_s"),
    (LoopSpec(estimator="camera"), (Barometer(),), "one IMU"),
    (LoopSpec(estimator="camera", sensors=("imu",)), (Imu(),), "add `camera`"),
    (LoopSpec(sensors=("camera", "imu", "range-finder")), (Imu(), RangeFinder()), "no use of `range-finder`"),
])  # fmt: skip
def test_a_loop_that_cannot_hold_the_vehicle_is_refused(loop, sensors, told):
    with pytest.raises(UserError, match=told):
        check_loop(loop, box(sensors=sensors))


@pytest.mark.parametrize(("outages", "refused"), [
    (((0.0, 60.0),), True), (((0.5, 60.0), (0.0, 0.7)), True), (((0.0, 0.5),), False), (((0.1, 60.0),), False),
    (((0.0, 0.3), (0.4, 60.0)), False),
])  # fmt: skip
def test_gnss_that_is_denied_during_the_whole_flight_holds_nothing(outages, refused):
    """Only the flight itself tells how long it is."""
    spec, loop = box(sensors=(Imu(), Gnss())), {"sensors": ("imu", "gnss"), "gnss_outages_s": outages}
    check_loop(LoopSpec(**loop), spec)
    if refused:
        with pytest.raises(
            UserError, match=r"imu, gnss alone, without GNSS during the whole flight .* add `camera` or"
        ):
            flown(spec, Watching(), **loop)
    else:
        assert len(flown(spec, Watching(), **loop).results) > 5


@pytest.mark.parametrize("limit_s", [None, 0.5])
def test_an_outage_that_begins_after_the_flight_is_refused(limit_s):
    """It denies nothing, and the flight would count as one with an outage."""
    spec, loop = box(sensors=(Imu(), Gnss())), {"time_limit_s": limit_s, "gnss_outages_s": ((0.1, 0.2), (0.5, 60.0))}
    if limit_s is None:
        assert len(flown(spec, Watching(), **loop).results) > 5
        loop["gnss_outages_s"] = ((600.0, 700.0),)
    with pytest.raises(UserError, match=r"gnss_outages_s: \[\d.*\] begins after the end of the flight, which takes"):
        flown(spec, Watching(), **loop)


@pytest.mark.parametrize(("sensors", "rate_hz", "told"), [
    ((Imu(), Barometer(rate_hz=0.01)), 15.0, r"sensors\[1\], baro: rate_hz 0.01: one reading takes 100 s, and the fli"),
    ((Imu(rate_hz=1e12),), 15.0, r"sensors\[0\], imu: at rate_hz 1e\+12 it would have"),
    ((Imu(),), 0.01, "rates_hz 0.01: one frame takes 100 s, and the flight .* s; raise rates_hz, or fly longer"),
])  # fmt: skip
def test_a_rate_that_the_flight_cannot_serve_is_refused(sensors, rate_hz, told):
    with pytest.raises(UserError, match=told):
        flown(box(sensors=sensors, rate_hz=rate_hz), Watching(), estimator="truth")


def test_loops_that_can_are_not():
    assert check_loop(LoopSpec(sensors=("imu", "flow")), box(sensors=(Imu(), FlowDeck()))) == ("imu", "flow")
    assert check_loop(LoopSpec(estimator="truth", sensors=()), box(sensors=())) == ()
    assert check_loop(LoopSpec(), box()) == ("camera", "imu", "baro")
    assert "range-finder" in check_loop(LoopSpec(), box(sensors=(Imu(), RangeFinder())))


def test_the_tracker_truth_is_for_flights_only():
    with pytest.raises(UserError, match="uavbench fly"):
        GroundTruth().start(None, None, None, None)


# The end


def test_each_end_is_found_at_its_row():
    judge = Judge(CrashSpec(clearance_m=0.1, tilt_deg=60.0, stray_m=1.0), 0.07, obstacles_of(box()))
    record = np.zeros((5, 30))
    record[:, 0:3], record[:, 3] = [1.0, 0.0, 1.0], 1.0
    reference = np.zeros((5, 17))
    reference[:, 0:3] = record[:, 0:3]
    assert judge.ending(record, reference, 100) is None
    for change, status, why in [
        ((slice(0, 3), [0.3, 0.0, 0.2]), "crashed", "structure"),
        ((slice(0, 3), [1.0, 0.0, 0.16]), "crashed", "floor"),
        ((slice(3, 7), [np.cos(0.6), np.sin(0.6), 0, 0]), "crashed", "tilted"),
        ((slice(0, 3), [2.5, 0.0, 1.0]), "strayed", "path"),
        ((slice(7, 8), np.nan), "crashed", "lost control"),
    ]:
        now = record.copy()
        now[3:, change[0]] = change[1]
        found = judge.ending(now, reference, 100)
        assert (found.status, why in found.why, found.stamp_ns) == (status, True, 103 * 2_000_000)


def test_the_quick_look_for_the_end_hides_none(monkeypatch):
    """Rows about every limit, some by less than round-off: the exact test alone finds the same."""
    judge = Judge(CrashSpec(clearance_m=0.1, tilt_deg=60.0, stray_m=1.0), 0.07, obstacles_of(box()))
    rng = np.random.default_rng(0)
    flights = []
    for _ in range(300):
        record, reference = np.zeros((5, 30)), np.zeros((5, 17))
        record[:, 0:3] = rng.choice([0.0, 0.2, 0.37, 0.4, 1.0], (5, 3)) + rng.choice([-1e-12, 0.0, 1e-12, 0.02], (5, 3))
        record[:, 2] += rng.choice([0.17, 1.0])
        tilt = rng.choice([0.0, np.radians(30.0)]) + rng.choice([-1e-12, 0.0, 1e-12, 0.02])
        record[:, 3], record[:, 4] = np.cos(tilt), np.sin(tilt)
        reference[:, 0:3] = record[:, 0:3] + [rng.choice([0.5, 1.0]) + rng.choice([-1e-12, 0.0, 1e-12, 0.02]), 0.0, 0.0]
        flights.append((record, reference))
    quick = [judge.ending(record, reference, 0) for record, reference in flights]
    monkeypatch.setattr("uavbench.bench.closed_loop.ending._is_clear", lambda *_: False)
    assert quick == [judge.ending(record, reference, 0) for record, reference in flights]
    assert 20 < sum(found is None for found in quick) < 280


def test_a_time_limit_ends_a_flight():
    found = flown(box(), Blind(), estimator="truth", time_limit_s=0.5)
    assert (found.record["flight"]["status"], found.record["flight"]["ended_s"]) == ("timed out", 0.5)
    assert not measure_flight(found).success


class NotFinite:
    """A tracker whose poses are not finite."""

    def start(self, structure, camera, cam_from_world, rng):
        self.pose = Pose(cam_from_world.rotation, np.ones(3))
        object.__setattr__(self.pose, "translation", np.full(3, np.nan))
        return self

    def track(self, image, stamp_ns):
        return TrackResult(status="ok", cam_from_world=self.pose)


def test_a_bad_result_in_flight_is_told_with_the_place_in_the_trackers_code():
    flight = flown(box(), NotFinite(), estimator="truth")
    assert flight.record["errors"]
    for error in flight.record["errors"]:
        assert "[bad-result] the pose is not finite" in error
        assert re.search(r"test_closed_loop.py:\d+ in track\)", error)


@pytest.mark.parametrize("rate_hz", [0.0, np.inf])
def test_a_rate_that_does_not_fit_is_refused_by_name(rate_hz):
    with pytest.raises(UserError, match=f"rates_hz {rate_hz:g}: "):
        fly(box(), Pilot(label="it", tracker=GroundTruth(), rate_hz=rate_hz, loop=LoopSpec(estimator="truth")))
