"""Tables of points with something wrong: the line, what was found, what is needed."""

import os
from pathlib import Path

import numpy as np
import pytest

from camcal.data.blocks import BLOCK_BYTES
from camcal.data.points import read_points
from camcal.errors import DataError

HEADER = "view,X,Y,Z,u,v"
GOOD = [f"a,{i % 5},{i // 5},0,{100 + 9.7 * i + i * i / 7},{50 + 3.3 * i}" for i in range(20)]


def refused(folder: Path, text: str | bytes, name: str = "p.csv") -> DataError:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(DataError) as caught:
        read_points(path)
    assert caught.value.exit_code == 3
    assert caught.value.hint
    assert "\n" not in caught.value.message
    assert caught.value.message.endswith(".")
    caught.value.message = caught.value.message.replace(str(path), name)
    return caught.value


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a,1,two,0,4,3", "p.csv:9: Y: 'two' is not a number; a number is needed."),
        ("a,1,,0,4,3", "p.csv:9: Y: an empty field; a number is needed."),
        ("a,1,2,0,4,1_000", "p.csv:9: v: '1_000' is not a number"),
        ("a,1,2,0,4,\u0663", "p.csv:9: v: '\u0663' is not a number"),
        ("a,1,2,0,4,0x10", "p.csv:9: v: '0x10' is not a number"),
        ("a,1,2,0,4,3 5", "p.csv:9: v: '3 5' is not a number"),
        ("a,1,2,0,4," + "x" * 99, "p.csv:9: v: '" + "x" * 37 + "...' is not a number"),
        ("a,1,2,0,nan,3", "p.csv:9: u is nan; a finite number is needed."),
        ("a,1,-Inf,0,4,3", "p.csv:9: Y is -Inf; a finite number is needed."),
        ("a,1,1e999,0,4,3", "p.csv:9: Y is 1e999; a finite number is needed."),
        ("a,1,2", "p.csv:9: 3 fields found; view,X,Y,Z,u,v are needed."),
        ("a,1,2,0,4,3,7", "p.csv:9: 7 fields found; view,X,Y,Z,u,v are needed."),
        ("a;1;2;0;4;3", "p.csv:9: 1 field found; view,X,Y,Z,u,v are needed."),
        (",1,2,0,4,3", "p.csv:9: the view is empty; a name is needed."),
        ("  ,1,2,0,4,3", "p.csv:9: the view is empty; a name is needed."),
        ('"",1,2,0,4,3', "p.csv:9: the view is empty; a name is needed."),
        ('"a,1,2,0,4,3', "p.csv:9"),
    ],
)
def test_a_bad_row_is_named_by_its_line(tmp_path, row, message):
    lines = [HEADER, *GOOD[:3], "# a comment", "", *GOOD[3:5], row, *GOOD[5:]]
    if message == "p.csv:9":  # an unclosed quote is part of the name: the row itself is complete
        (tmp_path / "p.csv").write_text("\n".join(lines))
        assert [v.id for v in read_points(tmp_path / "p.csv").views] == ["a", '"a']
        return
    assert refused(tmp_path, "\n".join(lines)).message.startswith(message)


@pytest.mark.parametrize("sigma", ["0", "-0.5"])
def test_sigma_must_be_positive(tmp_path, sigma):
    rows = [f"{row},0.1" for row in GOOD]
    rows[4] = GOOD[4] + "," + sigma
    error = refused(tmp_path, "\n".join([HEADER + ",sigma", *rows]))
    assert error.message == f"p.csv:6: sigma is {sigma}; a number above 0 is needed."


@pytest.mark.parametrize("number", ["1.5", "1e17"])
def test_ids_are_whole_numbers(tmp_path, number):
    rows = [f"{i},{row}" for i, row in enumerate(GOOD)]
    rows[4] = number + "," + GOOD[4]
    error = refused(tmp_path, "\n".join(["id," + HEADER, *rows]))
    assert error.message == f"p.csv:6: id is {number}; a whole number is needed."


