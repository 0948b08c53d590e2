"""Groups of runs, their names and pairs, and curves over time and distance with their bands."""

import numpy as np
import pytest

from uavbench.reports.many_runs.comparison import decimals_of
from uavbench.reports.many_runs.curves import Axis, Band, distance_axis, time_axis
from uavbench.reports.many_runs.evaluate_many import evaluate_many
from uavbench.reports.many_runs.groups import Pairing, grouped, pairing
from uavbench.reports.many_runs.results import ManyResults
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_kitti, write_tum

POSES, RUNS = 120, 7
T = np.arange(POSES) / 10
WAY = np.column_stack([3 * np.cos(T / 3), 2 * np.sin(T / 3), 0.1 * T])


def trajectory(positions):
    return Trajectory(np.rint(T * 1e9).astype(np.int64), positions, np.tile([1.0, 0, 0, 0], (POSES, 1)))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Empty files of RUNS runs of three trackers."""
    folder = tmp_path_factory.mktemp("made")
    for name in "abc":
        (folder / name).mkdir()
        for run in range(RUNS):
            (folder / name / f"run{run}.tum").touch()
    return folder


# Groups and pairs


def names_of(folder, groups, estimates=()):
    return {(r.group, r.name) for r in grouped([folder / e for e in estimates], groups)}


def test_runs_are_called_by_what_the_wildcards_stand_for(made):
    found = names_of(made, [f"A={made}/a/run*.tum", f"B={made}/b/run[0-2].tum", f"C={made}/c/run?.tum"])
    assert {name for group, name in found if group == "A"} == set(map(str, range(RUNS)))
    assert {name for group, name in found if group == "B"} == {"0", "1", "2"}
    # One pattern takes more than the other: what they share are the names of the files.
    found = names_of(made, [f"A={made}/a/run*.tum", f"B={made}/b/*.tum"])
    assert {name for _, name in found} == {f"run{k}" for k in range(RUNS)}
    assert names_of(made, [f"A={made}/a/run0.tum", f"A={made}/a/run1.tum"]) == {("A", "run0"), ("A", "run1")}
    assert len(names_of(made, [f"A={made}/**/run*.tum"])) == 3 * RUNS
    assert names_of(made, [f"A={made}/a/../a/run1.tum"], ["a/run1.tum"]) == {("A", "run1")}


def test_patterns_choose_as_in_a_shell(made):
    """Among the estimates as on the disk: ranges, negations, and wildcards that stay in their folder."""
    estimates = [f"a/run{k}.tum" for k in range(RUNS)]
    for pattern, expected in (("[^0-4]", {"5", "6"}), ("[!0-4]", {"5", "6"}), ("[0-11]", {"0", "1"})):
        left = [name for name in estimates if name[5] in expected]
        for given in ([], left):
            assert {name for _, name in names_of(made, [f"A={made}/a/run{pattern}.tum"], given)} == expected
    with pytest.raises(UserError, match="matches no file"):
        names_of(made, [f"A={made}/a/run[6-0].tum"])
    with pytest.raises(UserError, match="matches no file"):
        names_of(made, [f"A={made}/*.tum"], ["a/run0.tum"])
    assert names_of(made, [f"A={made}/a/**/run0.tum"]) == {("A", "run0")}


def test_runs_pair_by_name_then_by_order_and_else_not_at_all():
    assert pairing({"A": ["1", "2", "3"], "B": ["3", "1", "2"]}).rows == {"A": [0, 1, 2], "B": [1, 2, 0]}
    some = pairing({"A": ["1", "2", "3"], "B": ["2", "3"]})
    assert (some.rows, some.how) == ({"A": [1, 2], "B": [0, 1]}, "the 2 runs that all trackers have, paired by name")
    assert "in the order given" in pairing({"A": ["x", "y"], "B": ["u", "v"]}).how
    none = pairing({"A": ["x", "y"], "B": ["u"]})
    assert none.n == 0 and "no paired test" in none.how


# Curves


def test_errors_are_binned_by_time_and_by_distance():
    truth = trajectory(WAY)
    errors = np.random.default_rng(0).random(POSES)
    axis = time_axis(truth)
    for k, value in enumerate(axis.binned(truth.stamps_ns, errors)):
        last = k == len(axis.edges) - 2
        inside = (axis.edges[k] <= T + 1e-9) & ((axis.edges[k + 1] > T + 1e-9) | last)
        assert value == pytest.approx(np.sqrt(np.mean(errors[inside] ** 2)))
    along = distance_axis(truth)
    assert along.edges[-1] == pytest.approx(truth.length_m)
    half = np.arange(POSES) < POSES // 2
    found = along.binned(truth.stamps_ns[half], np.full(half.sum(), 0.3))
    assert np.nanmax(np.abs(found - 0.3)) < 1e-12 and np.isnan(found[len(found) // 2 + 2 :]).all()
    still = trajectory(np.zeros((POSES, 3)))
    assert np.isfinite(distance_axis(still).binned(still.stamps_ns, errors)[0])


def test_a_band_holds_nine_tenths_of_the_runs_that_have_a_pose():
    curves = [np.array([float(k), np.nan, 5.0 if k else np.nan]) for k in range(21)]
    band = Band.of(curves)
    assert (band.low[0], band.middle[0], band.high[0]) == (1.0, 10.0, 19.0)
    assert np.isnan([band.low[1], band.middle[1], band.high[1]]).all()
    assert band.low[2] == band.high[2] == 5.0


@pytest.mark.parametrize(
    ("estimates", "groups", "told"),
    [
        ([], [], "name at least one estimate"),
        ([], ["A=HERE/nothing"], "matches no file"),
        ([], ["A=HERE/nothing*"], "matches no file"),
        ([], ["HERE/a/run0.tum"], "write NAME=PATTERN"),
        ([], ["=HERE/a/run0.tum"], "write NAME=PATTERN"),
        ([], ["A="], "write NAME=PATTERN"),
        (["a/run0.tum", "a/run0.tum"], [], "is given twice"),
        (["b/run0.tum"], ["A=HERE/a/*"], r"b/run0\.tum: in no group"),
        ([f"b/run{k}.tum" for k in range(3)], ["A=HERE/a/*"], r"b/run2\.tum: in no group"),
        ([f"b/run{k}.tum" for k in range(5)], ["A=HERE/a/*"], r"b/run2\.tum \(and 2 more\): in no group"),
        ([], ["A=HERE/a/*", "B=HERE/*/run0.tum"], "is in the groups A and B"),
    ],
)
def test_groups_that_are_wrong_are_named(made, estimates, groups, told):
    with pytest.raises(UserError, match=told):
        grouped([made / name for name in estimates], [spec.replace("HERE", str(made)) for spec in groups])


def test_estimates_without_a_group_are_runs_of_one(made, tmp_path):
    assert {(r.group, r.name) for r in grouped([made / "a" / "run0.tum"], [])} == {("estimate", "run0")}
    (tmp_path / "x" / "y").mkdir(parents=True)
    (tmp_path / "x" / "y" / "deep.tum").touch()
    assert len(names_of(tmp_path, [f"A={tmp_path}/**/*.tum"])) == 1
    # Two files of one name in a group: their paths tell them apart.
    pair = [made / "a" / "run0.tum", made / "b" / "run0.tum"]
    assert [r.name for r in grouped(pair, [])] == [str(path) for path in pair]


def test_round_off_of_one_run_does_not_widen_a_column():
    assert decimals_of(np.array([3.4, 0.0, 4e-15, np.nan])) == 2
    assert decimals_of(np.array([3.4, 0.0123])) == 4
    assert decimals_of(np.zeros(3)) == decimals_of(np.array([np.nan])) == 2


@pytest.mark.parametrize(("poses", "bins"), [(1, 1), (2, 1), (3, 1), (4, 2), (120, 60), (401, 200), (1000, 200)])
def test_bins_are_equal_and_hold_two_poses_or_more_and_there_are_200_at_most(poses, bins):
    stamps = 7 * 10**9 + np.arange(poses) * 10**8
    way = np.column_stack([3.0 + 0.5 * np.arange(poses), np.zeros((poses, 2))])
    truth = Trajectory(stamps, way, np.tile([1.0, 0, 0, 0], (poses, 1)))
    for axis, end in ((time_axis(truth), 0.1 * (poses - 1)), (distance_axis(truth), 0.5 * (poses - 1))):
        np.testing.assert_allclose(axis.edges, np.linspace(0, end, bins + 1), atol=1e-12)
        np.testing.assert_allclose(axis.middles, (np.arange(bins) + 0.5) * end / bins, atol=1e-12)
        np.testing.assert_allclose(axis.values, np.linspace(0, end, poses), atol=1e-12)
        np.testing.assert_array_equal(axis.stamps_ns, stamps)


def test_an_axis_may_begin_anywhere():
    axis = Axis(np.array([2.0, 3.0, 4.0]), np.array([5, 6, 7]) * 10**9, np.array([2.0, 3.2, 4.0]))
    stamps = np.array([5.0, 5.5, 6.0, 7.0])
    found = axis.binned(np.rint(stamps * 1e9).astype(np.int64), np.array([1.0, 7.0, 2.0, 6.0]))
    np.testing.assert_allclose(found, [5.0, np.sqrt(20.0)], atol=1e-12)
    assert np.isnan(axis.binned(np.array([7 * 10**9]), np.array([1.0]))).tolist() == [True, False]


def test_runs_of_one_tracker_pair_with_nothing():
    for names in ({}, {"A": ["1", "2"]}):
        assert pairing(names) == Pairing({}, "one tracker: nothing to compare") and pairing(names).n == 0
    whole = pairing({"A": ["1", "2"], "B": ["2", "1"]})
    assert (whole.how, whole.n) == ("2 runs, paired by name", 2)
    in_order = pairing({"A": ["x"], "B": ["u"]})
    assert (in_order.rows, in_order.how[:6], in_order.n) == ({"A": [0], "B": [0]}, "1 run,", 1)


def test_names_that_no_two_trackers_share_are_those_of_the_wildcards(made, tmp_path):
    found = names_of(made, [f"A={made}/a/run[01].tum", f"B={made}/b/run[23].tum"])
    assert found == {("A", "0"), ("A", "1"), ("B", "2"), ("B", "3")}
    for name in "ab":
        (tmp_path / "x" / "y" / name).mkdir(parents=True)
        (tmp_path / "x" / "y" / name / "run0.tum").touch()
    deep = names_of(made, [f"{name.upper()}={tmp_path}/**/{name}/run0.tum" for name in "ab"])
    assert deep == {("A", "x/y"), ("B", "x/y")}


def test_brackets_without_anything_between_are_themselves(tmp_path):
    (tmp_path / "run[].tum").touch()
    assert names_of(tmp_path, [f"A={tmp_path}/run[].tum"], ["run[].tum"]) == {("A", "run[]")}


def test_a_truth_without_stamps_has_those_of_the_first_estimate_that_has_any(tmp_path):
    fast = Trajectory(np.arange(POSES) * 10**9 // 40 + 10**18, WAY, np.tile([1.0, 0, 0, 0], (POSES, 1)))
    write_kitti(fast, tmp_path / "truth.txt")
    write_kitti(fast, tmp_path / "a.txt")
    for name in ("b.tum", "c.tum"):
        write_tum(fast, tmp_path / name)
    runs = grouped([tmp_path / name for name in ("a.txt", "b.tum", "c.tum")], [])
    found = evaluate_many(tmp_path / "truth.txt", runs)
    assert found.time.edges[-1] == pytest.approx((POSES - 1) / 40)
    for run in found.runs:
        assert np.isfinite(run.over_time["position"]).all() and np.isfinite(run.over_distance["rotation"]).all()


def test_trackers_that_show_the_same_best_value_are_all_bold(tmp_path):
    """Two trackers with the same estimates, and a third whose positions are worse and whose rotations are as good."""
    write_tum(trajectory(WAY), tmp_path / "truth.tum")
    for name, seed, size in (("a", 0, 0.01), ("b", 0, 0.01), ("c", 1, 0.05)):
        (tmp_path / name).mkdir()
        for run in range(RUNS):
            noise = np.random.default_rng([seed, run]).normal(0, size, WAY.shape)
            write_tum(trajectory(WAY + noise), tmp_path / name / f"{run}.tum")
    runs = grouped([], [f"{name}={tmp_path}/{name}/*.tum" for name in "abc"])
    table = ManyResults(evaluate_many(tmp_path / "truth.tum", runs)).table.select(["ATE position", "ATE rotation"])
    assert [[cell.best for cell in cells] for _, cells in table.rows] == [[True, True], [True, True], [False, True]]
    assert not any(cell.significant for _, cells in table.rows for cell in cells)
    assert "ties included" in table.caption


# Trackers that have poses for different frames


def compared(folder, options=None, **keeps):
    """Results of trackers that keep these rows of poses, errors of 2 cm in the first half and of 6 cm in the second.

    Those of `worse...` are a fifth larger at every pose.
    """
    write_tum(trajectory(WAY), folder / "truth.tum")
    size_m = np.where(np.arange(POSES) < POSES // 2, 0.02, 0.06)[:, None]
    for seed, (name, rows) in enumerate(keeps.items()):
        (folder / name).mkdir()
        for run in range(RUNS):
            ways = np.random.default_rng([seed, run]).normal(size=WAY.shape)
            noise = ways / np.linalg.norm(ways, axis=1, keepdims=True) * size_m * (1.2 if "worse" in name else 1.0)
            whole = trajectory(WAY + noise)
            kept = Trajectory(whole.stamps_ns[rows], whole.positions_m[rows], whole.quaternions_wxyz[rows])
            write_tum(kept, folder / name / f"{run}.tum")
    runs = grouped([], [f"{name}={folder}/{name}/*.tum" for name in keeps])
    return ManyResults(evaluate_many(folder / "truth.tum", runs, **options or {}))


def of_position(results):
    return {(c.first, c.second): c for c in results.tested["ate_position"]}


ALL, EASY, HARD = slice(None), slice(0, POSES // 2), slice(POSES // 2, None)


def test_a_tracker_that_is_worse_on_every_frame_wins_nothing_by_being_lost_where_it_is_difficult(tmp_path):
    results = compared(tmp_path, worse=EASY, good=ALL)
    means = {name: float(values.mean()) for name, values in results.many.values("ate_position").items()}
    assert means["worse"] < means["good"]  # over all poses of its own, beside which stands its coverage
    found = of_position(results)["worse", "good"]
    assert found.significant and found.wins == 0.0
    assert found.difference.mean == pytest.approx(0.2 * 0.02)
    assert results.shared["worse", "good"] == pytest.approx(0.5)
    (motion,) = results.tested["rpe_position"]
    assert motion.difference.mean > 0 and motion.wins < 0.5
    assert not any(cell.significant or cell.best for cell in dict(results.table.rows)["worse"])
    assert results.to_json()["groups"]["worse"]["coverage"] == pytest.approx(0.5)
    assert "read them with coverage" in results.table.caption and "50 %" in results.text()


def test_a_tracker_that_is_mostly_lost_takes_no_frames_from_a_test_of_two_others(tmp_path):
    found = compared(tmp_path, worse=ALL, good=ALL, lost=slice(0, 20))
    both = of_position(found)["worse", "good"]
    rms_m = np.sqrt((0.02**2 + 0.06**2) / 2)
    assert both.difference.mean == pytest.approx(0.2 * rms_m, rel=1e-6)
    assert found.shared["worse", "good"] == 1.0 and found.shared["good", "lost"] == pytest.approx(20 / POSES)
    assert of_position(found)["good", "lost"].difference.mean == pytest.approx(0, abs=1e-9)


def test_trackers_that_share_no_frame_are_not_compared_and_none_is_better_than_the_other(tmp_path):
    found = compared(tmp_path, good=ALL, worse=HARD, early=EASY)
    assert set(of_position(found)) == {("good", "worse"), ("good", "early")}
    assert "no test of the ATE of worse - early, which share no frame" in found.table.caption
    assert not any(cell.significant for _, cells in found.table.rows for cell in cells)


def test_frames_between_those_of_a_slower_tracker_are_not_shared(tmp_path):
    found = compared(tmp_path, good=ALL, third=slice(0, None, 3))
    assert found.shared["good", "third"] == pytest.approx(1 / 3)
    assert of_position(found)["good", "third"].difference.mean == pytest.approx(0, abs=1e-9)


def test_intervals_in_frames_are_compared_with_equal_ones_and_those_in_seconds_with_poses_at_their_ends(tmp_path):
    """A tracker of a third of the rate, whose frames are longer, and which begins between the seconds of the other."""
    (tmp_path / "frames").mkdir()
    found = compared(tmp_path / "frames", good=ALL, third=slice(4, None, 3))
    assert "rpe_position" not in found.tested
    assert "no test of the RPE of good - third, which share no interval" in found.table.caption
    (tmp_path / "s").mkdir()
    found = compared(tmp_path / "s", {"delta": 1.2, "unit": "s"}, good=ALL, third=slice(4, None, 3))
    (motion,) = found.tested["rpe_position"]
    assert motion.difference.mean == pytest.approx(0, abs=0.01) and "no test" not in found.table.caption
    lost = np.r_[0:30, 45:POSES]
    (tmp_path / "gap").mkdir()
    found = compared(tmp_path / "gap", {"delta": 0.5, "unit": "s", "all_pairs": True}, worse=ALL, good=lost)
    assert found.tested["rpe_position"][0].wins < 0.5
