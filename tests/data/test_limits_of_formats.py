"""Numbers of camera files and of archives, each just below and just above, or beside finer ones."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.data import npz, shape
from camcal.data.dlt_table import dlt_text
from camcal.data.formats import (
    blender,
    dbat,
    dlt,
    files,
    foreign,
    gaps,
    lensfun,
    meshroom,
    page,
    usd,
)
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.source import Source
from camcal.data.point_files import photomodeler
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.contracts import test_limits_of_work as work
from tests.data import corner_samples
from tests.data.formats.test_tools import LENSFUN
from tests.sides import LESS, MORE, same_with_finer_and_not_with_coarser
from tests.solved import solved

PINHOLE = Camera(lenses.make("pinhole"), np.array([900.0, 900, 639.5, 479.5]), (1280, 960))


# ------------------------------------------------------------------------------------ tables of the DLT
def test_tables_that_are_recognised(monkeypatch):
    """Those that are longer are cut in their rows; the limit has room for a thousand cameras."""
    one = PINHOLE.matrix @ np.c_[np.eye(3), [0.123456789123, 0.2, 4.5]]
    assert len(dlt_text([one / 3] * 1000)) < dlt.LONGEST
    text = dlt_text([one / 3] * 5).rstrip()
    source = SimpleNamespace(kind="text", text=text)
    for most, known in ((len(text), True), (text.rindex(","), False)):
        monkeypatch.setattr(dlt, "LONGEST", most)
        assert dlt._sniff(source) == known


@pytest.mark.parametrize(("share", "same"), [(LESS, True), (MORE, False)])
def test_numbers_that_are_those_that_were_read(share, same):
    known = PINHOLE.matrix @ np.c_[np.eye(3), [0.1, 0.2, 4.0]]
    made = known.copy()
    made[0, 0] += share * dlt.SAME * np.abs(known[:, 0]).max()
    assert dlt._same(made, known) == same


# ------------------------------------------------------------------------------------ written files
@pytest.mark.parametrize("name", ["max_px", "rotation", "shift"])
def test_what_was_written_and_reads_back(monkeypatch, name):
    """No more than the rounding of the numbers apart: else the writer is wrong, and nothing is written."""
    cameras = CameraFile((NamedCamera("a", PINHOLE),))
    content = SimpleNamespace(content="", beside={})
    monkeypatch.setattr(files, "parsed", lambda *_: cameras)
    for share, good in ((LESS, True), (MORE, False)):
        found = replace(gaps.Gap(0.0), **{name: share * files.EXACT})
        monkeypatch.setattr(files, "gap", lambda *_, f=found: f)
        form = SimpleNamespace(title="a file")
        if good:
            assert files._read_back(form, cameras, SimpleNamespace(suffix=".x"), content) is found
        else:
            with pytest.raises(RuntimeError, match="when it is read back"):
                files._read_back(form, cameras, SimpleNamespace(suffix=".x"), content)


def bent(k1):
    return Camera(lenses.make("opencv4"), np.array([900.0, 900, 639.5, 479.5, k1, 0.05, 0, 0]), (1280, 960))


def test_pixels_over_which_cameras_are_compared(monkeypatch):
    """Of two that agree in the corners and differ by 1 px between; to a fiftieth of a pixel."""
    one = bent(-0.2)
    corner = one.unproject(np.zeros((1, 2)))[0]
    square = np.square(corner[:2] / corner[2]).sum()
    other = replace(one, params=one.params + [0, 0, 0, 0, -0.02, 0.02 / square, 0, 0])
    same_with_finer_and_not_with_coarser(
        monkeypatch, gaps, "GRID", (2, 2), (161, 121), 0.02, lambda: gaps.difference(one, other)
    )


def test_errors_that_are_stated_of_round_trips(monkeypatch):
    """The order of magnitude of the largest one, and no less than rounding."""
    form = SimpleNamespace(models=("pinhole",))
    for share, stated in ((LESS, 1.0), (1.0, 1.0), (MORE, 10.0), (11.0, 100.0)):
        monkeypatch.setattr(page, "_round_trip", lambda *_, s=share: s * page.LEAST)
        assert page._error(form) == pytest.approx(stated * page.LEAST)


@pytest.mark.parametrize(
    ("module", "name", "ending"),
    [
        (blender, "SENSOR", ".py"),
        (dbat, "PIXEL", ".xml"),
        (meshroom, "SENSOR", ".sfm"),
        (usd, "PIXEL_MM", ".usda"),
    ],
)
def test_sizes_of_a_sensor_that_decide_nothing(monkeypatch, tmp_path, module, name, ending):
    """What is written for the size of the sensor; whatever it is, the same camera is read."""
    cameras = CameraFile((NamedCamera("a", PINHOLE, Pose.identity()),))
    read = []
    for factor in (1, 2):
        monkeypatch.setattr(module, name, factor * getattr(module, name))
        path = tmp_path / f"{factor}{ending}"
        written = module.FORMAT.write(cameras, ending)
        text = getattr(written, "content", written)
        source = Source(path, text.encode() if isinstance(text, str) else text)
        source.image_size = PINHOLE.image_size
        monkeypatch.undo()
        read.append((text, files.parsed(module.FORMAT, source).cameras[0].camera))
    (one, first), (other, second) = read
    assert one != other and first.image_size == second.image_size
    assert gaps.difference(first, second) < 1e-9


def test_the_size_that_a_lens_database_does_not_say(monkeypatch):
    """The angle of a place in the picture is that of the lens, whatever size is assumed."""
    angles = []
    for factor in (1, 2):
        monkeypatch.setattr(lensfun, "LONGER", factor * 6000)
        for named in files.parsed(
            lensfun.FORMAT, Source(SimpleNamespace(suffix=".xml"), LENSFUN.encode())
        ).cameras:
            width, height = named.camera.image_size
            at = np.array([[0.8 * (width - 1), 0.7 * (height - 1)]])
            angles.append(named.camera.lens.unproject(named.camera.params, at)[0][0])
    np.testing.assert_allclose(angles[:2], angles[2:], atol=1e-3)


# ------------------------------------------------------------------------------------ inversions
@pytest.mark.parametrize(("share", "found"), [(MORE, True), (LESS, False)])
def test_areas_that_count_as_positive(share, found):
    """A plane whose second direction is shrunk by so much is inverted, one that is shrunk more is not."""
    shrunk = np.array([1.0, share * foreign.NO_AREA])
    target = np.array([[0.1, 0.1]]) * shrunk
    assert foreign.inverse(lambda w: w * shrunk, target)[1][0] == found


def folded():
    """Radii up to the fold of a lens whose image first grows and then shrinks."""
    k = 0.567, -0.333, -1.094
    r = np.linspace(0, 0.74, 297)

    def forward(w):
        square = np.square(w).sum(1, keepdims=True)
        return w * (1 + k[0] * square + k[1] * square**2 + k[2] * square**3)

    with np.errstate(all="ignore"):
        return foreign.inverse(forward, forward(np.c_[r, 0 * r]))[0][:, 0] - r


#: coarse, fine, tolerance, example
INVERSIONS = {
    "SOLVED": (1e-2, 1e-15, 1e-9, work.inverted),
    "STEP": (0.5, 1e-7, 1e-9, work.inverted),
    "LONGEST": (10.0, 0.15, 1e-3, folded),
}


@pytest.mark.parametrize("name", INVERSIONS)
def test_inversions(monkeypatch, name):
    coarse, fine, tolerance, example = INVERSIONS[name]
    if name == "STEP":  # what it changes is the way: few steps lead as far
        monkeypatch.setattr(foreign, "STEPS", 8)
    same_with_finer_and_not_with_coarser(monkeypatch, foreign, name, coarse, fine, tolerance, example)


# ------------------------------------------------------------------------------------ points
def test_arrays_that_are_taken_from_an_archive():
    stream = io.BytesIO()
    np.savez(stream, a=np.zeros(10), b=np.zeros(1000))
    size = 128 + 80  # the header of an array and its numbers
    assert list(npz.arrays(stream, ["a"], size)) == ["a"]
    with pytest.raises(ValueError, match="at most"):
        npz.arrays(stream, ["a"], size - 1)
    assert npz.LARGEST >= 13_000_000 * 5 * 8


def test_points_that_are_fitted_at_a_time(monkeypatch):
    """Only memory depends on it."""
    views = solved(views=4).observations.views
    usual = shape.shapes(views)
    for count in (1, 10**9):
        monkeypatch.setattr(shape, "POINTS_AT_A_TIME", count)
        again = shape.shapes(views)
        np.testing.assert_allclose(again.spreads, usual.spreads, rtol=1e-12)
        np.testing.assert_allclose(again.image_spreads, usual.image_spreads, rtol=1e-12)


@pytest.mark.parametrize("line", range(1, 5))
def test_numbers_of_the_head_of_photomodeler(line):
    """Each of its lines has at least so many; with one fewer it is another text."""
    lines = corner_samples.photomodeler(corner_samples.MARKS).splitlines()
    for count, known in ((photomodeler.HEAD[line - 1], True), (photomodeler.HEAD[line - 1] - 1, False)):
        own = [*lines[:line], " ".join(["1"] * count), *lines[line + 1 :]]
        assert photomodeler._sniff(SimpleNamespace(suffix=".txt", text="\n".join(own))) == known
