"""A meadow is drawn blade by blade: without a seam, sharper than grass from near, and the same every time."""

import cv2
import numpy as np
import pytest

from uavbench.scenes.materials import painted
from uavbench.scenes.materials.painted import Material


@pytest.fixture(scope="module")
def meadow() -> Material:
    return painted.meadow(np.random.default_rng(4))


def light(look: Material) -> np.ndarray:
    return cv2.cvtColor(look.texture, cv2.COLOR_RGB2GRAY).astype(np.float64)


def steepest(look: Material) -> float:
    """Grey codes per mm of the steepest hundredth, as the texture is enlarged for a camera that resolves 1 mm."""
    patch = light(look)[:400, :400]
    scale = 1000 * look.tile_m[0] / look.texture.shape[0]
    seen = cv2.resize(patch, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    return float(np.quantile(np.abs(np.diff(seen, axis=1)), 0.99))


def test_a_meadow_has_no_seam(meadow: Material) -> None:
    grey = light(meadow)
    for axis in (0, 1):
        steps = np.abs(np.diff(grey, axis=axis, append=grey.take([0], axis=axis))).mean(axis=1 - axis)
        assert steps[-1] < steps[:-1].mean() + 4 * steps[:-1].std()


def test_a_meadow_is_as_bright_as_grass_and_sharper_from_near(meadow: Material) -> None:
    grass = painted.grass(np.random.default_rng(4))
    assert light(meadow).mean() == pytest.approx(light(grass).mean(), rel=0.1)
    assert light(meadow).std() == pytest.approx(light(grass).std(), rel=0.25)
    assert steepest(meadow) > 2.5 * steepest(grass)


def test_the_same_generator_gives_the_same_meadow(meadow: Material) -> None:
    assert painted.meadow(np.random.default_rng(4)).texture.tobytes() == meadow.texture.tobytes()
    assert meadow.soaks, "no water stands on it, as on grass"
