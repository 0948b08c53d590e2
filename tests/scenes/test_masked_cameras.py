"""Masked polygons of a camera: which pixels they are, and how they are written and read."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavbench.scenes.camera import Camera
from uavbench.trajectories.errors import UserError

CAMERA = Camera.from_field_of_view(64, 48, 60.0)
CORNERS = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 40)), min_size=3, max_size=6).map(tuple)


def test_pixels_inside_a_polygon_and_on_its_border_are_masked():
    shown = replace(
        CAMERA, masked=(((10, 5), (19, 5), (19, 8), (10, 8)), ((-9, 40), (90, 40), (90, 60), (-9, 60)))
    ).unmasked
    expected = np.ones((48, 64), dtype=bool)
    expected[5:9, 10:20] = expected[40:] = False
    np.testing.assert_array_equal(shown, expected)
    assert CAMERA.unmasked.all()


@given(st.lists(CORNERS, max_size=3))
def test_masked_parts_are_read_as_written(tmp_path_factory, polygons):
    camera = replace(CAMERA, masked=polygons)
    path = tmp_path_factory.mktemp("camera") / "camera.toml"
    camera.save(path)
    assert Camera.load(path) == camera


@pytest.mark.parametrize(
    ("masked", "told"),
    [
        ("[[0, 0], [9, 0], [9, 9]]", "not a polygon of three or more corners, as in masked = "),
        ("[[[0, 0], [9, 0]]]", "not a polygon of three or more corners"),
        ("[[[0, 0, 1], [9, 0, 1], [9, 9, 1]]]", "not a polygon"),
        ("[[[0, 0], [9, 0], [9, nan]]]", "not a polygon"),
        ('"mask.png"', "must be polygons, as in masked = "),
        ("7", "must be polygons"),
        ("[[[0, 0], [63, 0], [63, 47], [0, 47]]]", "covers all of the image"),
    ],
)
def test_what_is_no_mask_is_told(tmp_path, masked, told):
    path = tmp_path / "camera.toml"
    CAMERA.save(path)
    path.write_text(path.read_text() + f"masked = {masked}\n")
    with pytest.raises(UserError, match=r"camera\.toml: masked") as error:
        Camera.load(path)
    assert told in str(error.value)
