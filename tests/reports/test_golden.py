"""ATE, RPE, association and alignment against the figures of evo and rpg, to 1e-9 relative.

tests/golden/evo/expected*.json hold the calls that made them ("generator"), tests/golden/evo/make.py makes those of evo
anew; evo was run unmodified.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.golden.evo import make
from uavbench.reports.metrics.align import align, alignment
from uavbench.reports.metrics.ape import absolute_errors
from uavbench.reports.metrics.association import PosePairs, associate
from uavbench.reports.metrics.rpe import PairInterval, interval_pairs, relative_errors
from uavbench.reports.metrics.sub_trajectories import rpg_lengths, segment_errors
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.trajectories.trajectory import Trajectory

FOLDER = Path(__file__).parents[1] / "golden" / "evo"
ROUND_OFF = 2e-14
RATIO_ROUND_OFF = 1e-11
"""In percent: what the last bits of positions in metres make of the difference of two like distances of centimetres;
the smallest of all ratios differs by as much from one processor to the next, and it alone is given this much."""
ALIGNMENTS = {
    "none": ("none", None),
    "se3": ("se3", None),
    "sim3": ("sim3", None),
    "scale_only": ("scale", None),
    "origin": ("origin", None),
    "origin_scale": ("origin-scale", None),
    "se3_n100": ("se3", 100),
    "sim3_n100": ("sim3", 100),
}
RELATIONS = {
    "translation_part": "translation_m",
    "rotation_part": "rotation",
    "full_transformation": "full",
    "rotation_angle_deg": "angle_deg",
    "rotation_angle_rad": "angle_rad",
    "point_distance": "point_distance_m",
    "point_distance_error_ratio": "point_distance_percent",
}
UNITS = {"frames": "frames", "meters": "m", "degrees": "deg", "radians": "rad"}
SYNC = {"nearest_time": "evo", "interpolation": "evo-interpolated"}
RPG_ALIGNMENTS = {
    "none_-1": ("none", None),
    "se3_-1": ("se3", None),
    "sim3_-1": ("sim3", None),
    "se3_1": ("origin", None),
    "posyaw_-1": ("yaw", None),
    "posyaw_1": ("yaw", 1),
}


def figures(name: str) -> dict:
    return json.loads((FOLDER / name).read_text())


@cache
def trajectory(name: str) -> Trajectory:
    lines = (FOLDER / f"{name}.tum").read_text().splitlines()
    values = np.array([line.split() for line in lines if not line.startswith("#")], dtype=float)
    return Trajectory(np.round(values[:, 0] * 1e9).astype(np.int64), values[:, 1:4], values[:, [7, 4, 5, 6]])


@cache
def aligned(pair: str, sync: str, kind: str) -> PosePairs:
    pairs = associate(trajectory(f"{pair}_gt"), trajectory(f"{pair}_est"), SYNC[sync], 0.01)
    return align(pairs, *ALIGNMENTS[kind])


def assert_equal(errors: np.ndarray, expected: dict, case: object) -> None:
    summary = ErrorSummary.of(errors)
    for name, value in expected.items():
        ratio = isinstance(case, dict) and case.get("relation") == "point_distance_error_ratio"
        smallest = RATIO_ROUND_OFF if ratio and name == "min" else ROUND_OFF
        assert getattr(summary, name) == pytest.approx(value, rel=1e-9, abs=smallest), (case, name)


@pytest.mark.parametrize("pair", ["A_orbit", "B_lemniscate"])
def test_every_absolute_error_equals_evo(pair: str) -> None:
    for row in figures("expected.json")["pairs"][pair]["ape"]:
        relation = RELATIONS[row["relation"]].replace("point_distance_m", "translation_m")
        errors = absolute_errors(aligned(pair, row["sync"], row["align"]), relation)
        assert_equal(errors, {"n": row["n"], **row["stats"]}, row)


@pytest.mark.parametrize("pair", ["A_orbit", "B_lemniscate"])
def test_every_relative_error_equals_evo(pair: str) -> None:
    for row in figures("expected.json")["pairs"][pair]["rpe"]:
        pairs = aligned(pair, row["sync"], row["align"])
        pairs_from = "reference" if row["pairs_from_reference"] else "estimate"
        over = PairInterval(row["delta"], UNITS[row["unit"]], row["all_pairs"], pairs_from, row["rel_delta_tol"])
        errors = relative_errors(pairs, *interval_pairs(pairs, over), RELATIONS[row["relation"]])
        assert_equal(errors, {"n": row["n"], **row["stats"]}, row)


@pytest.mark.parametrize("kind", ["ape", "rpe"])
def test_the_figures_are_those_that_their_script_makes(kind: str) -> None:
    expected = figures("expected.json")
    given = expected["generator"]["alignment_kwargs"], expected["pairs"]["A_orbit"]["t_max_diff"]
    for row in expected["pairs"]["A_orbit"][kind][:: {"ape": 13, "rpe": 101}[kind]]:
        again = getattr(make, kind)("A_orbit", row, *given)
        assert again.keys() == row.keys()
        assert again["n"] == row["n"]
        assert again["stats"] == pytest.approx(row["stats"], rel=1e-9, abs=ROUND_OFF), row


@pytest.mark.parametrize("pair", ["A_orbit", "B_lemniscate"])
def test_every_alignment_equals_evo(pair: str) -> None:
    rows = [row for row in figures("expected.json")["pairs"][pair]["ape"] if "alignment_sim3" in row]
    assert rows
    for row in rows:
        pairs = aligned(pair, row["sync"], "none")
        found = alignment(pairs, *ALIGNMENTS[row["align"]])
        if row["align"] == "scale_only":  # evo reports the whole similarity that the scale came from
            found = alignment(pairs, "sim3")
        expected = np.array(row["alignment_sim3"])
        if row["align"] == "origin_scale":  # and here the rotation and translation, without the scale
            np.testing.assert_allclose(found.rotation, expected[:3, :3], atol=1e-12)
        else:
            np.testing.assert_allclose(found.scale * found.rotation, expected[:3, :3], atol=1e-12)
        np.testing.assert_allclose(found.translation, expected[:3, 3], atol=1e-11)


@pytest.mark.parametrize("case", figures("expected_association.json")["cases"], ids=lambda c: f"{c['t_max_diff']}s")
def test_association_equals_evo_and_tum(case: dict) -> None:
    reference, estimate = trajectory("D_assoc_gt"), trajectory("D_assoc_est")
    many = associate(reference, estimate, "evo", case["t_max_diff"])
    assert (many.stamps_ns / 1e9).tolist() == case["evo"]["ref_stamps"]
    assert len(np.unique(many.stamps_ns)) == case["evo"]["unique_ref"]
    assert_equal(absolute_errors(align(many, "se3"), "translation_m"), case["evo"]["ape_se3"], case["t_max_diff"])
    once = associate(reference, estimate, "one-to-one", case["t_max_diff"])
    assert len(once) == case["tum_one_to_one"]["n"]
    expected = case["tum_one_to_one"]["ape_se3"]
    assert_equal(absolute_errors(align(once, "se3"), "translation_m"), expected, case["t_max_diff"])


@pytest.mark.parametrize("pair", ["A_orbit", "B_lemniscate"])
def test_alignments_and_sub_trajectories_equal_rpg(pair: str) -> None:
    expected = figures("rpg_expected.json")["pairs"][pair]
    pairs = aligned(pair, "nearest_time", "none")
    for kind, row in expected["abs"].items():
        found = align(pairs, *RPG_ALIGNMENTS[kind])
        assert_equal(absolute_errors(found, "translation_m"), row["trans"], kind)
        smallest = 1e-6 if kind == "se3_1" else ROUND_OFF  # rpg takes angles from the trace: arccos(1) is coarse
        angles = ErrorSummary.of(absolute_errors(found, "angle_deg"))
        for name, value in row["rot_deg"].items():
            assert getattr(angles, name) == pytest.approx(value, rel=1e-9, abs=smallest), (kind, name)
    assert [f"{length}" for length in rpg_lengths(pairs.reference_m)] == list(expected["rel"])
    names = {
        "trans_m": "translation_m",
        "trans_perc": "translation_percent",
        "rot_deg": "rotation_deg",
        "rot_deg_per_m": "rotation_deg_per_m",
        "yaw_deg": "yaw_deg",
        "gravity_deg": "tilt_deg",
    }
    for length, row in expected["rel"].items():
        found = segment_errors(pairs, float(length))
        for theirs, ours in names.items():
            for name, value in row[theirs].items():
                assert getattr(getattr(found, ours), name) == pytest.approx(value, rel=1e-9), (length, ours, name)
