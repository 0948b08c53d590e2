"""Lines of numbers: the quick way and the careful way give the same, and what is wrong is named with its line."""

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.trajectory_files import number_lines
from uavbench.trajectories.trajectory_files.formats import read_trajectory, read_tum
from uavbench.trajectories.trajectory_files.number_lines import Layout, read_lines

TUM = Layout(8, unit_ns=10**9)
ROW = "0 0 0 0 0 0 1"


def test_long_files_are_read_the_quick_way_to_the_last_digit(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    stamps = np.cumsum(rng.integers(1, 10**7, 5000)) + 1_403_636_579_763_555_584
    numbers = np.concatenate([rng.normal(size=(5000, 6)), 10 ** rng.uniform(-300, 10, (5000, 1))], axis=1)
    cells = [
        [f"{ns // 10**9}.{ns % 10**9:09d}", *map(repr, row)] for ns, row in zip(stamps, numbers.tolist(), strict=True)
    ]
    monkeypatch.setattr(number_lines, "BLOCK_BYTES", 1 << 14)
    quick = []
    plain = number_lines._plain
    monkeypatch.setattr(number_lines, "_plain", lambda *given: quick.append(found := plain(*given)) or found)
    for separator in (" ", ",", ", ", "\t"):
        path = tmp_path / "long.tum"
        path.write_text("# t x y z qx qy qz qw\n" + "\n".join(separator.join(row) for row in cells) + "\n")
        quick.clear()
        read = read_lines(path, TUM)
        assert sum(part is not None for part in quick) == len(quick) - 1 > 10  # all but the one with the comment
        np.testing.assert_array_equal(read.stamps_ns, stamps)
        np.testing.assert_array_equal(read.values[:, 1:], numbers)
        np.testing.assert_array_equal(read.numbers, np.arange(5000) + 2)


@settings(max_examples=300)
@given(
    cells=st.lists(
        st.one_of(
            st.floats(allow_nan=False, allow_infinity=False).map(repr),
            st.decimals(allow_nan=False, allow_infinity=False).map(str),
            st.text("0123456789.+-e", max_size=24),
            st.text("0123456789.", min_size=1, max_size=24),
        ),
        min_size=1,
        max_size=6,
    ),
    end=st.sampled_from(["\n", " \n", "", "\n\n"]),
    separator=st.sampled_from([" ", ",", "  ", "\t"]),
)
def test_the_quick_way_gives_what_the_careful_one_gives_or_nothing(cells, end, separator):
    layout = Layout(2, unit_ns=10**9)
    block = ("".join(f"{cell}{separator}{cell}\n" for cell in cells)[:-1] + end).encode()
    quick = number_lines._plain(block, 1, layout)
    try:
        slow = number_lines._careful(Path("a"), block, 1, layout)
    except UserError:
        assert quick is None
        return
    if quick is not None:
        for name in ("numbers", "stamps_ns", "values"):
            np.testing.assert_array_equal(getattr(quick, name), getattr(slow, name))


def test_a_byte_order_mark_is_no_part_of_the_first_line(tmp_path):
    (tmp_path / "a.tum").write_bytes(b"\xef\xbb\xbf" + f"1 {ROW}\r\n2 {ROW}\r\n".encode())
    assert read_lines(tmp_path / "a.tum", TUM).stamps_ns.tolist() == [10**9, 2 * 10**9]


def test_an_empty_cell_is_no_number(tmp_path):
    (tmp_path / "a.csv").write_text("1,,2\n" * 3)
    with pytest.raises(UserError, match="line 1 has 2 values, expected 3"):
        read_lines(tmp_path / "a.csv", Layout(3))


@pytest.mark.parametrize("blank", ["", " ", "\t"])
@pytest.mark.parametrize("place", [1, 3, 7])
def test_values_behind_an_empty_cell_do_not_move_up_into_it(tmp_path, place, blank):
    """The pose of a line that turns by 180 degrees would have stayed one with its values moved up by a column."""
    rows = [[str(10**15 + k * 10**7), "1", "2", "3", "0", "0", "0", "1", "0", "0", "0"] for k in range(9)]
    rows[5][place] = blank
    for separator in (",", ", "):
        (tmp_path / "a.csv").write_text("".join(separator.join(row) + "\n" for row in rows))
        with pytest.raises(UserError, match=rf"a\.csv: line 6: value {place + 1} is missing"):
            read_trajectory(tmp_path / "a.csv", "euroc")
    rows[5] = [*rows[4][:1], *rows[4][1:8], "", blank, ""]
    rows[5][0] = str(10**15 + 5 * 10**7)
    (tmp_path / "a.csv").write_text("".join(",".join(row) + "\n" for row in rows))  # columns that are not read
    assert read_trajectory(tmp_path / "a.csv").trajectory.positions_m.tolist() == [[1.0, 2.0, 3.0]] * 9


def test_an_empty_first_cell_is_told_in_a_file_without_stamps(tmp_path):
    row = "1,0,0,0,0,1,0,0,0,0,1,0"
    for bad in (f",{row}", f" , {row}"):
        (tmp_path / "a.txt").write_text(f"{row}\n{bad}\n{row}\n")
        with pytest.raises(UserError, match="line 2: value 1 is missing"):
            read_trajectory(tmp_path / "a.txt", "kitti")


@pytest.mark.parametrize("bad", ["x", "nan nan", "1e999"])
def test_the_line_is_named_deep_in_a_long_file(tmp_path, bad):
    lines = [f"{k} {ROW}" for k in range(100_000)]
    lines[98_765] = f"98765 {bad} {ROW[4:]}" if bad == "nan nan" else f"98765 {bad} {ROW[2:]}"
    (tmp_path / "a.tum").write_text("\n".join(lines))
    with pytest.raises(UserError, match="line 98766"):
        read_trajectory(tmp_path / "a.tum")


@pytest.mark.parametrize(
    "stamp",
    [
        "1e999990", "1e999999", "-1e999999", "1" * 5000, "1e20", "9223372036.854775808", "-9223372036.854775809",
        "9" * 20, f"{-(2**63) - 1}",
    ],
)  # fmt: skip
@pytest.mark.parametrize("format", ["tum", "euroc"])
def test_stamps_beyond_64_bits_are_told_before_they_are_written_out(tmp_path, stamp, format):
    if Decimal(stamp).adjusted() < 18 and format == "euroc":
        pytest.skip("fits as nanoseconds")
    (tmp_path / "a.txt").write_text(f"{stamp} {ROW}\n")
    with pytest.raises(UserError, match=r"line 1: the time stamp .* does not fit into 64-bit .*is it in the unit"):
        read_trajectory(tmp_path / "a.txt", format)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("metres", ["1e308", "-1e155", "1.1e12"])
def test_positions_beyond_the_limit_are_named_with_their_line(tmp_path, place, metres):
    position = ["0", "0", "0"]
    position[place] = metres
    (tmp_path / "a.tum").write_text(f"1 {ROW}\n2 {' '.join(position)} 0 0 0 1\n")
    with pytest.raises(UserError, match=r"a\.tum: line 2: its position is beyond 1e\+12 m"):
        read_tum(tmp_path / "a.tum")


def test_an_endless_line_and_too_many_poses_are_told(tmp_path, monkeypatch):
    (tmp_path / "a.tum").write_text(f"1 {ROW}\n" + "1" * 200_000)
    with pytest.raises(UserError, match="line 2 is longer than 16,384 bytes"):
        read_tum(tmp_path / "a.tum")
    monkeypatch.setattr(number_lines, "MOST_POSES", 9)
    (tmp_path / "b.tum").write_text("".join(f"{k} {ROW}\n" for k in range(10)))
    with pytest.raises(UserError, match="more than 9 poses"):
        read_tum(tmp_path / "b.tum")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("0,5 1,25 2,0 3,0 0,0 0,0 0,0 1,0", "line 2 has decimal commas; write decimal points"),
        ("0 1,25 2 3 0 0 0 1", "line 2 has decimal commas"),
        ("0,5;1,25;2,0;3,0;0,0;0,0;0,0;1,0", "line 2 has decimal commas"),
        ("0,5\t1,25\t2,0\t-3,0", "line 2 has decimal commas"),
        ("1403636579758555392\t4,68\t-1,78\t0,78\t0,53\t-0,15\t-0,82\t-0,08", "line 2 has decimal commas"),
        ("0.5; 1.25; 2; 3; 0; 0; 0; 1", "'0.5;' is not a time stamp; separate values by spaces or commas, not by semi"),
    ],
)
def test_decimal_commas_and_semicolons_are_told_as_such(tmp_path, line, told):
    (tmp_path / "a.txt").write_text(f"# by a spreadsheet\n{line}\n")
    with pytest.raises(UserError, match=told):
        read_trajectory(tmp_path / "a.txt")
    with pytest.raises(UserError, match=told):
        read_trajectory(tmp_path / "a.txt", "tum")
