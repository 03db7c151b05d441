"""Formats of tools without a reader that installs here: files as their owners document them."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.formats import files
from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.pose import Pose

USD = """#usda 1.0
def Camera "Left" (
    prepend apiSchemas = ["OmniLensDistortionOpenCvPinholeAPI"]
)
{
    token omni:lensdistortion:model = "opencvPinhole"
    float omni:lensdistortion:opencvPinhole:cx = 1024
    float omni:lensdistortion:opencvPinhole:cy = 512
    float omni:lensdistortion:opencvPinhole:fx = 900
    float omni:lensdistortion:opencvPinhole:fy = 800
    int2 omni:lensdistortion:opencvPinhole:imageSize = (2048, 1024)
    float omni:lensdistortion:opencvPinhole:k1 = -0.1
}
"""
LENSFUN = """<lensdatabase version="2"><lens><maker>M</maker><model>Zoom</model><mount>Generic</mount>
<cropfactor>1.531</cropfactor><calibration>
<distortion model="ptlens" focal="24" a="0.00094" b="-0.00031" c="-0.02187"/>
<distortion model="poly3" focal="50" k1="-0.01"/>
</calibration></lens></lensdatabase>"""


def read(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    source = Source(path)
    return files.parsed(files.recognised(source), source)


def test_usd(tmp_path):
    (named,) = read(tmp_path, "a.usda", USD).cameras
    assert named.name == "Left" and named.camera.image_size == (2048, 1024)
    assert named.camera.values["fy"] == 800 and named.camera.values["k1"] == -0.1
    with pytest.raises(DataError, match="no lens-distortion schema"):
        read(tmp_path, "b.usda", '#usda 1.0\ndef Camera "x"\n{\n    float focalLength = 50\n}\n')
    with pytest.raises(DataError, match="unknown lens-distortion model 'ftheta'"):
        read(tmp_path, "c.usda", USD.replace('"opencvPinhole"', '"ftheta"'))


def test_lensfun(tmp_path):
    """The radius of a point by the owner's formula; the focal length of a sensor of that crop factor."""
    found = read(tmp_path, "a.xml", LENSFUN)
    ptlens, poly3 = (n.camera for n in found.cameras)
    assert [n.name for n in found.cameras] == ["Zoom 24mm", "Zoom 50mm"] and found.notes
    short = np.hypot(36, 24) / 1.531 / np.hypot(1, 1.5)  # mm
    half = 2000.0  # px of half the shorter side, of 6000 x 4000
    for camera, focal, bent in (
        (
            ptlens,
            24,
            lambda r: r * (0.00094 * r**3 - 0.00031 * r**2 - 0.02187 * r + 1 - 0.00094 + 0.00031 + 0.02187),
        ),
        (poly3, 50, lambda r: r * (1 + 0.01 - 0.01 * r**2)),
    ):
        r = np.linspace(0.05, 1.6, 20)
        tangent = r * short / 2 / focal
        uv = np.c_[2999.5 + half * bent(r), np.full(20, 1999.5)]
        rays, good = camera.lens.unproject(camera.params, uv)
        assert good.all()
        np.testing.assert_allclose(rays[:, 0] / rays[:, 2], tangent, rtol=1e-9)


def test_gyroflow(tmp_path):
    text = (
        '{"name": "x", "calib_dimension": {"w": 2704, "h": 1520}, "fisheye_params": {"RMS_error": 0.5, "camera_matrix":'
        ' [[1186.5, 0, 1352.1], [0, 1187.0, 760.3], [0, 0, 1]], "distortion_coeffs": [0.05, 0.01, -0.02, 0.003]}}'
    )
    (named,) = read(tmp_path, "a.json", text).cameras
    assert named.camera.lens.name == "kb4" and named.camera.values["k4"] == 0.003
    with pytest.raises(DataError, match="unknown distortion_model"):
        read(tmp_path, "b.json", text.replace('"name"', '"distortion_model": "gopro_superview", "name"'))


def test_numbers_of_a_dlt_file_come_back_to_the_last_bit(tmp_path):
    """Programs of a laboratory hold the same file, and compare it."""
    rng = np.random.default_rng(5)
    cameras = []
    for _ in range(3):
        turn = rotations.exp(rng.uniform(-1, 1, 3))
        p = np.array([[1400.0, 0, 960], [0, 1400, 540], [0, 0, 1]]) @ np.c_[turn, [0.3, -0.2, 4.0]]
        cameras.append((p / p[2, 3]).ravel()[:11])
    text = "".join(",".join(repr(float(x)) for x in row) + "\n" for row in np.transpose(cameras))
    found = read(tmp_path, "dlt.csv", text)
    form = files.named_format("dlt")
    assert files.rendered(form, found, tmp_path / "again.csv").content == text
    moved = replace(found.cameras[0], pose=Pose(np.eye(3), np.array([0.0, 0, 5])))
    other = replace(found, cameras=(moved, *found.cameras[1:]))
    assert (
        files.rendered(form, other, tmp_path / "again.csv").content != text
    )  # not the numbers of another camera
