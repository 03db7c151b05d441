"""Correspondences from text tables."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.data.columns import POINTS, role_of
from camcal.data.layout import Layout
from camcal.data.observations import Correspondences, View
from camcal.data.points import read_points
from camcal.data.table import _split_lines
from camcal.data.writing import write_points
from camcal.errors import DataError, UsageError
from tests.shared_data import DATA, needs_data

#: numbers that JSON has not, or has in another way
FORMS = (
    "+1",
    ".5",
    "1.",
    "007",
    "-0",
    " 1",
    "1 ",
    "1E5",
    "1e+05",
    "123456789012345678901234567890",
    "5e-324",
    "-.1e-7",
)
ROWS = [(0.5, -1.0, 0.25, 100.125, 200.0), (1.5, -1.0, 0.0, 110.0, 2e2), (0.5, 2.0, 1e-3, 100.0, 220.5)]


def written(folder: Path, text: str | bytes, name: str = "points.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def check_rows(c: Correspondences, columns=slice(0, 5)) -> None:
    (view,) = c.views
    assert np.array_equal(np.hstack([view.xyz, view.uv]), ROWS)


def test_views_keep_the_order_of_first_appearance_though_their_rows_are_scattered(tmp_path):
    text = "view,X,Y,Z,u,v\nb,0,0,0,1,2\na,0,0,0,3,4\nb,1,0,0,5,6\na,1,0,0,7,8\n"
    path = written(tmp_path, text)
    c = read_points(path)
    assert [v.id for v in c.views] == ["b", "a"]
    assert c.views[0].uv.tolist() == [[1, 2], [5, 6]]
    assert c.views[1].uv.tolist() == [[3, 4], [7, 8]]
    assert c.files == ({"path": str(path), "sha256": hashlib.sha256(text.encode()).hexdigest()},)


@needs_data
@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "views", "points"),
    [
        ("barranco_medel/points.csv", 1, 7),
        ("cs6476/pic_a.csv", 1, 20),
        ("cs6476/pic_a_norm.csv", 1, 20),
        ("cs6476/pic_b.csv", 1, 20),
        ("dbat_camcal/points.csv", 21, 2074),
        ("fisheye_jy/left.csv", 34, 1632),
        ("iit_ncc/ncc-imagePt.csv", 1, 268),
        ("iit_ncc/ncc-noise-0-imagePt.csv", 1, 268),
        ("iit_ncc/ncc-noise-1-imagePt.csv", 1, 268),
        ("mrcal_case/points.csv", 50, 2700),
        ("opencv_calib1/points.csv", 7, 245),
        ("ov_plane/test.csv", 7, 2723),
        ("ov_plane/train.csv", 18, 6864),
        ("tsai_cube/left.csv", 1, 26),
        ("tsai_cube/right.csv", 1, 26),
        ("whu/9282.csv", 1, 89),
        ("zhang1998/points.csv", 5, 1280),
    ],
)
def test_real_tables(name, views, points):
    c = read_points(DATA / name)
    assert (len(c), c.point_count) == (views, points)


@needs_data
@pytest.mark.shared
def test_real_pair_of_files_holds_what_the_table_holds():
    folder = DATA / "cs6476"
    pair = read_points(points3d=folder / "pts3d.txt", points2d=folder / "pts2d-pic_a.txt")
    table = read_points(folder / "pic_a.csv")
    assert np.array_equal(pair.views[0].xyz, table.views[0].xyz)
    assert np.array_equal(pair.views[0].uv, table.views[0].uv)
    assert len(pair.files) == 2


def test_write_and_read_back(tmp_path):
    rows = np.array(ROWS)
    c = Correspondences.from_views([View("a b.png", rows[:, :3], rows[:, 3:]), (rows[:, :3], rows[:, 3:])])
    write_points(tmp_path / "out.csv", c)
    back = read_points(tmp_path / "out.csv")
    assert [v.id for v in back.views] == ["a b.png", "view2"]
    assert np.array_equal(back.views[1].xyz, rows[:, :3])


def test_missing_file(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_points(tmp_path / "absent.csv")


def test_no_file_is_a_usage_error():
    with pytest.raises(UsageError, match="no file of points"):
        read_points()


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   ", " , ", "\t\t", " \t"])
@pytest.mark.parametrize(
    "header", [None, "X Y Z u v", "x y z px py", "OBJECT_X object-y objectz Image_X image_y", "X Y Z col row"]
)
def test_separators_and_headers(tmp_path, separator, header):
    lines = [] if header is None else [header.replace(" ", separator)]
    lines += [separator.join(map(repr, row)) for row in ROWS]
    c = read_points(written(tmp_path, "\n".join(lines)))
    check_rows(c)
    assert c.views[0].id == "points.csv"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_the_byte_order_mark(tmp_path, end, mark):
    lines = ["view,X,Y,Z,u,v", *(",".join(["a", *map(str, row)]) for row in ROWS), ""]
    c = read_points(written(tmp_path, mark + end.join(lines)))
    check_rows(c)
    assert c.views[0].id == "a"


@pytest.mark.parametrize(
    "text",
    [
        "X;Y;Z;u;v\n1,5;-2;0,25;100,5;1e2\n",
        "1,5;-2;0,25;100,5;1e2\n",
        "1,5\t-2\t0,25\t100,5\t1e2\n",
        '"1,5";"-2";"0,25";"100,5";"1e2"\n',
    ],
)
def test_decimal_commas(tmp_path, text):
    (view,) = read_points(written(tmp_path, text)).views
    assert view.xyz.tolist() == [[1.5, -2.0, 0.25]]
    assert view.uv.tolist() == [[100.5, 100.0]]


def test_comments_and_blank_lines(tmp_path):
    text = "# made by hand\n\n  # X Y\nX,Y,Z,u,v\n1,2,3,4,5  # the corner\n   \n\t\n6,7,8,9,10 # end\n# done"
    (view,) = read_points(written(tmp_path, text)).views
    assert view.uv.tolist() == [[4, 5], [9, 10]]


@pytest.mark.parametrize(
    ("text", "xyz", "uv"),
    [
        ("1,2,100,200\n3,4,101,201\n", [[1, 2, 0], [3, 4, 0]], [[100, 200], [101, 201]]),
        ("X,Y,u,v\n1,2,100,200\n", [[1, 2, 0]], [[100, 200]]),
        ("v,u,Z,Y,X\n200,100,3,2,1\n", [[1, 2, 3]], [[100, 200]]),
        ("# u,v,X,Y\n100,200,1,2\n", [[1, 2, 0]], [[100, 200]]),
        ("# a note, with a comma\n# X Y u v\n1,2,100,200\n", [[1, 2, 0]], [[100, 200]]),
        ("X (mm),Y (mm),Z [mm],u [px],v [px]\n1,2,3,100,200\n", [[1, 2, 3]], [[100, 200]]),
    ],
)
def test_columns_are_found_by_name_or_number(tmp_path, text, xyz, uv):
    (view,) = read_points(written(tmp_path, text)).views
    assert view.xyz.tolist() == xyz
    assert view.uv.tolist() == uv


@pytest.mark.parametrize("name", ["view", "File", "IMAGE", "frame", "name", "image_name"])
@pytest.mark.parametrize("place", [0, 3, 5])
@pytest.mark.parametrize("separator", [",", " "])
def test_the_view_may_stand_anywhere(tmp_path, name, place, separator):
    rows = [["X", "Y", "Z", "u", "v"], ["1", "2", "3", "4", "5"], ["6", "7", "8", "9", "10"]]
    for row, word in zip(rows, [name, "a.png", "b#1.png"], strict=True):
        row.insert(place, word)
    c = read_points(written(tmp_path, "\n".join(separator.join(row) for row in rows)))
    assert [(v.id, v.xyz.tolist(), v.uv.tolist()) for v in c.views] == [
        ("a.png", [[1, 2, 3]], [[4, 5]]),
        ("b#1.png", [[6, 7, 8]], [[9, 10]]),
    ]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("7,1,2,3,4,5\n7,2,2,3,4,5\n9,1,2,3,4,5\n", ["7", "9"]),
        ("a.png 1 2 3 4 5\nb.png 1 2 3 4 5\n", ["a.png", "b.png"]),
        ("a.png,1,2,4,5\nb.png,1,2,4,5\n", ["a.png", "b.png"]),
        ('"a, b #1.png",1,2,3,4,5\n', ["a, b #1.png"]),
        ('"say ""a""" 1 2 3 4 5\n', ['say "a"']),
        ('view,X,Y,Z,u,v\n" a ",1,2,3,4,5\n a ,1,2,3,4,5\n', [" a ", "a"]),
        ("view,X,Y,Z,u,v\na b,1,2,3,4,5\n", ["a b"]),
        ("ä€,1,2,3,4,5\n", ["ä€"]),
    ],
)
def test_names_of_views(tmp_path, text, names):
    assert [v.id for v in read_points(written(tmp_path, text)).views] == names


