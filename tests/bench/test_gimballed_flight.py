"""A camera on a gimbal in closed loop: what it sees, what the vehicle knows of its joints, and what is recorded."""

from dataclasses import asdict, dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.bench.test_closed_loop import Watching, box, flown
from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.eye import eye
from uavbench.bench.closed_loop.spec import FilterSpec, LoopSpec
from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.bench.filming.video import write_video
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.flown_mounts import MOUNT_COLUMNS, FlownMounts
from uavbench.reports.closed_loop.measures import cameras_flown, cameras_planned, measure_flight, tracker_errors
from uavbench.scenes.dataset.body import body_of, samples_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.generate import generate
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene, obstacles_of
from uavbench.scenes.shots.shots import rehearse
from uavbench.scenes.spec import CameraSpec
from uavbench.scenes.world.indoor import Indoor
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.axes import PitchAxis
from uavbench.trajectories.gimbal.encoder import Encoder
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.paths.around import FigureEight
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.sensor import Table
from uavbench.trajectories.simulation.flight import fly as fly_open_loop
from uavbench.trajectories.trajectory import Trajectory

PERFECT = Encoder(rate_hz=200.0, noise_deg=0.0, resolution_deg=0.0, zero_deg=0.0)
SWAYING = FigureEight(period_s=1.5, loops=1, width_m=0.3, depth_m=0.05, height_m=0.6)
"""A path that tilts the vehicle by some degrees."""
OFFSET_M = (0.1, -0.02, -0.05)


def gimballed(encoder=PERFECT, **more):
    """A short flight in front of a box with a camera on a gimbal, few pixels and no surroundings."""
    mount = Gimbal(**{"pitch_deg": -15.0, "offset_m": OFFSET_M, "encoder": encoder, **more.pop("mount", {})})
    camera = CameraSpec(width=96, height=72, horizontal_fov_deg=75.0)
    return box(SWAYING, **{"camera": camera, "sensors": (Imu(),), "mount": mount, **more})


def angles_of(flight):
    return flight.mounts.flown.values[:, 7:]


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory):
    """The same flight on its true state: as a rendered sequence, and in closed loop with what its tracker was given."""
    effects = (MotionBlur(), RollingShutter(readout_ms=20.0))
    spec = gimballed(Encoder(rate_hz=130.0), effects=effects, mount={"mode": "target", "pitch_deg": 0.0})
    folder = tmp_path_factory.mktemp("gimballed") / "box"
    generate(spec, folder, content_hash="x")
    tracker = Watching()
    return spec, Sequence.load(folder), flown(spec, tracker, estimator="truth"), tracker.seen


def test_on_the_true_state_path_and_joints_are_those_of_the_open_loop(lockstep):
    spec, sequence, flight, _ = lockstep
    open_loop = fly_open_loop(spec.flight, spec.mount.at_rest, obstacles_of(spec), spec.seed)
    rows = flight.path.stamps_ns // 2_000_000
    np.testing.assert_allclose(flight.path.group("true_p_m"), open_loop.positions_m[rows], atol=1e-9)
    motion = spec.mount.along(open_loop, sequence.structure.bounds.mean(axis=0))
    np.testing.assert_allclose(angles_of(flight), motion.angles(flight.path.stamps_ns), atol=1e-12)
    assert np.degrees(np.ptp(angles_of(flight), axis=0)).min() > 1, "every joint moves"
    for i, frame in enumerate(sequence):
        seen = flight.groundtruth.pose(i).inverse()
        np.testing.assert_allclose(seen.matrix, frame.cam_from_world.matrix, atol=1e-9)


def test_images_are_those_of_the_rendered_sequence_row_by_row(lockstep):
    _, sequence, flight, given = lockstep
    assert [stamp for stamp, _ in given["images"]] == flight.results.stamps_ns.tolist() == sequence.stamps_ns.tolist()
    for frame, (_, image) in zip(sequence, given["images"], strict=True):
        assert np.array_equal(image, frame.image)


