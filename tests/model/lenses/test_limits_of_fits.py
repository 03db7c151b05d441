"""Numbers of the regression of lenses, of undistorted pictures and of rational curves, each from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses import rational, regress, start, undistort
from camcal.model.lenses.regress import Regression
from tests.sides import LESS, MORE

PINHOLE = lenses.make("pinhole")
RAYS = np.c_[np.random.default_rng(0).uniform(-0.6, 0.6, (200, 2)), np.ones(200)]
CAMERA = Camera(PINHOLE, np.array([800.0, 800, 499.5, 399.5]), (1000, 800))


def result(score, params=(1.0,), covered=(True,), errors=(0.0,)):
    return Regression(np.array(params), np.array(covered), np.array(errors), score)


# ------------------------------------------------------------------------------------ regression
def test_an_error_at_which_no_other_start_is_tried(monkeypatch):
    for share, tried in ((LESS, 1), (MORE, 2)):
        score = (share * regress.EXACT) ** 2
        grown = []
        monkeypatch.setattr(regress, "_starts", lambda *_: [CAMERA.params, CAMERA.params])
        monkeypatch.setattr(regress, "_grow", lambda *_, g=grown, s=score: g.append(1) or result(s))
        regress.regress(PINHOLE, RAYS, CAMERA.project(RAYS))
        assert len(grown) == tried


def test_minima_that_are_one(monkeypatch):
    monkeypatch.setattr(regress, "_starts", lambda *_: [0, 1])
    for share, count in ((LESS, 1), (MORE, 2)):
        params = [[1000.0], [1000 * (1 + share * regress.SAME)]]
        monkeypatch.setattr(regress, "_grow", lambda _, i, *__, p=params: result(1.0, p[i]))
        assert len(regress.minima(PINHOLE, RAYS, CAMERA.project(RAYS))) == count


def test_pairs_of_a_fit(monkeypatch):
    """More are thinned out evenly, but for the outermost."""
    enough, outermost = regress.ENOUGH, regress.OUTERMOST
    for count, thinned in ((enough, False), (enough + 1, True)):
        rays = np.c_[np.linspace(0, 0.5, count), np.zeros(count), np.ones(count)]
        given = []
        monkeypatch.setattr(regress, "_thinned", lambda *a, g=given: g.append(1) or (a[0][:9], a[1][:9]))
        regress.regress(PINHOLE, rays, CAMERA.project(rays), start=CAMERA.params)
        assert bool(given) == thinned
    monkeypatch.undo()
    rays = np.c_[np.linspace(0, 0.5, 7000), np.zeros(7000), np.ones(7000)]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    kept = np.sort(regress._thinned(rays, np.arange(14000).reshape(-1, 2))[1][:, 0]) // 2
    assert 7000 - kept[-outermost] == outermost and (kept >= 7000 - outermost - 10).sum() <= outermost + 2
    assert enough - 20 <= len(kept) <= enough


@pytest.mark.parametrize(
    ("covered", "error", "near"),
    [(98, 0.019, True), (97, 0.019, False), (98, 0.0199, True), (98, 0.0201, False)],
)
def test_a_start_like_a_pinhole_camera(covered, error, near):
    """It covers more than 97 of a hundred rays, to .02 of the picture's extent."""
    mask = np.arange(100) < covered
    uv = np.array([[0.0, 0], [640, 480]])
    assert regress._near(result(0.0, covered=mask, errors=np.full(100, error * 640)), uv) == near


def test_pixels_that_are_missed():
    uv = CAMERA.project(RAYS)
    extent = np.ptp(uv, axis=0).max()
    for share, covered in ((LESS, True), (MORE, False)):
        off = uv.copy()
        inner = np.abs(uv - uv.mean(0)).sum(1).argmin()
        off[inner, 0] += share * regress.MISSED * extent
        found = regress.measure(PINHOLE, CAMERA.params, RAYS, off)
        assert found.covered[inner] == covered and found.covered.sum() == 199 + covered
        assert np.sqrt(found.score * 200) == pytest.approx(min(share, 1) * 0.2 * extent)


@pytest.mark.parametrize(("count", "found"), [(regress.LEAST_RAYS, True), (regress.LEAST_RAYS - 1, False)])
def test_rays_of_a_camera_matrix(count, found):
    """Of the inner two fifths of ten rays, of which the others have none."""
    rays = np.c_[0.1 * np.arange(1, 11), 0.03 * np.arange(1, 11) ** 2, np.ones(10)]
    lens = SimpleNamespace(
        from_values=lambda _: np.array([1.0, 1, 0, 0]),
        project=lambda _, r: (r[:, :2], np.arange(10) < count),
        has_skew=False,
    )
    params = regress._with_matrix(lens, {}, rays, CAMERA.project(rays))
    assert (params == pytest.approx(CAMERA.params)) == found


