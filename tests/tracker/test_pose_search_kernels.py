"""The pose search's kernels against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavbench.tracker.robust.relocalization.edge_pixel_kernels import ORIENTATIONS
from uavbench.tracker.robust.relocalization.pose_search_kernels import orientation

NOT_TINY = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-6)


def bins_from_angle(x, y):
    """Bins that the angle of a line along (x, y) may be in: two where it is within rounding of their border."""
    turn = math.atan2(y, x) / math.pi * ORIENTATIONS
    return {math.floor(turn + e) % ORIENTATIONS for e in (-1e-9, 1e-9)}


@given(NOT_TINY, NOT_TINY)
def test_a_line_is_in_the_bin_of_its_angle(x, y):
    if x or y:
        assert orientation.for_python(x, y) in bins_from_angle(x, y)
        assert orientation.for_python(-x, -y) == orientation.for_python(x, y)


@pytest.mark.parametrize("k", range(ORIENTATIONS))
def test_the_middle_of_each_bin_is_in_it(k):
    angle = (k + 0.5) * math.pi / ORIENTATIONS
    assert orientation.for_python(math.cos(angle), math.sin(angle)) == k


def test_axes_begin_a_bin():
    found = [orientation.for_python(x, y) for x, y in np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)]
    assert found == [0, ORIENTATIONS // 2, 0, ORIENTATIONS // 2]
