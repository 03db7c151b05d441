"""Small files of points as other programs write them, for the tests of their readers and for damage."""

import io
import json
import struct

import numpy as np
from scipy.io import savemat

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


BOARD = np.array([[0.0, 1, 2, 0, 1, 2], [0, 0, 0, 1, 1, 1]]) * 0.03


def tartan_pictures():
    """Pixels (2, N) and 1-based numbers of points of three pictures; the last one sees a single point."""
    rng = np.random.default_rng(7)
    numbers = [np.array([1, 2, 3, 6]), np.array([4, 5, 6]), np.array([2])]
    return [(rng.uniform(10, 500, (2, len(n))), n) for n in numbers]


def mat(**variables):
    """The bytes of a .mat."""
    out = io.BytesIO()
    savemat(out, variables)
    return out.getvalue()


def tartan_corners():
    """corners.mat as TartanCalib writes it."""
    return mat(corners=[{"x": x, "cspond": np.stack([n, np.ones(len(n))])} for x, n in tartan_pictures()])


def tartan_board():
    """board.mat as TartanCalib writes it."""
    return mat(boards={"Rt": np.eye(3, 4), "X": BOARD})


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


GCP = "EPSG:32633\n" + "".join(f"1 2 3 4 5 {p}.jpg\n2 3 4 5 6 {p}.jpg gcp2\n" for p in "abc")
PHOTONVISION = {
    "resolution": {"width": 640.0, "height": 480.0},
    "observations": [
        {
            "locationInObjectSpace": [{"x": 0.1 * i, "y": 0.0, "z": 0.0} for i in range(3)],
            "locationInImageSpace": [{"x": 10.0 * i, "y": 4.0} for i in range(3)],
            "snapshotName": "img7.png",
        }
    ],
}
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
board_width: 3
board_height: 2
square_size: 25.
image_points: !!opencv-matrix
   rows: 2
   cols: 6
   dt: "2f"
   data: [ 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12. ]
"""
VNL = "# filename x y level\n" + "".join(
    f"a.jpg {10 * i} {20 * j} 0\n" if (i, j) != (1, 1) else "a.jpg - - -\n"
    for j in range(2)
    for i in range(3)
)


def samples():
    """For each reader of `POINT_FILES`: the name of a file, its content, and what stands beside it."""
    return {
        "vnl": ("points.vnl", VNL.encode(), {}),
        "orpc": ("a.orpc", ORPC.encode(), {"cube.dsc": dsc().encode(), "cube.tp": TP.encode()}),
        "tartan": ("corners.mat", tartan_corners(), {"board.mat": tartan_board()}),
        "tartan-dataset": ("dataset.bin", dataset(tartan_pictures()), {}),
        "calibio": ("project.json", calibio(cameras=1).encode(), {}),
        "photonvision": ("photonvision.json", json.dumps(PHOTONVISION).encode(), {}),
        "opencv": ("sample.yml", OPENCV.encode(), {}),
        "gcp": ("gcp_list.txt", GCP.encode(), {}),
        "photomodeler": ("export.txt", photomodeler(MARKS).encode(), {}),
    }
