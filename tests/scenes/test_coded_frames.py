"""Frames in 8 bits: the same whether they are computed at once, or by way of their radiance."""

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.test_effects import SMALL, giving, rng
from uavbench.scenes.effects.image_sensor import Noise
from uavbench.scenes.effects.lens import Vignetting
from uavbench.scenes.rendering.camera_simulator import Coded, Rendered, light_of
from uavbench.scenes.rendering.radiance import encode


@pytest.mark.parametrize("shape", [(120, 160, 3), (37, 53, 3), (1, 1, 3)])
def test_a_frame_coded_at_once_is_that_by_way_of_its_radiance(shape: tuple[int, int, int]) -> None:
    """Over several frames, of which each has a random number of its own, dark and saturated pixels among them."""
    roots = rng().integers(0, 256, (3, *shape), dtype=np.uint8)
    at_once = Noise(full_well_e=300.0).start(giving(Rendered(lambda k: roots[k])), rng())
    apart = Noise(full_well_e=300.0).start(giving(lambda k: light_of(roots[k])), rng())
    assert isinstance(at_once.image, Coded)
    assert not isinstance(apart.image, Coded)
    for k in (0, 1):
        light = apart.image(k)
        assert light is not None
        found = at_once.frame(k)
        assert found is not None
        assert np.array_equal(found, encode(light))
    last = apart.image(2)
    assert last is not None
    assert np.array_equal(at_once.image(2), last)  # type: ignore[arg-type]


def test_a_further_effect_is_in_the_frame() -> None:
    roots = rng().integers(0, 256, (SMALL.height, SMALL.width, 3), dtype=np.uint8)
    first, second = (Noise().start(giving(Rendered(lambda _: roots)), rng()) for _ in range(2))
    light = Vignetting().start(second, rng()).image(0)
    assert light is not None
    frame = Vignetting().start(first, rng()).frame(0)
    assert frame is not None
    assert np.array_equal(frame, encode(light))


def test_a_dropped_frame_has_no_codes() -> None:
    assert replace(giving(lambda _: None)).frame(0) is None
