"""Points that other programs wrote: corners of mrcal, OpenCV's dumps, PhotonVision, gcp_list.txt, DLTdv."""

import json

import cv2
import numpy as np
import pytest

from camcal.data.labelled import read_labelled
from camcal.data.observations import Correspondences, View
from camcal.data.points import read_points
from camcal.data.writing import write_points
from camcal.errors import CamcalError, DataError, UsageError

VNL = "## made here\n# filename x y level\n" + "".join(
    f"a.jpg {10 * i} {20 * j} 0\n" if (i, j) != (1, 1) else "a.jpg - - -\n"
    for j in range(2)
    for i in range(3)
)


def put(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_vnl(tmp_path):
    found = read_points(put(tmp_path, "c.vnl", VNL), board=(3, 2), square=0.1)
    view = found.views[0]
    assert view.id == "a.jpg" and len(view) == 5
    assert np.allclose(view.xyz[:, :2], np.array([[0, 0], [1, 0], [2, 0], [0, 1], [2, 1]]) * 0.1)
    assert view.uv.tolist() == [[0, 0], [10, 0], [20, 0], [0, 20], [20, 20]]
    assert view.point_ids.tolist() == [0, 1, 2, 3, 5]


@pytest.mark.parametrize(
    "text, board, words",
    [
        (VNL, None, "size of the board"),
        (VNL, (4, 2), "4x2 = 8"),
        ("# filename x y\na.jpg 1\n", None, "fields"),
        ("# filename x y\na.jpg 1 q\n", (1, 1), "could not convert"),
        ("# a b c\na.jpg 1 2\n", None, "legend"),
        ("# filename x y\n", None, "no rows"),
    ],
)
def test_bad_vnl(tmp_path, text, board, words):
    with pytest.raises(DataError, match=words) as error:
        read_points(put(tmp_path, "c.vnl", text), board=board)
    assert error.value.hint


def test_vnl_with_the_board_in_it(tmp_path):
    text = "# filename x y level cid boardX boardY\na.jpg 1 2 0 7 0.5 1.5\na.jpg 3 4 0 8 1.0 1.5\n"
    view = read_points(put(tmp_path, "c.vnl", text)).views[0]
    assert view.xyz.tolist() == [[0.5, 1.5, 0], [1, 1.5, 0]] and view.uv.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("grid", [True, False])
def test_opencv_dump(tmp_path, suffix, grid):
    """As OpenCV's calibration sample writes it: a row for each picture, two channels."""
    path = tmp_path / f"out.{suffix}"
    pixels = np.random.default_rng(1).uniform(0, 400, (3, 6, 2)).astype(np.float32)
    x, y = np.meshgrid(np.arange(3), np.arange(2))
    xyz = np.c_[x.ravel(), y.ravel(), np.zeros(6)].astype(np.float32) * 25
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("board_width", 3), ("board_height", 2)):
        store.write(name, value)
    store.write("square_size", 25.0)
    store.write("image_points", pixels)
    if grid:
        store.write("grid_points", xyz.reshape(6, 1, 3))
    store.release()
    found = read_points(path)
    assert found.image_size == (640, 480) and [v.id for v in found.views] == ["view1", "view2", "view3"]
    assert np.allclose(np.stack([v.uv for v in found.views]), pixels, atol=1e-4)
    assert np.allclose(found.views[2].xyz, xyz)


def test_photonvision(tmp_path):
    points = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 0.1, "y": 0.0, "z": 0.0}, {"x": 0.2, "y": 0.0, "z": 0.0}]
    pixels = [{"x": 1.0, "y": 2.0}, {"x": 3.0, "y": 4.0}, {"x": -1.0, "y": -1.0}]
    view = {"locationInObjectSpace": points, "locationInImageSpace": pixels, "snapshotName": "img7.png"}
    found = {"resolution": {"width": 640.0, "height": 480.0}, "observations": [view]}
    read = read_points(put(tmp_path, "p.json", json.dumps(found)))
    assert read.image_size == (640, 480) and read.views[0].id == "img7.png"
    assert read.views[0].uv.tolist() == [[1, 2], [3, 4]] and read.views[0].xyz[1].tolist() == [0.1, 0, 0]


