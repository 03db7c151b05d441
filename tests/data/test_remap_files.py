"""Maps as other programs take them: read back by numpy, and by a reader of EXR and PGM of the tests' own."""

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.data import remap_files
from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.undistort import undistortion


@pytest.fixture(scope="module")
def made():
    lens = lenses.make("opencv5")
    params, size = lens.examples()[0]
    return undistortion(Camera(lens, np.array(params), size), size=(160, 120)), size


def read_exr(data):
    """Channels (H, W) of an uncompressed scan-line EXR of floats."""
    assert struct.unpack_from("<ii", data) == (20000630, 2)
    at, found = 8, {}
    while data[at]:
        name, kind = (data[at:].split(b"\0", 2))[:2]
        at += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<i", data, at)
        found[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    _, _, right, bottom = struct.unpack("<4i", found[b"dataWindow"])
    width, height = right + 1, bottom + 1
    offsets = struct.unpack_from(f"<{height}Q", data, at + 1)
    names = ["B", "G", "R"]  # in the order of the alphabet
    assert found[b"channels"].count(b"\0\2\0\0\0") == 3
    rows = [np.frombuffer(data, "<f4", 3 * width, o + 8).reshape(3, width) for o in offsets]
    assert [struct.unpack_from("<ii", data, o) for o in offsets] == [(y, 12 * width) for y in range(height)]
    assert offsets[-1] + 8 + 12 * width == len(data)
    return dict(zip(names, np.stack(rows, 1), strict=True))


def test_npz(made):
    found, size = made
    (data,) = remap_files.contents(Path("m.npz"), found.u, found.v, size, matrix=found.camera.matrix).values()
    with np.load(io.BytesIO(data)) as archive:
        assert np.array_equal(archive["u"], found.u) and archive["source_size"].tolist() == list(size)
        assert np.array_equal(archive["matrix"], found.camera.matrix)


def test_stmap(made):
    found, (width, height) = made
    (data,) = remap_files.contents(Path("m.exr"), found.u, found.v, (width, height)).values()
    channels = read_exr(data)
    inside = channels["R"] >= 0
    assert inside.mean() > 0.5 and (channels["B"] == 0).all()
    assert np.abs(channels["R"][inside] * width - 0.5 - found.u[inside]).max() < 1e-3
    assert np.abs((1 - channels["G"][inside]) * height - 0.5 - found.v[inside]).max() < 1e-3


def test_pgm(made):
    found, size = made
    files = remap_files.contents(Path("m.pgm"), found.u, found.v, size)
    assert [p.name for p in files] == ["m-x.pgm", "m-y.pgm"]
    for data, values in zip(files.values(), (found.u, found.v), strict=True):
        head = b"P5\n160 120\n65535\n"
        assert data.startswith(head)
        whole = np.frombuffer(data[len(head) :], ">u2").reshape(120, 160)
        inside = whole != 65535
        assert np.abs(whole[inside] - values[inside]).max() <= 0.5 and inside.mean() > 0.5


def test_gstreamer():
    """cv2 reads it as the element does: from memory, by the names of its source."""
    lens = lenses.make("opencv8")
    params, size = lens.examples()[0]
    (data,) = remap_files.contents(
        Path("m.gst"), np.zeros((2, 2)), np.zeros((2, 2)), size, Camera(lens, np.array(params), size)
    ).values()
    text = data.decode()
    assert "\n" not in text and '"' not in text
    store = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    matrix, bend = store.getNode("cameraMatrix").mat(), store.getNode("distCoeffs").mat()
    assert [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]] == list(params[:4])
    assert bend.ravel().tolist() == list(params[4:])


@pytest.mark.parametrize("spec, skew, word", [("kb4", False, "fisheye"), ("opencv5", True, "skew")])
def test_gstreamer_refuses_by_name(spec, skew, word):
    lens = lenses.make(spec, skew)
    params, size = lens.examples()[0]
    values = np.array(params, float)
    if skew:
        values[4] = 1.5
    with pytest.raises(UsageError, match=word):
        remap_files.gstreamer(Camera(lens, values, size))


def test_an_unknown_ending():
    with pytest.raises(UsageError, match="npz"):
        remap_files.check_ending(Path("m.tif"))


def test_crop_box(made):
    found, size = made
    x, y, w, h = remap_files.crop_box(found.u, found.v, size)
    inner = slice(y, y + h), slice(x, x + w)
    assert (found.u[inner] > -0.5).all() and (found.v[inner] > -0.5).all()
    assert (found.u[inner] < size[0] - 0.5).all() and (found.v[inner] < size[1] - 0.5).all()
    assert w * h > 0.4 * found.u.size
    whole = np.ones((4, 6)), np.ones((4, 6))
    assert remap_files.crop_box(*whole, (3, 3)) == (0, 0, 6, 4)
    assert remap_files.crop_box(-whole[0], whole[1], (3, 3)) is None
    one = whole[0].copy()
    one[1, 0] = -1
    assert remap_files.crop_box(one, whole[1], (3, 3)) == (1, 0, 5, 4)
    one[1, 0], one[2, 3] = 1, -1
    assert remap_files.crop_box(one, whole[1], (3, 3)) is None  # black inside alone