def test_ragged_rows_that_cancel_out_are_seen(tmp_path):
    text = "\n".join([HEADER, *GOOD[:3], "a,1,2,0,4", "a,1,2,0,4,3,7", *GOOD[3:]])
    assert refused(tmp_path, text).message.startswith("p.csv:5: 5 fields found")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_the_line_is_right_far_behind_the_first_block(tmp_path, end):
    count = BLOCK_BYTES // 14  # rows of about 18 bytes: more than one block
    rows = [f"a,{i},{i % 7},0,{i % 1000},5" for i in range(count)]
    rows[: count // 2 : 97] = ["# what follows is real"] * len(rows[: count // 2 : 97])
    rows[-40] = "a,1,2,0,4,x"
    error = refused(tmp_path, end.join([HEADER, *rows]) + end)
    assert error.message.startswith(f"p.csv:{count - 40 + 2}: v: 'x' is not a number")


@pytest.mark.parametrize(
    ("header", "message", "hint"),
    [
        ("view,X,Y,Z,u,w", "p.csv:1: unknown column 'w'.", "Columns that camcal knows: view,id,X,Y,Z"),
        ("vieww,X,Y,Z,u,v", "p.csv:1: unknown column 'vieww'.", "Did you mean 'view'?"),
        (
            "view,X,x,Z,u,v",
            "p.csv:1: the columns 'X' and 'x' both mean X; one is needed.",
            "Name the columns",
        ),
        ("view,id,sigma,Z,u,v", "p.csv:1: the header (view, id, sigma, Z, u, v) lacks X and Y.", "Name"),
        (",,,,,", "p.csv:1: unknown column ''.", "Columns that camcal knows"),
    ],
)
def test_bad_headers(tmp_path, header, message, hint):
    error = refused(tmp_path, "\n".join([header, *GOOD]))
    assert error.message == message
    assert error.hint.startswith(hint)


@pytest.mark.parametrize(
    ("row", "count"), [("1 2 3", "3 columns"), ("1,2,3,4,5,6,7", "7 columns"), ("5", "1 column")]
)
def test_wrong_number_of_columns_without_a_header(tmp_path, row, count):
    error = refused(tmp_path, f"# nothing known\n\n{row}\n{row}\n")
    assert error.message.startswith(
        f"p.csv:3: {count} found; without a header, 4 (X Y u v), 5 (X Y Z u v) or 6"
    )


def test_text_in_the_first_row_is_no_view_where_the_other_rows_are_numbers(tmp_path):
    error = refused(tmp_path, "1O,2,3,4,5\n2,3,3,4,5\n")
    assert error.message == "p.csv:1: X: '1O' is not a number; a number is needed."


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "p.csv: the file is empty (0 bytes)."),
        (b"\n\n# only this\n", "p.csv: only comments and blank lines; points are needed."),
        (HEADER.encode() + b"\n", "p.csv: a header but no rows; points are needed."),
        (HEADER.encode(), "p.csv: a header but no rows; points are needed."),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "p.csv: a binary file (zero byte at 8); text is needed."),
        (HEADER.encode("utf-16"), "p.csv: the text is UTF-16; UTF-8 is needed."),
        (b"view,X,Y,Z,u,v\nM\xfcnchen,1,2,3,4,5\n", "p.csv: byte 0xfc near position 16 is not UTF-8 text."),
        (b"1,2,3,4," + b"5" * (3 << 20), "p.csv: a line has more than 1048576 characters."),
    ],
)
def test_bad_files(tmp_path, data, message):
    assert refused(tmp_path, data).message == message


def test_folder_and_missing_file(tmp_path):
    with pytest.raises(DataError, match="a folder; a file of points is needed"):
        read_points(tmp_path)
    with pytest.raises(DataError, match=r"absent\.csv: no such file"):
        read_points(tmp_path / "absent.csv")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the super-user may read all")
def test_unreadable_file(tmp_path):
    path = tmp_path / "p.csv"
    path.touch(mode=0)
    with pytest.raises(DataError, match="cannot be read"):
        read_points(path)


def test_the_same_row_twice(tmp_path):
    error = refused(tmp_path, "\n".join([HEADER, *GOOD, GOOD[3]]))
    assert error.message == (
        "p.csv:22: the point (3, 0, 0) is given a second time in view 'a', after line 5, with the same image point."
    )


def test_a_point_with_two_pixels(tmp_path):
    error = refused(tmp_path, "\n".join([HEADER, *GOOD, "a,3.0,-0.0,0,1,1"]))
    assert error.message == (
        "p.csv:22: the point (3, 0, 0) is given a second time in view 'a', after line 5, with another image point."
    )


