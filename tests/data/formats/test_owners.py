"""What camcal writes, read by the programs that own the formats, where they are installed: `pytest -m slow`.

Owners in another environment are found through CAMCAL_OWNERS, the Python interpreter that has them; other versions of
OpenCV through CAMCAL_CV2, interpreters separated by `:`.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.data.formats import files
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.foreign import ForeignCamera
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose

pytestmark = pytest.mark.slow
OWNERS = os.environ.get("CAMCAL_OWNERS", sys.executable)
SYSTEM = shutil.which("python3", path="/usr/bin") or sys.executable
#: px
SAME = 1e-6


def camera_of(spec, square=False):
    lens = lenses.make(spec)
    params, size = lens.examples()[0]
    params = np.array(params, float)
    params[1] = params[0] if square else params[1]
    return Camera(lens, params, size)


def rays_of(camera):
    """Rays (N, 3) over the picture and their pixels."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(5, width - 6, 9), np.linspace(5, height - 6, 7))
    uv = np.c_[u.ravel(), v.ravel()]
    rays = camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    return rays[seen] * np.linspace(1, 3, seen.sum())[:, None], uv[seen]


def ask(python, script, *arguments, stdin=None):
    """What a script of an owner's prints as JSON; skipped where the owner is not there."""
    words = [python, "-c", script, *map(str, arguments)]
    done = subprocess.run(words, input=stdin, capture_output=True, text=True, timeout=300, check=False)
    if "ModuleNotFoundError" in done.stderr:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.strip().splitlines()[-1])


PYCOLMAP = """
import sys, json, pycolmap
from pathlib import Path
scene = pycolmap.Reconstruction()
folder = sys.argv[1]
(scene.read_text if sys.argv[2] == ".txt" else scene.read_binary)(folder)
camera = next(iter(scene.cameras.values()))
print(json.dumps([camera.img_from_cam(p).ravel().tolist() for p in json.loads(sys.stdin.read())]))
"""


@pytest.mark.parametrize("suffix", [".txt", ".bin"])
@pytest.mark.parametrize(
    "spec",
    [
        "pinhole",
        "opencv4",
        "opencv5",
        "opencv8",
        "kb4",
        "fov",
        "division:1",
        "kb:2",
        "brown:radial=1,decentering=0",
    ],
)
def test_pycolmap(tmp_path, spec, suffix):
    camera = camera_of(spec, square=spec in ("kb:2", "brown:radial=1,decentering=0"))
    files.write(tmp_path / f"cameras{suffix}", CameraFile.one(camera), "colmap")
    for name in ("images", "points3D", "rigs", "frames"):
        (tmp_path / f"{name}{suffix}").write_bytes(b"" if suffix == ".txt" else bytes(8))
    for name in ("rigs", "frames"):
        (tmp_path / f"{name}{suffix}").unlink()
    rays, uv = rays_of(camera)
    if spec in (
        "pinhole",
        "opencv4",
        "opencv5",
        "opencv8",
        "fov",
        "division:1",
        "brown:radial=1,decentering=0",
    ):
        rays, uv = rays[rays[:, 2] > 0.2], uv[rays[:, 2] > 0.2]
    got = np.array(ask(OWNERS, PYCOLMAP, tmp_path, suffix, stdin=json.dumps(rays.tolist())))
    assert np.abs(got - 0.5 - uv).max() < SAME


ROUND = """
import sys, json, pycolmap, numpy as np
camera = pycolmap.Camera(model=sys.argv[1], width=640, height=480, params=json.loads(sys.argv[2]))
print(json.dumps([camera.cam_ray_from_img(np.array(p)).ravel().tolist() if hasattr(camera, "cam_ray_from_img")
                  else np.append(camera.cam_from_img(np.array(p)), 1).tolist() for p in json.loads(sys.stdin.read())]))
"""


