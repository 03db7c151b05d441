"""`camcal rectify` and `camcal evaluate --natural` on simulated pictures of a textured wall."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.data.formats import read, write
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.points import read_points
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.shared_data import DATA, needs_data

SIZE = (320, 240)
LENS = lenses.make("opencv5")
VALUES = {"fx": 260.0, "fy": 260.0, "cx": 160.0, "cy": 118.0, "k1": -0.2}
CAMERA = Camera(LENS, LENS.from_values(VALUES), SIZE)
POSE = Pose.from_vector(np.array([0.01, 0.03, -0.02]), np.array([-60.0, 1, 2]))


def picture(pose):
    """A tilted wall of blurred noise, 1000 units away, seen by a camera at cam_from_world."""
    texture = np.random.default_rng(3).uniform(0, 255, (900, 1200)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(texture, (0, 0), 2.5), None, 0, 255, cv2.NORM_MINMAX)
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    rays = CAMERA.unproject(np.stack([u, v], -1)) @ pose.rotation
    normal, centre = np.array([0.3, 0.1, -1.0]), pose.centre
    depth = (-1000 - centre @ normal) / (rays @ normal)
    xyz = centre + rays * depth[..., None]
    x, y = (xyz[..., 0] / 1.5 + 600).astype(np.float32), (xyz[..., 1] / 1.5 + 450).astype(np.float32)
    return cv2.remap(texture, x, y, cv2.INTER_CUBIC).astype(np.uint8)


@pytest.fixture
def rig():
    """rig.yml, left.png and right.png in the folder of the test."""
    cameras = (
        NamedCamera("left", CAMERA, Pose.identity()),
        NamedCamera("right", CAMERA, POSE),
    )
    write("rig.yml", CameraFile(cameras))
    cv2.imwrite("left.png", picture(Pose.identity()))
    cv2.imwrite("right.png", picture(POSE))
    return "rig.yml"


def test_rectify(camcal, rig):
    code, out, err = camcal(
        "rectify", rig, "left=left.png", "right=right.png", "-o", "out", "--format", "json"
    )
    assert code == 0, err
    assert sorted(p.name for p in Path("out").iterdir()) == [
        "left.png", "maps.npz", "rectification.yaml", "right.png", "rows-1.png",
    ]  # fmt: skip
    made = json.loads(out)["rectification"]
    assert made["cameras"] == ["left", "right"] and made["direction"] == "horizontal"
    assert made["baseline"] == pytest.approx(np.linalg.norm(POSE.translation))
    # cv2 reads the matrices, and remaps by the maps to the same picture
    stored = cv2.FileStorage("out/rectification.yaml", cv2.FILE_STORAGE_READ)
    for name in ("R1", "R2", "P1", "P2", "Q"):
        np.testing.assert_allclose(stored.getNode(name).mat(), made[name])
    assert stored.getNode("alpha").real() == 0 and stored.getNode("first").string() == "left"
    maps = np.load("out/maps.npz")
    again = cv2.remap(cv2.imread("left.png", 0), maps["left_u"], maps["left_v"], cv2.INTER_LINEAR)
    shown = maps["left_u"] != -1
    written = cv2.imread("out/left.png", 0)
    assert np.abs(again.astype(int) - written)[shown & (maps["left_u"] > 1) & (maps["left_v"] > 1)].max() <= 1
    # rows of the pictures agree: those of the right one moved along the row only
    flow = cv2.calcOpticalFlowFarneback(
        written, cv2.imread("out/right.png", 0), None, 0.5, 4, 25, 5, 7, 1.5, 0
    )
    middle = flow[60:180, 60:260]
    assert np.median(np.abs(middle[..., 1])) < 0.1 and np.median(middle[..., 0]) < -5
    assert cv2.imread("out/rows-1.png").shape == (240, 640, 3)


def test_the_order_of_the_names_does_not_matter(camcal, rig):
    made = []
    for i, words in enumerate((["left=left.png", "right=right.png"], ["right=right.png", "left=left.png"])):
        code, out, _ = camcal("rectify", rig, *words, "-o", f"out{i}", "--format", "json")
        assert code == 0
        made.append(json.loads(out)["rectification"])
    assert {**made[0], "files": None} == {**made[1], "files": None}


def test_folders_of_pictures(camcal, rig):
    for side in ("left", "right"):
        Path(side).mkdir()
        for i in (1, 2):
            Path(side, f"{side}0{i}.png").write_bytes(Path(f"{side}.png").read_bytes())
    assert camcal("rectify", rig, "left=left", "right=right", "-o", "out", "--alpha", "0")[0] == 0
    names = {p.name for p in Path("out").glob("*.png")}
    assert names == {"left01.png", "left02.png", "right01.png", "right02.png", "rows-01.png", "rows-02.png"}
    assert not (cv2.imread("out/left01.png", 0) == 0).all(0).any()
    code, _, err = camcal("rectify", rig, "left=left", "right=right", "-o", "out")
    assert code == 2 and "--force" in err
    Path("left/left01.png").unlink()
    code, _, err = camcal("rectify", rig, "left=left", "right=right", "-o", "other")
    assert code == 3 and "'left' has 1 picture and 'right' 2" in err and not Path("other").exists()


def test_natural(camcal, rig):
    code, out, err = camcal(
        "evaluate", rig, "--natural", "left=left.png", "right=right.png", "--format", "json", "-o", "n.yaml"
    )
    assert code == 0, err
    found = json.loads(out)
    assert found["natural"] == yaml.safe_load(Path("n.yaml").read_text())["natural"]
    made = found["natural"]
    assert made["matches"] > 100 and made["found"] >= made["matches"]
    # pictures without noise, resampled once: hundredths of a px
    assert made["vertical_disparity"]["median"] < 0.05 and found["warnings"] == []
    assert made["pairs"][0]["left"] == "left.png" and made["pairs"][0]["disparity"]["least"] > 0


def test_natural_finds_a_camera_that_was_knocked(camcal, rig):
    """A twentieth of a degree: 0.23 px."""
    known = read(rig)
    knocked = Pose.from_vector(np.radians([0.05, 0, 0]), np.zeros(3)) @ POSE
    write("knocked.yml", CameraFile((known.cameras[0], NamedCamera("right", CAMERA, knocked))))
    words = ("--natural", "left=left.png", "right=right.png", "--format", "json")
    code, out, err = camcal("evaluate", "knocked.yml", *words, "--max-rms", "0.15")
    found = json.loads(out)
    assert code == 1 and "vertical disparity" in err and found["verdict"] == "fail"
    assert [w["code"] for w in found["warnings"]] == ["vertical-disparity"]
    # f = 260 px; the file has the right camera look down by 0.05 degrees: v of its rays is too large, left less right
    # is negative
    mean = found["natural"]["vertical_disparity"]["mean"]
    assert mean == pytest.approx(-260 * np.radians(0.05), rel=0.15)
    turn = found["natural"]["turn"]  # the file is off by the opposite of what the camera has turned
    assert turn["camera"] == "right" and turn["median_after"] < 0.05
    assert np.subtract(turn["rotation_vector_deg"], [-0.05, 0, 0]) == pytest.approx(0, abs=0.01)
    assert "Rotating right by 0.0" in found["warnings"][0]["hint"]
    assert camcal("evaluate", "knocked.yml", *words, "--max-rms", "0.4")[0] == 0
    assert camcal("evaluate", "knocked.yml", *words, "--fail-on", "doubtful")[0] == 1
    assert camcal("evaluate", rig, *words, "--fail-on", "doubtful")[0] == 0


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["left=left.png"], 2, "NAME=PICTURES each"),
        (["left=left.png", "top=right.png"], 3, "has no camera 'top'"),
        (["left=left.png", "right=absent.png"], 3, "no file or folder 'absent.png'"),
        (
            ["left=left.png", "right=small.png"],
            3,
            "the picture is 32x24, the camera was calibrated for 320x240",
        ),
    ],
)
def test_what_is_refused(camcal, rig, words, code, said):
    cv2.imwrite("small.png", np.zeros((24, 32), np.uint8))
    found, _, err = camcal("rectify", rig, *words, "-o", "out")
    assert found == code and said in err


def test_exports_hold_the_rectification(camcal, rig):
    assert camcal("convert", rig, "pair.yml")[0] == 0
    stored = cv2.FileStorage("pair.yml", cv2.FILE_STORAGE_READ)
    p2 = stored.getNode("P2").mat()
    k, d = CAMERA.opencv()
    theirs = cv2.stereoRectify(k, d, k, d, SIZE, POSE.rotation, POSE.translation.reshape(3, 1))
    np.testing.assert_allclose(stored.getNode("R1").mat(), theirs[0], atol=1e-12)
    assert p2[0, 3] / p2[0, 0] == pytest.approx(-np.linalg.norm(POSE.translation))
    assert stored.getNode("Q").mat().shape == (4, 4)
    code, _, err = camcal("convert", rig, "{camera}.yaml", "--to", "ros")
    assert code == 0 and "R and P hold the rectification" in err
    right = yaml.safe_load(Path("right.yaml").read_text())
    np.testing.assert_allclose(np.reshape(right["projection_matrix"]["data"], (3, 4)), p2)
    np.testing.assert_allclose(
        np.reshape(right["rectification_matrix"]["data"], (3, 3)), theirs[1], atol=1e-12
    )
    # one camera by itself has none
    assert camcal("convert", "right.yaml", "alone.yaml", "--to", "ros")[0] == 0
    alone = yaml.safe_load(Path("alone.yaml").read_text())
    assert alone["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()


@needs_data
def test_rows_of_a_real_pair_agree(camcal):
    """By camcal's corners, .15 px as for cv2's own rectification of all 13 pairs (.14).

    cv2.findChessboardCornersSB takes the border of the board for a column of corners in the right picture of pair 04,
    or not, as the focal length of the rectified pictures changes by 1e-6 of itself; so it is no judge of rows.
    """
    folders = [f"{side}={DATA}/opencv_{side}" for side in ("left", "right")]
    assert camcal("rig", *folders, "--square", "30mm", "-m", "opencv5", "-o", "rig.yaml", "-q")[0] in (0, 1)
    rows = []
    for n in ("01", "04", "09", "14"):
        pair = [f"{side}={DATA}/opencv_{side}/{side}{n}.jpg" for side in ("left", "right")]
        assert camcal("rectify", "rig.yaml", *pair, "-o", f"out{n}")[0] == 0
        found = []
        for side in ("left", "right"):
            assert camcal("detect", f"out{n}/{side}{n}.jpg", "--board", "9x6", "-o", f"{side}{n}.csv")[0] == 0
            found.append(read_points(f"{side}{n}.csv").uv)
        left, right = found
        if (left[-1] - left[0]) @ (right[-1] - right[0]) < 0:
            right = right[::-1]
        rows.append(left[:, 1] - right[:, 1])
    assert np.sqrt(np.mean(np.concatenate(rows) ** 2)) < 0.15