def test_a_point_of_two_views_is_no_duplicate(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("\n".join([HEADER, *GOOD, *(row.replace("a,", "b,") for row in GOOD)]))
    assert len(read_points(path)) == 2


def test_ids_tell_points_at_one_place_apart(tmp_path):
    rows = [f"{i},{row}" for i, row in enumerate([*GOOD, GOOD[3]])]
    path = tmp_path / "p.csv"
    path.write_text("\n".join(["id," + HEADER, *rows]))
    assert read_points(path).point_count == 21
    rows[7] = "3," + GOOD[7]
    error = refused(tmp_path, "\n".join(["id," + HEADER, *rows]))
    assert error.message == "p.csv:9: id 3 is given a second time in view 'a', after line 5."


def test_duplicates_are_found_among_many_points(tmp_path):
    rows = [f"{i % 300},{i // 300},0,{i},{i % 13}" for i in range(90_000)]
    rows[70_000] = rows[20]
    error = refused(tmp_path, "\n".join(rows))
    assert "p.csv:70001: the point (20, 0, 0) is given a second time, after line 21" in error.message


def board(order: str) -> list[str]:
    """Rows of a 5 x 4 board seen at a slant, their columns in the order given."""
    rows = []
    for i in range(20):
        x, y = i % 5 * 25.0, i // 5 * 25.0
        w = 1 + x / 700 + y / 900
        values = {"X": x, "Y": y, "Z": 0.0, "u": (120 + 3 * x + y / 3) / w, "v": (80 + 2.8 * y - x / 4) / w}
        rows.append(",".join(repr(values[c]) for c in order))
    return rows


@pytest.mark.parametrize("order", ["uvZXY", "uvXYZ", "uvXY"])
def test_pixels_in_front_of_the_board_are_refused_without_a_header(tmp_path, order):
    error = refused(tmp_path, "\n".join(board(order)))
    assert "like a board, and X and Y are scattered, like image points" in error.message
    assert "Name the columns" in error.hint


def test_exchanged_names_in_the_header_are_refused(tmp_path):
    error = refused(tmp_path, "\n".join(["X,Y,Z,u,v", *board("uvZXY")]))
    assert "p.csv:2: u and v are a regular grid" in error.message
    assert error.hint == "Exchange the names in the header."


def test_named_pixels_on_a_grid_are_believed(tmp_path):
    """A projector's pattern: pixels on a grid that does not start in the corner, points on a wall."""
    grid = [(200 + 40 * (i % 5), 100 + 40 * (i // 5)) for i in range(20)]
    wall = np.random.default_rng(1).uniform(0, 90, (20, 2))
    rows = [f"{x},{y},{u},{v}" for (x, y), (u, v) in zip(wall, grid, strict=True)]
    path = tmp_path / "p.csv"
    path.write_text("\n".join(["X,Y,u,v", *rows]))
    assert read_points(path).point_count == 20


@pytest.mark.parametrize("order", ["XYZuv", "XYuv"])
def test_the_right_order_is_read(tmp_path, order):
    path = tmp_path / "p.csv"
    path.write_text("\n".join(board(order)))
    assert read_points(path).point_count == 20


def test_a_board_seen_straight_on_is_read(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(
        "\n".join(f"{i % 5},{i // 5},0,{100 + 10 * (i % 5)},{50 + 10 * (i // 5)}" for i in range(25))
    )
    assert read_points(path).point_count == 25


def test_exchanged_columns_are_told_by_two_views(tmp_path):
    # separate squares: no regular grid, and negative coordinates; only their repetition tells
    rng = np.random.default_rng(0)
    board = rng.integers(-9, 9, (30, 2)) + rng.choice([0, 0.3], (30, 2)) + np.arange(30)[:, None]
    rows = [
        f"{view},{x},{y},0,{u},{v}"
        for view in "ab"
        for (x, y), (u, v) in zip(rng.uniform(0, 400, (30, 2)), board, strict=True)
    ]
    error = refused(tmp_path, "\n".join([HEADER, *rows]))
    assert "identical in two views" in error.message and "Exchange" in error.hint
