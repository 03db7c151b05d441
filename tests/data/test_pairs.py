"""Pairs of files whose rows correspond."""

import pytest

from camcal.data.points import read_points
from camcal.errors import DataError, UsageError

WORLD = "1 2 3\n4 5 6\n"
IMAGE = "100 200\n300 400\n"


@pytest.fixture
def pair(tmp_path):
    def read(world, image):
        (tmp_path / "w.txt").write_text(world)
        (tmp_path / "i.txt").write_text(image)
        return read_points(points3d=tmp_path / "w.txt", points2d=tmp_path / "i.txt")

    return read


@pytest.mark.parametrize(
    "world",
    [
        WORLD,
        "1,2,3\n4,5,6\n",
        "X Y Z\n1 2 3\n4 5 6\n",
        "Surveyed points of the rig\nX Y Z\nmm mm mm\n1 2 3\n4 5 6\n",
        "Date: 5 May\nthe points\n1 2 3\n4 5 6\n",
        "Z\tX\tY\n3\t1\t2\n6\t4\t5\n",
        "# X Y Z\n1 2 3\n4 5 6\n",
        "\n1;2;3\n\n4;5;6",
    ],
)
@pytest.mark.parametrize(
    "image",
    [IMAGE, "u,v\n100,200\n300,400\n", "x y\n100 200\n300 400", "px\n100 200\n300 400"],
)
def test_rows_correspond(pair, world, image):
    (view,) = pair(world, image).views
    assert view.id == "i.txt"
    assert view.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert view.uv.tolist() == [[100, 200], [300, 400]]


def test_two_columns_are_a_plane(pair):
    assert pair("1 2\n4 5\n", IMAGE).views[0].xyz.tolist() == [[1, 2, 0], [4, 5, 0]]


def test_views_ids_and_sigmas_come_from_either_file(pair):
    c = pair("id X Y Z\n7 1 2 3\n8 4 5 6\n", "view u v sigma\nb 100 200 .1\na 300 400 .2\n")
    found = [(v.id, v.point_ids.tolist(), v.sigma.tolist()) for v in c.views]
    assert found == [("b", [7], [0.1]), ("a", [8], [0.2])]


@pytest.mark.parametrize(
    ("world", "image", "message"),
    [
        (WORLD + "7 8 9\n", IMAGE, r"w\.txt holds 3 points and .*i\.txt holds 2; the same number is needed"),
        (IMAGE, WORLD, r"i\.txt:1: 3 columns found; without a header, 2 \(u v\) are needed"),
        (
            "1 2 3 4\n",
            IMAGE,
            r"w\.txt:1: 4 columns found; without a header, 3 \(X Y Z\) or 2",
        ),
        ("1 two 3\n4 5 6\n", IMAGE, r"w\.txt:1: Y: 'two' is not a number"),
        ("one 2 3\n4 5 6\n", IMAGE, r"w\.txt:1: X: 'one' is not a number"),
        (WORLD, "u v\n100 200\n300 x\n", r"i\.txt:3: v: 'x' is not a number"),
        (WORLD, "u v\n", r"i\.txt: the file has a header but no rows"),
        ("id X Y\n1 1 2\n2 4 5\n", "id u v\n1 1 2\n3 4 5\n", r"w\.txt:3 has id 2, .*i\.txt:3 has id 3"),
        (
            "view X Y\na 1 2\nb 4 5\n",
            "view u v\na 1 2\nc 4 5\n",
            r"txt:3 has view 'b', .*txt:3 has view 'c'",
        ),
        (
            "view X Y\na 1 2\na 4 5\n",
            "view u v\na 1 2\nc 4 5\n",
            r"txt:3 has view 'a', .*txt:3 has view 'c'",
        ),
        ("1 2 3\n1 2 3\n", IMAGE, r"i\.txt:2: the point \(1, 2, 3\) is given a second time, after line 1"),
    ],
)
def test_what_does_not_go_together(pair, world, image, message):
    with pytest.raises(DataError, match=message) as caught:
        pair(world, image)
    assert caught.value.hint


def test_half_a_pair_or_too_much(tmp_path):
    with pytest.raises(UsageError, match="a file of 3D points and one of 2D"):
        read_points(points3d=tmp_path / "w.txt")
    with pytest.raises(UsageError, match="a file of 3D points and one of 2D"):
        read_points("p.csv", points3d="w.txt", points2d="i.txt")