@pytest.mark.parametrize(
    "model, params",
    [
        (
            "THIN_PRISM_FISHEYE",
            [400, 401, 320, 240, 0.01, -0.02, 0.001, -0.001, 0.003, -0.001, 0.0005, -0.0004],
        ),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE",
            [400, 401, 320, 240, *[0.01, -0.003, 0.001, 0, 0, 0], 1e-3, -2e-3, 1e-3, 2e-3, -1e-3, 1e-3],
        ),
    ],
)
def test_pycolmap_models_that_are_refitted(tmp_path, model, params):
    path = tmp_path / "cameras.txt"
    path.write_text(f"1 {model} 640 480 {' '.join(map(repr, map(float, params)))}\n")
    camera = files.read(path).cameras[0].camera
    assert isinstance(camera, ForeignCamera)
    uv = np.array([[320.0, 240], [5, 5], [600, 30], [100, 400]])
    rays, seen = camera.lens.unproject(None, uv)
    theirs = np.array(ask(OWNERS, ROUND, model, json.dumps(params), stdin=json.dumps((uv + 0.5).tolist())))
    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
    assert seen.all() and np.abs(rays - theirs).max() < 1e-8


RIG = """
import sys, json, pycolmap
scene = pycolmap.Reconstruction()
scene.read_text(sys.argv[1])
(rig,) = scene.rigs.values()
(other,) = [s for s in rig.sensor_ids() if s != rig.ref_sensor_id]
print(json.dumps([rig.ref_sensor_id.id, other.id, rig.sensor_from_rig(other).matrix().tolist()]))
"""


def test_pycolmap_reads_the_rig(tmp_path):
    turn = Pose(rotations.exp(np.array([0.01, 0.2, -0.02])), np.array([-0.1, 0.0, 0.01]))
    camera = camera_of("opencv4")
    files.write(
        tmp_path / "cameras.txt",
        CameraFile((NamedCamera("left", camera, Pose.identity()), NamedCamera("right", camera, turn))),
        "colmap",
    )
    for name in ("images", "points3D", "frames"):
        (tmp_path / f"{name}.txt").write_text("")
    first, second, pose = ask(OWNERS, RIG, tmp_path)
    assert (first, second) == (1, 2)
    assert np.abs(np.array(pose) - np.c_[turn.rotation, turn.translation]).max() < 1e-12


OPENUSD = """
import sys, json
from pxr import Usd
stage = Usd.Stage.Open(sys.argv[1])
(camera,) = [p for p in stage.Traverse() if p.GetTypeName() == "Camera"]
name = "omni:lensdistortion:opencvPinhole:"
values = {a.GetName().removeprefix(name): a.Get() for a in camera.GetAttributes() if a.GetName().startswith(name)}
print(json.dumps({n: list(v) if n == "imageSize" else v for n, v in values.items()}))
"""


def test_openusd(tmp_path):
    """OpenUSD keeps these attributes in single precision."""
    camera = camera_of("opencv12")
    files.write(tmp_path / "camera.usda", CameraFile.one(camera))
    found = ask(OWNERS, OPENUSD, tmp_path / "camera.usda")
    assert found.pop("imageSize") == list(camera.image_size)
    for name, value in camera.values.items():
        assert found[name] == pytest.approx(value, rel=1e-6, abs=1e-9)


MRCAL = """
import sys, json, mrcal, numpy as np
model = mrcal.cameramodel(sys.argv[1])
points = np.array(json.loads(sys.stdin.read()))
print(json.dumps([mrcal.project(points, *model.intrinsics()).tolist(), model.extrinsics_rt_fromref().tolist()
                  if not callable(getattr(model, "rt_cam_ref", None)) else model.rt_cam_ref().tolist()]))
"""


#: mrcal of the system's packages, and of a wheel
BOTH = pytest.mark.parametrize("python", [SYSTEM, OWNERS], ids=["system", "owners"])


@BOTH
@pytest.mark.parametrize("spec", ["pinhole", "opencv4", "opencv5", "opencv8", "opencv12"])
def test_mrcal(tmp_path, spec, python):
    camera = camera_of(spec)
    pose = Pose(rotations.exp(np.array([0.1, -0.2, 0.3])), np.array([1.0, 2.0, -3.0]))
    files.write(tmp_path / "a.cameramodel", CameraFile((NamedCamera("a", camera, pose),)))
    rays, uv = rays_of(camera)
    got, rt = ask(python, MRCAL, tmp_path / "a.cameramodel", stdin=json.dumps(rays.tolist()))
    assert np.abs(np.array(got) - uv).max() < SAME
    assert np.allclose(rt, [0.1, -0.2, 0.3, 1, 2, -3])


