"""Rows of external trackers: what is right is read exactly, what is wrong has a name."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavbench.bench.external.rows import FAULTS, POSE_HEADER, TrackerFault, read_estimates, read_row
from uavbench.tracker.results import COVARIANCE_COLUMNS

POSE = "0.1,-0.2,3.5,0.5,0.5,-0.5,0.5"
STAMPS = [0, 100, 200, 300]


def fault_of(text):
    with pytest.raises(TrackerFault) as caught:
        read_row(text, "frame 0")
    assert FAULTS[caught.value.fault.name] in str(caught.value)
    return caught.value.fault.name


@pytest.mark.parametrize(("length", "told"), [(60, "x" * 60), (61, "x" * 57 + "..."), (3000, "x" * 57 + "...")])
def test_of_a_long_row_the_beginning_is_told(length, told):
    with pytest.raises(TrackerFault, match=f"'{told}' does not begin with an integer stamp"):
        read_row("x" * length, "frame 0")


def test_a_pose_is_read_exactly():
    stamp, result = read_row(f"100,ok,{POSE}\n", "frame 0")
    assert (stamp, result.status, result.covariance) == (100, "ok", None)
    np.testing.assert_allclose(result.cam_from_world.translation, [0.1, -0.2, 3.5], rtol=0, atol=0)
    np.testing.assert_allclose(result.cam_from_world.quaternion_wxyz, [0.5, 0.5, -0.5, 0.5], atol=1e-15)


@pytest.mark.parametrize("stamp_ns", [-(2**63), 2**63 - 1])
def test_stamps_of_64_bits_are_read(stamp_ns):
    assert read_row(f"{stamp_ns},lost", "frame 0")[0] == stamp_ns


def test_a_covariance_is_the_upper_triangle_by_rows():
    upper = np.eye(6)[np.triu_indices(6)]
    upper[1] = 0.5
    _, result = read_row(f"100,ok,{POSE}," + ",".join(map(str, upper)), "frame 0")
    assert result.covariance[0, 1] == result.covariance[1, 0] == 0.5
    assert np.trace(result.covariance) == 6


@pytest.mark.parametrize(
    "text", ["100,lost", "100,lost,,,,,,,", "100,not_initialized", "100,ambiguous", " 100 , lost "]
)
def test_a_frame_without_a_pose_needs_no_numbers(text):
    stamp, result = read_row(text, "frame 0")
    assert stamp == 100
    assert result.cam_from_world is None


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "malformed"),
        (f"1_00,ok,{POSE}", "malformed"),
        ("1_00,lost", "malformed"),
        (f"100,ok,{POSE.replace('3.5', '3_5')}", "malformed"),
        ("hello", "malformed"),
        ("1.5,ok," + POSE, "malformed"),
        ("1" * 21 + ",ok," + POSE, "malformed"),
        ("100", "malformed"),
        ("100,fine," + POSE, "malformed"),
        ("100,ok", "malformed"),
        ("100,ok,1,2,3,1,0,0", "malformed"),
        ("100,ok," + POSE + ",1", "malformed"),
        ("100,ok,a,2,3,1,0,0,0", "malformed"),
        ("100,lost," + POSE, "malformed"),
        ("100,ok,nan,2,3,1,0,0,0", "not-finite"),
        ("100,ok,inf,2,3,1,0,0,0", "not-finite"),
        ("100,ok,1,2,3,0,0,0,0", "bad-rotation"),
        ("100,ok,1,2,3,2,0,0,0", "bad-rotation"),
        ("100,ok," + POSE + ",-1" + ",0" * 20, "bad-covariance"),
    ],
)
def test_each_wrong_row_has_a_named_fault(text, fault):
    assert fault_of(text) == fault


@given(st.text(max_size=200))
def test_any_text_is_a_row_or_a_named_fault(text):
    try:
        read_row(text, "frame 0")
    except TrackerFault as error:
        assert error.fault.name in FAULTS


def estimates(tmp_path, *rows, header=POSE_HEADER):
    path = tmp_path / "estimates.csv"
    path.write_text("\n".join([",".join(header), *rows]) + "\n")
    results, faults = read_estimates(path, STAMPS)
    assert len(results) == len(STAMPS)
    return [r.status for r in results], [f.name for f in faults]


def rows(*stamps):
    return [f"{stamp},ok,{POSE}" for stamp in stamps]


def test_a_whole_file_has_no_fault(tmp_path):
    assert estimates(tmp_path, *rows(*STAMPS)) == (["ok"] * 4, [])
    blank = "," * len(COVARIANCE_COLUMNS)
    wide = [*POSE_HEADER, *COVARIANCE_COLUMNS]
    assert estimates(tmp_path, *(r + blank for r in rows(*STAMPS)), header=wide) == (["ok"] * 4, [])


def test_missing_duplicate_unknown_and_disordered_rows(tmp_path):
    assert estimates(tmp_path, *rows(0, 100, 300)) == (["ok", "ok", "lost", "ok"], ["missing"])
    assert estimates(tmp_path, *rows(0, 100, 100, 200, 300)) == (["ok"] * 4, ["duplicate"])
    assert estimates(tmp_path, *rows(0, 100, 150, 200, 300)) == (["ok"] * 4, ["unknown-stamp"])
    assert estimates(tmp_path, *rows(0, 200, 100, 300)) == (["ok"] * 4, ["out-of-order"])


def test_all_faults_are_told_and_cost_their_frames_only(tmp_path):
    told = estimates(tmp_path, "0,ok,nan,0,0,1,0,0,0", *rows(100, 100, 50), "200,lost")
    assert told == (["lost", "ok", "lost", "lost"], ["not-finite", "duplicate", "unknown-stamp", "missing"])


def test_a_file_that_is_absent_binary_or_a_link(tmp_path):
    path = tmp_path / "estimates.csv"
    assert [f.name for f in read_estimates(path, STAMPS)[1]] == ["no-output"]
    path.write_bytes(b"\xff\xfe\x00")
    assert [f.name for f in read_estimates(path, STAMPS)[1]] == ["malformed"]
    path.write_text("stamp,x\n")
    assert [f.name for f in read_estimates(path, STAMPS)[1]] == ["malformed"]
    path.unlink()
    path.symlink_to("/etc/hostname")
    assert [f.name for f in read_estimates(path, STAMPS)[1]] == ["no-output"]


def test_a_flood_of_rows_is_refused_by_its_size_and_faults_are_counted(tmp_path, monkeypatch):
    path = tmp_path / "estimates.csv"
    path.write_text(",".join(POSE_HEADER) + "\n" + "x\n" * 2_000_000)
    results, faults = read_estimates(path, [0, 1000])
    assert len(results) == 2 and len(faults) == 1 and "write one row for each frame" in str(faults[0])
    path.write_text(",".join(POSE_HEADER) + "\n" + "x\n" * 50 + "1000,ok,1,2,3,1,0,0,0\n2000,ok,1e155,0,0,1,0,0,0\n")
    monkeypatch.setattr("uavbench.bench.external.rows.MOST_FAULTS", 10)
    results, faults = read_estimates(path, [0, 1000, 2000])
    assert [row.status for row in results] == ["lost", "ok", "lost"]
    assert len(faults) == 11 and faults[-1].name == "too-many" and "42 more faults" in str(faults[-1])


def test_a_stamp_with_an_underscore_is_no_row_of_its_frame(tmp_path):
    """Python reads 1_00 as 100."""
    rows = [f"{stamp},ok,{POSE}" for stamp in ("0", "1_00", "200", "300")]
    (tmp_path / "estimates.csv").write_text("\n".join([",".join(POSE_HEADER), *rows]) + "\n")
    results, faults = read_estimates(tmp_path / "estimates.csv", STAMPS)
    assert [result.status for result in results] == ["ok", "lost", "ok", "ok"]
    assert [(fault.name, fault.where) for fault in faults] == [("malformed", "estimates.csv line 3")]
