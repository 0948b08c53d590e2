"""Furniture along the walls of a room, in the frame of the room: where it stands, and what it leaves as it was."""

import numpy as np
import pytest

from uavbench.scenes.renderables import Part
from uavbench.scenes.world.furniture import Span, Wall, furniture, radiator
from uavbench.scenes.world.indoor import Indoor
from uavbench.trajectories.random_streams import stream

SIDE_M = 7.0
BOUNDS = np.array([[-0.2, -0.15, 0.0], [0.2, 0.15, 0.3]])
DEEPEST_M = 0.85
"""Deepest piece, a table, with its distance from the wall."""


def corners(parts: tuple[Part, ...]) -> np.ndarray:
    return np.concatenate([part.vertices for part in parts])


def room(furniture: float) -> tuple[Part, ...]:
    return Indoor(furniture=furniture).build(BOUNDS, stream(3, "room")).parts


def test_the_room_itself_stays_as_it_was() -> None:
    plain, furnished = room(0.0), room(0.8)
    assert len(furnished) > len(plain)
    for before, after in zip(plain, furnished, strict=False):
        assert np.array_equal(before.vertices, after.vertices)
        assert before.texture is not None and after.texture is not None
        assert np.array_equal(before.texture, after.texture)


def test_the_same_seed_gives_the_same_furniture() -> None:
    for one, other in zip(room(0.7), room(0.7), strict=True):
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.texture, other.texture)  # type: ignore[arg-type]


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("seed", range(8))
def test_pieces_stand_before_their_wall_and_beside_the_door(turns: int, seed: int) -> None:
    door = Span(2.0, 3.2)
    parts = furniture(SIDE_M, [Wall(turns, (door,))], 1.0, stream(seed, "wall"))
    angle = -turns * np.pi / 2
    back = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    x, y, z = (corners(parts) @ back.T + [SIDE_M / 2, -SIDE_M / 2, 0.0]).T
    assert x.min() > 0.7 and x.max() < SIDE_M - 0.7
    assert y.max() <= 1e-9 and y.min() >= -DEEPEST_M
    assert z.min() >= 0.0 and z.max() < 2.1
    assert not ((x > door.begin + 1e-9) & (x < door.end - 1e-9)).any()
    assert x.max() > door.end, "beyond the door, too"


def test_nothing_tall_stands_before_what_hangs_on_a_wall() -> None:
    for seed in range(10):
        low = corners(furniture(SIDE_M, [Wall(0, (), 1.2)], 1.0, stream(seed, "low")))
        assert low[:, 2].max() < 1.25, "a screen on a table may reach as high"


def test_faces_look_into_the_room_and_to_the_sides() -> None:
    """None looks at its wall, nor at the floor but for the lower sides of what is raised; a radiator is raised."""
    for part in radiator(SIDE_M, Wall(0), 3.5, stream(1, "radiator")):
        a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        assert normals[:, 1].max() < 0.5
        middle = corners((part,)).mean(axis=0)
        assert (np.einsum("ij,ij->i", normals, (a + b + c) / 3 - middle) > -0.06).all()


def test_a_larger_share_of_the_walls_has_more_pieces() -> None:
    walls = [Wall(k) for k in range(4)]
    few, many = (len(corners(furniture(SIDE_M, walls, share, stream(2, "share")))) for share in (0.2, 1.0))
    assert 0 < 2 * few < many
