"""`select`, `convert --to-model`, `lens-fit`, `undistort`."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.report.camera import camera_document
from camcal.report.document import save
from camcal.report.loading import load_camera


@pytest.fixture
def kb4(tmp_path):
    lens = lenses.make("kb4")
    params, size = lens.examples()[0]
    save(camera_document(Camera(lens, params, size)), tmp_path / "kb4.yaml")
    return tmp_path / "kb4.yaml"


def test_a_camera_document_reads_back(kb4):
    camera, lens = load_camera(kb4), lenses.make("kb4")
    assert camera.lens == lens and camera.params.tolist() == lens.examples()[0][0].tolist()


def test_convert(camcal, kb4):
    code, out, err = camcal("convert", kb4, "--to-model", "opencv8", "-o", "o.yaml", "--format", "json")
    assert code == 0, err
    figures = json.loads(out)["conversion"]
    assert 0 < figures["rms_px"] < figures["max_px"] < 0.1
    assert load_camera("o.yaml").lens.name == "opencv8"


@pytest.mark.parametrize(
    "args, code, words",
    [
        (["--to-model", "opencv5"], 4, "no camera of model 'opencv5' is within 0.5 px"),
        (["--to-model", "opencv6"], 2, "Did you mean"),
        (["--to-model", "ds", "--max-px", "0.001"], 4, "0.001 px"),
    ],
)
def test_convert_refuses(camcal, kb4, args, code, words):
    found, out, err = camcal("convert", kb4, *args, "-o", "o.yaml")
    assert (found, out) == (code, "")
    assert words in err and not Path("o.yaml").exists()


def write_pairs():
    lens = lenses.make("opencv5")
    params, _ = lens.examples()[0]
    u, v = np.meshgrid(np.linspace(0, 639, 15), np.linspace(0, 479, 12))
    uv = np.c_[u.ravel(), v.ravel()]
    rays, _ = lens.unproject(params, uv)
    np.savetxt(
        "pairs.csv", np.c_[rays[:, :2] / rays[:, 2:], uv], delimiter=",", header="x,y,u,v", comments=""
    )


def test_lens_fit(camcal):
    write_pairs()
    code, out, err = camcal(
        "lens-fit", "pairs.csv", "--model", "polynomial:5", "-o", "o.yaml", "--format", "yaml"
    )
    assert code == 0, err
    fit = yaml.safe_load(out)["lens_fit"]
    assert (
        fit["refined"]["rms_point"] <= fit["direct"]["rms_point"] < 0.1 and fit["refined"]["pairs_lost"] == 0
    )
    assert load_camera("o.yaml").lens.name == "polynomial:5"


@pytest.mark.parametrize(
    "args, code, words",
    [
        (["pairs.csv", "--ideal", "fx=500"], 2, "cx"),
        (["absent.csv"], 3, "absent.csv"),
        (["few.csv", "--model", "bicubic"], 3, "at least 10 pairs"),
    ],
)
def test_lens_fit_refuses(camcal, args, code, words):
    write_pairs()
    Path("few.csv").write_text("x,y,u,v\n0,0,320,240\n.1,0,370,240\n0,.1,320,290\n.1,.1,370,290\n")
    found, _, err = camcal("lens-fit", *args)
    assert found == code and words in err


def test_select(camcal):
    code, _, err = camcal("simulate", "points", "--views", "8", "--model", "opencv4", "-o", "p.csv")
    assert code == 0, err
    code, out, err = camcal(
        "select", "p.csv", "--image-size", "640x480", "--models", "pinhole,opencv4", "--format", "json"
    )
    assert code == 0, err
    made = json.loads(out)
    assert made["chosen"] == "opencv4" and [m["model"] for m in made["models"]] == ["opencv4", "pinhole"]


def test_select_refuses_an_unknown_model(camcal):
    code, _, err = camcal("select", "p.csv", "--models", "opencv4,opencv6")
    assert code == 2 and "opencv6" in err


def test_undistort(camcal, kb4):
    Path("in").mkdir()
    picture = np.full((800, 1280, 3), (10, 120, 230), np.uint8)
    cv2.imwrite("in/a.png", picture)
    cv2.imwrite("in/b.tif", picture[..., 0].astype(np.uint16) * 200)
    Path("in/c.jpg").write_bytes(b"not a picture")
    cv2.imwrite("in/d.png", picture[:100, :100])
    code, _, err = camcal(
        "undistort", "in", "-c", kb4, "-o", "out", "--keep", "no-black", "--size", "320x200"
    )
    assert code == 1 and "c.jpg" in err and "d.png: it is 100x100" in err and "2 of 4" in err
    a, b = cv2.imread("out/a.png"), cv2.imread("out/b.tif", cv2.IMREAD_UNCHANGED)
    assert a.shape == (200, 320, 3) and (a == (10, 120, 230)).all()
    assert b.dtype == np.uint16 and b.shape == (200, 320) and (b == 2000).all()
    assert load_camera("out/camera.yaml").lens.name == "pinhole"
    code, _, err = camcal("undistort", "in/a.png", "-c", kb4, "-o", "out")
    assert code == 2 and "exists" in err


@pytest.mark.parametrize("keep, words", [("200", "at most 160"), ("wide", "no-black")])
def test_undistort_refuses(camcal, kb4, keep, words):
    cv2.imwrite("a.png", np.zeros((800, 1280), np.uint8))
    code, _, err = camcal("undistort", "a.png", "-c", kb4, "-o", "out", "--keep", keep)
    assert code == 2 and words in err and not Path("out").exists()


def test_undistort_writes_maps_alone(camcal, kb4):
    code, out, err = camcal(
        "undistort",
        "-c",
        kb4,
        "-o",
        "out",
        "--size",
        "320x200",
        "--maps",
        "m.npz",
        "--maps",
        "m.exr",
        "--maps",
        "m.pgm",
    )
    assert (code, out) == (0, ""), err
    assert all(Path(name).exists() for name in ("m.npz", "m.exr", "m-x.pgm", "m-y.pgm", "out/camera.yaml"))
    with np.load("m.npz") as maps:
        assert maps["u"].shape == (200, 320)
        crop = yaml.safe_load(Path("out/camera.yaml").read_text())["undistortion"]["crop"]
        assert list(crop.values()) == maps["crop"].tolist()
    assert camcal("undistort", "-c", kb4, "-o", "other", "--maps", "m.npz")[0] == 2  # it exists
    code, _, err = camcal("undistort", "-c", kb4, "-o", "other")
    assert code == 2 and "--maps" in err