GCP = """EPSG:32617
544256.7 5320919.9 5 3044 2622 IMG_0525.jpg gcp1
544157.7 5320899.2 6 4193 1552 IMG_0585.jpg gcp2
544033.4 5320876.0 7 1606 2763 IMG_0525.jpg gcp3
"""


def test_gcp_list(tmp_path):
    found = read_points(put(tmp_path, "gcp_list.txt", GCP))
    assert [v.id for v in found.views] == ["IMG_0525.jpg", "IMG_0585.jpg"]
    assert found.views[0].xyz[1].tolist() == [544033.4, 5320876.0, 7]
    with pytest.raises(DataError, match="degrees"):
        read_points(put(tmp_path, "g.txt", GCP.replace("32617", "4326")))
    with pytest.raises(DataError, match=":3:"):
        read_points(put(tmp_path, "h.txt", GCP.replace("1552 ", "x ")))


def test_a_plain_txt_stays_a_table(tmp_path):
    assert len(read_points(put(tmp_path, "p.txt", "0 0 0 1 2\n1 0 0 3 4\n")).views[0]) == 2


def test_dltdv(tmp_path):
    text = (
        "pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y,pt2_cam1_X,pt2_cam1_Y\n1,2,3,4,NaN,NaN\n5,6,7,8,9,10\n"
    )
    found = read_labelled(put(tmp_path, "xypts.csv", text), ("camera", "point"))
    names = [found.names["point"][i] for i in found.labels["point"]]
    assert names == ["1:pt1", "1:pt1", "2:pt1", "2:pt1", "2:pt2"]
    assert found.uv.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8], [9, 10]]
    assert [found.names["camera"][i] for i in found.labels["camera"]] == ["1", "2", "1", "2", "1"]


def board(names=("a.jpg", "b.jpg")):
    x, y = np.meshgrid(np.arange(4), np.arange(3))
    xyz = np.c_[x.ravel(), y.ravel(), np.zeros(12)] * 0.025
    views = [View(n, xyz, np.random.default_rng(i).uniform(0, 400, (12, 2))) for i, n in enumerate(names)]
    return Correspondences.from_views([views[0], views[1].take(np.arange(12) != 5)], (640, 480))


@pytest.mark.parametrize("suffix", ["csv", "npz", "vnl"])
def test_what_is_written_reads_back(tmp_path, suffix):
    given = board()
    write_points(tmp_path / f"p.{suffix}", given)
    again = read_points(tmp_path / f"p.{suffix}", board=(4, 3), square=0.025)
    for a, b in zip(given.views, again.views, strict=True):
        assert a.id == b.id and np.array_equal(a.uv, b.uv) and np.allclose(a.xyz, b.xyz, atol=1e-12)


def test_vnl_refuses_what_it_cannot_hold(tmp_path):
    with pytest.raises(UsageError, match="space"):
        write_points(tmp_path / "p.vnl", board(("a b.jpg", "c.jpg")))
    scattered = Correspondences.from_views(
        [(np.random.default_rng(1).uniform(0, 1, (9, 3)), np.zeros((9, 2)))]
    )
    with pytest.raises(UsageError, match="rectangular"):
        write_points(tmp_path / "q.vnl", scattered)


def test_mutated_files_end_in_one_line(tmp_path):
    import random

    rng = random.Random(5)
    for name, text in (("a.vnl", VNL), ("g.txt", GCP)):
        for _ in range(300):
            data = bytearray(text.encode())
            for _ in range(rng.choice((1, 3, 9))):
                data[rng.randrange(len(data))] = rng.randrange(256)
            (tmp_path / name).write_bytes(bytes(data))
            try:
                read_points(tmp_path / name, board=(3, 2))
            except CamcalError as error:
                assert "\n" not in error.message
