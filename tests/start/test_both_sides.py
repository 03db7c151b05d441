"""Numbers that decide something in the closed forms, each just below and just above."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.start import assumptions, base, claus, mirrored, numbering, shape, tsai, zhang
from camcal.start.base import NO_DEPTH
from tests.sides import LESS, MORE

from . import scenes
from .scenes import board, rig


def seen(xyz, uv=None):
    """One view; without images, the points lie where a camera 1 m before them has them."""
    if uv is None:
        uv = 900 * xyz[:, :2] / (xyz[:, 2:] + 1) + 400
    return Observations.from_views([View("a", xyz, uv)], (800, 600))


def test_the_depth_of_the_origin():
    matrix = np.array([[900.0, 0, 400, 1], [0, 900, 300, 1], [0, 0, 1, 0]])
    for share, divided in ((MORE, True), (LESS, False)):
        matrix[2, 3] = share * NO_DEPTH * 900
        found = base.scaled(matrix)
        assert (found[2, 3] == 1) == divided
        assert (np.linalg.norm(found) == pytest.approx(1)) == (not divided)


def test_points_on_a_line():
    """Nine points whose extent across a line is at the limit, beside that along it."""
    along = np.linspace(-1, 1, 9)
    across = np.where(np.arange(9) % 2, 1.0, -1.0)
    for share, fits in ((1.05, True), (0.95, False)):
        # both columns have mean 0 and hardly any correlation: extents are their rms
        size = share * shape.COLLINEAR * along.std() / across.std()
        xyz = np.c_[along, size * (across - across.mean()), np.zeros(9)]
        uv = 900 * np.c_[along, across] + 1000
        observations = seen(xyz, uv)
        reasons = shape.unusable(observations)
        assert bool(reasons) != fits


@pytest.mark.parametrize(("points", "least"), [(board(), shape.LEAST_PLANAR), (rig(), shape.LEAST_3D)])
def test_enough_points(points, least):
    chosen = np.random.default_rng(0).permutation(len(points))
    shape.check(seen(points[chosen[:least]]))
    with pytest.raises(DataError, match=f"{least - 1} points"):
        shape.check(seen(points[chosen[: least - 1]]))


def test_a_plane_but_for_rounding():
    for out, words in ((0.5 * shape.FLAT, "on a plane"), (2 * shape.FLAT, "nearly on a plane (off it by")):
        xyz = board()
        xyz[::2, 2] = out * np.ptp(xyz[:, 0])
        why = shape.choose(seen(xyz, 900 * xyz[:, :2] + 100))[1]
        assert words in why and ("nearly" in why) == ("nearly" in words)


def test_a_grid_that_can_be_numbered_in_two_ways():
    def grid(columns, rows):
        xyz = board(columns, rows)
        return numbering._grid(View("a", xyz, xyz[:, :2]))

    assert grid(3, 2) == (3, 2) and numbering.LEAST_GRID == 6
    assert grid(2, 2) is None and grid(6, 1) is None


def test_coordinates_of_one_row():
    digit = 10.0**-numbering.DIGITS
    for off, size in ((0.4 * digit, (9, 6)), (0.6 * digit, None)):
        xyz = board(square=0.125)  # the extent is 1
        xyz[10, 1] += off
        assert numbering._grid(View("a", xyz, xyz[:, :2])) == size


def test_rays_near_the_centre_of_the_image():
    for share, determined in ((LESS, True), (MORE, False)):
        rows = np.c_[np.zeros((3, 3)), np.diag([1.0, 1.0, 1 / (share * claus.MOST_CONDITION)])]
        if determined:
            np.testing.assert_allclose(claus.pinhole_at_centre(rows)[:, 3:], np.eye(3))
        else:
            with pytest.raises(EstimationError, match="undetermined"):
                claus.pinhole_at_centre(rows)


def conic(cx):
    """B = K⁻ᵀ K⁻¹ of a camera in unit coordinates, by its entries 11, 12, 22, 13, 23, 33."""
    k = np.linalg.inv(np.array([[1.5, 0, cx], [0, 1.5, 0], [0, 0, 1]]))
    b = k.T @ k
    return b[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]


def test_a_principal_point_near_the_image():
    every = assumptions.SETS[1]
    singular = np.ones(6)
    for share, kept in ((LESS, True), (MORE, False)):
        k, reason = assumptions._plausible(conic(share * assumptions.FAR_OUTSIDE), singular, every, 5)
        assert (k is not None) == kept and kept == (not reason)


def test_views_that_determine_a_camera():
    every = assumptions.SETS[1]
    for share, kept in ((MORE, True), (LESS, False)):
        singular = np.array([1.0, 1, 1, 1, share * assumptions.UNDETERMINED * np.sqrt(5), 0])
        k, reason = assumptions._plausible(conic(0.0), singular, every, 5)
        assert (k is not None) == kept
        assert (reason == "the views do not determine it") == (not kept)


# ------------------------------------------------------------------------------------ numbering, frames, depths
def numbered(columns=4, rows=3):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    xyz = np.c_[x.ravel(), y.ravel(), np.zeros(columns * rows)].astype(float)
    return View("a", xyz, 50 * xyz[:, :2] + 100)


def test_an_even_grid_is_not_looked_at_further():
    """Of steps of 1 the last one is longer by a part of it."""
    for part, even in ((LESS, True), (MORE, False)):
        view = numbered()
        uv = view.uv.copy()
        uv[view.xyz[:, 0] == 3, 0] += 50 * part * numbering.EVEN
        assert numbering._even(replace(view, uv=uv), 4, 3) == even


def test_a_numbering_that_leads_astray(monkeypatch):
    monkeypatch.setattr(numbering, "_even", lambda *_: False)
    data = Observations.from_views([numbered()], (800, 600))
    for left, other, wrong in (
        (MORE * numbering.ASTRAY, LESS * numbering.MENDED, True),
        (LESS * numbering.ASTRAY, 0.0, False),
        (MORE * numbering.ASTRAY, 1.01 * numbering.MENDED, False),
    ):

        def remaining(view, plane, own=left, part=other):
            return own if np.array_equal(plane, view.xyz[:, :2]) else part * own

        monkeypatch.setattr(numbering, "_left", remaining)
        if wrong:
            with pytest.raises(DataError, match="numbered as a grid of 4x3"):
                numbering.check_numbering(data)
        else:
            numbering.check_numbering(data)


def test_views_whose_numbering_is_looked_at(monkeypatch):
    seen = []
    monkeypatch.setattr(numbering, "_even", lambda *_: False)
    monkeypatch.setattr(numbering, "_left", lambda view, plane: seen.append(view.id) or 1.0)
    most = numbering.LOOKED_AT
    for count in (most, most + 1):
        seen.clear()
        views = [replace(numbered(), id=str(i)) for i in range(count)]
        numbering.check_numbering(Observations.from_views(views, (800, 600)))
        assert len(set(seen)) == most


def test_an_axis_that_a_direction_runs_along():
    for cosine, named in ((MORE * mirrored.ALONG, True), (LESS * mirrored.ALONG, False)):
        rest = np.sqrt((1 - cosine**2) / 2)
        v = np.array([rest, cosine, rest])
        u = np.cross(v, [0, 0, 1.0])
        reflected = np.stack([u / np.linalg.norm(u), v, np.zeros(3)])
        assert bool(mirrored.which(reflected)[0]) == named


def test_planes_that_face_the_camera():
    for degrees, said in ((LESS * tsai.FRONTO_PARALLEL, True), (MORE * tsai.FRONTO_PARALLEL, False)):
        rotation = rotations.exp(np.radians([[degrees, 0.0, 0.0]]))
        message = tsai._undetermined(rotation, True, 0.5).message
        assert ("fronto-parallel" in message) == said


def test_perspective_that_stands_out_of_the_noise(monkeypatch):
    good = scenes.scene(scenes.board(), scenes.tilts(4), noise=0.2).observations
    (planes,) = zhang._planes([(good, good.shapes)])
    monkeypatch.setattr(zhang.Planes, "visible", MORE * zhang.VISIBLE)
    assert zhang._intrinsics(planes, good, False)[0][0, 0] > 0
    monkeypatch.setattr(zhang.Planes, "visible", LESS * zhang.VISIBLE)
    with pytest.raises(EstimationError, match="times its noise"):
        zhang._intrinsics(planes, good, False)


def test_points_behind_the_camera():
    """The homography of a plane whose points lie to both sides of the camera's plane."""
    h = np.array([[[900.0, 0, 0], [0, 900, 0], [1.0, 0, 0]]])  # depth = x
    for behind, count in ((1, 10), (2, 19)):
        x = np.r_[np.full(behind, -1.0), np.full(count - behind, 1.0)]
        local = np.c_[x, np.linspace(-1, 1, count)][None]
        allowed = behind <= shape.BEHIND * count
        assert zhang._behind(h, local) == ([] if allowed else [(0, behind)])
        assert allowed == (count == 10)
