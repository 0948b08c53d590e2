"""CSV tables as users' programs write them are read, or refused by file, line, column and what to do."""

import numpy as np
import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files import tables
from uavbench.trajectories.files.tables import (
    column_names,
    integers,
    line_of_row,
    named_rows,
    numbers,
    readings,
    table_rows,
)

COLUMNS = ["px_m", "py_m"]
PLAIN = "stamp_ns,px_m,py_m\n10,1.5,-2\n20,2.5,-3\n"


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        "\ufeff" + PLAIN,
        PLAIN.replace(",", ", "),
        PLAIN.replace(",", '","').replace("\n", '"\n"')[:-1].replace("stamp", '"stamp', 1),
        "# frame: world_from_body\n\n" + PLAIN.replace("\n20", "\n# in between\n\n,,\n20").replace(",,\n", ""),
        "py_m,stamp_ns,note,px_m\n-2,10,a,1.5\n-3,20,b,2.5\n",
        PLAIN[:-1],
        PLAIN.replace("\n20", '\n,,\n "# quoted",,\n20'),
        PLAIN.replace(",", '", "').replace("\n", '"\n"')[:-1].replace("stamp", '"stamp', 1),
        '# "a, 5" pipe, "open\n' + PLAIN.replace("\n20", '\n# and, "here\n"# cm, m"\n20'),
        PLAIN.replace("stamp_ns", "stamp_ns,note").replace("\n10", '\n10,5" pipe').replace("\n20", '\n20,"a ""b"""'),
    ],
    ids=[
        *("plain", "Windows", "old Mac", "mark", "spaces", "quotes", "comments", "other order", "no last end"),
        *("blank cells", "spaced quotes", "quotes in comments", "quotes in notes"),
    ],
)
def test_dialects_of_one_table_are_read_alike(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode())
    assert numbers(path, COLUMNS).tolist() == [[1.5, -2.0], [2.5, -3.0]]
    assert {"stamp_ns", *COLUMNS} <= set(column_names(path))
    assert [row["px_m"].strip() for row in named_rows(path, COLUMNS)] == ["1.5", "2.5"]
    assert integers(path, ["stamp_ns"]).tolist() == [[10], [20]]
    assert integers(path, ["stamp_ns"]).dtype == np.int64


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (PLAIN.replace(",", ";"), "missing columns px_m, py_m; its columns are separated by semicolons: write commas"),
        (PLAIN.replace(",", "\t"), "its columns are separated by tabs"),
        (PLAIN.replace("px_m", "x"), "missing columns px_m$"),
        ("", "missing columns px_m, py_m$"),
        (PLAIN.replace("stamp_ns", "px_m"), "has the column px_m 2 times"),
        (PLAIN.replace("2.5", "2,5"), "line 3 has 4 values, not 3; write numbers with a decimal point"),
        (PLAIN.replace(",-3", ""), "line 3 has 2 values, not 3$"),
        (PLAIN.replace(",-3", ",-3,"), "line 3 has 4 values, not 3; remove commas at its end"),
        (PLAIN.replace("2.5", ""), "line 3: px_m is empty; leave the line out"),
        (PLAIN.replace("2.5", "2.5 m"), "line 3: px_m = '2.5 m' is not a number"),
        (PLAIN.replace("-3", "1_5"), "line 3: py_m = '1_5' is not a number"),
        (PLAIN.replace("-3", "x\x1b" + "y" * 900), r"line 3: py_m = .{20,60} is not a number"),
        (
            PLAIN.replace("-2", '"-2').replace("-3", '-3"'),
            "line 2: a value begins with a quotation mark and does not end",
        ),
        ("# a\n" + PLAIN.replace("-3", '"-3'), "line 4: a value begins with a quotation mark"),
        (PLAIN.replace("1.5", '"1,5"'), "line 2: px_m = '1,5' is not a number"),
        (PLAIN.split("\n", 1)[1], "missing columns px_m, py_m$"),
        ("# a\n\n" + PLAIN.replace("\n20", "\n\n# b\n20").replace("-3", "?"), "line 7: py_m = '\\?' is not"),
    ],
)
def test_what_is_wrong_is_told_by_line_and_column(tmp_path, text, told):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=told) as error:
        numbers(path, COLUMNS)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("stamp", "told"),
    [
        ("2e1", "line 3: stamp_ns = '2e1' is not a whole number"),
        ("20.0", "line 3: stamp_ns = '20.0' is not a whole"),
        ("", "line 3: stamp_ns is empty; leave the line out, or give a whole number"),
        ("99999999999999999999", "line 3: an integer has more than 64 bits"),
    ],
)
def test_stamps_are_whole_numbers(tmp_path, stamp, told):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("20", stamp))
    with pytest.raises(UserError, match=told):
        integers(path, ["stamp_ns"])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "latin-1"])
