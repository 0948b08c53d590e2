from pathlib import Path

import numpy as np

from tests.reports.drawn import make_sequence
from uavbench.reports.figures.flight import flight, frustum, gnss_along
from uavbench.reports.style import house_style


def test_a_flight_is_drawn_the_same_twice_with_and_without_gnss(tmp_path: Path) -> None:
    sequence = make_sequence(tmp_path / "arc", 12)
    assert gnss_along(sequence) is None
    header = "stamp_ns,satellites,pdop,px_m,py_m,pz_m\n"
    for case, gnss in enumerate(
        ("", header + "0,7.0,2.0,1.0,1.0,1.0\n200000000,3.0,,,,\n400000000,5.0,3.0,1.0,1.0,1.0\n")
    ):
        if gnss:
            (sequence.folder / "gnss.csv").write_text(gnss)
            np.testing.assert_array_equal(gnss_along(sequence), [[0, 7, 1], [0.2, 3, 0], [0.4, 5, 1]])
        with house_style():
            first, second = (flight(sequence, tmp_path / f"{name}{case}") for name in ("a", "b"))
        assert [p.suffix for p in first] == [".pdf", ".png", ".csv"]
        assert all(p.read_bytes() == q.read_bytes() for p, q in zip(first, second, strict=True))
        assert len((tmp_path / f"a{case}.csv").read_text().splitlines()) == 13


def test_a_frustum_ends_at_the_corners_of_the_image(tmp_path: Path) -> None:
    sequence = make_sequence(tmp_path / "arc", 2)
    pose, camera = sequence.true_cam_from_world(0), sequence.camera
    lines = frustum(camera, pose, 0.5)
    np.testing.assert_allclose(lines[:4, 0], np.tile(pose.inverse().translation, (4, 1)), atol=1e-12)
    corners = camera.project(pose.transform(lines[:4, 1]))
    w, h = camera.width - 0.5, camera.height - 0.5
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]], atol=1e-6)