def test_the_tracker_is_given_the_encoders_readings_of_the_sequence_and_no_fixed_mount(lockstep):
    _, sequence, _, given = lockstep
    body, whole = given["body"], body_of(sequence)
    assert body.cam_from_body is None and body.gimbal == whole.gimbal
    for field in ("kind", "columns"):
        assert getattr(body.sensors["gimbal"], field) == getattr(whole.sensors["gimbal"], field)
    assert dict(body.sensors["gimbal"].parameters) == dict(whole.sensors["gimbal"].parameters)
    rows = [(t, v) for s in given["samples"] for t, v in zip(s["gimbal"].stamps_ns, s["gimbal"].values, strict=True)]
    expected = samples_of(sequence, "gimbal", whole.sensors["gimbal"])
    assert [t for t, _ in rows] == expected.stamps_ns[: len(rows)].tolist()
    assert len(rows) > 100
    np.testing.assert_allclose([v for _, v in rows], expected.values[: len(rows)], rtol=0, atol=1e-12)
    for (stamp, _), samples in zip(given["images"], given["samples"], strict=True):
        assert samples["gimbal"].stamps_ns[-1] <= stamp


def test_what_is_recorded_of_the_encoders_is_what_they_measure_without_the_truth():
    """Without noise the truth, with noise as far from it as the data sheet says."""
    for encoder in (PERFECT, Encoder(rate_hz=200.0, noise_deg=0.5, resolution_deg=0.0, zero_deg=0.0)):
        flight = flown(gimballed(encoder), GroundTruth(), estimator="truth")
        table = flight.readings["gimbal"]
        assert table.columns == ("yaw_rad", "roll_rad", "pitch_rad")
        common = np.isin(table.stamps_ns, flight.path.stamps_ns)
        errors = np.degrees(table.values[common] - angles_of(flight))
        if encoder is PERFECT:
            np.testing.assert_allclose(errors, 0.0, atol=1e-12)
        else:
            assert errors.std() == pytest.approx(0.5, rel=0.2)


@pytest.mark.parametrize("estimator", ["filter", "camera"])
def test_the_vehicle_believes_its_encoders_however_wrong_they_are(estimator):
    """With offsets of some degrees its attitude is wrong by as much, since it never has the true angles."""
    loop = {"estimator": estimator, "filter": FilterSpec(start_deg=5.0)}
    honest = flown(gimballed(), GroundTruth(), **loop)
    wrong = replace(gimballed(), mount=replace(gimballed().mount, encoder=replace(PERFECT, zero_deg=4.0)))
    deceived = flown(wrong, GroundTruth(sigma_deg=0.01), **loop)

    def tilts_deg(flight):
        true, found = (flight.path.group(f"{kind}_q")[3:] for kind in ("true", "estimated"))
        return np.degrees(2 * np.arccos(np.clip(np.abs((true * found).sum(axis=1)), 0, 1)))

    table = deceived.readings["gimbal"]
    common = np.isin(table.stamps_ns, deceived.path.stamps_ns)
    offsets = np.degrees(table.values[common] - angles_of(deceived)[: common.sum()])
    assert np.ptp(offsets, axis=0).max() < 1e-9
    assert np.median(tilts_deg(honest)) < 0.2
    assert np.median(tilts_deg(deceived)[:20]) > 0.4 * np.linalg.norm(offsets[0])


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch", "pitch"])
def test_on_the_true_poses_it_stays_in_its_corridor(axes):
    spec = gimballed(Encoder(), mount={"axes": axes})
    found = flown(spec, GroundTruth(), corridor_m=0.3)
    told = measure_flight(found)
    assert told.success and told.status == "completed"
    assert told.path_max_m < 0.1
    assert told.estimate_rms_m < 0.01
    assert told.refused_share == 0.0
    assert told.tracker_rms_m < 1e-9


class Noisy(GroundTruth):
    """The true pose of the camera with noise of the claimed standard deviations."""

    def answer(self, true_cam_from_world):
        rng = np.random.default_rng(round(1e12 * abs(float(true_cam_from_world.translation[0]))))
        result = super().answer(true_cam_from_world)
        noise = Pose.exp(np.sqrt(np.diag(result.covariance)) * rng.normal(size=6))
        return replace(result, cam_from_world=noise @ true_cam_from_world)


def test_the_filters_innovations_in_flight_are_consistent_with_the_noise_of_the_encoders():
    encoder = Encoder(rate_hz=100.0, noise_deg=0.3, resolution_deg=0.0, zero_deg=0.0)
    white = FilterSpec(camera_slow_share=0.0, camera_bias_m=0.0, camera_bias_deg=0.0)
    told = []
    for seed in range(4):
        spec = replace(gimballed(encoder), seed=seed)
        flight = flown(spec, Noisy(sigma_m=0.002, sigma_deg=0.05), filter=white)
        told += [row[2] for row in flight.innovations if row[1] == "CameraPose" and row[0] > 0.2e9]
    low, high = chi2.ppf([0.001, 0.999], 6 * len(told)) / (6 * len(told))
    assert low <= np.mean(told) / 6 <= high


