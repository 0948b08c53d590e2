"""The Cramer-Rao bound: closed forms, the noise it takes for granted, and bounds of rendered frames."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import erf

from tests.scenes.test_generate import SPEC
from uavbench.scenes.camera import Camera
from uavbench.scenes.camera_path import camera_path
from uavbench.scenes.dataset.crlb import FrameBounds, bound, directions, finer, information, jacobian, light_variance
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import file_hash
from uavbench.scenes.effects.image_sensor import AutoExposure, FixedExposure, Noise, Quantization
from uavbench.scenes.effects.lens import LateralColour
from uavbench.scenes.effects.processing import ColourFilter
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.generate import generate
from uavbench.scenes.rendering.camera_simulator import (
    CameraSimulator,
    View,
    ideal_camera,
    light_of,
    render_camera,
    through_lens,
)
from uavbench.scenes.rendering.radiance import Radiance, decode, encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import CameraSpec
from uavbench.scenes.world.studio import Studio
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.simulation.flight import fly

FX_PX, DEPTH_M, SOFTNESS_PX, CONTRAST = 500.0, 2.0, 1.3, 0.4


def soft_edge(twist: np.ndarray) -> Radiance:
    """A soft vertical edge on a wall across the optical axis, seen after moving by a twist."""
    u = np.arange(-40, 41) - FX_PX * twist[0] / DEPTH_M
    row = 0.3 + CONTRAST * (0.5 + 0.5 * erf(u / (np.sqrt(2) * SOFTNESS_PX)))
    return np.broadcast_to(row[None, :, None], (30, 81, 3)).astype(np.float32)


def test_the_bound_of_a_soft_edge_is_the_closed_form() -> None:
    """The information of a Gaussian-blurred step of height a is a^2 / (2 sqrt(pi) s) for each px of its length."""
    sigma = 0.01
    step = 0.25 * DEPTH_M / FX_PX
    J = jacobian(lambda xi: soft_edge(np.array([*xi, 0, 0, 0, 0, 0])), np.array([[step]]))
    found = bound(information(J, np.full((30, 81, 3), sigma**-2)))
    per_px = CONTRAST**2 / (2 * np.sqrt(np.pi) * SOFTNESS_PX) / sigma**2
    assert found is not None
    assert step * np.sqrt(found[0, 0]) == pytest.approx(DEPTH_M / FX_PX / np.sqrt(30 * 3 * per_px), rel=0.02)


def test_what_one_edge_does_not_show_has_no_bound() -> None:
    J = jacobian(soft_edge, 1e-3 * np.eye(6))
    assert bound(information(J, np.ones((30, 81, 3)))) is None


@pytest.mark.parametrize("effects", [(Noise(),), (Noise(900.0, 20.0),), (Noise(), Quantization(6)), (Quantization(5),)])
def test_the_variance_is_that_of_what_the_sensor_does(effects: tuple[Noise | Quantization, ...]) -> None:
    """Light from dim to bright through the effects and the 8-bit codes, against the light itself."""
    clean = np.linspace(0.05, 0.9, 600 * 400 * 3, dtype=np.float32).reshape(600, 400, 3)
    source = CameraSimulator(Camera(400, 600, 1, 1, 0, 0), *[None] * 5, image=lambda _: clean)  # type: ignore[arg-type]
    for effect in effects:
        source = effect.start(source, np.random.default_rng(3))
    light = source.image(0)
    assert light is not None
    whitened = (decode(encode(light)) - clean) / np.sqrt(light_variance(clean, effects))
    for part in np.array_split(whitened.reshape(-1), 4):
        assert np.mean(np.square(part)) == pytest.approx(1.0, abs=0.1)


def test_light_that_saturates_tells_nothing() -> None:
    assert np.isinf(light_variance(np.full((2, 2, 3), 1.2, dtype=np.float32), (Noise(),))).all()


def test_colours_that_a_filter_blocks_tell_nothing_and_measured_ones_as_much_as_without() -> None:
    clean = np.full((6, 8, 3), 0.4, dtype=np.float32)
    filtered, plain = (light_variance(clean, effects) for effects in ((Noise(), ColourFilter("GBRG")), (Noise(),)))
    measured = np.isfinite(filtered)
    assert (measured.sum(axis=2) == 1).all()
    assert measured[0, 0, 1] and measured[0, 1, 0] and measured[1, 0, 2]  # BGR
    assert np.array_equal(filtered[measured], plain[measured])


def test_a_lens_displaces_colours_of_a_finer_camera_as_far() -> None:
    """Seen by a bound's renders, red and blue of a flight are those of its frames, and brighter by its stops."""
    dimmer, lens = FixedExposure(stops=-0.5), LateralColour(red_px=2.0, blue_px=-2.0)
    spec = replace(SPEC, environment=Studio(), mount=Mount(pitch_deg=-20.0))
    scene, camera = build_scene(spec), spec.camera.camera()
    flight = fly(spec.flight, spec.mount, scene.obstacles, spec.seed)
    ground_truth = camera_path(flight, spec.mount.cam_from_body)(0)
    pinhole, places = render_camera(camera, lens.margin_px)
    taken, told = [], []
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        ideal = ideal_camera(renderer, camera, pinhole, places, lambda _: ground_truth)
        for effects in ((), (dimmer,), (lens, dimmer)):
            light = with_effects(ideal, effects, 0).image(0)
            assert light is not None
            taken.append(light)
    for effects in ((), (dimmer,), (lens, dimmer)):
        with FrameBounds(scene.renderer, camera, lambda _: ground_truth, effects) as limit:
            told.append(limit._light(np.zeros(6), 0))
    for one, other in ((0, 1), (1, 2)):
        change, expected = told[other] - told[one], taken[other] - taken[one]
        assert np.vdot(change, expected) / np.vdot(expected, expected) == pytest.approx(1.0, abs=0.2)


