"""Effects of users: an image that is none of linear light is told, and not written as white or black."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from uavbench.scenes.camera import Camera
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import CameraSimulator
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


def image_with(change):
    none = lambda *_: None  # noqa: E731
    source = CameraSimulator(CAMERA, CAMERA, None, lambda _: Pose.identity(), none, none, lambda _: LIGHT)
    return with_effects(source, (Own(change),), 0).image(40_000_000)


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