def test_the_prediction_for_trackers_is_the_truth_up_to_its_covariance():
    tracker = Watching(lambda stamp_ns: TrackResult(status="lost"))
    found = flown(gimballed(Encoder(noise_deg=0.3)), tracker, time_limit_s=1.5)
    expected = tracker.seen["expected"]
    assert len(expected) == len(found.results) > 5
    for i, (pose, covariance) in enumerate(expected):
        xi = (found.groundtruth.pose(i).inverse() @ pose.inverse()).log()
        assert xi @ np.linalg.solve(covariance, xi) < 30.0  # chi-square of 6: 4e-5
        assert np.linalg.eigvalsh(covariance[3:, 3:])[0] > np.radians(0.3) ** 2


def test_a_flight_is_the_same_to_the_byte_and_measured_alike_when_it_is_loaded(tmp_path):
    spec = gimballed(Encoder())
    flights = [flown(spec, GroundTruth(), latency=replace(LoopSpec().latency, ms=50.0)) for _ in range(2)]
    for name, flight in zip("ab", flights, strict=True):
        flight.save(tmp_path / name)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert {"gimbal.csv", "mounts.csv", "plan_mounts.csv", "groundtruth_world_from_cam.tum"} <= set(files)
    for name in set(files) - {"times.csv", "record.json"}:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    loaded = Flown.load(tmp_path / "a")
    told, again = asdict(measure_flight(flights[0])), asdict(measure_flight(loaded))
    for name, value in told.items():
        assert again[name] == (pytest.approx(value, abs=1e-6) if isinstance(value, float) else value), name


def test_a_video_shows_what_the_camera_saw_in_flight(tmp_path, monkeypatch):
    """Up to the poses between the rows of path.csv and mounts.csv, which are 20 ms apart."""
    spec, tracker, shown = gimballed(mount={"offset_m": (0.0, 0.0, 0.0)}), Watching(), []

    def kept(flown, frame, image):
        shown.append(image.copy())
        return image

    flown(spec, tracker, estimator="truth", time_limit_s=2.0).save(tmp_path / "flight")
    monkeypatch.setattr("uavbench.bench.filming.video.with_overlay", kept)
    write_video(spec, tmp_path / "flight", tmp_path / "video", "x", lambda done, whole: None)
    assert len(shown) == len(tracker.seen["images"]) > 10
    path, scene = Flown.load(tmp_path / "flight").path, build_scene(spec)
    way = Trajectory(path.stamps_ns, path.group("true_p_m"), path.group("true_q"))
    with eye(spec, scene, way, lambda stamp_ns: spec.mount.at_rest.cam_from_body) as source:
        fixed = [encode(source.image(stamp)) for stamp, _ in tracker.seen["images"]]
    seen = np.array([image for _, image in tracker.seen["images"]], dtype=float)
    of_video, of_fixed = (np.abs(np.array(images) - seen).mean() for images in (shown, fixed))
    assert of_video < 0.01 * of_fixed


