"""Flights beside each other: pairs of runs against exact tests, swept loops, and the worst flight of a run."""

import json
from dataclasses import fields, replace
from pathlib import Path

import pytest
from scipy.stats import binom

from uavbench.reports.closed_loop.comparison import by_run, compared, success
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.closed_loop.repeated_flights import counted
from uavbench.reports.closed_loop.report import FlownRun, worst_of, write_page
from uavbench.reports.closed_loop.summary_figures import along_loops, success_of_runs, swept_loops
from uavbench.reports.closed_loop.tables import FlightNotes, cells_of_pair, table
from uavbench.reports.style import house_style
from uavbench.trajectories.errors import UserError

NOTES = FlightNotes("flights", {}, {})


def score(run, seed, *, succeeds=True, path_m=0.01, sequence="box"):
    """A flight of a run, with what the comparison reads of it."""
    numbers = {f.name: 0.1 for f in fields(FlightScore)}
    return FlightScore(**{
        **numbers, "label": run.split("@")[0], "run": run, "rate_hz": 15.0, "sequence": f"{sequence}-s{seed}",
        "seed": seed, "status": "completed" if succeeds else "crashed", "why": "", "success": succeeds,
        "path_rms_m": path_m, "path_max_m": 3 * path_m, "frames": 10, "faults": (),
    })  # fmt: skip


def flights(run, fates, path_m=0.01):
    return [
        score(run, seed, succeeds=fate == "+", path_m=path_m * (1 + 0.01 * seed)) for seed, fate in enumerate(fates)
    ]


def test_success_is_compared_by_the_flights_in_which_one_alone_succeeds():
    scores = flights("a@15hz", "++++++++--") + flights("b@15hz", "-------+--")
    (pair,) = compared(scores)
    assert (pair.flights, pair.first_only, pair.second_only, pair.both) == (10, 7, 0, 1)
    assert pair.success_p == pytest.approx(2 * binom.cdf(0, 7, 0.5))
    assert cells_of_pair(pair)[3].endswith("*")
    assert success(by_run(scores)["a@15hz"]).successes == 8


def test_path_errors_are_compared_where_both_succeed():
    scores = flights("a@15hz", "++++++-+", 0.02) + flights("b@15hz", "+++++++-", 0.01)
    (pair,) = compared(scores)
    assert (pair.both, pair.first_only, pair.second_only) == (6, 1, 1)
    expected = [0.01 * (1 + 0.01 * seed) for seed in range(6)]
    assert pair.path_m.mean == pytest.approx(sum(expected) / 6)
    assert pair.path_m.low > 0 and pair.path_p < 0.05 and pair.success_p == 1.0


def test_p_is_adjusted_over_all_pairs_and_runs_without_a_flight_in_common_are_none():
    runs = {name: flights(name, fates) for name, fates in (("a", "+" * 7), ("b", "-" * 7), ("c", "+" * 7))}
    pairs = {(p.first, p.second): p for p in compared([s for group in runs.values() for s in group])}
    assert pairs["a", "b"].success_p == pytest.approx(3 * 2**-6)
    assert pairs["a", "c"].success_p == 1.0
    apart = [score("d", 0, sequence="box"), score("e", 0, sequence="wall")]
    assert compared(apart) == []


def test_flights_that_no_seed_changes_count_once_and_are_named():
    same = [score("a@15hz", seed) for seed in range(5)] + [score("b@15hz", seed, path_m=0.02) for seed in range(5)]
    assert counted(same) == [same[0], same[5]]
    (line,) = [line for line in table(NOTES, same).splitlines() if line.startswith("| box | a@15hz")]
    assert line.startswith("| box | a@15hz | 1 | 1 | 21-100 |"), "the Wilson interval of one flight, not of five"
    assert "box: seeds 0, 1, 2, 3 and 4 have the same frames and results, and count as one run" in table(NOTES, same)
    differ = flights("a@15hz", "+++")
    assert counted(differ) == differ and "count as one run" not in table(NOTES, differ)


