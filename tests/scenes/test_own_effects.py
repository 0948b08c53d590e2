"""Effects of users: images that are none of linear light, or not those of the seed or of the ground truth, are told."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from uavbench.scenes.camera import Camera
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, Geometry, ideal_camera
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

CAMERA = Camera(16, 12, 10.0, 10.0, 7.5, 5.5, "none", ())
LIGHT = np.full((12, 16, 3), 0.2, dtype=np.float32)


@dataclass(frozen=True)
class Own:
    """An effect that applies a function to each image."""

    change: object

    def start(self, source, rng):
        return replace(source, image=lambda stamp_ns: self.change(source.image(stamp_ns)))


@dataclass(frozen=True)
class Other:
    """An effect that gives a simulator with other parts."""

    parts: dict

    def start(self, source, rng):
        return replace(source, **self.parts)


@dataclass(frozen=True)
class Drawn:
    """An effect with a random image of each frame, and noise of the generator that it is given."""

    draw: object

    def start(self, source, rng):
        drawn = self.draw(rng)
        return replace(source, image=lambda stamp_ns: source.image(stamp_ns) * next(drawn))


class Grey:
    """A renderer of grey, 2 m away."""

    def color(self, *_):
        return np.full((12, 16, 3), 100, dtype=np.uint8)

    def geometry(self, *_):
        return Geometry(np.full((12, 16), 2.0, dtype=np.float32), np.ones((12, 16), dtype=np.uint8))


def simulator():
    none = lambda *_: None  # noqa: E731
    return CameraSimulator(CAMERA, CAMERA, None, lambda _: Pose.identity(), none, none, lambda _: LIGHT)


def image_with(change):
    return with_effects(simulator(), (Own(change),), 0).image(40_000_000)


@pytest.mark.parametrize(("change", "told"), [
    (lambda light: np.where(np.indices(light.shape)[0] < 5, np.nan, light), "holds numbers that are not finite"),
    (lambda light: (light * 255).astype(np.uint8), "is of uint8, not of floats"),
    (lambda light: light * 255, "has the median 51, as if it were in grey levels"),
    (lambda light: light - 5, "has the median -4.8, below black"),
    (lambda light: light.mean(axis=2), r"has the shape \(12, 16\), not \(12, 16, 3\)"),
    (lambda light: light[::2, ::2], r"has the shape \(6, 8, 3\), not"),
    (lambda light: light.tolist(), "is a list, not of floats"),
])  # fmt: skip
def test_an_image_that_is_none_of_linear_light_is_told(change, told):
    with pytest.raises(UserError, match=rf"effect .*:Own: at 0\.040 s its image {told}.*; an effect takes and gives"):
        image_with(change)


def test_an_effect_that_starts_no_simulator_is_told(monkeypatch):
    monkeypatch.setattr(Own, "start", lambda *_: None)
    with pytest.raises(UserError, match=r"effect .*:Own: start gives a NoneType; it takes a CameraSimulator"):
        image_with(None)


@pytest.mark.parametrize("change", [
    lambda light: light * 8, lambda light: light * 0, lambda light: None,
    lambda light: light.astype(np.float64) + np.random.default_rng(0).normal(0, 0.1, light.shape),
    lambda light: light * 0 - np.random.default_rng(0).random(light.shape) / 50,
])  # fmt: skip
def test_glare_darkness_noise_and_lost_frames_are_left_alone(change):
    found = image_with(change)
    assert found is None or found.shape == LIGHT.shape


@pytest.mark.parametrize(("parts", "told"), [
    ({"camera": replace(CAMERA, fx=20.0)}, "camera"),
    ({"pinhole": replace(CAMERA, cx=3.0)}, "pinhole"),
    ({"lens": np.zeros((12, 16, 2), dtype=np.float32)}, "lens"),
    ({"cam_from_world": lambda _: Pose.identity()}, "cam_from_world"),
])  # fmt: skip
def test_an_effect_of_another_camera_than_that_of_the_ground_truth_is_told(parts, told):
    with pytest.raises(UserError, match=rf"effect .*:Other: start gives a CameraSimulator of another {told}, and grou"):
        with_effects(simulator(), (Other(parts),), 0)


def test_an_effect_may_have_rows_and_an_equal_camera():
    same = with_effects(simulator(), (Other({"camera": replace(CAMERA), "row_delay_ns": 1e5}),), 0)
    assert same.row_delay_ns == 1e5


@pytest.mark.parametrize("part", ["color", "depth", "instances"])
def test_an_effect_cannot_change_what_annotations_are_made_of(part):
    def blackened(source, stamp_ns):
        getattr(source.render(stamp_ns), part)[:] = 0
        return source.image(stamp_ns)

    source = ideal_camera(Grey(), CAMERA, CAMERA, None, lambda _: Pose.identity())
    camera = with_effects(source, (Other({"image": lambda stamp_ns: blackened(source, stamp_ns)}),), 0)
    with pytest.raises(ValueError, match="read-only"):
        camera.image(0)
    assert (getattr(camera.render(0), part) > 0).all()


COUNTED = iter(range(1, 100))


def kept(rng):
    """Numbers that go on where an earlier call ended."""
    return (1 + 0.1 * number for number in COUNTED)


def unseeded(rng):
    other = np.random.default_rng()
    return iter(other.random, None)


def late(rng):
    """Random from the second frame on."""
    yield 1.0
    yield from unseeded(rng)


def much_later(rng):
    """Random from the sixth frame on, of the global generator."""
    yield from [1.0] * 5
    yield from iter(np.random.random, None)


@pytest.mark.parametrize(
    ("draw", "at_s"), [(kept, "0.000"), (unseeded, "0.000"), (late, "0.100"), (much_later, "0.500")]
)
def test_images_that_are_others_in_each_run_of_a_seed_are_told(draw, at_s):
    camera = with_effects(simulator(), (Drawn(lambda rng: iter(rng.random, None)), Drawn(draw)), 0)
    with pytest.raises(UserError, match=rf"effect .*:Drawn: at {at_s} s it gives another image each time; take all"):
        for number in range(8):
            camera.image(number * 100_000_000)


def test_images_of_the_generator_given_to_an_effect_are_those_of_its_seed():
    made = [with_effects(simulator(), (Drawn(lambda rng: iter(rng.random, None)),), seed) for seed in (0, 0, 1)]
    one, same, other = ([camera.image(number * 100_000_000) for number in range(6)] for camera in made)
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    assert len({float(image[0, 0, 0]) for image in one}) == 6


@dataclass(frozen=True)
class Asking:
    """An effect that sums images of two instants and writes to them."""

    asked: list

    def start(self, source, rng):
        def image(stamp_ns):
            self.asked.append(stamp_ns)
            total = source.image(stamp_ns)
            total *= np.float32(0.5)
            total += source.expose(stamp_ns - 10, stamp_ns) + source.image(stamp_ns)
            return total

        return replace(source, image=image)


def test_the_second_pass_of_a_frame_renders_nothing():
    rendered = []

    def light(*times_ns):
        rendered.append(times_ns)
        return LIGHT.copy()

    camera = with_effects(replace(simulator(), image=light, expose=light), (Asking([]),), 0)
    for stamp_ns in (100, 200):
        np.testing.assert_array_equal(camera.image(stamp_ns), 2.5 * LIGHT)
    assert rendered == [(100,), (90, 100), (100,), (200,), (190, 200), (200,)]


def test_an_effect_that_asks_the_camera_for_other_images_each_time_is_told():
    draws = iter([100, 101])
    effect = Other({"image": None})
    source = simulator()
    ask = lambda self, found, rng: replace(found, image=lambda stamp_ns: found.image(next(draws)))  # noqa: E731
    Asks = type("Asks", (Other,), {"start": ask})
    with pytest.raises(UserError, match=r"effect .*:Asks: it asks for another image each time, 0\.000 s; take all"):
        with_effects(source, (Asks(effect.parts),), 0).image(0)


@dataclass
class Fading:
    """An effect that writes to its parameters, and is darker at each start."""

    gain: float = 1.0

    def start(self, source, rng):
        self.gain *= 0.5
        return replace(source, image=lambda stamp_ns: source.image(stamp_ns) * np.float32(self.gain))


def test_what_an_effect_writes_to_its_parameters_reaches_no_other_camera():
    effect = Fading()
    for camera in ("camera", "right"):
        image = with_effects(simulator(), (effect,), 0, camera).image(0)
        np.testing.assert_array_equal(image, LIGHT / 2)
    assert effect == Fading()