def grown(monkeypatch, covered, more):
    """The cones and steps of fits, each of which brings so many rays more into the domain."""
    rays = np.c_[np.linspace(0, 1, 101), np.zeros(101), np.ones(101)]
    inside, asked = [covered], []

    def measure(*_):
        return result(1.0, covered=np.arange(101) < inside[0])

    def fit(_, params, chosen, uv, free, steps):
        asked.append((len(chosen), steps))
        inside[0] += more
        return params

    monkeypatch.setattr(regress, "measure", measure)
    monkeypatch.setattr(regress, "_fit", fit)
    regress._grow(PINHOLE, CAMERA.params, rays, CAMERA.project(rays), np.ones(4, bool))
    return asked


def test_fits_to_widening_cones(monkeypatch):
    """Three to each while it brings further rays, with few steps but in the last; one to all where all are covered."""
    assert grown(monkeypatch, 101, 0) == [(101, regress.LAST_STEPS)]
    asked = grown(monkeypatch, 10, 1)
    assert [n for n, _ in asked] == [10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21]
    assert [s for _, s in asked] == [regress.STEPS] * 9 + [regress.LAST_STEPS] * 3
    assert [n for n, _ in grown(monkeypatch, 50, 51)] == [41, 71, 91, 101]


def test_a_start_for_the_next_cone(monkeypatch):
    """Twelve steps to a cone give a start from which all rays are fitted; two do not."""
    lens = lenses.make("opencv4")
    rays = np.c_[np.random.default_rng(1).uniform(-1.2, 1.2, (60, 2)), np.ones(60)]
    camera = Camera(lens, np.array([800.0, 800, 500, 400, -0.2, 0.02, 0, 0]), (1000, 800))
    uv = camera.project(rays)
    good = np.isfinite(uv).all(1)
    pairs = regress._Pairs(
        lens, camera.params * [1.3, 1.3, 1, 1, -0.5, 0, 1, 1], rays[good], uv[good], np.ones(8, bool)
    )
    left = [
        regress.minimise(pairs, pairs.params[None], regress.Options(regress.SETTLED, steps)).equations.cost[0]
        for steps in (1, regress.STEPS, 2 * regress.STEPS)
    ]
    few, usual, more = np.sqrt(np.array(left) / good.sum())
    assert few > 0.1 > usual and more < 0.1


# ------------------------------------------------------------------------------------ undistorted pictures
class LaidOutError(Exception):
    """Raised where the size of a picture is accepted."""


def laid_out(*_):
    raise LaidOutError


