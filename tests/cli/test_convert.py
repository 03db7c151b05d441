"""`convert` between formats, `--save-camera`, `-o cam.yml`, and foreign files where a camera is asked for."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares

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


def test_a_format_with_one_focal_length(camcal, opencv5):
    """fx is not fy: refused by name; refitted with fx = fy, which scipy's least squares confirm to be the closest."""
    code, _, err = camcal("convert", opencv5, "s.json", "--to", "openmvg")
    assert code == 2 and "fx different from fy" in err
    refit = ("--to", "openmvg", "--to-model", "opencv5", "--max-px", "5", "--format", "json")
    code, out, err = camcal("convert", opencv5, "s.json", *refit)
    assert code == 0, err
    rms = json.loads(out)["conversion"]["rms_px"]
    (named,) = read("s.json").cameras
    before, camera = read(opencv5).cameras[0].camera, named.camera
    assert camera.params[0] == camera.params[1]
    u, v = np.meshgrid(np.linspace(0, 639, 41), np.linspace(0, 479, 31))
    pixels = np.c_[u.ravel(), v.ravel()]
    rays = before.unproject(pixels)

    def residuals(p):
        return (Camera(camera.lens, np.r_[p[0], p], camera.image_size).project(rays) - pixels).ravel()

    found = least_squares(residuals, np.r_[camera.params[1:]], x_scale="jac", xtol=1e-14, ftol=1e-14)
    # a regression takes every other pixel of the grid, which costs 0.2 % here
    assert rms == pytest.approx(np.sqrt((found.fun**2).sum() / len(pixels)), rel=5e-3)


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
        (["cam.yaml", "x.yml", "-o", "y.yml"], 2, "both DST and --output"),
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


def test_every_suffix_of_a_result_is_opencvs_file(camcal):
    """`-o cam.yml`, `.xml`, `.json` of the main jobs and of `convert`, and `--to opencv` under .yaml, read by cv2.

    The storage is kept in a variable while its nodes are read: cv2 raises where it is a temporary, of files that it
    wrote itself too (the next test).
    """
    assert camcal("simulate", "points", "--views", "6", "-o", "p.csv")[0] == 0
    estimate = ("estimate", "p.csv", "--image-size", "640x480", "-m", "opencv5", "--no-crosscheck", "-o")
    assert camcal(*estimate, "cam.yaml")[0] == 0
    written = {
        n: p["value"] for n, p in yaml.safe_load(Path("cam.yaml").read_text())["camera"]["parameters"].items()
    }
    for suffix in ("yml", "xml", "json"):
        assert camcal(*estimate, f"cam.{suffix}")[0] == 0
        assert camcal("convert", "cam.yaml", f"converted.{suffix}")[0] == 0
    assert camcal("convert", "cam.yaml", "other.yaml", "--to", "opencv")[0] == 0
    names = [f"{a}.{s}" for a in ("cam", "converted") for s in ("yml", "xml", "json")] + ["other.yaml"]
    for name in names:
        store = cv2.FileStorage(name, cv2.FILE_STORAGE_READ)
        matrix, bend = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat()
        found = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *bend.ravel()]
        assert np.allclose(
            found, [written[n] for n in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")], atol=1e-9
        )


def test_a_storage_that_is_not_kept_is_a_fault_of_the_caller(tmp_path):
    """Of a file that cv2 itself wrote: the nodes of a storage end with it (seen in 4.10, 4.12, 4.14, 5.0 and 5.1)."""
    path = str(tmp_path / "own.yml")
    store = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    store.write("camera_matrix", np.eye(3))
    store.release()
    with pytest.raises(cv2.error, match="blockIdx"):
        cv2.FileStorage(path, cv2.FILE_STORAGE_READ).getNode("camera_matrix").mat()
    kept = cv2.FileStorage(path, cv2.FILE_STORAGE_READ)
    assert np.array_equal(kept.getNode("camera_matrix").mat(), np.eye(3))