UNPROJECT = """
import sys, json, mrcal, numpy as np
model = mrcal.cameramodel(intrinsics=(sys.argv[1], np.array(json.loads(sys.argv[2]))), imagersize=(640, 480))
model.write(sys.argv[3])
v = np.array(json.loads(sys.stdin.read()))
print(json.dumps(mrcal.project(v, *model.intrinsics()).tolist()))
"""
KNOTS = (np.random.default_rng(3).normal(size=2 * 11 * 8) * 0.01).round(6).tolist()


@BOTH
@pytest.mark.parametrize(
    "model, values",
    [
        ("LENSMODEL_STEREOGRAPHIC", []),
        ("LENSMODEL_LATLON", []),
        ("LENSMODEL_LONLAT", []),
        ("LENSMODEL_CAHVOR", [0.01, -0.02, 0.003, -0.05, 0.01]),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=11_Ny=8_fov_x_deg=120", KNOTS),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=2_Nx=11_Ny=8_fov_x_deg=120", KNOTS),
    ],
)
def test_mrcal_models_that_are_refitted(tmp_path, model, values, python):
    """mrcal's own file is read, and its projections of our rays are the pixels that we asked for."""
    path = tmp_path / "a.cameramodel"
    intrinsics = json.dumps([300.0, 301.0, 320.0, 240.0, *values])
    ask(python, UNPROJECT, model, intrinsics, path, stdin="[[0.1, 0.2, 1.0]]")
    camera = files.read(path).cameras[0].camera
    uv = np.array([[320.0, 240], [100, 100], [500, 330], [250, 400]])
    rays, seen = camera.lens.unproject(camera.params, uv)
    again = ask(python, UNPROJECT, model, intrinsics, path, stdin=json.dumps(rays.tolist()))
    assert seen.all() and np.abs(np.array(again) - uv).max() < SAME


ANIPOSE = """
import sys, json, numpy as np
from aniposelib.cameras import CameraGroup
points = np.array(json.loads(sys.stdin.read()))
print(json.dumps([c.project(points).reshape(-1, 2).tolist() for c in CameraGroup.load(sys.argv[1]).cameras]))
"""


def test_aniposelib(tmp_path):
    poses = [Pose.identity(), Pose(rotations.exp(np.array([0.1, 0.4, -0.1])), np.array([-0.5, 0.1, 0.2]))]
    rig = CameraFile(
        tuple(NamedCamera(n, camera_of("opencv5"), p) for n, p in zip(("a", "b"), poses, strict=True))
    )
    files.write(tmp_path / "calibration.toml", rig)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3)) + [0, 0, 4]
    got = ask(OWNERS, ANIPOSE, tmp_path / "calibration.toml", stdin=json.dumps(points.tolist()))
    for named, theirs in zip(rig.cameras, got, strict=True):
        assert np.abs(named.camera.project(named.pose.apply(points)) - theirs).max() < SAME


@pytest.mark.skipif(shutil.which("octave") is None, reason="octave is not installed")
@pytest.mark.parametrize("suffix", [".m", ".mat"])
def test_octave_runs_the_script(tmp_path, suffix):
    camera = camera_of("opencv5")
    files.write(tmp_path / f"Calib_Results{suffix}", CameraFile.one(camera), "bouguet")
    load = (
        f"source('{tmp_path}/Calib_Results.m')" if suffix == ".m" else f"load('{tmp_path}/Calib_Results.mat')"
    )
    script = f"{load}; printf('%.17g ', [fc(:); cc(:); kc(:); alpha_c; nx; ny])"
    done = subprocess.run(
        ["octave", "--quiet", "--eval", script], capture_output=True, text=True, timeout=120, check=True
    )
    got = [float(w) for w in done.stdout.split()]
    assert got == [*camera.params.tolist(), 0, *camera.image_size]


