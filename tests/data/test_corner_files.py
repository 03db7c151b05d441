"""Corners of deltille, TartanCalib, PhotoModeler and calib.io, in files made here as those programs write them."""

import json
import os
import random

import numpy as np
import pytest

from camcal.data.point_files import POINT_FILES
from camcal.data.points import read_points
from camcal.errors import CamcalError, DataError
from tests.data.corner_samples import (
    BOARD,
    MARKS,
    ORPC,
    TP,
    calibio,
    dataset,
    dsc,
    photomodeler,
    samples,
    tartan_board,
    tartan_corners,
    tartan_pictures,
)
from tests.hardening.mutate import mutated

#: damaged files beside each; CAMCAL_FUZZ takes more
COUNT = int(os.environ.get("CAMCAL_FUZZ", "100"))


def put(tmp_path, name, content):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_each_reader_has_a_sample(tmp_path):
    """The samples that the tests of damage begin from are read."""
    assert list(samples()) == list(POINT_FILES)
    for name, (file, content, beside) in samples().items():
        for other, data in beside.items():
            put(tmp_path, f"{name}/{other}", data)
        assert read_points(put(tmp_path, f"{name}/{file}", content), board=(3, 2)).views


def test_orpc_with_its_target(tmp_path):
    path = put(tmp_path, "corners/train/0002.orpc", ORPC)
    put(tmp_path, "cube.dsc", dsc())
    found = read_points(path)
    assert found.image_size == (1280, 800)
    assert [v.id for v in found.views] == ["0002.pgm board 0", "0002.pgm board 1"]
    assert found.views[0].xyz.tolist() == [[0, 40, 0], [40, 40, 0], [0, 0, 0]]
    assert found.views[1].uv.tolist() == [[222.75, 482.5], [218.25, 528.5]]
    put(tmp_path, "cube.tp", TP)
    (whole,) = read_points(path).views
    assert whole.id == "0002.pgm" and whole.point_ids.tolist() == [0, 1, 3, 6, 8]
    assert whole.xyz[3].tolist() == [0 + 5, 40 + 6, 0 + 7]  # (0, 40, 0) turned and moved
    assert whole.xyz[4].tolist() == [0 + 5, 40 + 6, -80 + 7]


def test_orpc_on_the_board_of_the_command_line(tmp_path):
    one = ORPC.replace("num_corners: 5", "num_corners: 3").rsplit("1,0,1", 1)[0]
    path = put(tmp_path, "a.orpc", one)
    (view,) = read_points(path, board=(3, 2), square=0.04).views
    assert view.id == "0002.pgm" and np.allclose(view.xyz, [[0, 0, 0], [0.04, 0, 0], [0, 0.04, 0]])
    with pytest.raises(DataError, match="target"):
        read_points(path)
    with pytest.raises(DataError, match="corner 3; a board of 1x2"):
        read_points(path, board=(1, 2))
    with pytest.raises(DataError, match="2 corners; it says 3"):
        read_points(put(tmp_path, "b.orpc", one.rstrip().rsplit("\n", 1)[0] + "\n"), board=(3, 2))


def test_tartan_mat(tmp_path):
    tartan = tartan_pictures()
    put(tmp_path, "corners.mat", tartan_corners())
    with pytest.raises(DataError, match=r"board\.mat") as error:
        read_points(tmp_path / "corners.mat")
    assert error.value.hint
    put(tmp_path, "board.mat", tartan_board())
    found = read_points(tmp_path / "corners.mat")
    assert [len(v) for v in found.views] == [4, 3, 1]
    for view, (x, n) in zip(found.views, tartan, strict=True):
        assert np.array_equal(view.uv, x.T) and np.allclose(view.xyz[:, :2], BOARD[:, n - 1].T)
        assert view.point_ids.tolist() == (n - 1).tolist()
    # the same as MATLAB writes it, which BabelCalib's own files count from 1
    data = (tmp_path / "corners.mat").read_bytes()
    head = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(116)
    (tmp_path / "corners.mat").write_bytes(head + data[116:])
    assert np.allclose(read_points(tmp_path / "corners.mat").views[0].uv, tartan[0][0].T - 1)