def test_text_of_another_encoding_is_told(tmp_path, encoding):
    path = tmp_path / "a.csv"
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    path.write_bytes(mark + PLAIN.replace("10", "\u00e9").encode(encoding))
    with pytest.raises(
        UserError, match="not readable as text" if encoding == "latin-1" else "UTF-16.*save it as UTF-8"
    ):
        numbers(path, COLUMNS)


def test_rows_by_name_have_no_name_twice(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("py_m", "py_m,,").replace("-2", "-2,,").replace("-3", "-3,,"))
    assert [row["py_m"] for row in named_rows(path, ["px_m"])] == ["-2", "-3"]
    path.write_text(PLAIN.replace("stamp_ns", "py_m"))
    with pytest.raises(UserError, match="has the column py_m 2 times"):
        named_rows(path, ["px_m"])


def test_the_line_of_a_row_counts_what_is_no_row(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("# a\n" + PLAIN.replace("\n20", "\n\n20"))
    assert [line_of_row(path, row) for row in (0, 1)] == [3, 5]
    with table_rows(path, COLUMNS) as (names, rows):
        assert names == ["stamp_ns", *COLUMNS]
        assert [row.line for row in rows] == [3, 5]


def test_readings_are_stamped_and_may_have_gaps(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("1.5", "").replace("-3", "nan"))
    found = readings(path, COLUMNS, gaps=True)
    assert found.stamps_ns.tolist() == [10, 20]
    np.testing.assert_array_equal(found.values, [[np.nan, -2.0], [2.5, np.nan]])
    path.write_text(PLAIN.splitlines()[0])
    assert readings(path, COLUMNS).values.shape == (0, 2)
    path.write_text(PLAIN.replace("\n20", "\n11"))
    assert readings(path, COLUMNS).stamps_ns.tolist() == [10, 11]


@pytest.mark.parametrize(
    ("text", "gaps", "told"),
    [
        (PLAIN.replace("20,", "10,"), True, "line 3: its stamp is not later than the previous one; sort the file"),
        (PLAIN.replace("20,", "9,"), False, "line 3: its stamp is not later"),
        (PLAIN.replace("2.5", "nan"), False, "line 3: px_m = nan is not finite; leave the line out"),
        (PLAIN.replace("-3", "-inf"), True, "line 3: py_m = -inf is not finite"),
        (PLAIN.replace("2.5", ""), False, "line 3: px_m is empty"),
        (PLAIN.replace("2.5", "x"), True, "line 3: px_m = 'x' is not a number, or nothing"),
    ],
)
def test_bad_readings_are_told_by_their_line(tmp_path, text, gaps, told):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=told):
        readings(path, COLUMNS, gaps=gaps)


def test_endless_lines_and_tables_are_told(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN + f"30,{'1' * 40},1\n")
    longest = len(path.read_text().splitlines()[-1]) + 1
    monkeypatch.setattr(tables, "LONGEST_LINE", longest)
    assert len(numbers(path, COLUMNS)) == 3
    monkeypatch.setattr(tables, "LONGEST_LINE", longest - 1)
    with pytest.raises(UserError, match=f"line 4 is longer than {longest - 1} characters; is this a CSV file"):
        numbers(path, COLUMNS)
    monkeypatch.setattr(tables, "LONGEST_LINE", 1000)
    monkeypatch.setattr(tables, "MOST_ROWS", 3)
    with pytest.raises(UserError, match="has more than 3 rows"):
        numbers(path, COLUMNS)
    monkeypatch.setattr(tables, "MOST_ROWS", 4)
    assert len(numbers(path, COLUMNS)) == 3
