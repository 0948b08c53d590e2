"""Edges of images whose codes are blurred: how far they are displaced, and what results say of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.optimize import least_squares
from scipy.special import ndtr

from tests.tracker.synthetic import pose_error
from tests.tracker.test_response import PLAIN, STEP_NS
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.generate import generate
from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.edges.columns import APPEARANCE_COLUMNS, NEGATIVE_COLOUR, POSITIVE_COLOUR, TIMES_SEEN
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, PIXEL_PX, Optics
from uavbench.tracker.robust.optics.code_blur_kernels import displaced_by_codes
from uavbench.tracker.robust.optics.response import light_of_codes
from uavbench.tracker.robust.tracker import Robust

SRGB = light_of_codes(Camera.from_field_of_view(640, 480, horizontal_deg=65.0))
CODES = np.arange(256.0)
BLUR_PX = 1.2
FINE = 200
"""Samples of a pixel."""
FRAMES = 30


def displaced(low, high, blur_px=BLUR_PX, light=SRGB):
    """Displacement, px, of an edge between two colours b g r, the second on the positive side of its normal."""
    row = np.zeros((1, APPEARANCE_COLUMNS))
    row[0, NEGATIVE_COLOUR : NEGATIVE_COLOUR + 3], row[0, POSITIVE_COLOUR : POSITIVE_COLOUR + 3] = low, high
    row[0, TIMES_SEEN] = 9
    optics, one = Optics(light[None].copy(), blur_px, ALIGNED.copy()), np.ones(1, np.int64)
    return displaced_by_codes(np.zeros(1, np.int64), np.arange(2), one, np.ones(1), row, optics, 3)[0]


def fitted(low, high, blur_px):
    """Where a blurred step of light fits seven pixels best whose codes, blurred by a pixel before, were blurred again.

    The mean over where the edge lies between the pixels.
    """
    at = np.arange(-15 * FINE, 15 * FINE + 1) / FINE
    light_low, light_high = np.interp([low, high], CODES, SRGB)
    codes = np.interp(light_low + (light_high - light_low) * ndtr(at / PIXEL_PX), SRGB, CODES)
    codes = gaussian_filter1d(codes, FINE * np.sqrt(blur_px**2 - PIXEL_PX**2), mode="nearest")
    places = []
    for between in np.linspace(-0.5, 0.5, 5):
        pixels = np.arange(-3, 4) + between
        seen = np.interp(np.interp(pixels, at, codes), CODES, SRGB)

        def left(x, pixels=pixels, seen=seen):
            return x[0] + x[1] * ndtr((pixels - x[2]) / blur_px) - seen

        places.append(least_squares(left, [light_low, light_high - light_low, 0.0]).x[2])
    return np.mean(places)


@pytest.mark.parametrize("codes", [(40, 90), (60, 120), (100, 200), (20, 60), (120, 160), (200, 70)])
@pytest.mark.parametrize("blur_px", [0.8, 1.2, 1.5])
def test_displacements_are_those_of_fits_to_blurred_codes(codes, blur_px):
    low, high = codes
    expected = fitted(min(codes), max(codes), blur_px) * np.sign(high - low)
    assert displaced((low,) * 3, (high,) * 3, blur_px) == pytest.approx(expected, rel=0.12)
    assert abs(expected) > 0.04


def test_edges_are_displaced_to_their_dark_sides():
    assert displaced((30, 40, 50), (160, 140, 150)) > 0.2
    assert displaced((160, 140, 150), (30, 40, 50)) < -0.2


def test_sharp_images_and_linear_codes_displace_nothing():
    assert displaced((30, 40, 50), (160, 140, 150), PIXEL_PX) == 0.0
    assert displaced((30, 40, 50), (160, 140, 150), light=CODES / 255) == pytest.approx(0.0, abs=1e-9)


def test_edges_without_a_located_point_are_not_displaced():
    row = np.zeros((1, APPEARANCE_COLUMNS))
    row[0, POSITIVE_COLOUR : POSITIVE_COLOUR + 3], row[0, TIMES_SEEN] = 200, 9
    optics, rows, first = Optics(SRGB[None].copy(), BLUR_PX, ALIGNED.copy()), np.zeros(3, np.int64), np.array([0, 2, 3])
    steps, weight = np.array([0, 1, 1]), np.array([1.0, 0.0, 1.0])
    found = displaced_by_codes(rows, first, steps, weight, row, optics, 3)
    assert found[0] == 0.0 and found[1] > 0.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A plain box before one colour, as long as it is looked at."""
    folder = tmp_path_factory.mktemp("plain") / "plain"
    path = replace(PLAIN.flight.path, duration_s=FRAMES / 15)
    generate(replace(PLAIN, flight=replace(PLAIN.flight, path=path)), folder, content_hash="plain")
    return Sequence.load(folder)


def blurred(codes, of_codes):
    """Image (h, w, 3) whose codes are blurred, or its light."""
    if of_codes:
        return np.rint(gaussian_filter(codes.astype(float), (BLUR_PX, BLUR_PX, 0))).astype(np.uint8)
    return encode(gaussian_filter(SRGB[codes], (BLUR_PX, BLUR_PX, 0)))


@pytest.mark.parametrize("of_codes", [False, True])
def test_results_allow_for_blur_of_light_and_of_codes(flight, of_codes):
    """Codes displace a plain box by 3.0 mm along the line of sight, where 0.3 mm were claimed: NEES was 154."""
    run = Robust().start(flight.structure, flight.camera, flight[0].cam_from_world, np.random.default_rng(1))
    found = []
    for k in range(FRAMES):
        result, true = run.track(blurred(flight.image(k), of_codes), k * STEP_NS), flight[k].cam_from_world
        xi = (true @ result.cam_from_world.inverse()).log()
        nees = float(xi @ np.linalg.solve(result.covariance, xi)) / 6
        found.append((1e3 * pose_error(result.cam_from_world, true)[0], nees))
    error_mm, nees = np.array(found)[10:].T
    assert 0.02 < np.median(nees) < 1.5
    assert error_mm.mean() > 1.5 if of_codes else error_mm.mean() < 0.3