def test_tartan_dataset(tmp_path):
    tartan = tartan_pictures()
    found = read_points(put(tmp_path, "d.bin", dataset(tartan)))
    assert found.image_size == (640, 480) and [v.id for v in found.views] == ["view1", "view2", "view3"]
    for view, (x, n) in zip(found.views, tartan, strict=True):
        assert np.allclose(view.uv, x.T, atol=1e-4) and np.allclose(view.xyz[:, :2], BOARD[:, n - 1].T)
    two = put(tmp_path, "two.bin", dataset(tartan, ((640, 480), (320, 240))))
    with pytest.raises(DataError, match="2 cameras"):
        read_points(two)
    assert read_points(f"{two}#cam1").image_size == (320, 240)
    with pytest.raises(DataError, match="version 0"):
        read_points(put(tmp_path, "old.bin", dataset(tartan, version=0)))
    with pytest.raises(DataError, match="do not fit"):
        read_points(put(tmp_path, "cut.bin", dataset(tartan)[:200]))


def test_photomodeler(tmp_path):
    found = read_points(put(tmp_path, "export.txt", photomodeler(MARKS)))
    assert found.image_size == (2272, 1704) and [v.id for v in found.views] == ["P1.JPG", "P2.JPG"]
    first, second = found.views
    assert first.uv.tolist() == [[1429.1, 1456.4], [12.5, 13.5]] and first.point_ids.tolist() == [2, 1001]
    assert first.xyz.tolist() == [[0.28, 1.14, -0.0007], [0, 1, 0]] and len(second) == 1
    assert read_points(put(tmp_path, "no_size.txt", photomodeler(MARKS, ""))).image_size is None
    with pytest.raises(DataError, match="5 numbers; 6 are needed"):
        read_points(put(tmp_path, "cut.txt", photomodeler([*MARKS, " 1 3 100 200 0.1"])))
    twice = photomodeler(MARKS).replace(" 3 0.42", " 2 0.42")
    with pytest.raises(DataError, match="twice"):
        read_points(put(tmp_path, "smart.txt", twice))


def test_calibio(tmp_path):
    path = put(tmp_path, "project.json", calibio())
    with pytest.raises(DataError, match="2 cameras") as error:
        read_points(path)
    assert "#camera0" in error.value.hint
    found = read_points(f"{path}#camera1")
    assert found.image_size == (640, 480) and [v.id for v in found.views] == ["img0.png", "img1.png"]
    assert found.views[1].point_ids.tolist() == [0, 2, 3, 4, 5]
    assert found.views[1].uv[1].tolist() == [21, 11] and np.allclose(found.views[1].xyz[2], [0, 0.02, 0])
    whole = read_points(put(tmp_path, "whole.json", calibio(ids=False, cameras=1)))
    assert [len(v) for v in whole.views] == [6, 6]
    short = json.loads(calibio(ids=False, cameras=1))
    short["detections"][0]["featurePoints"].pop()
    with pytest.raises(DataError, match="5 corners have no ids"):
        read_points(put(tmp_path, "short.json", json.dumps(short)))


@pytest.mark.parametrize("name", [n for n, (_, _, beside) in samples().items() if beside])
def test_a_damaged_board_or_target_ends_in_one_line(tmp_path, name):
    file, content, beside = samples()[name]
    path, rng = put(tmp_path, file, content), random.Random(3)
    for other, data in beside.items():
        for _ in range(COUNT):
            put(tmp_path, other, mutated(data, rng))
            try:
                read_points(path, board=(3, 2))
            except CamcalError as error:
                assert "\n" not in error.message and error.hint
        put(tmp_path, other, data)
