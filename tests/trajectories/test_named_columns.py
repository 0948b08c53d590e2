"""Comments that name the columns of a trajectory file: an order that is not the format's is an error, not ignored."""

from pathlib import Path

import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory_files.formats import read_trajectory

TUM = "".join(f"{k}.5 1 2 3 0 0 0 1\n" for k in range(3))
EUROC = "".join(f"{k}403636579763555584,1,2,3,1,0,0,0\n" for k in range(1, 4))
EUROC_NAMES = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"


@pytest.mark.parametrize(
    "text",
    [
        f"# timestamp tx ty tz qx qy qz qw\n{TUM}",
        f"# timestamp_s tx_m ty_m tz_m qx qy qz qw\n{TUM}",
        f"# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13\n{TUM}",
        f"# ground truth trajectory\n# file: 'rgbd_dataset_freiburg1_xyz.bag'\n# timestamp tx ty tz qx qy qz qw\n{TUM}",
        f"# x is forward, y left, z up; no order of q\n{TUM}",
        TUM,
        f"{EUROC_NAMES}\n{EUROC}",
        f"{EUROC_NAMES}, v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]\n{EUROC}",
        f"#timestamp,px,py,pz,qw,qx,qy,qz\n{EUROC}",
    ],
)
def test_columns_in_the_order_of_the_format_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.txt").write_text(text)
    assert len(read_trajectory(tmp_path / "a.txt").trajectory) == 3


@pytest.mark.parametrize(
    ("text", "named", "format"),
    [
        (f"# timestamp tx ty tz qw qx qy qz\n{TUM}", "x y z qw qx qy qz", "tum"),
        (f"# t, z, y, x, qx, qy, qz, qw\n{TUM}", "z y x qx qy qz qw", "tum"),
        (EUROC_NAMES.replace("q_RS_w [], ", "") + f", q_RS_w []\n{EUROC}", "x y z qx qy qz qw", "euroc"),
        (EUROC_NAMES.replace("R_x", "R_?").replace("R_z", "R_x").replace("R_?", "R_z") + f"\n{EUROC}",
         "z y x qw qx qy qz", "euroc"),
    ],
)  # fmt: skip
def test_columns_in_another_order_are_an_error(tmp_path: Path, text: str, named: str, format: str) -> None:
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(UserError, match=f"a.txt: its comment names the columns {named}, but in the format {format} "):
        read_trajectory(tmp_path / "a.txt")


def test_columns_of_euroc_with_seconds_are_told_to_have_nanoseconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"{EUROC_NAMES}\n" + "".join(f"1403636579.{k}5,1,2,3,1,0,0,0\n" for k in range(3)))
    with pytest.raises(UserError, match=r"; or, if it is euroc, write its stamps in integer nanoseconds$"):
        read_trajectory(tmp_path / "a.csv")
    with pytest.raises(UserError, match=r"have decimals and step by 0\.1, and those of euroc are integer nanoseconds"):
        read_trajectory(tmp_path / "a.csv", "euroc")


@pytest.mark.parametrize("written", ["{:.18e}", "{:.1f}", "{:g}"])
def test_nanoseconds_as_other_programs_write_whole_numbers_are_those_of_euroc(tmp_path: Path, written: str) -> None:
    stamps_ns = [50_000_000 * k for k in range(3)]
    rows = "".join(f"{written.format(float(ns))},1,2,3,1,0,0,0\n" for ns in stamps_ns)
    (tmp_path / "a.csv").write_text(f"{EUROC_NAMES}\n{rows}")
    read = read_trajectory(tmp_path / "a.csv")
    assert (read.format, read.trajectory.stamps_ns.tolist()) == ("euroc", stamps_ns)
