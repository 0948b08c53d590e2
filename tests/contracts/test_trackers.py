"""Every tracker variant, on a rendered sequence: the same twice, honest about its status, unharmed by bad frames."""

from functools import cache

import numpy as np
import pytest

from uavbench.bench.config.suite import load_suite
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.generate import generate
from uavbench.tracker.protocol import ImageError, StampError, StartError
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

SUITE = """
title = "contract"
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
mount = { pitch_deg = -28.0 }
environment = { kind = "indoor", floor = "carpet" }
flight.path = { kind = "hand-pilot", duration_s = 1.0, range_m = [0.85, 1.25], height_m = [0.6, 0.95] }
camera = { width = 640, height = 480, horizontal_fov_deg = 65.0 }
effects = [{ kind = "noise" }]
[trackers]
hold = { kind = "hold" }
"""
VARIANTS = pytest.mark.parametrize("kind", list(TRACKERS))


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("contract")
    (folder / "suite.toml").write_text(SUITE)
    spec = load_suite(folder / "suite.toml").sequences[0]
    generate(spec, folder / "sequence", content_hash="contract")
    return Sequence.load(folder / "sequence")


@pytest.fixture(scope="module")
def tracked(sequence):
    """Results of a kind of tracker with seed 5, made once."""
    return cache(lambda kind: track_sequence(TRACKERS[kind](), sequence, rate_hz=15.0, seed=5))


def begun(kind, sequence):
    return TRACKERS[kind]().start(
        sequence.structure, sequence.camera, sequence.true_cam_from_world(0), stream(3, "contract")
    )


def apart(a, b):
    """Length in m and rad of the twist between two poses."""
    difference = (a @ b.inverse()).log()
    return np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])


@VARIANTS
def test_the_same_seed_gives_the_same_estimate(kind, sequence, tracked):
    one, two = tracked(kind), track_sequence(TRACKERS[kind](), sequence, rate_hz=15.0, seed=5)
    assert len(one.rows) == len(sequence)
    for a, b in zip(one.rows, two.rows, strict=True):
        assert a.status == b.status == "ok"
        assert np.array_equal(a.cam_from_world.matrix, b.cam_from_world.matrix)
        assert (a.covariance is None) == (b.covariance is None)
        if a.covariance is not None:
            assert np.array_equal(a.covariance, b.covariance)


@VARIANTS
def test_poses_are_rigid_and_near_the_truth_at_first(kind, sequence, tracked):
    results = tracked(kind)
    assert results.record["errors"] == []
    for i, row in enumerate(results.rows):
        assert row.status == "ok"
        metres, radians = apart(row.cam_from_world, sequence.true_cam_from_world(i))
        if i < 3:
            assert metres < 0.15
            assert radians < np.radians(8)
        R = row.cam_from_world.rotation
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) > 0


@VARIANTS
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_blank_frame_is_lost_and_the_next_good_one_may_be_found(kind, sequence, level):
    """`hold` alone says what it said before: it looks at no image."""
    run = begun(kind, sequence)
    first = run.track(sequence.image(0), 0)
    blank = np.full((sequence.camera.height, sequence.camera.width, 3), level, dtype=np.uint8)
    for i in range(1, 4):
        result = run.track(blank, i * 66_000_000)
        if kind == "hold":
            assert np.array_equal(result.cam_from_world.matrix, first.cam_from_world.matrix)
        else:
            assert result.status == "lost"
    after = run.track(sequence.image(4), 4 * 66_000_000)
    if after.status == "ok":
        metres, radians = apart(after.cam_from_world, sequence.true_cam_from_world(4))
        assert metres < 0.3
        assert radians < np.radians(20)


@VARIANTS
def test_grey_and_colour_frames_give_nearly_the_same_pose(kind, sequence):
    grey = np.ascontiguousarray(sequence.image(0)[..., 1])
    poses = []
    for image in (grey, sequence.image(0)):
        result = begun(kind, sequence).track(image, 0)
        assert result.status == "ok"
        poses.append(result.cam_from_world)
    metres, radians = apart(*poses)
    assert metres < 0.03
    assert radians < np.radians(2)


@VARIANTS
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda image: image[:10, :10], r"shape \(10, 10, 3\); give \(480, 640\) grey or \(480, 640, 3\) BGR"),
        (lambda image: image.transpose(1, 0, 2), r"shape \(640, 480, 3\)"),
        (lambda image: np.dstack([image, image[..., :1]]), r"shape \(480, 640, 4\)"),
        (lambda image: image[..., :2], r"shape \(480, 640, 2\)"),
        (lambda image: image[None], r"shape \(1, 480, 640, 3\)"),
        (lambda image: image.astype(np.float32) / 255, "type float32; .*uint8, values from 0 to 255"),
        (lambda image: image.astype(np.float64), "type float64"),
        (lambda image: image.astype(np.uint16), "type uint16"),
        (lambda image: image.tolist(), "the image is list"),
        (lambda image: None, "the image is NoneType"),
    ],
)
def test_an_image_that_is_none_is_refused_by_name_and_harms_nothing(kind, sequence, change, told):
    run = begun(kind, sequence)
    with pytest.raises(ImageError, match=told):
        run.track(change(sequence.image(0)), 0)
    assert run.track(sequence.image(0), 0).status == "ok"


