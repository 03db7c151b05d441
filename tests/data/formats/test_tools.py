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


def read(tmp_path, name, text, size=None):
    path = tmp_path / name
    path.write_text(text)
    source = Source(path, image_size=size)
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


PRESET = """import bpy
camera = bpy.context.edit_movieclip.tracking.camera

camera.sensor_width = 36.0
camera.units = 'MILLIMETERS'
camera.focal_length = 24.0
camera.pixel_aspect = 1.5
camera.k1 = -0.1
camera.k2 = 0.02
camera.k3 = 0.0
"""


def test_blender_preset(tmp_path):
    """Blender's own preset: mm, no size, no principal point."""
    path = tmp_path / "phone.py"
    path.write_text(PRESET)
    with pytest.raises(DataError, match="image size"):
        files.read(path)
    (named,) = files.read(path, image_size=(1280, 1080)).cameras
    f = 24 * 1280 / 36
    assert named.camera.values == pytest.approx(
        {"fx": f, "fy": 1.5 * f, "cx": 639.5, "cy": 539.5, "k1": -0.1, "k2": 0.02, "p1": 0, "p2": 0, "k3": 0}
    )


@pytest.mark.parametrize("kind", ["BROWN", "DIVISION", "NUKE"])
def test_blender_distortion(tmp_path, kind):
    """libmv's formulas (distortion_models.h), written out here with y upwards, in square pixels."""
    text = PRESET.replace("1.5", "1.0").replace("camera.k1", "camera.unused_k1")
    f, size, centre = 800.0, (640, 480), (330.0, 250.0)
    names = {
        "BROWN": "brown_k1 brown_k2 brown_k3 brown_k4 brown_p1 brown_p2",
        "DIVISION": "division_k1 division_k2",
    }
    names["NUKE"] = "nuke_k1 nuke_k2 nuke_p1 nuke_p2"
    values = dict(zip(names[kind].split(), (-0.1, 0.02, 0.003, -0.001, 0.004, -0.002), strict=False))
    values |= {"focal_length_pixels": f, "principal_point_pixels": centre, "distortion_model": kind}
    text += "".join(f"camera.{n} = {v!r}\n" for n, v in values.items())
    (named,) = read(tmp_path, "c.py", text, size).cameras
    x, y = np.random.default_rng(2).uniform(-0.3, 0.3, (2, 40))
    r2 = x * x + y * y
    if kind == "BROWN":
        k1, k2, k3, k4, p1, p2 = [values[n] for n in names[kind].split()]
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        xd = x * radial + p1 * (r2 + 2 * x * x) + p2 * 2 * x * y
        yd = y * radial + p2 * (r2 + 2 * y * y) + p1 * 2 * x * y
        u, v = f * xd + centre[0], f * yd + centre[1]
        ideal = (x, y)
    elif kind == "DIVISION":
        below = 1 + values["division_k1"] * r2 + values["division_k2"] * r2**2
        u, v, ideal = f * x / below + centre[0], f * y / below + centre[1], (x, y)
    else:
        k1, k2, p1, p2 = [values[n] for n in names[kind].split()]
        u, v = f * x + centre[0], f * y + centre[1]
        a, b = x * f / 320, y * f / 320
        radial = 1 + k1 * (a * a + b * b) + k2 * (a * a + b * b) ** 2
        ideal = (x / (radial + p1 * b * b), y / (radial + p2 * a * a))
    pixels = np.c_[u - 0.5, size[1] - v - 0.5]
    rays, seen = named.camera.lens.unproject(named.camera.params, pixels)
    assert seen.all()
    assert np.abs(rays[:, :2] / rays[:, 2:] - np.c_[ideal[0], -ideal[1]]).max() < 1e-9
    if kind == "NUKE":
        with pytest.raises(DataError, match="NUKE"):
            files.single(read(tmp_path, "c.py", text, size), "c.py")


XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/">
 <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
  <rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" xcr:Version="3"
   xcr:DistortionModel="brown3t2" xcr:FocalLength35mm="24" xcr:Skew="0" xcr:AspectRatio="1"
   xcr:PrincipalPointU="-0.01" xcr:PrincipalPointV="0.02">
   <xcr:Rotation>0 -1 0 1 0 0 0 0 1</xcr:Rotation>
   <xcr:Position>1 2 3</xcr:Position>
   <xcr:DistortionCoeficients>-0.1 0.02 0.003 0 0.004 -0.002</xcr:DistortionCoeficients>
  </rdf:Description>
 </rdf:RDF>
</x:xmpmeta>
"""


def test_realitycapture(tmp_path):
    with pytest.raises(DataError, match="image size"):
        read(tmp_path, "a.xmp", XMP)
    (named,) = read(tmp_path, "a.xmp", XMP, (3000, 4000)).cameras
    f = 24 / 36 * 4000
    expected = {"fx": f, "fy": f, "cx": 1500 - 40 - 0.5, "cy": 2000 + 80 - 0.5, "k1": -0.1, "k2": 0.02}
    expected |= {"p1": -0.002, "p2": 0.004, "k3": 0.003}
    assert named.camera.values == pytest.approx(expected)
    assert np.allclose(named.pose.apply(np.array([[1.0, 2, 3], [2, 2, 3]])), [[0, 0, 0], [0, 1, 0]])
    for before, after, words in (
        ("brown3t2", "division", "division"),
        ('Skew="0"', 'Skew="0.1"', "skew"),
        ('AspectRatio="1"', 'AspectRatio="1.1"', "aspect"),
    ):
        with pytest.raises(DataError, match=words):
            read(tmp_path, "b.xmp", XMP.replace(before, after), (3000, 4000))


def test_lensfun_takes_the_size_of_the_command_line(tmp_path):
    text = """<lensdatabase><lens><model>m</model><cropfactor>1.5</cropfactor><calibration>
    <distortion model="poly3" focal="50" k1="-0.01"/></calibration></lens></lensdatabase>"""
    (nominal,) = read(tmp_path, "l.xml", text).cameras
    (given,) = read(tmp_path, "l.xml", text, (3000, 2000)).cameras
    assert nominal.camera.image_size == (6000, 4000) and given.camera.image_size == (3000, 2000)
    assert given.camera.params[0] == pytest.approx(nominal.camera.params[0] / 2)


@pytest.mark.parametrize("names", [("extrinsics",), ("rt_cam_ref",), ("extrinsics", "rt_cam_ref")])
def test_mrcal_of_before_and_after_2_5(tmp_path, names):
    """2.5 calls the pose rt_cam_ref and writes the old name beside it; the new one is taken."""
    pose = [0.1, -0.2, 0.3, 1.0, 2.0, 3.0 + 1e-12]
    said = {n: pose if n == names[-1] else [round(v, 9) for v in pose] for n in names}
    text = "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [500, 501, 320, 240], 'imagersize': [640, 480],"
    text += "".join(f"    '{n}': {v!r}, # a comment\n" for n, v in said.items()) + "}\n"
    (named,) = read(tmp_path, "a.cameramodel", text).cameras
    assert np.array_equal(named.pose.translation, pose[3:]) and np.allclose(
        rotations.log(named.pose.rotation), pose[:3]
    )


OST = """# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo/left]

camera matrix
500.000000 0.000000 330.000000
0.000000 502.000000 236.000000
0.000000 0.000000 1.000000

distortion
0.100000 -0.100000 -0.002000 -0.003000 0.000000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
510.000000 0.000000 320.000000 0.000000
0.000000 510.000000 240.000000 0.000000
0.000000 0.000000 1.000000 0.000000

"""


@pytest.mark.parametrize("name", ["ost.txt", "left.ini"])
def test_ros_calibrators_text(tmp_path, name):
    """ost.txt of ROS's cameracalibrator: the camera of the picture, not of the rectified one (projection)."""
    (named,) = read(tmp_path, name, OST).cameras
    assert named.camera.params[:4].tolist() == [500, 502, 330, 236] and named.camera.image_size == (640, 480)
    assert [named.camera.values[n] for n in ("k1", "k2", "p1", "p2")] == [0.1, -0.1, -0.002, -0.003]