def test_poses_of_another_flight_and_numbers_that_are_no_pose_are_refused(tmp_path):
    stamps, level = np.array([0, 20_000_000]), [0.0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    mounts = FlownMounts(*(Table(MOUNT_COLUMNS, stamps, np.array([level, level])) for _ in range(2)))
    for name in ("good", "bad"):
        (tmp_path / name).mkdir()
    mounts.write(tmp_path / "good")
    loaded = FlownMounts.load(tmp_path / "good", stamps, stamps)
    assert loaded.planned.values.tolist() == mounts.planned.values.tolist()
    with pytest.raises(UserError, match=r"plan_mounts\.csv: its stamps are not those of the flight"):
        FlownMounts.load(tmp_path / "good", stamps, stamps + 1)
    replace(mounts, flown=Table(MOUNT_COLUMNS, stamps, np.zeros((2, 10)))).write(tmp_path / "bad")
    with pytest.raises(UserError, match=r"mounts\.csv: has a row that is not a pose"):
        FlownMounts.load(tmp_path / "bad", stamps, stamps)


def test_measures_look_from_the_true_pose_of_the_camera():
    found = flown(gimballed(rate_hz=10.0), GroundTruth())
    views = cameras_flown(found)
    stamps = found.results.stamps_ns.tolist()
    for k in range(1, len(views)):
        frame = stamps.index(k * 500_000_000)
        np.testing.assert_allclose(views[k].matrix, found.groundtruth.pose(frame).inverse().matrix, atol=1e-9)
    np.testing.assert_allclose(tracker_errors(found).metres, 0.0, atol=1e-9)
    level = Mount(pitch_deg=-15.0, offset_m=OFFSET_M).cam_from_body
    for row in range(len(found.plan)):
        np.testing.assert_allclose(found.planned_cam_from_body(row).matrix, level.matrix, atol=1e-12)
    at = found.mounts.at
    np.testing.assert_allclose(at(40_000_000).matrix, found.cam_from_body(2).matrix, atol=1e-12)


def test_the_planned_camera_points_at_its_target_as_far_as_the_stops_allow():
    aimed = flown(gimballed(mount={"mode": "target", "pitch_deg": 0.0}), GroundTruth(), estimator="truth")
    middle = aimed.structure.bounds.mean(axis=0)
    for view in cameras_planned(aimed):
        x, y, z = view.transform(middle[None])[0]
        assert (x, y) == (pytest.approx(0, abs=1e-9), pytest.approx(0, abs=1e-9)) and z > 0
    stopped = {"mode": "target", "pitch_deg": 0.0, "pitch_axis": PitchAxis(least_deg=-2.0)}
    held = flown(gimballed(mount=stopped), GroundTruth(), estimator="truth")
    np.testing.assert_allclose(held.mounts.planned.column("pitch_rad"), np.radians(-2.0), atol=1e-12)


@dataclass(frozen=True)
class Swinging:
    """A user's mount."""

    at_rest = Mount()

    def along(self, motion, target_m):
        return lambda stamp_ns: Mount().cam_from_body


@dataclass(frozen=True)
class gimbal(Imu):
    """A user's sensor with the name of the encoders."""


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        (replace(gimballed(), mount=Swinging()), "fixed or a gimbal, not Swinging, whose pose on the body the vehicle"),
        (gimballed(Encoder(rate_hz=0.2)), r"gimbal: encoder\.rate_hz 0\.2: one reading takes 5 s"),
        (gimballed(sensors=(Imu(), gimbal())), "a sensor has the name gimbal of the encoders"),
    ],
)
def test_what_cannot_be_known_of_a_mount_is_refused_by_name(spec, told):
    with pytest.raises(UserError, match=told):
        check_loop(LoopSpec(sensors=("camera", "imu")), spec, 3.0)


def test_a_target_beyond_the_stops_is_told_or_refused_as_in_an_open_flight():
    """Missed in some frames it is recorded, in the same words as of a rendered sequence; in all it is an error."""
    stops = {"pitch_axis": PitchAxis(least_deg=-21.0)}
    sway = FigureEight(period_s=1.2, loops=1, width_m=0.1, depth_m=0.05, height_m=0.6, rise_m=0.3)
    some = replace(
        gimballed(mount={"mode": "target", "pitch_deg": 0.0, "target_m": (0.0, 0.0, 0.0), **stops}),
        flight=replace(gimballed().flight, path=sway),
    )
    flight = flown(some, GroundTruth(), estimator="truth")
    (told,) = flight.record["unreached"]
    assert [told] == rehearse(replace(some, rate_hz=15.0))
    assert told.startswith("gimbal of camera: the stops of pitch_axis, -21 to 60 degrees, keep it from its target in ")
    assert "unreached" not in flown(gimballed(), GroundTruth(), estimator="truth").record
    never = replace(some, mount=replace(some.mount, target_m=(0.0, 0.0, -9.0)))
    with pytest.raises(UserError, match=r"camera camera: mount.target_m: the stops of pitch_axis, .*; widen the stops"):
        flown(never, GroundTruth(), estimator="truth")


def test_a_closed_loop_refuses_a_room_too_small_before_it_starts():
    small = replace(gimballed(), environment=Indoor(room_m=1.5))
    with pytest.raises(UserError, match=r"camera camera: t = .* a wall or the ceiling of the room"):
        flown(small, GroundTruth(), estimator="truth")