def test_pixels_of_an_undistorted_picture(monkeypatch):
    monkeypatch.setattr(undistort, "_all_pixels", laid_out)
    for size, error in (
        ((20_000, undistort.MOST_PIXELS // 20_000), LaidOutError),
        ((20_000, undistort.MOST_PIXELS // 20_000 + 1), UsageError),
    ):
        with pytest.raises(error):
            undistort.undistortion(CAMERA, size=size)


def test_rows_that_are_mapped_at_a_time(monkeypatch):
    asked = []
    monkeypatch.setattr(
        undistort,
        "_sources",
        lambda _, __, pixels: (asked.append(len(pixels)), (pixels, pixels[..., 0] >= 0))[1],
    )
    monkeypatch.setattr(undistort, "STRIP", 3 * 40 + 39)
    undistort.undistortion(CAMERA, size=(40, 8))
    assert asked == [3, 3, 2]


@pytest.mark.parametrize(("projection", "degrees"), [("perspective", 160), ("equidistant", 358)])
def test_fields_that_a_projection_shows(projection, degrees):
    assert undistort._given_field(np.deg2rad(LESS * degrees), (100, 100), projection).params[0] > 0
    with pytest.raises(UsageError, match=f"at most {degrees}"):
        undistort._given_field(np.deg2rad(MORE * degrees), (100, 100), projection)


def without_black(monkeypatch, least):
    """The focal lengths that are tried for a picture that is filled from a given one on, and what is found."""
    asked = []

    def sources(_, target, grid):
        asked.append(target.params[0])
        return grid, np.array([target.params[0] >= least])

    monkeypatch.setattr(undistort, "_sources", sources)
    monkeypatch.setattr(undistort, "bisected", lambda *a: a[2])
    undistort._no_black(CAMERA, (100, 100), "perspective")
    return asked


def widest():
    return undistort._given_field(np.deg2rad(160 * 0.999), (100, 100), "perspective").params[0]


@pytest.mark.parametrize(("least", "tried"), [(LESS, 1), (MORE, 2), (1.49, 2), (1.51, 3)])
def test_the_search_for_a_field_without_black(monkeypatch, least, tried):
    """It begins just inside the widest field, and the focal length grows by half each time."""
    asked = without_black(monkeypatch, least * widest())
    assert len(asked) == tried and asked[0] == pytest.approx(widest())


def test_the_longest_focal_length_without_black(monkeypatch):
    """The last that is tried is below a million picture sizes."""
    steps = np.floor(np.log(1e6 * 100 / widest()) / np.log(1.5))
    last = widest() * 1.5**steps
    assert without_black(monkeypatch, LESS * last)[-1] == pytest.approx(last)
    with pytest.raises(EstimationError, match="no ray"):
        without_black(monkeypatch, MORE * last)


def test_a_focal_length_that_is_bisected():
    for least in (100.0, 123.4, 199.0):
        found = undistort.bisected(lambda f, least=least: f >= least, 50.0, 200.0)
        assert least <= found <= least * (1 + undistort.BISECTED)
    asked = []
    undistort.bisected(lambda f: asked.append(1) or True, 1.0, 1 + MORE * undistort.BISECTED)
    assert len(asked) == 1
    asked.clear()
    undistort.bisected(lambda f: asked.append(1) or True, 1.0, 1 + LESS * undistort.BISECTED)
    assert not asked


@pytest.mark.parametrize("size", [(4001, 3001)])
def test_points_that_stand_for_a_picture(size):
    """Between two a border of 4000 px whose middle is 400 px off lies to hundredths of a px."""
    grid = undistort.border_grid(size)
    assert len(grid) == 4 * undistort.SIDE + undistort.INSIDE**2
    step = np.diff(np.unique(grid[: undistort.SIDE, 0])).max()
    assert 0.02 < 400 * (step / 4000) ** 2 < 0.08  # of a parabola, between two points


# ------------------------------------------------------------------------------------ rational curves, rough cameras
def fisheye():
    theta = np.linspace(0.01, 1.3, 80)
    return np.tan(theta), theta


def test_reweightings_of_a_rational_curve(monkeypatch):
    """The fourth changes the curve by less than 1e-6 focal lengths; the second does not."""
    r, rd = fisheye()
    found = {}
    for turns in (2, rational.TURNS, 2 * rational.TURNS):
        monkeypatch.setattr(rational, "TURNS", turns)
        k, m = rational.fit_rational(r, rd, 3, 3)
        powers = (r * r)[:, None] ** np.arange(1, 4)
        found[turns] = r * (1 + powers @ k) / (1 + powers @ m)
    few, usual, more = found.values()
    assert np.abs(usual - more).max() < 1e-6 < np.abs(few - more).max()


def test_radii_at_which_a_curve_is_looked_at():
    """A fold that is a few steps wide is seen."""
    steps = 1 / (rational.SAMPLES - 1)
    for width, grows in ((4 * steps, False), (0.25 * steps, True)):
        # the slope 1 + 3 k1 s + 5 k2 s² is below 0 between two radii about sqrt(.5)
        middle = ((round(0.7 / steps) + 0.5) * steps) ** 2
        half = width * np.sqrt(middle)
        product = middle**2 - half**2
        assert (
            rational._grows(np.array([-2 * middle / product / 3, 1 / product / 5]), np.zeros(0), 1.0) == grows
        )


@pytest.mark.parametrize(("share", "exact"), [(LESS, True), (MORE, False)])
def test_innermost_rays_far_from_the_axis(share, exact):
    """The innermost tenth is used alone up to 1.2 rad; all the others have moved."""
    turn = np.arange(100.0)
    angle = np.where(turn < 10, share * 1.2, 1.3)
    rays = np.c_[np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)]
    uv = 300 * angle[:, None] * np.c_[np.cos(turn), np.sin(turn)] + (500, 400)
    uv[10:] += 30
    f, centre = start.rough_pinhole(rays, uv)
    assert (abs(f - 300) < 1e-6 and np.abs(centre - (500, 400)).max() < 1e-6) == exact


def test_the_innermost_rays():
    """A tenth of a hundred, and eight of twenty."""
    for count, used in ((100, 10), (20, start.LEAST_RAYS)):
        tangent = np.linspace(0.001, 0.5, count)
        rays = np.c_[tangent * np.cos(np.arange(count)), tangent * np.sin(np.arange(count)), np.ones(count)]
        angle = np.arctan(tangent)
        uv = 800 * rays[:, :2] / tangent[:, None] * angle[:, None] + (500, 400)
        for wrong, exact in ((used, True), (used - 1, False)):
            moved = uv.copy()
            moved[wrong:] += 30
            f, centre = start.rough_pinhole(rays, moved)
            assert (abs(f - 800) < 1e-6 and np.abs(centre - (500, 400)).max() < 1e-6) == exact