@VARIANTS
def test_a_frame_that_is_not_later_than_all_before_is_lost(kind, sequence):
    """`robust` alone had asked for the stamp: the others tracked a frame of the past as a new one."""
    run, plain = begun(kind, sequence), begun(kind, sequence)
    images, stamps = [sequence.image(k) for k in range(4)], sequence.stamps_ns[:4].tolist()
    assert run.track(images[0], stamps[0]).status == plain.track(images[0], stamps[0]).status == "ok"
    assert run.track(images[1], stamps[1]).status == plain.track(images[1], stamps[1]).status == "ok"
    for k, stamp in ((2, stamps[1]), (2, stamps[0]), (0, stamps[0])):
        assert run.track(images[k], stamp).status == "lost"
    with pytest.raises(StampError, match=r"the stamp is 0\.2; give whole nanoseconds"):
        run.track(images[2], 0.2)
    found, expected = run.track(images[3], stamps[3]), plain.track(images[3], stamps[3])
    assert found.status == expected.status == "ok"
    if kind != "robust":
        assert np.array_equal(found.cam_from_world.matrix, expected.cam_from_world.matrix)


def read_only(image):
    return np.frombuffer(image.tobytes(), np.uint8).reshape(image.shape)


@VARIANTS
@pytest.mark.parametrize(
    "view",
    [
        read_only,
        np.asfortranarray,
        lambda image: np.ascontiguousarray(image[..., ::-1])[..., ::-1],
        lambda image: np.ascontiguousarray(image[::-1])[::-1],
        lambda image: np.pad(image, ((3, 3), (5, 5), (0, 0)))[3:-3, 5:-5],
    ],
    ids=["read-only", "by columns", "channels reversed", "upside down", "a crop"],
)
def test_a_view_of_an_image_is_tracked_as_the_image_itself(kind, sequence, view):
    image = sequence.image(0)
    assert np.array_equal(view(image), image)
    plain, viewed = (begun(kind, sequence).track(given, 0) for given in (image, view(image)))
    assert viewed.status == plain.status == "ok"
    assert np.array_equal(viewed.cam_from_world.matrix, plain.cam_from_world.matrix)


@VARIANTS
def test_a_first_pose_may_be_stored_in_any_order(kind, sequence):
    """As that of an inverse, whose rotation is stored by columns."""
    pose = sequence.true_cam_from_world(0)
    by_columns = Pose(np.asfortranarray(pose.rotation), pose.translation)
    assert by_columns.rotation.flags.f_contiguous
    rng = stream(3, "contract")
    run = TRACKERS[kind]().start(sequence.structure, sequence.camera, by_columns, rng)
    image, stamp = sequence.image(0), int(sequence.stamps_ns[0])
    expected = begun(kind, sequence).track(image, stamp)
    found = run.track(image, stamp)
    assert found.status == expected.status == "ok"
    assert np.array_equal(found.cam_from_world.matrix, expected.cam_from_world.matrix)


@VARIANTS
@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        ("cam_from_world", lambda pose: pose.matrix, r"cam_from_world is ndarray; give a Pose, as Pose\.from_matrix"),
        ("cam_from_world", lambda pose: Pose(pose.rotation, [np.nan, 0, 0]), "the initial pose is not finite"),
        ("cam_from_world", lambda pose: Pose(2 * pose.rotation, pose.translation), "its rows are not orthonormal"),
        ("cam_from_world", lambda pose: Pose(-pose.rotation, pose.translation), "or it mirrors"),
        ("camera", lambda camera: camera.K, r"camera is ndarray; give a Camera, as Camera\.load"),
        ("structure", lambda structure: "model.obj", "structure is str; give a Structure, as load_structure"),
        ("rng", lambda rng: 0, r"rng is int; give a Generator, as np\.random\.default_rng\(0\)"),
    ],
)
def test_what_no_run_can_start_from_is_refused_by_name(kind, sequence, name, change, told):
    given = {
        "structure": sequence.structure,
        "camera": sequence.camera,
        "cam_from_world": sequence.true_cam_from_world(0),
        "rng": stream(3, "contract"),
    }
    with pytest.raises(StartError, match=told):
        TRACKERS[kind]().start(**{**given, name: change(given[name])})
