"""Recognising, checking and choosing; what is hostile ends in one line."""

import re

import numpy as np
import pytest

from camcal.data.formats import files, format_of, read
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.source import Source
from camcal.errors import CamcalError, DataError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose

OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 501., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.02, 1e-3, -2e-3, 0.003 ]
"""
CHAIN = """cam0:
  camera_model: pinhole
  intrinsics: [500.0, 501.0, 320.0, 240.0]
  distortion_model: radtan
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  resolution: [640, 480]
cam1:
  camera_model: pinhole
  intrinsics: [510.0, 511.0, 322.0, 241.0]
  distortion_model: equidistant
  distortion_coeffs: [0.01, 0.002, 0.001, -0.002]
  resolution: [640, 480]
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
"""


def put(tmp_path, text, name="camera.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_opencv_by_content(tmp_path):
    found = read(put(tmp_path, OPENCV))
    assert found.names == ["camera"] and found.cameras[0].camera.lens.name == "opencv5"
    assert found.cameras[0].camera.values["k3"] == 0.003


@pytest.mark.parametrize(
    "coefficients, more, lens",
    [
        ("[0.1, 0.02, 1e-3, 2e-3]", "", "opencv4"),
        ("[0.1, 0.02, 1e-3, 2e-3]", "fisheye_model: 1\n", "kb4"),
        ("[0.1, 0.02, 1e-3, 2e-3]", "xi: 1.2\n", "mei"),
        ("[]", "", "pinhole"),
    ],
)
def test_opencv_models(tmp_path, coefficients, more, lens):
    text = f"K: [[500, 0, 320], [0, 500, 240], [0, 0, 1]]\nD: {coefficients}\n{more}"
    assert read(put(tmp_path, text)).cameras[0].camera.lens.name == lens


def test_a_rig_needs_a_name(tmp_path):
    path = put(tmp_path, CHAIN)
    rig = read(path)
    assert rig.names == ["cam0", "cam1"] and rig.has_poses
    assert rig.cameras[1].pose.translation.tolist() == [-0.1, 0, 0]
    with pytest.raises(DataError, match="2 cameras") as error:
        files.single(rig, str(path))
    assert "#cam0" in error.value.hint
    assert files.single(read(f"{path}#cam1"), str(path)).lens.name == "kb4"
    with pytest.raises(DataError, match="no camera 'cam2'"):
        read(f"{path}#cam2")


def test_the_same_camera_many_times_is_one_camera():
    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(500, 500, 300, 200), (640, 480))
    shots = CameraFile((NamedCamera("a.jpg", camera), NamedCamera("b.jpg", camera)))
    assert files.single(shots, "x") is camera


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("a.yaml", OPENCV.replace("0.003 ]", ".nan ]"), "not finite"),
        ("a.yaml", OPENCV.replace("500.,", "-500.,"), "fx = -500"),
        ("a.yaml", OPENCV.replace("0.003 ]", "0.003, 1. ]"), "6 distortion coefficients"),
        ("a.yaml", OPENCV.replace("640", "-640"), "-640"),
        ("a.yaml", CHAIN.replace("radtan", "wobbly"), "wobbly"),
        ("a.yaml", CHAIN.replace("1.0, 0.0, 0.0, -0.1", "2.0, 0.0, 0.0, -0.1"), "rotation"),
        ("a.yaml", CHAIN.replace("[1.0, 0.0, 0.0, -0.1]", "[-1.0, 0.0, 0.0, -0.1]"), "rotation"),
        ("a.yaml", "a: &x [1, 2]\nb: &y [*x, *x]\nc: [*y, *y]\n", "aliases"),
        ("a.yaml", "a: " + "[" * 100 + "]" * 100, "nested"),
        ("a.json", '{"a": ' + "[" * 100000, "JSON"),
        ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "entities"),
        ("a.xml", "<a>" * 500 + "</a>" * 500, "nested"),
        ("a.xml", "<a", "XML"),
        ("a.toml", "[a", "TOML"),
        ("a.txt", "", "no camera"),
        ("a.txt", "1 OPENCV 640 480 800 801\n", "numbers"),
        ("a.txt", "1 NOSUCH 640 480 800 801 1\n", "NOSUCH"),
        (
            "a.cameramodel",
            "{'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': __import__('os').getcwd()}",
            "literal",
        ),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': " + "(" * 3000, "literal"),
    ],
)
def test_bad_files_end_in_one_line(tmp_path, name, text, words):
    with pytest.raises(DataError, match=re.escape(words)) as error:
        read(put(tmp_path, text, name))
    assert "\n" not in error.value.message and error.value.hint
    assert name in error.value.message


def test_what_is_no_file(tmp_path):
    with pytest.raises(DataError, match="there is no file"):
        read(tmp_path / "absent.yaml")
    with pytest.raises(DataError, match="folder"):
        read(tmp_path)
    with pytest.raises(DataError, match="regular file"):
        read("/dev/zero")


@pytest.mark.parametrize(
    "name, form", [("a.yml", "opencv"), ("a.YAML", "camcal"), ("a.m", "bouguet"), ("a.txt", None)]
)
def test_the_ending_says_the_format(name, form):
    assert format_of(name) == form


def test_writing(tmp_path):
    lens = lenses.make("opencv4")
    cameras = CameraFile(
        tuple(
            NamedCamera(
                n,
                Camera(lens, np.array([500.0, 501, 320, 240, -0.1, 0, 0, k]), (640, 480)),
                Pose(np.eye(3), np.array([i, 0, 0.0])),
            )
            for i, (n, k) in enumerate((("left", 0.0), ("right", 0.001)))
        )
    )
    gaps = files.write(tmp_path / "{camera}.yml", cameras)
    assert [p.rpartition("/")[2] for p in gaps] == ["left.yml", "right.yml"]
    assert all(gap.max_px < 1e-9 for gap in gaps.values())
    with pytest.raises(UsageError, match="exists already"):
        files.write(tmp_path / "left.yml", cameras)
    with pytest.raises(UsageError, match="extension"):
        files.write(tmp_path / "left.txt", cameras)
    with pytest.raises(UsageError, match="ROS camera_info holds one camera") as error:
        files.write(tmp_path / "x.yaml", cameras, "ros")
    assert "{camera}" in error.value.hint
    files.write(tmp_path / "stereo.yml", cameras)
    assert read(tmp_path / "stereo.yml").cameras[1].pose.translation.tolist() == [1, 0, 0]
    files.write(tmp_path / "cameras.txt", cameras, "colmap")
    assert "CAMERA 2 1" in (tmp_path / "rigs.txt").read_text()
    assert read(tmp_path / "cameras.txt").cameras[1].pose.translation.tolist() == [1, 0, 0]


def test_every_error_of_a_reader_names_the_file():
    for form in files.formats():
        for data in (b"{}", b"[1]", b"<a/>", b"a: 1", b"\x00\x01", b""):
            with pytest.raises(CamcalError, match=r"odd\.yaml"):
                files.parsed(form, Source(__import__("pathlib").Path("odd.yaml"), data))
