"""`convert` between formats, `--save-camera`, `-o cam.yml`, and foreign files where a camera is asked for."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.data.formats import read
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.report.camera import camera_document
from camcal.report.document import save

RIG = """cam0:
  camera_model: pinhole
  intrinsics: [500.0, 501.0, 320.0, 240.0]
  distortion_model: radtan
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  resolution: [640, 480]
cam1:
  camera_model: omni
  intrinsics: [1.2, 510.0, 511.0, 322.0, 241.0]
  distortion_model: radtan
  distortion_coeffs: [0.01, 0.002, 0.001, -0.002]
  resolution: [640, 480]
  T_cn_cnm1: [[0.0, -1.0, 0.0, -0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
"""


@pytest.fixture
def opencv5(tmp_path):
    lens = lenses.make("opencv5")
    params, size = lens.examples()[0]
    save(camera_document(Camera(lens, np.array(params), size)), tmp_path / "cam.yaml")
    return tmp_path / "cam.yaml"


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_cv2_reads_what_is_written(camcal, opencv5, suffix):
    code, _, err = camcal("convert", opencv5, f"cv.{suffix}")
    assert code == 0 and "reads back within" in err, err
    store = cv2.FileStorage(f"cv.{suffix}", cv2.FILE_STORAGE_READ)
    params = lenses.make("opencv5").examples()[0][0]
    assert store.getNode("camera_matrix").mat()[0, 0] == params[0]
    assert store.getNode("distortion_coefficients").mat().ravel().tolist() == list(params[4:])
    assert camcal("compare", opencv5, f"cv.{suffix}", "--max-px", "1e-9")[0] == 0


def test_terms_without_a_place_are_named_and_refitted(camcal, opencv5):
    code, _, err = camcal("convert", opencv5, "k.yaml", "--to", "kalibr")
    assert code == 2 and "k3" in err and "--to-model" in err
    code, out, err = camcal(
        "convert",
        opencv5,
        "k.yaml",
        "--to",
        "kalibr",
        "--to-model",
        "opencv4",
        "--format",
        "json",
        "--max-px",
        "1",
    )
    assert code == 0, err
    figures = json.loads(out)["conversion"]
    assert 1e-3 < figures["max_px"] < 1 and figures["written"][0]["max_px"] < 1e-9
    code, _, err = camcal(
        "convert", opencv5, "m.yaml", "--to", "kalibr", "--to-model", "opencv4", "--max-px", "1e-4"
    )
    assert code == 4 and "px" in err


def test_a_rig_through_formats(camcal, tmp_path):
    (tmp_path / "chain.yaml").write_text(RIG)
    chain = tmp_path / "chain.yaml"
    code, _, err = camcal("convert", chain, "rig.yaml")
    assert code == 0, err
    rig = yaml.safe_load(Path("rig.yaml").read_text())
    assert list(rig["cameras"]) == ["cam0", "cam1"] and rig["rig"]["reference"] == "cam0"
    assert rig["rig"]["cam_from_rig"]["cam1"]["translation"] == [-0.1, 0.2, 0.3]
    assert camcal("convert", "rig.yaml", "back.yaml", "--to", "kalibr")[0] == 0
    assert camcal("convert", "back.yaml", "{camera}.cameramodel")[0] == 2  # mei has no place in mrcal
    code, _, err = camcal("convert", "back.yaml", "one.yml", "--camera", "cam1")
    assert code == 0, err
    assert camcal("compare", "one.yml", f"{chain}#cam1", "--max-px", "1e-9")[0] == 0
    code, _, err = camcal("compare", chain, "one.yml")
    assert code == 3 and "2 cameras" in err


@pytest.mark.parametrize(
    "args, code, words",
    [
        (["cam.yaml"], 2, "to-model"),
        (["cam.yaml", "x.txt"], 2, "--to FORMAT"),
        (["cam.yaml", "x.yml", "-o", "y.yml"], 2, "both given"),
        (["cam.yaml", "x.yml", "--to", "openvc"], 2, "opencv"),
        (["cam.yaml", "x.yml", "--camera", "left"], 3, "left"),
        (["cam.yaml", "x.yml", "--image-size", "10x10"], 2, "640x480"),
        (["cam.yaml", "cam.yaml"], 2, "exists already"),
    ],
)
def test_refusals(camcal, opencv5, args, code, words):
    args = [opencv5 if a == "cam.yaml" else a for a in args]
    found, out, err = camcal("convert", *args)
    assert (found, out) == (code, "") and words in err


def test_the_main_jobs_write_camera_files(camcal):
    assert camcal("simulate", "points", "--views", "8", "-o", "p.csv")[0] == 0
    options = ("estimate", "p.csv", "--image-size", "640x480", "--no-crosscheck")
    code, _, err = camcal(*options, "-o", "r.yaml", "--save-camera", "cam.xml", "--save-camera", "cam.toml")
    assert code == 0, err
    code, _, err = camcal(*options, "-o", "cam.yml")
    assert code == 0 and "Camera written to cam.yml" in err
    for other in ("cam.xml", "cam.toml", "cam.yml"):
        assert camcal("compare", "r.yaml", other, "--max-px", "1e-9")[0] == 0
    code, _, err = camcal(*options, "-o", "s.yaml", "--save-camera", "cam.dat")
    assert code == 2 and ".dat" in err


def test_evaluate_a_rig(camcal, tmp_path):
    (tmp_path / "chain.yaml").write_text(RIG)
    rig = read(tmp_path / "chain.yaml")
    x, y = np.meshgrid(np.arange(5) * 0.1, np.arange(4) * 0.1)
    xyz = np.c_[x.ravel() - 0.2, y.ravel() - 0.2, 0.05 * np.sin(9 * x.ravel())]
    rows = ["camera,view,X,Y,Z,u,v"]
    for view, t in (("a", [0.0, 0.0, 2.0]), ("b", [0.1, 0.05, 1.5])):
        for named in rig.cameras:
            for p, q in zip(xyz, named.camera.project(named.pose.apply(xyz + t)), strict=True):
                rows.append(",".join([named.name, view, *(repr(float(v)) for v in (*p, *q))]))
    Path("p.csv").write_text("\n".join(rows) + "\n")
    code, out, err = camcal(
        "evaluate", tmp_path / "chain.yaml", "p.csv", "--format", "json", "--robust", "none"
    )
    assert code == 0, err
    found = json.loads(out)
    assert found["fit"]["max"] < 1e-8 and found["fit"]["points_used"] == 80
    assert np.allclose(found["views"][1]["rig_from_board"]["translation"], [0.1, 0.05, 1.5])
    # half a pixel in one camera alone: no pose of the rig takes it up
    moved = [line if "cam1" not in line else _shifted(line, 0.5) for line in rows]
    Path("q.csv").write_text("\n".join(moved) + "\n")
    code, out, _ = camcal(
        "evaluate", tmp_path / "chain.yaml", "q.csv", "--format", "json", "--max-rms", "0.01"
    )
    assert code == 1 and 0.01 < json.loads(out)["fit"]["rms_point"] < 0.5
    Path("r.csv").write_text("\n".join(rows).replace("cam1", "cam7") + "\n")
    code, _, err = camcal("evaluate", tmp_path / "chain.yaml", "r.csv")
    assert code == 3 and "no camera 'cam7'" in err


def _shifted(line, by):
    *head, u, v = line.split(",")
    return ",".join([*head, repr(float(u) + by), v])