@pytest.mark.skipif(shutil.which("octave") is None, reason="octave is not installed")
@pytest.mark.parametrize("version", ["-v6", "-v7"])
def test_octave_writes_what_is_read(tmp_path, version):
    struct = (
        "s.FocalLength=[500 501]; s.PrincipalPoint=[321 241]; s.ImageSize=[480 640]; s.Skew=0; s.name='x';"
    )
    struct += "s.RadialDistortion=[-0.1 0.02]; s.TangentialDistortion=[0 0]; c={1,2}; t=true; e=[];"
    done = ["octave", "--quiet", "--eval", f"{struct} save('{version}','{tmp_path}/a.mat','c','t','e','s')"]
    subprocess.run(done, capture_output=True, timeout=120, check=True)
    camera = files.read(tmp_path / "a.mat").cameras[0].camera
    assert camera.values == {
        "fx": 500,
        "fy": 501,
        "cx": 320,
        "cy": 240,
        "k1": -0.1,
        "k2": 0.02,
        "p1": 0,
        "p2": 0,
    }


def test_scipy_reads_the_mat_files(tmp_path):
    from scipy.io import loadmat

    camera = camera_of("opencv5")
    files.write(tmp_path / "a.mat", CameraFile.one(camera))
    found = loadmat(tmp_path / "a.mat", squeeze_me=True, struct_as_record=False)["intrinsics"]
    assert found.PrincipalPoint.tolist() == [camera.params[2] + 1, camera.params[3] + 1]


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
@pytest.mark.parametrize("spec", ["pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "opencv14"])
def test_cv2_projects_what_it_reads(tmp_path, spec, suffix):
    camera = camera_of(spec)
    files.write(tmp_path / f"a{suffix}", CameraFile.one(camera), "opencv")
    store = cv2.FileStorage(str(tmp_path / f"a{suffix}"), cv2.FILE_STORAGE_READ)
    k, d = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat()
    rays, uv = rays_of(camera)
    got = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), k, d)[0].reshape(-1, 2)
    assert np.abs(got - uv).max() < SAME


CV2 = """
import sys, json, pathlib, cv2, numpy as np
rays = np.array(json.loads(sys.stdin.read()))
found = {}
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k, d = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat()
    if int(store.getNode("fisheye_model").real()) if not store.getNode("fisheye_model").empty() else 0:
        fisheye = cv2.fisheye if hasattr(cv2.fisheye, "projectPoints") else cv2
        uv = fisheye.projectPoints(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), k, d.ravel())[0]
    elif path.name.startswith("stereo"):
        uv = [store.getNode(n).mat().tolist() for n in ("M1", "D1", "M2", "D2", "R", "T")]
        found[path.name] = uv
        continue
    else:
        uv = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), k, d)[0]
    found[path.name] = np.asarray(uv).reshape(-1, 2).tolist()
print(json.dumps([cv2.__version__, found]))
"""


@pytest.mark.parametrize(
    "python", [p for p in os.environ.get("CAMCAL_CV2", "").split(":") if p] or [sys.executable]
)
def test_versions_of_cv2(tmp_path, python):
    """One file of each ending and lens, and the two cameras of a pair, as each version of cv2 reads them."""
    cameras = {
        spec: camera_of(spec)
        for spec in ("pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "opencv14", "kb4")
    }
    points = np.random.default_rng(2).uniform(-0.3, 0.3, (30, 3)) + [0, 0, 2]
    for suffix in (".yml", ".xml", ".json"):
        for spec, camera in cameras.items():
            files.write(tmp_path / f"{spec}{suffix}", CameraFile.one(camera), "opencv")
        turn = Pose(rotations.exp(np.array([0.01, 0.2, -0.02])), np.array([-0.1, 0.0, 0.01]))
        pair = (
            NamedCamera("a", cameras["opencv5"], Pose.identity()),
            NamedCamera("b", cameras["opencv8"], turn),
        )
        files.write(tmp_path / f"stereo{suffix}", CameraFile(pair), "opencv")
    _, found = ask(python, CV2, tmp_path, stdin=json.dumps(points.tolist()))
    assert len(found) == 24
    for name, theirs in found.items():
        spec = name.partition(".")[0]
        if spec == "stereo":
            assert (
                np.abs(np.array(theirs[4]) - turn.rotation).max() < 1e-12 and np.ravel(theirs[5])[0] == -0.1
            )
            assert np.ravel(theirs[1])[:5].tolist() == cameras["opencv5"].params[4:].tolist()
        else:
            assert np.abs(np.array(theirs) - cameras[spec].project(points)).max() < SAME


def test_the_environment_is_known():
    assert Path(OWNERS).exists()
