"""Where the colours of a camera lie is learned from the edges that stand alone, and accounted for where they are."""

import cv2
import numpy as np
import pytest

from tests.tracker.lit_edge import BRIGHT, SIZE, SRGB, appearance, edge
from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit, pose_error
from uavbench.tracker.robust.edges.columns import BINS, NORMAL_U, NORMAL_V
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.steps.blur_kernels import LEAST_MEASURED
from uavbench.tracker.robust.edges.steps.colour_kernels import colours_apart
from uavbench.tracker.robust.edges.steps.optics_kernels import (
    ALIGNED,
    OUTWARDS,
    WEIGHT,
    Optics,
    displaced_px,
    learned_light,
)
from uavbench.tracker.robust.optics.colours import Colours
from uavbench.tracker.robust.tracker import Robust

WIDTH, HEIGHT = 640, 480
CORNER_PX = np.hypot(WIDTH, HEIGHT) / 2
NOWHERE = np.zeros((3, 3))
LENS = np.array([[-0.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
STEP_NS = 66_666_667


def displacement(of_channels, u, v, normal):
    """Displacements (3,) along a normal of channels that are displaced so outwards, along u and along v."""
    outwards = (np.array([u, v]) - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) @ normal / CORNER_PX
    return of_channels @ [outwards, *normal]


def with_edges(rng, of_channels=NOWHERE, edges=8, noise=2.0, along_pixels=False, bright=BRIGHT):
    """An image with edges here and there, whose channels are displaced, their search lines and rows of appearance."""
    image, lines, half = np.zeros((HEIGHT, WIDTH, 3), np.uint8), [], SIZE // 2
    for k in range(edges):
        column, row = k % 4 * 160 + rng.integers(half, 160 - half), k // 4 % 2 * 240 + rng.integers(half, 240 - half)
        angle = rng.integers(4) * 90 + rng.uniform(-2, 2) if along_pixels else rng.uniform(0, 360)
        normal = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        moved_px = displacement(of_channels, column, row, normal)
        seen, at = edge(0.5, angle, noise=noise, rng=rng, moved_px=moved_px, bright=bright)
        image[row - half : row + half + 1, column - half : column + half + 1] = seen
        lines.append(at.lines + np.array([column - half, row - half, 0, 0]))
    rows = np.repeat(np.arange(edges) * BINS, len(lines[0]))
    lines = np.concatenate(lines)
    n = len(lines)
    return image, SearchLines(lines, np.zeros((n, 6)), np.ones(n, np.int64)), rows


def seen_in(image, lines, rows, colours=ALIGNED, distance=0.0):
    known = np.zeros((rows.max() + 1, 8))
    known[rows] = appearance(lines)
    at = np.broadcast_to(distance, len(rows)).astype(float)
    return colours_apart.for_python(image, lines, rows, known, at, Optics(SRGB[None], 0.5, colours))


def learned_from(of_channels=NOWHERE, camera=lambda image: image, seed=1, **of_image):
    rng, state = np.random.default_rng(seed), Colours()
    for _ in range(20):
        image, lines, rows = with_edges(rng, of_channels, **of_image)
        state.learn(seen_in(camera(image), lines, rows, state.known), 0.5, 0.1)
    return state


def mosaic(image):
    """An image whose pixels saw one colour each, the others of them interpolated: RGGB, as OpenCV's BayerBG."""
    raw = image[..., 1].copy()
    raw[0::2, 0::2], raw[1::2, 1::2] = image[0::2, 0::2, 2], image[1::2, 1::2, 0]
    return cv2.cvtColor(raw, cv2.COLOR_BayerBG2BGR)


@pytest.mark.parametrize("seed", range(3))
def test_lateral_colour_is_learned(seed):
    known = learned_from(LENS, seed=seed).known
    assert known[:, OUTWARDS] == pytest.approx(LENS[:, 0], abs=0.04)
    assert (known[:, 2:] == 0).all()
    assert (known[:, WEIGHT] == 1).all()


def test_colours_that_are_displaced_everywhere_are_learned_too():
    shifted = np.array([[0.3, -0.1, 0.25], [0, 0, 0], [-0.2, 0.2, 0.1]])
    known = learned_from(shifted).known
    assert known[:, 1:] == pytest.approx(shifted, abs=0.05)
    assert (known[:, WEIGHT] == 1).all()


def test_no_channel_is_blamed_for_what_was_not_yet_known():
    """Blue and red that lie upon each other would seem to tell of edges, and green beside them not to."""
    both = np.array([[0, 0.5, 0], [0, 0, 0], [0, 0.4, 0]])
    rng, state = np.random.default_rng(1), Colours()
    for _ in range(10):
        image, lines, rows = with_edges(rng, both)
        state.learn(seen_in(image, lines, rows, state.known), 0.5, 0.1)
        assert (state.known[:, 1:] == 0).all() or (state.known[:, WEIGHT] == 1).all()
    assert state.known[:, 1:] == pytest.approx(both, abs=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_colours_that_lie_upon_each_other_are_left_there(seed):
    assert (learned_from(seed=seed).known == ALIGNED).all()


def test_frames_of_one_second_say_no_more_than_one():
    """Edges that are displaced by themselves are so in all of them."""
    rng = np.random.default_rng(3)
    one, many = Colours(), Colours()
    seen = seen_in(*with_edges(rng, LENS))
    one.learn(seen, 0.0, 0.1)
    for _ in range(100):
        many.learn(seen, 0.001, 0.0)
    assert np.linalg.eigvalsh(many.information[0]).max() < 1.2 * np.linalg.eigvalsh(one.information[0]).max()


@pytest.mark.parametrize("seed", range(3))
def test_a_mosaic_is_told_by_its_green(seed):
    """Edges along its pixels lie between those of red and blue, without any of these seeing them pass."""
    weights = learned_from(camera=mosaic, seed=seed, along_pixels=True).known[:, WEIGHT]
    assert weights[1] == 1.0
    assert max(weights[0], weights[2]) < 0.1


@pytest.mark.parametrize("worst", range(3))
def test_the_worst_channel_weighs_least_whichever_it_is(worst):
    rng, state = np.random.default_rng(5), Colours()
    for _ in range(20):
        displaced = np.zeros((3, 3))
        displaced[worst, 1:] = rng.normal(0, 0.25, 2)
        image, lines, rows = with_edges(rng, displaced)
        state.learn(seen_in(image, lines, rows, state.known), 0.5, 0.1)
    assert state.known[worst, WEIGHT] < 0.1 * np.delete(state.known[:, WEIGHT], worst).min()


@pytest.mark.parametrize("blown", [[0], [2], [0, 1]])
def test_channels_that_are_blown_out_are_not_taken_for_displaced_ones(blown):
    """Beside blown-out light a channel's step is displaced towards the dark side, here towards the middle."""
    state, bright = Colours(), np.array([0.5, 0.45, 0.4])
    bright[blown] = 6.0
    for k in range(10):
        image, lines, rows = with_edges(np.random.default_rng(k), noise=1.0, bright=bright)
        outer = ((lines.lines[:, :2] - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) * lines.lines[:, 2:]).sum(axis=1) > 0
        lines, rows = SearchLines(*(each[outer] for each in lines)), rows[outer]
        state.learn(seen_in(image, lines, rows, state.known), 0.5, 0.1)
    assert (state.known == ALIGNED).all()


def test_nothing_is_learned_where_no_colours_are_seen():
    image, lines, rows = with_edges(np.random.default_rng(0), LENS)
    grey = np.ascontiguousarray(np.repeat(image[..., 1:2], 3, axis=2))
    few = np.where(np.arange(len(rows)) < LEAST_MEASURED - 1, 0.0, np.inf)
    state = Colours()
    for seen in (
        seen_in(np.ascontiguousarray(image[..., :1]), lines, rows),
        seen_in(image, lines, rows, distance=np.inf),
        seen_in(image, lines, rows, distance=few),
        seen_in(np.full_like(image, 90), lines, rows),
        seen_in(grey, lines, rows),
    ):
        state.learn(seen, 1.0, 0.1)
    assert (state.known == ALIGNED).all()


@pytest.mark.parametrize("weights", [(1, 1, 1), (0.1, 1, 0.1), (0, 0, 1)])
def test_an_edge_is_displaced_as_its_channels_are(weights):
    """By the mean of their displacements, each by its weight and by the square of its step of light."""
    colours = np.column_stack([weights, LENS + np.array([[0.1, -0.2, 0.05], [0, 0, 0], [0, 0.1, 0]])])
    image, line = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.array([600.0, 100.0, 0.6, -0.8])
    row = np.array([20.0, 60, 40, 200, 90, 160, 5, 0])
    light = SRGB[row[3:6].astype(int)] - SRGB[row[:3].astype(int)]
    shares = np.array(weights) * light**2 / (np.array(weights) @ light**2)
    direction, optics = np.empty(3), Optics(SRGB[None], 0.5, colours)
    assert learned_light.py_func(row, 3, optics, direction) == pytest.approx(light @ direction)
    assert direction == pytest.approx(np.array(weights) * light / np.linalg.norm(np.array(weights) * light))
    expected = shares @ displacement(colours[:, 1:], *line[:2], line[[NORMAL_U, NORMAL_V]])
    assert displaced_px.py_func(row, image, line, optics, direction) == pytest.approx(expected)


def lateral(image, red, blue):
    """An image whose red and blue are enlarged by so many px at its corner."""
    h, w = image.shape[:2]
    out = image.copy()
    for channel, px in ((0, blue), (2, red)):
        scale = 1 + px / (np.hypot(h, w) / 2)
        at = np.array([[scale, 0, (w - 1) / 2 * (1 - scale)], [0, scale, (h - 1) / 2 * (1 - scale)]])
        out[..., channel] = cv2.warpAffine(image[..., channel], at, (w, h), flags=cv2.INTER_CUBIC)
    return out


def errors(camera, seed, frames=40):
    """Errors in m of the camera's place in the second half of a flight about a box."""
    scene, found = Scene([box_corners()], seed=seed), []
    poses = orbit(frames, seed=seed)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i, pose in enumerate(poses):
        result = run.track(camera(scene.render(pose)), i * STEP_NS)
        assert result.status == "ok"
        found.append(pose_error(result.cam_from_world, pose).distance_m)
    return np.array(found[frames // 2 :])


@pytest.mark.parametrize("seed", range(2))
def test_a_flight_with_lateral_colour_is_as_exact_as_one_without(seed):
    """Edges are 0.4 px beside their places at the sides of the image: the box was thought to be nearer by that."""
    assert np.sqrt(np.mean(errors(lambda image: lateral(image, 0.8, 0.6), seed) ** 2)) < 0.0010
