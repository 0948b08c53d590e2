"""Sharp textures: nearer to the mean of a pixel than OpenGL's mipmaps, off by default, and the same geometry."""

from functools import partial

import cv2
import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.rendering.radiance import RENDERED
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.pose import Array, Pose

EYE = (0.0, 0.0, 2.0)
SLANTED = looking(EYE, (8.0, 0.0, 0.0))
FRONTAL = looking(EYE, (0.5, 0.0, 0.0))
FINER = 8
"""Samples per side of a pixel of the images that count as right."""


@pytest.fixture(scope="module")
def pattern() -> Texture:
    """Noise of equal contrast in each octave."""
    field = noise.fractal((512, 512), 128, np.random.default_rng(1), octaves=6, gain=1.0)
    return noise.finish(noise.paint((128.0, 128.0, 128.0), 1 + 0.2 * field))


def floor(texture: Texture) -> Part:
    """Level ground of 40 x 40 m with tiles of 4 m."""
    at = np.array([[-20.0, -20.0, 0.0], [20.0, -20.0, 0.0], [20.0, 20.0, 0.0], [-20.0, 20.0, 0.0]])
    return Part(vertices=at, triangles=np.array([[0, 1, 2], [0, 2, 3]]), uv=at[:, :2] / 4.0, texture=texture)


def light(part: Part, pose: Pose, *, sharp: bool, times: int = 1) -> Array:
    """Linear light (60, 80) of the ground, of an image so many times as large, averaged."""
    camera = Camera(80 * times, 60 * times, 70.0 * times, 70.0 * times, 40.0 * times - 0.5, 30.0 * times - 0.5)
    with Renderer((part,), FLAT_LIGHT, camera.width, camera.height, sharp=sharp) as renderer:
        codes = RENDERED[renderer.color(pose, camera)[..., 1]]
    return np.asarray(cv2.resize(codes, (80, 60), interpolation=cv2.INTER_AREA), dtype=np.float64)


@pytest.mark.parametrize(("pose", "most"), [(SLANTED, 0.7), (FRONTAL, 0.9)], ids=["slanted", "frontal"])
def test_sharp_textures_are_nearer_to_the_mean_of_each_pixel(pattern: Texture, pose: Pose, most: float) -> None:
    ground = floor(pattern)
    right = light(ground, pose, sharp=False, times=FINER)
    plain, sharp = (np.std(light(ground, pose, sharp=wanted) - right) for wanted in (False, True))
    assert sharp < most * plain


def test_sharp_textures_keep_depth_and_the_shape_of_leaves(pattern: Texture) -> None:
    """A mask of leaves is looked up alike for images and for depth."""
    mask = np.where(pattern[..., :1] > 128, 255, 0).astype(np.uint8)
    camera, leaves = Camera(80, 60, 70.0, 70.0, 39.5, 29.5), floor(np.dstack([pattern, mask]))
    seen = []
    for sharp in (False, True):
        with Renderer((leaves,), FLAT_LIGHT, 80, 60, sharp=sharp) as renderer:
            seen.append((renderer.color(SLANTED, camera), renderer.geometry(SLANTED, camera).depth_m))
    assert np.array_equal(seen[0][0], seen[1][0])
    assert np.array_equal(seen[0][1], seen[1][1])


@pytest.mark.parametrize("kind", [Indoor, partial(Outdoor, ground="gravel")], ids=["indoor", "outdoor"])
def test_textures_are_sharp_only_where_asked_for(kind: type[Indoor] | type[Outdoor]) -> None:
    bounds = np.array([[-0.2, -0.2, 0.0], [0.2, 0.2, 0.3]])
    plain, sharp = (kind(sharp_textures=wanted).build(bounds, np.random.default_rng(2)) for wanted in (False, True))
    assert kind() == kind(sharp_textures=False)
    assert (plain.sharp, sharp.sharp) == (False, True)
    for one, other in zip(plain.parts, sharp.parts, strict=True):
        assert np.array_equal(one.vertices, other.vertices)
        assert one.texture is not None and other.texture is not None
        assert np.array_equal(one.texture, other.texture)
