"""Trees that branch: as tall and wide as asked, the same every time, in the mask, and `round` ones as ever."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking
from uavbench.bench.config.suite import suite_of
from uavbench.scenes.camera import Camera
from uavbench.scenes.clutter import branching, trees
from uavbench.scenes.clutter.branching import Looks, Place, branching_tree
from uavbench.scenes.clutter.habits import FAR_M, HABITS, TREE_SPREAD
from uavbench.scenes.clutter.limbs import COARSE, FINE, Crown, skeleton
from uavbench.scenes.clutter.placing import ring_places
from uavbench.scenes.clutter.trees import Trees
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.renderables import Part
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.random_streams import stream

BOUNDS = np.array([[-5.0, -1.0, 0.0], [5.0, 1.0, 4.0]])
FIELDS = ("vertices", "triangles", "normals", "uv", "tint", "texture")
HEIGHT_M = 7.0
ROUND_TRIANGLES = "80abfc067bc66c31cf0f444ee548fee49c64b5b8bd3acbdbeb4051f118b5d7bc"
ROUND_SUM = (26750.580249637922, -675.3901992946419, 6245.587795869061)
"""SHA-256 of the triangles of four `round` trees, and the sum of their vertices, before other habits were added."""
CAMERA = Camera(96, 72, 80.0, 80.0, 48.0, 36.0)
SUITE = {
    "title": "trees",
    "rates_hz": [15.0],
    "sequences": {
        "a": {
            "structure": {"kind": "wall"},
            "environment": {"kind": "studio"},
            "flight": {"path": {"kind": "hover", "duration_s": 0.1}},
        }
    },
    "trackers": {"hold": {"kind": "hold"}},
}


def grown(habit: str, seed: int = 1, **more: float) -> tuple[Part, ...]:
    return Trees(habit=habit, density=0.2, **more).build(BOUNDS, stream(seed, "clutter", 0)).parts  # type: ignore[arg-type]


def bytes_of(parts: tuple[Part, ...]) -> list[bytes]:
    found = [getattr(part, name) for part in parts for name in FIELDS]
    return [np.ascontiguousarray(each).tobytes() for each in found if each is not None]


@pytest.fixture(scope="module")
def looks() -> Looks:
    return Looks.of(tuple(HABITS), materials.bark(stream(0, "bark")), stream(0, "looks"))


def tree(name: str, looks: Looks, gap_m: float = 6.0, seed: int = 3, height_m: float = HEIGHT_M) -> tuple[Part, ...]:
    return branching_tree(name, height_m, Place(np.zeros(3), gap_m), looks, stream(seed, name))


def points(parts: tuple[Part, ...]) -> np.ndarray:
    return np.concatenate([part.vertices for part in parts])


@pytest.mark.parametrize("habit", ["mixed", *HABITS])
def test_the_same_seed_gives_the_same_bytes(habit: str) -> None:
    first, again, other = grown(habit), grown(habit), grown(habit, seed=2)
    assert bytes_of(first) == bytes_of(again)
    assert bytes_of(first) != bytes_of(other)


def test_round_is_the_default_and_as_ever() -> None:
    parts = Trees(density=0.2).build(BOUNDS, stream(1, "clutter", 0)).parts
    assert bytes_of(parts) == bytes_of(grown("round"))
    triangles = hashlib.sha256(np.concatenate([part.triangles for part in parts]).tobytes()).hexdigest()
    assert triangles == ROUND_TRIANGLES
    assert points(parts).sum(axis=0) == pytest.approx(ROUND_SUM, rel=1e-6)


@pytest.mark.parametrize("name", HABITS)
@pytest.mark.parametrize("gap_m", [6.0, 20.0])
def test_a_tree_is_as_tall_as_asked_and_within_the_width_of_its_habit(name: str, gap_m: float, looks: Looks) -> None:
    for seed in range(4):
        at = points(tree(name, looks, gap_m, seed))
        assert at[:, 2].max() == pytest.approx(HEIGHT_M, rel=0.01)
        assert at[:, 2].min() > -0.02 * HEIGHT_M
        wide = 2 * np.hypot(at[:, 0], at[:, 1]).max() / HEIGHT_M
        assert 0.7 * HABITS[name].crown_wide < wide <= HABITS[name].crown_wide + 1e-9


@pytest.mark.parametrize("name", HABITS)
def test_a_crown_ends_short_of_the_structure(name: str, looks: Looks) -> None:
    for gap_m in (0.5, 2.0):
        leaves = tree(name, looks, gap_m)[-1]
        assert np.hypot(leaves.vertices[:, 0], leaves.vertices[:, 1]).max() <= gap_m + 1e-9


def test_heights_are_those_of_round_trees() -> None:
    parts = grown("mixed", height_m=10.0)
    low, high = TREE_SPREAD
    assert 10 * low < points(parts)[:, 2].max() < 10 * high


@pytest.mark.parametrize("name", HABITS)
def test_the_top_of_a_crown_is_narrow(name: str, looks: Looks) -> None:
    for seed in range(4):
        at = tree(name, looks, seed=seed)[-1].vertices
        far = np.hypot(at[:, 0], at[:, 1])
        top = far[at[:, 2] > 0.97 * HEIGHT_M]
        assert len(top) <= 0.06 * len(far)
        assert top.max() < 0.75 * far.max()


@pytest.mark.parametrize("name", HABITS)
def test_limbs_end_among_leaves(name: str, looks: Looks, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(branching, "skeleton", lambda *args: made.append(skeleton(*args)) or made[-1])
    for gap_m in (6.0, 20.0):
        corners = tree(name, looks, gap_m)[-1].vertices.reshape(-1, 4, 3)
        ends = made[-1].limbs[:, -1] * HEIGHT_M
        near = np.linalg.norm(ends[:, None] - corners.mean(axis=1), axis=2).min(axis=1)
        assert near.max() < 0.15 * HEIGHT_M


def test_trees_stand_in_the_same_places_whatever_their_habit(monkeypatch: pytest.MonkeyPatch) -> None:
    stood = []

    def recorded(*args: object) -> object:
        stood.append(ring_places(*args))  # type: ignore[arg-type]
        return stood[-1]

    monkeypatch.setattr(trees, "ring_places", recorded)
    at = [points(grown(habit)) for habit in ("round", "spruce", "mixed")]
    assert all(places.tobytes() == stood[0].tobytes() for places in stood)
    for tree_points in at:
        apart = np.linalg.norm(stood[0][:, None, :2] - tree_points[:, :2], axis=2).min(axis=1)
        assert (apart < 0.5).all(), "a trunk at each place"


def test_a_tree_does_not_depend_on_the_others() -> None:
    first, both = (
        Trees(habit="oval", density=count / 20, furthest_m=9.0).build(BOUNDS, stream(4, "clutter", 0)).parts
        for count in (1, 2)
    )
    for alone, together in zip(first, both, strict=True):
        assert together.vertices[: len(alone.vertices)].tobytes() == alone.vertices.tobytes()


def test_far_trees_have_fewer_triangles(looks: Looks) -> None:
    for name in HABITS:
        near, far = (sum(len(p.triangles) for p in tree(name, looks, gap)) for gap in (FAR_M - 0.1, FAR_M))
        assert far < 0.75 * near


@pytest.mark.parametrize("name", HABITS)
def test_boughs_stay_in_the_crown(name: str) -> None:
    crown = Crown(HABITS[name].crown_wide / 2, HABITS[name])
    bones = skeleton(crown, HABITS[name].near, stream(2, name))
    assert crown.holds(bones.limbs[:, -1]).all()
    if len(bones.boughs):
        assert crown.holds(bones.boughs[:, -1]).mean() > 0.85
    for fineness in (FINE, COARSE):
        for part in bones.wood(Material(np.full((1, 1, 3), 90, dtype=np.uint8), (1.0, 1.0)), 5.0, fineness):
            a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
            out = np.einsum("ij,ij->i", np.cross(b - a, c - a), part.normals[part.triangles].sum(axis=1))
            assert (out > 0).mean() > 0.99, "faces are turned outwards"


@pytest.mark.parametrize("name", HABITS)
def test_the_mask_covers_a_tree(name: str, looks: Looks) -> None:
    for gap_m, away_m in ((6.0, 9.0), (20.0, 30.0)):
        with Renderer(tree(name, looks, gap_m), FLAT_LIGHT, CAMERA.width, CAMERA.height) as renderer:
            pose = looking((0.0, -away_m, 2.0), (0.0, 0.0, HEIGHT_M / 2))
            seen, depth = renderer.color(pose, CAMERA), renderer.geometry(pose, CAMERA)
        assert set(np.unique(depth.instances)) == {0, 2}
        assert ((depth.instances == 2) == (depth.depth_m > 0)).all()
        shown = 80.0**2 * HEIGHT_M**2 / away_m**2 * HABITS[name].crown_wide
        assert 0.25 * shown < (depth.instances == 2).sum() < 1.05 * shown
        assert (seen[depth.instances == 2].sum(axis=1) > 0).mean() > 0.95


def test_an_unknown_habit_is_refused_with_those_that_there_are() -> None:
    table = {**SUITE["sequences"]["a"], "clutter": [{"kind": "trees", "habit": "spruse"}]}  # type: ignore[index]
    with pytest.raises(UserError, match=r"clutter\[0\]\.habit: .*'birch' or 'spruce', got 'spruse'"):
        suite_of({**SUITE, "sequences": {"a": table}}, (), Path(__file__))
    with pytest.raises(UserError, match=r"unknown habit 'spruse'; did you mean 'spruce'\? \(valid: birch, "):
        grown("spruse")