def test_the_table_of_detections(tmp_path):
    text = "file,id,X,Y,Z,u,v,sigma\nleft 01.jpg,3,25,0,0,10.5,20.5,0.08\nleft 01.jpg,4,50,0,0,30,21,0.1\n"
    (view,) = read_points(written(tmp_path, text), image_size=(640, 480)).views
    assert view.id == "left 01.jpg"
    assert view.point_ids.tolist() == [3, 4]
    assert view.point_ids.dtype == np.int64
    assert view.sigma.tolist() == [0.08, 0.1]


def test_the_image_size_is_kept(tmp_path):
    assert read_points(written(tmp_path, "1,2,3,4,5"), image_size=(640, 480)).image_size == (640, 480)


def test_several_files_are_several_views(tmp_path):
    a = written(tmp_path, "1,2,3,4,5", "a.csv")
    b = written(tmp_path, "view,X,Y,Z,u,v\nq,1,2,3,4,5\nr,1,2,3,4,5", "b.csv")
    c = read_points(a, b)
    assert [v.id for v in c.views] == ["a.csv", "q", "r"]
    assert [f["path"] for f in c.files] == [str(a), str(b)]


def test_views_of_the_same_name_in_two_files_are_two_views(tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "y").mkdir()
    text = "view,X,Y,Z,u,v\n1,1,2,3,4,5\n"
    left, right = written(tmp_path, text, "left.csv"), written(tmp_path, text, "right.csv")
    assert [v.id for v in read_points(left, right).views] == ["left.csv:1", "right.csv:1"]
    same = written(tmp_path / "x", "1,2,3,4,5"), written(tmp_path / "y", "1,2,3,4,5")
    assert [v.id for v in read_points(*same).views] == [str(p) for p in same]
    with pytest.raises(UsageError, match="given twice"):
        read_points(left, left)


