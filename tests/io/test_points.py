"""Correspondences from text tables."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from camcal.errors import DataError, UsageError
from camcal.io.points import read_points
from camcal.io.writing import write_points
from camcal.types import Correspondences, View
from tests.shared_data import DATA, needs_data

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