def test_a_finer_camera_sees_the_same() -> None:
    camera = Camera(320, 240, 300.0, 310.0, 161.3, 117.8, "radtan", (-0.1, 0.02, 0.0, 0.0))
    points = np.random.default_rng(0).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 2.0], (50, 3))
    fine = finer(camera, 2).project(points)
    assert (fine + 0.5) / 2 - 0.5 == pytest.approx(camera.project(points), abs=1e-9)


def test_directions_move_what_is_seen_equally_far_and_differ() -> None:
    """Against the motion of points that are projected before and after each."""
    camera = Camera(320, 240, 300.0, 310.0, 161.3, 117.8)
    depth = np.full((240, 320), 2.0, dtype=np.float32)
    depth[100:] += 0.3 * np.linspace(0, 1, 140, dtype=np.float32)[:, None]
    shown = np.zeros((240, 320), dtype=np.uint8)
    shown[60:180, 80:240] = 1
    twists = directions(View(shown, depth, shown, Pose.identity()), camera, 0.1)
    assert twists is not None
    v, u = np.nonzero(shown)
    pixels = np.column_stack([u, v])
    rays = np.column_stack([(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(u))])
    points = depth[v, u, None] * rays
    moved = [(camera.project(Pose.exp(1e-3 * t).transform(points)) - pixels).ravel() for t in twists]
    products = np.array(moved) @ np.array(moved).T / len(u) / 1e-6
    assert products == pytest.approx(0.1**2 * np.eye(6), abs=0.1 * 0.1**2)


def test_what_is_not_there_gives_no_directions() -> None:
    nothing = np.zeros((24, 32), dtype=np.uint8)
    view = View(nothing, nothing.astype(np.float32), nothing, Pose.identity())
    assert directions(view, Camera(32, 24, 30.0, 30.0, 15.5, 11.5), 0.1) is None