def test_blocks_join_without_a_seam(tmp_path):
    """The file is several blocks long, with comments, blank lines, and quotes in some blocks only."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(60_000, 5)) * 10.0 ** rng.integers(-8, 9, (60_000, 5))
    names = [f"v{i % 3}" if i < 50_000 else f'"v {i % 3}"' for i in range(len(values))]
    lines = [f"{n},{','.join(map(repr, row))}" for n, row in zip(names, values.tolist(), strict=True)]
    lines[100:40_000:501] = [line + "  # note\n" for line in lines[100:40_000:501]]
    c = read_points(written(tmp_path, "\n".join(lines)))
    assert [v.id for v in c.views] == ["v0", "v1", "v2", "v 2", "v 0", "v 1"]
    order = np.argsort(np.array([0, 1, 2])[np.arange(50_000) % 3], kind="stable")
    assert np.array_equal(np.concatenate([v.xyz for v in c.views[:3]]), values[order, :3])
    assert np.array_equal(np.concatenate([v.uv for v in c.views[:3]]), values[order, 3:])


def test_the_examples_of_the_documentation(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "input-formats.md").read_text()
    first, second = (
        read_points(written(tmp_path, block)) for block in re.findall(r"```csv\n(.*?)```", text, re.S)
    )
    assert [(v.id, len(v)) for v in first.views] == [("left01.jpg", 2), ("left02.jpg", 1)]
    assert [(v.id, v.uv.tolist()) for v in second.views] == [
        ("board; first", [[244.45, 94.09], [274.62, 92.22]])
    ]


def test_the_names_of_columns_in_the_documentation(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "input-formats.md").read_text()
    rows = re.findall(r"^\| `(\w+)`(?:, `(\w+)`)? \|[^|]*\|([^|]*)\|[^|]*\|$", text, re.M)
    assert [row[0] for row in rows] == ["view", "X", "Z", "u", "sigma", "id", "printed"]
    for first, second, others in rows:
        for name in re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", others))):
            assert role_of(name, POINTS) in (first, second), name


TYPED = [(1.5, 2.25, 3.0, 100.5, 200.25), (4.0, -2.0, 1.0, 50.0, 60.0), (0.5, 1.0, -3.0, 7.0, 8.0)]


@pytest.mark.parametrize(
    "text",
    [
        "X,Y,Z,x,y\n" + "".join(",".join(map(str, r)) + "\n" for r in TYPED),
        "X,Y,Z,u,v,\n" + "".join(",".join(map(str, r)) + ",\n" for r in TYPED),
        "% X Y Z u v\n" + "".join(" ".join(map(str, r)) + "\n" for r in TYPED),
        "% a comment\n%\n" + "".join(" ".join(map(str, r)) + "\n" for r in TYPED),
        "Point,X,Y,Z,u,v\n" + "".join(f"P{i}," + ",".join(map(str, r)) + "\n" for i, r in enumerate(TYPED)),
        "Point;X;Y;Z;u;v\n"
        + "".join(f'"P;{i}";' + ";".join(map(str, r)) + "\n" for i, r in enumerate(TYPED)),
    ],
)
def test_tables_as_people_have_them(tmp_path, text):
    """x, y beside X, Y; separators at the end of lines; MATLAB's comments; names of points."""
    (view,) = read_points(written(tmp_path, text)).views
    assert np.c_[view.xyz, view.uv].tolist() == [list(map(float, r)) for r in TYPED]
    if text.startswith("Point"):
        assert view.point_ids.tolist() == [0, 1, 2]
    else:
        assert view.point_ids is None