def test_a_flight_that_could_not_be_flown_counts_as_no_success(tmp_path):
    lost = {f"box-s{seed} b@15hz": "cannot be started" for seed in range(2, 7)} | {"box-s0 c@15hz": "no GPU"}
    notes = FlightNotes("flights", lost, {})
    scores = flights("a@15hz", "+++++++") + flights("b@15hz", "++")
    judged = notes.judged(scores)
    lines = [line for line in table(notes, scores).splitlines() if line.startswith("| box")]
    assert lines[0].startswith("| box | a@15hz | 7 | 7 |")
    assert lines[1].startswith("| box | b@15hz | 2 of 7 | 2 | 8-64 | 0 | 1.0 |"), "Wilson's interval of 2 of 7"
    assert lines[2].startswith("| box | c@15hz | 0 of 1 | 0 | 0-79 | 0 |  |")
    pair = compared(judged)[0]
    assert (pair.flights, pair.first_only, pair.second_only, pair.both) == (7, 5, 0, 2)
    with house_style():
        success_of_runs(judged, tmp_path / "success")
    rows = [row.split(",") for row in (tmp_path / "success.csv").read_text().splitlines()[1:]]
    assert [row[:3] for row in rows] == [["a@15hz", "7", "7"], ["b@15hz", "7", "2"], ["c@15hz", "1", "0"]]
    assert rows[2][-1] == "", "no path error where nothing was flown"


def test_flights_that_could_not_be_flown_count_once_where_their_seeds_repeat_one_flight():
    same = [replace(score("a@15hz", 0), seed=seed, sequence=f"box-s{seed}") for seed in range(3)]
    notes = FlightNotes("flights", {f"box-s{seed} b@15hz": f"box-s{seed}: fails" for seed in range(3)}, {})
    lines = [line for line in table(notes, same).splitlines() if line.startswith("| box")]
    assert lines[0].startswith("| box | a@15hz | 1 | 1 |")
    assert lines[1].startswith("| box | b@15hz | 0 of 1 | 0 | 0-79 |")


def test_the_worst_flight_of_a_run_is_one_that_failed():
    runs = [FlownRun(Path(str(s.seed)), s) for s in flights("a", "+-+")]
    assert worst_of(runs).score.seed == 1
    assert worst_of([runs[0], runs[2]]).score.seed == 2


def test_faults_of_a_tracker_are_told_where_the_flight_is_a_success_too(tmp_path):
    """A program that has crashed in flight and one that repeats itself, both of which got home on the IMU."""
    crashed = replace(score("a", 0), faults=("t = 1.000 s: [crashed] frame 15",))
    twice = replace(score("b", 0, succeeds=False), faults=tuple(f"t = {k}.000 s: [duplicate] row" for k in range(5)))
    lines = table(NOTES, [crashed, twice]).splitlines()
    assert "box-s0 a: t = 1.000 s: [crashed] frame 15" in lines
    assert [line for line in lines if line.startswith("box-s0 b: ")] == [
        "box-s0 b: crashed at 0.10 s: it left its corridor: it was up to 0.03 m from its path",
        *(f"box-s0 b: t = {k}.000 s: [duplicate] row" for k in range(3)),
        "box-s0 b: and 2 more faults of its tracker",
    ]
    (tmp_path / "record.json").write_text("{}")
    write_page(tmp_path, NOTES, [FlownRun(tmp_path, each) for each in (crashed, twice)], [], [], 0)
    page = (tmp_path / "index.html").read_text()
    assert page.count("t = 1.000 s: [crashed] frame 15") == page.count("[duplicate] row") / 3 == 1
    assert "and 2 more faults" in page


def test_a_number_of_many_digits_is_written_with_an_exponent():
    (line,) = [
        line for line in table(NOTES, [replace(score("a", 0), tracker_nees=3.2e299)]).splitlines() if "| a |" in line
    ]
    assert "| 3e+299 |" in line and len(line) < 200


