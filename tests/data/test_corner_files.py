"""Corners of deltille, TartanCalib, PhotoModeler and calib.io, in files made here as those programs write them."""

import json
import struct

import numpy as np
import pytest
from scipy.io import savemat

from camcal.data.points import read_points
from camcal.errors import DataError

RNG = np.random.default_rng(7)


def put(tmp_path, name, content):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


ORPC = """filename: ov/0002.pgm
width: 1280
height: 800
num_corners: 5
encoding: ascii
0,0,1,624.25,565.25
0,1,1,652.5,551.5
0,3,1,635.5,596.75
1,0,1,222.75,482.5
1,2,1,218.25,528.5
"""


def dsc():
    """Two boards of 3 x 2 corners, 4 cm apart, from the top row down."""
    text = ""
    for board in (0, 1):
        text += f"{board},3,4,40.000000\nt25h7,2.000000\n"
        text += "".join(f"-1,{c},{1 - r},{4.0 * c},{4.0 * (1 - r)},0.0\n" for r in (0, 1) for c in (0, 1, 2))
    return text


TP = "boards\n0 1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 5 0 1 0 6 -1 0 0 7\n"


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


BOARD = np.array([[0.0, 1, 2, 0, 1, 2], [0, 0, 0, 1, 1, 1]]) * 0.03


@pytest.fixture
def tartan():
    """Pixels and 1-based numbers of points of three pictures; the last one sees a single point."""
    numbers = [np.array([1, 2, 3, 6]), np.array([4, 5, 6]), np.array([2])]
    return [(RNG.uniform(10, 500, (2, len(n))), n) for n in numbers]


def test_tartan_mat(tmp_path, tartan):
    corners = [{"x": x, "cspond": np.stack([n, np.ones(len(n))])} for x, n in tartan]
    savemat(tmp_path / "corners.mat", {"corners": corners})
    with pytest.raises(DataError, match=r"board\.mat") as error:
        read_points(tmp_path / "corners.mat")
    assert error.value.hint
    savemat(tmp_path / "board.mat", {"boards": {"Rt": np.eye(3, 4), "X": BOARD}})
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


def dataset(pictures, sizes=((640, 480),), version=1):
    """As TartanCalib's export_dataset writes it."""
    out = b"calib_data" + struct.pack(">II", version, len(sizes))
    out += b"".join(struct.pack(">II", *s) for s in sizes) + struct.pack(">I", len(pictures))
    for x, n in pictures:
        name = b"placeholder.png"
        out += struct.pack(">I", len(name)) + name
        for _ in sizes:
            out += struct.pack(">I", len(n))
            out += b"".join(
                struct.pack("<ff", *p) + struct.pack(">i", i - 1) for p, i in zip(x.T, n, strict=True)
            )
    out += struct.pack(">Iii", 1, 2, 3) + struct.pack(">I", BOARD.shape[1])
    return out + b"".join(struct.pack(">i", i) + struct.pack("<ff", *p) for i, p in enumerate(BOARD.T))


def test_tartan_dataset(tmp_path, tartan):
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


def photomodeler(marks, size=" 2272 1704"):
    lines = [
        "Bundle of a project",
        f" 0.0005 20{size}",
        " 1" * 9,
        " 7.4 3.6 2.6 7.2 5.4 0 0 0 0 0",
        " 0" * 10,
    ]
    for i, name in enumerate(("f:\\images\\P1.JPG", "f:\\images\\P2.JPG")):
        rest = ["0.4 1.7 1.4 -179 -1 -39", "0 0 0 0 0 0", None, "7.4 3.6 2.6 7.2 5.4 0 0 0 0 0", "0 " * 10]
        lines += [f" {i} {name}", *("" if r is None else f" {i} {r}" for r in rest)]
    lines += [
        "",
        " 1001 0 1 0 0.5 0.5 0.5",
        "",
        " 2 0.28 1.14 -0.0007 0 0 0",
        " 3 0.42 1.14 0.0001 0 0 0",
        "",
    ]
    return "\n".join([*lines, *marks]) + "\n"


MARKS = [
    " 0 2 1429.1 1456.4 0.1 0.1",
    " 0 1001 12.5 13.5 0.1 0.1",
    " 1 3 100 200 0.1 0.1",
    " 1 77 1 1 0.1 0.1",
]


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


def calibio(ids=True, cameras=2):
    target = [{"x": 0.02 * c, "y": 0.02 * r, "z": 0.0} for r in range(2) for c in range(3)]
    one = {
        "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": 640, "height": 480}}},
        "parameters": {},
    }
    detections = [
        {
            "cameraId": camera,
            "poseId": pose,
            "targetId": 0,
            "featurePoints": [
                {"point": {"x": 10.0 * i + pose, "y": 5.0 * i + camera}, **({"id": i} if ids else {})}
                for i in range(6)
                if not ids or i != pose
            ],
        }
        for camera in range(cameras)
        for pose in range(2)
    ]
    listed = [{"model": {"polymorphic_id": 1, "ptr_wrapper": {"data": one}}} for _ in range(cameras)]
    info = [[{"filePath": f"C:/cam{c}/img{p}.png"} for c in range(cameras)] for p in range(2)]
    inner = {"cameras": listed, "targets": [{"objectPoints": target}], "poses": []}
    return json.dumps({"fileInfo": info, "calibration": inner, "detections": detections})


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
    with pytest.raises(DataError, match="5 corners without ids"):
        read_points(put(tmp_path, "short.json", json.dumps(short)))
