from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given, settings
from hypothesis import strategies as st

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import (
    READERS,
    WRITERS,
    declared_frame,
    guess_format,
    read_covariant_tum,
    read_kitti,
    read_trajectory,
    read_tum,
    write_euroc,
    write_tum,
)


def some(n: int = 20, seed: int = 0, start_ns: int = 1_403_636_580_838_555_574) -> Trajectory:
    rng = np.random.default_rng(seed)
    q = rng.standard_normal((n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return Trajectory(start_ns + np.cumsum(rng.integers(1, 10**8, n)), rng.standard_normal((n, 3)), q)


@pytest.mark.parametrize("name", list(WRITERS))
def test_written_files_read_back_and_are_guessed(name: str, tmp_path: Path) -> None:
    flown = some()
    WRITERS[name](flown, tmp_path / "t.txt")
    read, guessed = read_trajectory(tmp_path / "t.txt")
    assert guessed == name
    np.testing.assert_array_equal(read.positions_m, flown.positions_m)
    if name != "kitti":
        np.testing.assert_array_equal(read.stamps_ns, flown.stamps_ns)
        np.testing.assert_array_equal(read.quaternions_wxyz, flown.quaternions_wxyz)
    np.testing.assert_allclose(read.rotations, flown.rotations, atol=1e-15)


@pytest.mark.parametrize("start_ns", [0, 5, 10**9, 1_403_636_580_838_555_574])
@pytest.mark.parametrize("name", list(WRITERS))
def test_the_format_is_guessed_whatever_the_first_stamp(name: str, start_ns: int, tmp_path: Path) -> None:
    flown = some(start_ns=0)
    stamps = flown.stamps_ns - flown.stamps_ns[0] + start_ns
    WRITERS[name](Trajectory(stamps, flown.positions_m, flown.quaternions_wxyz), tmp_path / "t")
    assert read_trajectory(tmp_path / "t")[1] == name


def test_whole_seconds_are_no_nanoseconds(tmp_path: Path) -> None:
    (tmp_path / "t").write_text("".join(f"{1403636580 + 5 * k} 0 0 0 0 0 0 1\n" for k in range(5)))
    assert read_trajectory(tmp_path / "t")[1] == "tum"


def test_a_file_says_its_frame_by_comment_or_name(tmp_path: Path) -> None:
    write_tum(some(), tmp_path / "a.tum", "world_from_cam")
    write_tum(some(), tmp_path / "b_world_from_body.tum")
    write_tum(some(), tmp_path / "c.tum")
    write_tum(some(), tmp_path / "d_world_from_body.tum", "world_from_cam")
    said = [declared_frame(tmp_path / name) for name in ("a.tum", "b_world_from_body.tum", "c.tum")]
    assert said == ["world_from_cam", "world_from_body", None]
    assert len(read_tum(tmp_path / "a.tum")) == 20
    assert len(file_interface.read_tum_trajectory_file(str(tmp_path / "a.tum")).timestamps) == 20
    with pytest.raises(UserError, match="declares world_from_cam and world_from_body"):
        declared_frame(tmp_path / "d_world_from_body.tum")


@pytest.mark.parametrize(
    "comment",
    [
        "# Frame: world_from_cam",
        "# FRAME: World_From_Cam",
        "#frame:world-from-cam",
        "# frame : world from camera",
        "## frame = `world_from_cam`  ",
        "# by a person\r\n\t# frame:\tworld_from_cam\r",
    ],
)
def test_a_frame_is_declared_in_any_spelling(comment: str, tmp_path: Path) -> None:
    """Those with capitals or blanks had been no declaration, so poses of the camera were compared as the body's."""
    (tmp_path / "t.tum").write_text(f"{comment}\n0 0 0 0 0 0 0 1\n", newline="")
    assert declared_frame(tmp_path / "t.tum") == "world_from_cam"
    (tmp_path / "t.tum").write_text("# frame: map from base_link2\n0 0 0 0 0 0 0 1\n")
    assert declared_frame(tmp_path / "t.tum") == "map_from_base_link2"
    (tmp_path / "T_World_From_Body.tum").write_text("0 0 0 0 0 0 0 1\n")
    assert declared_frame(tmp_path / "T_World_From_Body.tum") == "world_from_body"


@pytest.mark.parametrize(
    "frame", ["body", "Camera", "world_to_cam", "T_WC", "world_from_cam, world_from_body", "to " + "x" * 500]
)
def test_a_declared_frame_that_is_none_is_told(frame: str, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(f"# frame: {frame}\n0 0 0 0 0 0 0 1\n")
    with pytest.raises(UserError, match=rf"t.tum: its comment declares the frame '{frame[:40]}', .* write `# frame: "):
        declared_frame(tmp_path / "t.tum")


@pytest.mark.parametrize("frame", ["", "map", "/odom", "ENU", "0", "WGS84 (EPSG:4326)", "bodytotal"])
def test_a_fixed_frame_alone_is_no_declaration(frame: str, tmp_path: Path) -> None:
    """Files of other programs had been refused for it."""
    (tmp_path / "t.tum").write_text(f"# frame: {frame}\n0 0 0 0 0 0 0 1\n")
    assert declared_frame(tmp_path / "t.tum") is None


@pytest.mark.parametrize("comment", ["# frames: 12", "# reference frame: map", "# time frame x", "#timestamp [ns], x"])
def test_other_comments_declare_no_frame(comment: str, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(f"{comment}\n0 0 0 0 0 0 0 1\n")
    assert declared_frame(tmp_path / "t.tum") is None


@settings(max_examples=60)
@given(ns=st.integers(min_value=-(10**18), max_value=4 * 10**18))
def test_any_nanosecond_survives_a_tum_file(ns: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("tum") / "t.tum"
    write_tum(Trajectory(np.array([ns]), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])), path)
    assert read_tum(path).stamps_ns.tolist() == [ns]


def test_stamps_are_parsed_exactly_where_floats_would_not_be(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(
        "# a comment\n\n1403636580.838555574 0 0 0 0 0 0 1\n"
        "1.403636580838555575e9 0 0 0 0 0 0 1\n1403636581 0 0 0 0 0 0 1\n"
    )
    assert read_tum(path).stamps_ns.tolist() == [1403636580838555574, 1403636580838555575, 1403636581000000000]


def test_evo_reads_what_we_write_and_we_read_what_it_writes(tmp_path: Path) -> None:
    flown = some()
    for name, reader in (
        ("tum", file_interface.read_tum_trajectory_file),
        ("euroc", file_interface.read_euroc_csv_trajectory),
        ("kitti", file_interface.read_kitti_poses_file),
    ):
        path = tmp_path / f"t.{name}"
        if name == "euroc":
            write_euroc(flown, path, motion=np.zeros((len(flown), 9)))
        else:
            WRITERS[name](flown, path)
        theirs = reader(str(path))
        np.testing.assert_allclose(theirs.positions_xyz, flown.positions_m, rtol=0, atol=1e-15)
        signs = np.sign(np.sum(theirs.orientations_quat_wxyz * flown.quaternions_wxyz, axis=1, keepdims=True))
        np.testing.assert_allclose(theirs.orientations_quat_wxyz * signs, flown.quaternions_wxyz, rtol=0, atol=1e-12)
    again = tmp_path / "again.tum"
    file_interface.write_tum_trajectory_file(
        str(again), file_interface.read_tum_trajectory_file(str(tmp_path / "t.tum"))
    )
    np.testing.assert_allclose(read_tum(again).positions_m, flown.positions_m, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "holds no pose"),
        ("1 0 0 0 0 0 1\n", "line 1 has 7 values"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2: its time stamp is not later than"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2: .* but the same; leave one of the two lines out"),
        ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2: its time stamp is not later than the previous one; sort"),
        ("#x\n1 0 0 nan 0 0 0 1\n", "line 2: its position is not finite"),
        ("1 0 0 0 0 0 0 2\n", "line 1: its quaternion is not of unit norm"),
        ("1 0 0 0 0 0 0 x\n", "line 1: could not convert"),
        ("one 0 0 0 0 0 0 1\n", "line 1: 'one' is not a time stamp"),
        ("t,tx,ty,tz,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n", "'t' is not a time stamp; put # before a line of names"),
        ("0 1_0 0 0 0 0 0 1\n", "line 1: could not convert string to float: '1_0'"),
        ("0 0 0 0 0 0 0 1\n1_0 0 0 0 0 0 0 1\n", "line 2: '1_0' is not a time stamp"),
        ("1e99 0 0 0 0 0 0 1\n", "does not fit"),
        ("nan 0 0 0 0 0 0 1\n", "is not a time stamp"),
        ("1 0 0 0 0 0 0 1\n2 0 0\n", "line 2 has 3 values, expected 8"),
    ],
)
def test_a_bad_file_is_named_with_its_line(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(UserError, match=r"bad\.tum: .*" + told):
        read_trajectory(path, None if "7 values" in told else "tum")


def test_missing_files_binary_files_and_unknown_formats(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        read_trajectory(tmp_path / "none.tum")
    (tmp_path / "image").write_bytes(bytes(range(256)))
    with pytest.raises(UserError, match="not readable as text"):
        read_trajectory(tmp_path / "image")
    write_tum(some(), tmp_path / "a.tum")
    with pytest.raises(UserError, match="did you mean 'tum'"):
        read_trajectory(tmp_path / "a.tum", "tumm")
    (tmp_path / "k").write_text("1 0 0 0 0 2 0 0 0 0 1 0\n")
    with pytest.raises(UserError, match="line 1: its first three columns are not a rotation"):
        read_kitti(tmp_path / "k")
    assert set(READERS) == set(WRITERS)


@pytest.mark.parametrize(("columns", "more"), [
    (0, ""), (3, ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"),
    (9, ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
        "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"),
])  # fmt: skip
def test_the_head_of_a_euroc_file_names_each_column(columns: int, more: str, tmp_path: Path) -> None:
    flown, motion = some(3), np.arange(3.0 * columns).reshape(3, columns)
    write_euroc(flown, tmp_path / "t.csv", motion if columns else None)
    head, *rows = (tmp_path / "t.csv").read_text().splitlines()
    pose = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    assert head == f"#timestamp [ns], {pose}{more}"
    values = np.array([row.split(",") for row in rows], dtype=float)[:, 1:]
    np.testing.assert_array_equal(values, np.hstack([flown.positions_m, flown.quaternions_wxyz, motion]))
    read, guessed = read_trajectory(tmp_path / "t.csv")
    assert guessed == "euroc"
    np.testing.assert_array_equal(read.positions_m, flown.positions_m)
    np.testing.assert_array_equal(read.quaternions_wxyz, flown.quaternions_wxyz)


@pytest.mark.parametrize(("rate_hz", "stamps"), [(10.0, [0, 10**8, 2 * 10**8]), (3.0, [0, 333333333, 666666667])])
def test_rows_of_kitti_are_a_period_apart(rate_hz: float, stamps: list[int], tmp_path: Path) -> None:
    WRITERS["kitti"](some(3), tmp_path / "k")
    assert read_kitti(tmp_path / "k", rate_hz).stamps_ns.tolist() == stamps
    assert rate_hz != 10.0 or read_kitti(tmp_path / "k").stamps_ns.tolist() == stamps


@pytest.mark.parametrize(("scale", "held"), [(1.0, True), (1 + 4e-4, True), (1 - 4e-4, True), (1 + 6e-4, False)])
def test_a_rotation_of_kitti_is_one_to_a_thousandth(scale: float, held: bool, tmp_path: Path) -> None:
    rows = [[1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7], [scale, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7]]
    (tmp_path / "k").write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
    if held:
        np.testing.assert_allclose(read_kitti(tmp_path / "k").positions_m, [[5, 6, 7]] * 2)
        return
    with pytest.raises(UserError, match="line 2: its first three columns are not a rotation"):
        read_kitti(tmp_path / "k")


def test_a_mirrored_matrix_is_no_rotation(tmp_path: Path) -> None:
    (tmp_path / "k").write_text("1 0 0 0 0 1 0 0 0 0 -1 0\n")
    with pytest.raises(UserError, match="not a rotation"):
        read_kitti(tmp_path / "k")


@pytest.mark.parametrize(("lines", "format"), [
    (["100000000000 0 0 0 1 0 0 0"], "euroc"), (["10000000000 0 0 0 1 0 0 0"], "tum"),
    (["0 0 0 0 1 0 0 0", "1000 0 0 0 1 0 0 0"], "euroc"), (["0 0 0 0 1 0 0 0", "999 0 0 0 1 0 0 0"], "tum"),
    (["0 0 0 0 1 0 0 0", "1000.5 0 0 0 1 0 0 0"], "tum"), (["-5 0 0 0 1 0 0 0", "+5000 0 0 0 1 0 0 0"], "euroc"),
    (["1,0,0,0,1,0,0,0,0,0,0,0", "5000000,0,0,0,1,0,0,0,0,0,0,0"], "euroc"), (["1 0 0 0 0 1 0 0 0 0 1 0"], "kitti"),
    (["1,0,0,0,0,1,0,0,0,0,1,0", "1,0,0,5000,0,1,0,0,0,0,1,0"], "kitti"),
    ([" ".join("0" * 29)], "tum"), ([" ".join("0" * 44)], "tum"), ([" ".join("0" * 30)], None), (["1 2 3"], None),
])  # fmt: skip
def test_formats_are_told_by_their_first_lines(lines: list[str], format: str | None, tmp_path: Path) -> None:
    (tmp_path / "t").write_text("\n".join(lines) + "\n")
    if format is not None:
        assert guess_format(tmp_path / "t") == format
        return
    with pytest.raises(UserError, match=r"line 1 has \d+ values, so it is neither"):
        guess_format(tmp_path / "t")


@pytest.mark.parametrize("covariant", [29, 44])
def test_covariances_behind_the_poses_of_a_tum_file_are_read(covariant: int, tmp_path: Path) -> None:
    P = np.arange(36.0).reshape(6, 6)
    P = P + P.T
    claimed = P[np.triu_indices(6)] if covariant == 29 else P.ravel()
    (tmp_path / "t").write_text(f"1 2 3 4 0 0 0 1 {' '.join(map(repr, claimed.tolist()))}\n")
    found = read_covariant_tum(tmp_path / "t")
    assert found.covariances is not None and found.covariances.axes == "fixed"
    np.testing.assert_array_equal(found.covariances.values[0], P)
    write_tum(some(), tmp_path / "bare")
    assert read_covariant_tum(tmp_path / "bare").covariances is None


@pytest.mark.parametrize(("row", "told"), [
    ("2 1.1e12 0 0 0 0 0 1", "line 2: its position is beyond"),
    ("2 0 -1.1e12 0 0 0 0 1", "line 2: its position is beyond"),
    ("2 0 0 0 0 0 0 1.002", "line 2: its quaternion"), ("2 0 0 0 0 0 0 0.998", "line 2: its quaternion"),
    ("1 0 0 0 0 0 0 1", "line 2: its time stamp"), ("2 1e12 -1e12 0 0 0 0 1.0009", ""),
])  # fmt: skip
def test_limits_of_a_pose_in_a_file(row: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "t").write_text(f"1 0 0 0 0 0 0 1\n{row}\n")
    if not told:
        assert len(read_tum(tmp_path / "t")) == 2
        return
    with pytest.raises(UserError, match=told):
        read_tum(tmp_path / "t")


@pytest.mark.parametrize("sign", ["#", "%", "//"])
def test_comments_of_other_programs_are_comments_and_say_the_same(tmp_path: Path, sign: str) -> None:
    write_tum(some(), tmp_path / "plain.tum")
    text = (tmp_path / "plain.tum").read_text()
    path = tmp_path / "t.tum"
    path.write_text(f"{sign} frame: world_from_body\n{sign}timestamp tx ty tz qx qy qz qw\n{text}  {sign} the end\n")
    read, guessed = read_trajectory(path)
    assert (guessed, declared_frame(path)) == ("tum", "world_from_body")
    np.testing.assert_array_equal(read.positions_m, some().positions_m)
    path.write_text(f"{sign} timestamp tx ty tz qw qx qy qz\n{text}")
    with pytest.raises(UserError, match="names the columns"):
        read_trajectory(path)


def test_poses_of_openvins_are_read_without_their_covariances(tmp_path: Path) -> None:
    write_tum(some(), tmp_path / "plain.tum")
    lines = (tmp_path / "plain.tum").read_text().splitlines()
    head = "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33 Pt11 Pt12 Pt13 Pt22 Pt23 Pt33\n"
    path = tmp_path / "state_estimate.txt"
    path.write_text(head + "".join(f"{line} {'0.1 0 0 0.1 0 0.1 ' * 2}\n" for line in lines))
    assert guess_format(path) == "tum"
    found = read_covariant_tum(path)
    assert found.covariances is None
    np.testing.assert_array_equal(found.trajectory.quaternions_wxyz, some().quaternions_wxyz)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (7, "without its time"),
        (9, "Leave out the one"),
        (13, "index first"),
        (16, "last row"),
        (17, "Write nanoseconds"),
        (10, "images.txt of COLMAP"),
        (11, "euroc .8 or more, integer nanoseconds first.$"),
    ],
)
def test_other_numbers_of_values_are_told_with_what_to_do(tmp_path: Path, values: int, told: str) -> None:
    (tmp_path / "t.txt").write_text(f"{' '.join(['0.5'] * values)}\n")
    with pytest.raises(UserError, match=f"line 1 has {values} values.*{told}"):
        guess_format(tmp_path / "t.txt")


@pytest.mark.parametrize("separator", [" ", ",", ", ", "\t"])
def test_rows_of_kitti_may_begin_with_their_number_counted_from_0(tmp_path: Path, separator: str) -> None:
    WRITERS["kitti"](some(), tmp_path / "plain.txt")
    rows = [line.split() for line in (tmp_path / "plain.txt").read_text().splitlines()]
    path = tmp_path / "numbered.txt"
    path.write_text(
        "# row r11 r12 ...\n" + "".join(separator.join([str(k), *row]) + "\n" for k, row in enumerate(rows))
    )
    found = read_trajectory(path)
    assert found.format == "kitti"
    plain = read_kitti(tmp_path / "plain.txt")
    np.testing.assert_array_equal(found.trajectory.positions_m, plain.positions_m)
    np.testing.assert_array_equal(found.trajectory.quaternions_wxyz, plain.quaternions_wxyz)
    np.testing.assert_array_equal(found.trajectory.stamps_ns, plain.stamps_ns)


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        (["0", "1", "3", "4"], r"line 3 begins with 3, and its pose is number 2.*move the column to a times\.txt"),
        (["0", "1", "2.5", "3"], r"line 3 begins with 2\.5"),
        (["1", "2", "3", "4"], r"line 1 has 13 values.*Move times to a times\.txt.*leave an index out"),
        (["0.0", "1.0", "2.0", "3.0"], "line 1 has 13 values"),
    ],
)
def test_another_column_before_the_poses_of_kitti_is_told(tmp_path: Path, numbers: list[str], told: str) -> None:
    (tmp_path / "k.txt").write_text("".join(f"{number} 1 0 0 5 0 1 0 6 0 0 1 7\n" for number in numbers))
    with pytest.raises(UserError, match=told):
        read_trajectory(tmp_path / "k.txt")
