"""Maps applied by the programs that they are for, where these are installed: `pytest -m slow`."""

import os
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest

from camcal.data import remap_files
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.undistort import undistortion

pytestmark = pytest.mark.slow
OWNERS = os.environ.get("CAMCAL_OWNERS", sys.executable)


@pytest.fixture(scope="module")
def camera():
    lens = lenses.make("opencv5")
    params, size = lens.examples()[0]
    return Camera(lens, np.array(params), size)


def write(folder, name, camera):
    made = undistortion(camera)
    for path, data in remap_files.contents(
        folder / name, made.u, made.v, camera.image_size, camera, matrix=made.camera.matrix
    ).items():
        path.write_bytes(data)
    return made


def smooth(size):
    """A picture whose blue and green are the column and the row, 0 to 255."""
    width, height = size
    u, v = np.meshgrid(np.arange(width) * 255 / (width - 1), np.arange(height) * 255 / (height - 1))
    return np.rint(np.stack([u, v, np.zeros_like(u)], -1)).astype(np.uint8)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_ffmpeg(tmp_path, camera):
    made = write(tmp_path, "m.pgm", camera)
    picture = np.random.default_rng(1).integers(0, 255, (*camera.image_size[::-1], 3), np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    words = ["ffmpeg", "-loglevel", "error", "-i", "a.png", "-i", "m-x.pgm", "-i", "m-y.pgm", "-lavfi"]
    subprocess.run(
        [*words, "format=gbrp[s];[s][1][2]remap,format=rgb24", "b.png"], cwd=tmp_path, check=True, timeout=120
    )
    u, v = np.rint(made.u).astype(int), np.rint(made.v).astype(int)
    width, height = camera.image_size
    inside = (made.u > -0.5) & (made.v > -0.5) & (made.u < width - 0.5) & (made.v < height - 0.5)
    got = cv2.imread(str(tmp_path / "b.png"))
    assert np.array_equal(got[inside], picture[v[inside], u[inside]])


OPENEXR = """
import sys, OpenEXR, numpy as np
found = OpenEXR.File(sys.argv[1]).channels()
part = next(iter(found.values())).pixels if len(found) == 1 else np.stack([found[c].pixels for c in "RGB"], -1)
np.save(sys.argv[2], part)
"""


def test_openexr(tmp_path, camera):
    made = write(tmp_path, "m.exr", camera)
    done = subprocess.run(
        [OWNERS, "-c", OPENEXR, str(tmp_path / "m.exr"), str(tmp_path / "m.npy")],
        capture_output=True,
        text=True,
        check=False,
    )
    if "ModuleNotFoundError" in done.stderr:
        pytest.skip("OpenEXR is not installed")
    assert done.returncode == 0, done.stderr
    pixels = np.load(tmp_path / "m.npy")
    inside = pixels[..., 0] >= 0
    assert pixels.shape[:2] == made.u.shape and inside.mean() > 0.5
    assert np.abs(pixels[..., 0][inside] * camera.image_size[0] - 0.5 - made.u[inside]).max() < 1e-3


@pytest.mark.skipif(shutil.which("gst-inspect-1.0") is None, reason="GStreamer is not installed")
def test_gstreamer(tmp_path, camera):
    """Where the element takes each pixel from is our lens, seen by a camera matrix of the element's own choice."""
    if subprocess.run(["gst-inspect-1.0", "cameraundistort"], capture_output=True, check=False).returncode:
        pytest.skip("the OpenCV plugin of GStreamer is not installed")
    write(tmp_path, "cam.gst", camera)
    cv2.imwrite(str(tmp_path / "a.png"), smooth(camera.image_size))
    line = "filesrc location=a.png ! pngdec ! videoconvert ! video/x-raw,format=BGR"
    line += (
        ' ! cameraundistort "settings=\\"$(cat cam.gst)\\"" ! videoconvert ! pngenc ! filesink location=b.png'
    )
    subprocess.run(["bash", "-c", f"gst-launch-1.0 -q {line}"], cwd=tmp_path, check=True, timeout=120)
    got = cv2.imread(str(tmp_path / "b.png"))[40:-40:4, 40:-40:4].reshape(-1, 3).astype(float)
    width, height = camera.image_size
    pixels = np.c_[got[:, 0] * (width - 1) / 255, got[:, 1] * (height - 1) / 255]
    v, u = np.mgrid[40 : height - 40 : 4, 40 : width - 40 : 4].reshape(2, -1)
    rays = camera.unproject(pixels)
    for axis, new in enumerate((u, v)):
        ideal = rays[:, axis] / rays[:, 2]
        design = np.c_[ideal, np.ones(len(ideal))]
        left = design @ np.linalg.lstsq(design, new, rcond=None)[0] - new
        # a grey level is 2.5 px wide: .6 to .8 px rms of rounding; without the distortion 3.4 to 4.7 px rms are left
        assert np.sqrt((left**2).mean()) < 1.2
