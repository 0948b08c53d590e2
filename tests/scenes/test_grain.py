"""Grain: equal contrast in each octave, the same mean albedo, drawn from the seed, and off by default."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from uavbench.scenes.materials.grain import grained
from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.wall import Wall
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec

STREAMS = partial(stream, 5, "grain")
GREY = np.full((768, 768, 3), 120, dtype=np.uint8)
SPEC = SequenceSpec(
    name="wall",
    seed=5,
    structure=Wall(bays=2),
    environment=Outdoor(ground="gravel"),
    flight=FlightSpec(path=Hover(duration_s=0.1)),
)


def part_of(texture: Texture, roughness: float = 0.9) -> Part:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Part(
        vertices=corners,
        triangles=np.array([[0, 1, 2]]),
        uv=corners[:, :2],
        texture=texture,
        roughness=roughness,
    )


def albedo(texture: Texture | None) -> Array:
    assert texture is not None
    return np.square(texture[..., 1].astype(np.float64) / 255)


def textures_of(environment: Outdoor) -> list[bytes]:
    parts = build_scene(replace(SPEC, environment=environment)).parts
    return [b"" if part.texture is None else part.texture.tobytes() for part in parts]


def test_each_octave_has_the_same_contrast() -> None:
    """Features of 64, 32 ... 2 texels: the log albedo of the octaves of frequency that all sizes around them reach."""
    (found,) = grained([part_of(GREY)], 0.08, STREAMS)
    log = np.log(albedo(found.texture))
    assert log.std() == pytest.approx(0.08 * np.sqrt(6), rel=0.05)
    power = np.abs(np.fft.fft2(log - log.mean()) / log.size) ** 2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(768), np.fft.fftfreq(768), indexing="ij"))
    variance = [power[(frequency >= low) & (frequency < 2 * low)].sum() for low in (1 / 64, 1 / 32, 1 / 16)]
    assert max(variance) < 1.25 * min(variance)
    assert np.sqrt(np.mean(variance)) == pytest.approx(0.08, rel=0.05)


def test_grain_keeps_the_mean_albedo() -> None:
    (found,) = grained([part_of(GREY)], 0.1, STREAMS)
    assert albedo(found.texture).mean() == pytest.approx(albedo(GREY).mean(), rel=0.005)


def test_glass_leaves_and_plain_colours_have_none() -> None:
    leaf = np.dstack([GREY, GREY[..., :1]])
    plain = [part_of(GREY, roughness=0.25), part_of(leaf), part_of(GREY[:1, :1]), replace(part_of(GREY), texture=None)]
    assert grained(plain, 0.1, STREAMS) == plain


def test_what_shares_a_texture_shares_it_still() -> None:
    one, other, wider = grained([part_of(GREY), part_of(GREY), part_of(np.hstack([GREY, GREY]))], 0.1, STREAMS)
    assert one.texture is other.texture
    assert wider.texture is not one.texture


def test_the_seed_alone_draws_the_grain() -> None:
    """What else is in the scene does not: its textures may come in any order."""
    wide = np.hstack([GREY, GREY])
    one = grained([part_of(GREY), part_of(wide)], 0.1, STREAMS)[0]
    again = grained([part_of(wide), part_of(GREY)], 0.1, STREAMS)[1]
    other = grained([part_of(GREY)], 0.1, partial(stream, 6, "grain"))[0]
    assert np.array_equal(albedo(one.texture), albedo(again.texture))
    assert not np.array_equal(albedo(one.texture), albedo(other.texture))


def test_a_scene_has_grain_only_where_asked_for() -> None:
    plain, zero = textures_of(Outdoor(ground="gravel")), textures_of(Outdoor(ground="gravel", grain=0.0))
    grain, again = (textures_of(Outdoor(ground="gravel", grain=0.06)) for _ in range(2))
    assert plain == zero
    assert grain == again
    changed = [one != other for one, other in zip(plain, grain, strict=True)]
    assert any(changed)
    assert not all(changed), "windows and the trees at the horizon have none"