def test_the_same_name_is_the_same_point(tmp_path):
    text = "view,Point,X,Y,u,v\n" + "a,P,0,0,1,2\na,Q,1,0,3,4\nb,Q,1,0,5,6\n"
    first, second = read_points(written(tmp_path, text)).views
    assert first.point_ids.tolist() == [0, 1] and second.point_ids.tolist() == [1]


@pytest.mark.parametrize(("count", "views"), [(5, 5), (6, 1)])
def test_names_of_points_without_a_header(tmp_path, count, views):
    rng = np.random.default_rng(0)
    text = "".join(f"P{i}," + ",".join(map(str, rng.normal(size=5))) + "\n" for i in range(count))
    assert len(read_points(written(tmp_path, text)).views) == views


def test_pixels_before_points_without_a_header(tmp_path):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-1, 1, (20, 3))
    uv = 500 * xyz[:, :2] / (xyz[:, 2:] + 5) + 300 + rng.normal(0, 0.5, (20, 2))
    right = "".join(" ".join(map(str, r)) + "\n" for r in np.c_[xyz, uv])
    assert read_points(written(tmp_path, right)).point_count == 20
    with pytest.raises(DataError, match="u v X Y Z"):
        read_points(written(tmp_path, "".join(" ".join(map(str, r)) + "\n" for r in np.c_[uv, xyz])))


def test_several_cameras_are_for_the_rig(tmp_path):
    with pytest.raises(DataError, match="unknown column 'camera'") as caught:
        read_points(written(tmp_path, "camera,frame,X,Y,Z,u,v\nc1,1,0,0,0,1,2\n"))
    assert "camcal rig" in caught.value.hint


SQUARE = ["0,0,10,10", "1,0,20,10", "0,1,10,20", "1,1,20,20"]


@pytest.mark.parametrize(("said", "shape"), [("1111", "auto"), ("1110", "flat"), ("0000", "flat")])
def test_a_table_says_whether_its_points_are_printed(tmp_path, said, shape):
    path = tmp_path / "p.csv"
    path.write_text("X,Y,u,v,printed\n" + "\n".join(f"{r},{s}" for r, s in zip(SQUARE, said, strict=True)))
    assert read_points(path).usual_board_shape == shape
    assert read_points(path).is_printed == (shape == "auto")


def test_printed_is_0_or_1(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("X,Y,u,v,printed\n" + "\n".join(f"{r},2" for r in SQUARE))
    with pytest.raises(DataError, match="printed"):
        read_points(path)


def test_points_found_on_a_target_are_written_as_printed(tmp_path):
    path, plain = tmp_path / "p.csv", tmp_path / "plain.csv"
    views = Correspondences.from_views([(np.eye(4, 3), np.arange(8.0).reshape(4, 2))])
    write_points(plain, views)
    write_points(path, replace(views, target={"kind": "checkerboard"}))
    assert "printed" not in plain.read_text() and read_points(plain).target is None
    assert path.read_text().splitlines()[0].endswith(",printed") and read_points(path).is_printed


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1e69, 1e69).map(repr) | st.sampled_from(FORMS), min_size=5, max_size=5))
def test_numbers_are_those_of_loadtxt(numbers):
    """Lines whose numbers are JSON's are parsed otherwise than those with another; to the same float64."""
    line = ",".join(numbers)
    columns = ("X", "Y", "Z", "u", "v")
    (found,), views = _split_lines([line], Layout(",", columns, 0, False), None)
    assert views is None and found.tolist() == np.loadtxt([line], delimiter=",").tolist()
    (found,), views = _split_lines([f"a,{line}"], Layout(",", ("view", *columns), 0, False), 0)
    assert views == ["a"] and found.tolist() == np.loadtxt([line], delimiter=",").tolist()


@pytest.mark.parametrize("field", ["1]", "[1", '"1"', "true", "null", "", "1 2", "0x1", "1]]", "{}"])
def test_what_is_no_number_is_none(field):
    with pytest.raises(ValueError, match=r"."):
        _split_lines([f"{field},2"], Layout(",", ("u", "v"), 0, False), None)