def test_the_best_estimate_from_an_image_reaches_its_bound() -> None:
    """Least squares over the light of plain, well sampled images: Gauss-Newton from a few deviations away."""
    noise = Noise(full_well_e=2000.0)
    spec = replace(
        SPEC,
        environment=Studio(),
        camera=CameraSpec(width=160, height=120, horizontal_fov_deg=50.0, lens_blur_px=0.6),
        mount=Mount(pitch_deg=-20.0),
        effects=(noise,),
    )
    scene, camera, rng = build_scene(spec), spec.camera.camera(), np.random.default_rng(2)
    flight = fly(spec.flight, spec.mount, scene.obstacles, spec.seed)
    ground_truth = camera_path(flight, spec.mount.cam_from_body)(0)
    with (
        scene.renderer(camera.width, camera.height) as renderer,
        FrameBounds(scene.renderer, camera, lambda _: ground_truth, (noise,), 0.6) as limit,
    ):

        def light(pose: Pose) -> Radiance:
            return light_of(through_lens(renderer, pose, camera, 0.0, 0.6))

        clean = light(ground_truth)
        P = limit.covariance(encode(clean), 0)
        assert P is not None
        steps = 3 * np.linalg.cholesky(P).T
        weight = 1 / light_variance(clean, (noise,))
        J = np.array([change.reshape(-1) for change in jacobian(lambda xi: light(Pose.exp(xi) @ ground_truth), steps)])
        gain = np.linalg.solve((J * weight.reshape(-1)) @ J.T, J * weight.reshape(-1))
        misfits = []
        for _ in range(6):
            source = CameraSimulator(camera, *[None] * 5, image=lambda _: clean)  # type: ignore[arg-type]
            noisy = noise.start(source, rng).image(0)
            assert noisy is not None
            seen, error = decode(encode(noisy)), Pose.exp(rng.standard_normal(6) @ steps)
            for _ in range(3):
                error = Pose.exp(((seen - light(error @ ground_truth)).reshape(-1) @ gain.T) @ steps) @ error
            misfits.append(error.log() @ np.linalg.solve(P, error.log()) / 6)
    assert 0.5 < np.mean(misfits) < 2.0


@pytest.fixture(scope="module")
def bounded(tmp_path_factory: pytest.TempPathFactory) -> list[Sequence]:
    """The same flight with a little and with much noise, and with an exposure that follows the light."""
    found = []
    for name, effects in (
        ("calm", (Noise(full_well_e=6000.0),)),
        ("noisy", (Noise(full_well_e=600.0, read_noise_e=0.8),)),
        ("exposed", (Noise(full_well_e=6000.0), AutoExposure(target=0.3))),
    ):
        folder = tmp_path_factory.mktemp("bounded") / name
        generate(replace(SPEC, effects=effects, crlb_every=3), folder, content_hash="abc")
        found.append(Sequence.load(folder))
    return found


def test_every_third_frame_has_a_bound_and_more_noise_a_larger_one(bounded: list[Sequence]) -> None:
    """Ten times the shot noise is at most ten times the variance: rounding stays as it is."""
    calm, noisy, exposed = bounded
    assert list(calm.pose_bounds) == list(noisy.pose_bounds) == [0, 3]
    for frame, covariance in calm.pose_bounds.items():
        assert (np.linalg.eigvalsh(covariance) > 0).all()
        assert 1e-7 < np.sqrt(np.trace(covariance[:3, :3])) < 1e-2
        for other, ratio in ((noisy.pose_bounds[frame], (4.0, 10.0)), (exposed.pose_bounds[frame], (0.1, 1.0))):
            shares = np.linalg.eigvals(np.linalg.solve(covariance, other)).real
            assert (shares > ratio[0]).all() and (shares < ratio[1]).all()


def test_the_images_are_the_same_without_bounds(bounded: list[Sequence], tmp_path: Path) -> None:
    generate(replace(SPEC, effects=(Noise(full_well_e=6000.0),)), tmp_path / "plain", content_hash="abc")
    assert Sequence.load(tmp_path / "plain").pose_bounds == {}
    for name in bounded[0].files:
        assert file_hash(tmp_path / "plain" / name) == file_hash(bounded[0].folder / name)