@pytest.mark.parametrize(("key", "value"), [("faults", 5), ("path_rms_m", "far"), ("success", None), ("frames", [])])
def test_a_score_that_is_none_is_named(tmp_path, key, value):
    score("a", 0).save(tmp_path / "score.json")
    assert FlightScore.load(tmp_path / "score.json") == score("a", 0)
    values = json.loads((tmp_path / "score.json").read_text())
    del values["made_by"]
    (tmp_path / "score.json").unlink()
    (tmp_path / "score.json").write_text(json.dumps({**values, key: value}))
    with pytest.raises(UserError, match=rf"score\.json: not the score of a flight: {key}"):
        FlightScore.load(tmp_path / "score.json")


LATENCY = {"estimator": "filter", "latency": {"kind": "constant", "ms": 0.0}}


@pytest.mark.parametrize(("tables", "key"), [
    ({str(ms): {**LATENCY, "latency": {"kind": "constant", "ms": ms}} for ms in (0.0, 50.0, 200.0)}, "latency.ms"),
    ({str(ms): {**LATENCY, "latency": {"kind": "constant", "ms": ms}} for ms in (0.0, 50.0)}, None),
    ({name: {**LATENCY, "estimator": name} for name in ("filter", "camera", "truth")}, None),
    ({f"{e}{ms}": {"estimator": e, "latency": {"kind": "constant", "ms": ms}}
      for e in ("filter", "camera") for ms in (0.0, 50.0, 200.0)}, "latency.ms"),
    ({f"{e}{ms}": {"estimator": e, "prior": e == "filter", "latency": {"kind": "constant", "ms": ms}}
      for e in ("filter", "camera") for ms in (0.0, 50.0, 200.0)}, None),
    ({str(k): {"corridor_m": 0.1 * k, "time_limit_s": 1.0 * k} for k in range(3)}, None),
    ({"": LATENCY}, None),
])  # fmt: skip
def test_loops_are_swept_where_one_number_alone_differs(tables, key):
    found = swept_loops(tables)
    assert (found and found.key) == key
    if found:
        assert list(dict.fromkeys(found.values.values())) == [0.0, 50.0, 200.0]
        assert set(found.estimators.values()) == ({""} if len(tables) == 3 else {"filter", "camera"})


def test_each_estimator_has_a_curve_of_its_own_along_what_both_sweep(tmp_path):
    loops = {f"{e}-{ms}": (e, ms) for e in ("filter", "camera") for ms in (0, 50, 200)}
    tables = {name: {"estimator": e, "latency": {"ms": float(ms)}} for name, (e, ms) in loops.items()}
    fates = {name: "++-" if name == "camera-200" else "+++" for name in loops}
    scores = [s for loop, fate in fates.items() for s in flights(f"a@15hz+{loop}", fate)]
    with house_style():
        along_loops(scores, swept_loops(tables), tmp_path / "along")
    rows = [row.split(",")[:4] for row in (tmp_path / "along.csv").read_text().splitlines()[1:]]
    expected = [[f"a@15hz {e}", str(ms), "3", "2" if (e, ms) == ("camera", 200) else "3"] for e, ms in loops.values()]
    assert rows == expected


def test_figures_over_flights_are_the_same_twice(tmp_path):
    tables = {f"{ms}ms": {"latency": {"ms": float(ms)}} for ms in (0, 50, 200)}
    fates = {"0ms": "++++", "50ms": "+++-", "200ms": "----"}
    scores = [s for loop, fate in fates.items() for s in flights(f"a@15hz+{loop}", fate)]
    with house_style():
        for name in ("one", "two"):
            success_of_runs(scores, tmp_path / name / "success")
            along_loops(scores, swept_loops(tables), tmp_path / name / "along")
    for path in sorted((tmp_path / "one").iterdir()):
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    rows = (tmp_path / "one" / "along.csv").read_text().splitlines()
    assert rows[0] == "run,latency.ms,flights,successes,low,high,path_rms_cm"
    assert [row.split(",")[:4] for row in rows[1:]] == [
        ["a@15hz", "0", "4", "4"], ["a@15hz", "50", "4", "3"], ["a@15hz", "200", "4", "0"]
    ]  # fmt: skip
