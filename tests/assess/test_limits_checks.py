"""Limits of checks and of causes, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import causes, free_board
from camcal.assess.causes import Found
from camcal.assess.checks import coverage, fit, folds, lens, noise, rejected, views
from camcal.assess.checks.facts import Facts
from camcal.assess.difference import grid_of
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from tests.sides import LESS, MORE
from tests.solved import solved

SIZE = (640, 480)


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


def severities(found):
    return [w.severity for w in found]


# ------------------------------------------------------------------------------------ the picture
def test_points_outside_the_picture():
    uv = np.full((20, 2), 100.0)
    for far, out in ((LESS * coverage.MARGIN_PX, []), (MORE * coverage.MARGIN_PX, ["doubtful"])):
        uv[0, 0] = SIZE[0] - 0.5 + far
        assert severities(coverage.outside_image(SimpleNamespace(image_points=uv, image_size=SIZE))) == out
    most = round(20 * coverage.MANY_OUTSIDE)
    for count, said in ((most, ["doubtful"]), (most + 1, ["wrong"])):
        uv = np.full((20, 2), 100.0)
        uv[:count] = 2000.0
        assert severities(coverage.outside_image(SimpleNamespace(image_points=uv, image_size=SIZE))) == said


def smaller(x, y, outside=0):
    """Whether the principal point, as parts of the picture's middle, and points fit a smaller picture."""
    centre = (np.array([x, y]) * SIZE - 1) / 2
    uv = np.full((20, 2), 10.0)
    uv[:outside] = np.array(SIZE) - 1.0
    camera = SimpleNamespace(params=np.r_[800.0, 800.0, centre])
    facts = SimpleNamespace(image_points=uv, image_size=SIZE, camera=camera, groups=lambda _: ["cx", "cy"])
    return bool(list(coverage.image_size(facts)))


def test_a_picture_of_another_size():
    most = coverage.OFF_CENTRE
    assert smaller(LESS * most, LESS * most) and not smaller(LESS * most, MORE * most)
    apart = coverage.SAME_RATIO
    assert smaller(0.5, 0.5 + LESS * apart) and not smaller(0.5, 0.5 + MORE * apart)
    most = round(20 * coverage.MANY_OUTSIDE) - 1
    assert smaller(0.5, 0.5, most) and not smaller(0.5, 0.5, most + 2)


def test_a_fold_in_the_corners_of_a_picture():
    camera = Camera(make("pinhole"), np.array([800.0, 800, 320, 240]), SIZE)
    pixels = grid_of(SIZE)
    for limit, below, above in ((lens.TIPS, "note", "doubtful"), (lens.MUCH, "doubtful", "wrong")):
        count = int(np.ceil(limit * len(pixels)))
        for unseen, said in ((pixels[: count - 1], below), (pixels[:count], above)):
            bent = SimpleNamespace(params=camera.params, lens=SimpleNamespace(limit_angle=lambda _: 0.5))
            facts = SimpleNamespace(unseen=unseen, image_size=SIZE, camera=bent, image_points=pixels)
            assert severities(lens.fold_in_image(facts)) == [said]


# ------------------------------------------------------------------------------------ residuals
def test_a_large_rms():
    """The smaller of a part of the diagonal and, in large pictures, of so many px or another part of it."""
    small, large = fit.MANY_PX / fit.LARGE, fit.MANY_PX / fit.CLICKED  # px across, where the three meet
    for diagonal, most in (
        (LESS * small, LESS * fit.MANY_PX),
        (MORE * small, fit.MANY_PX),
        (LESS * large, fit.MANY_PX),
        (MORE * large, MORE * fit.MANY_PX),
    ):
        assert fit.most_px(diagonal) == pytest.approx(most)


def test_radial_residuals_that_are_systematic(good, monkeypatch):
    for share, f, said in (
        (MORE * fit.EXPLAINED, 99.0, True),
        (LESS * fit.EXPLAINED, 99.0, False),
        (0.9, MORE * fit.F_LEAST, True),
        (0.9, LESS * fit.F_LEAST, False),
    ):
        monkeypatch.setattr(fit, "radial_structure", lambda _, s=(share, f): s)
        assert bool(list(fit.systematic(Facts(good)))) == said


def test_outliers_that_bend_the_camera(monkeypatch):
    """By more than a px, and than so many of the camera's own sigmas."""
    for apart, sigma, bent in (
        (MORE * fit.SEVERAL_PX, 0.0, True),
        (LESS * fit.SEVERAL_PX, 0.0, False),
        (9.0, 9.0 / (MORE * fit.SIGMAS), True),
        (9.0, 9.0 / (LESS * fit.SIGMAS), False),
    ):
        monkeypatch.setattr(fit, "moved_without", lambda *_, m=(apart, sigma): m)
        assert fit._bent_by(None, None) == bent


def test_rings_that_show_a_bend():
    """Points of too few rings show nothing; and a bump narrower than a ring of the largest number is averaged away."""

    def structure(count, bump=1.0):
        radius = np.linspace(1.0, 100.0, count)
        off = np.where(np.arange(count) < bump * count / 2, 1.0, -1.0)
        uv = np.c_[radius, np.zeros(count)]
        solution = SimpleNamespace(used_residuals=np.c_[off, np.zeros(count)])
        camera = SimpleNamespace(params=np.zeros(4))
        return fit.radial_structure(SimpleNamespace(image_points=uv, camera=camera, solution=solution))

    least = fit.LEAST_RINGS * fit.OF_A_RING
    assert structure(least)[0] > 0.5 and structure(least - 1) == (0.0, 0.0)
    most = fit.RINGS * fit.OF_A_RING
    degrees = []  # of freedom between rings
    keep = fit._explained
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "_explained", lambda v, g: degrees.append(len(g)) or keep(v, g))
        for count in (most - 1, most, 2 * most):
            structure(count)
    assert degrees == [fit.RINGS - 1, fit.RINGS, fit.RINGS]


def test_whole_pixels():
    uv = np.zeros((100, 2))
    least = int(np.floor(200 * noise.ROUNDED)) + 1
    for count, said in ((least, True), (least - 1, False)):
        uv.ravel()[:] = 0.3
        uv.ravel()[:count] = 5.0
        assert bool(list(noise.rounded(SimpleNamespace(image_points=uv)))) == said
    for off, said in ((LESS * noise.ON_GRID, True), (1.01 * noise.ON_GRID, False)):
        uv[:] = off
        assert bool(list(noise.rounded(SimpleNamespace(image_points=uv)))) == said
    for count, said in ((noise.LEAST_ROUNDED, True), (noise.LEAST_ROUNDED - 1, False)):
        assert bool(list(noise.rounded(SimpleNamespace(image_points=np.zeros((count, 2)))))) == said


@pytest.mark.parametrize(
    ("moment", "deviations", "codes"),
    [
        (LESS * noise.LIGHT, -MORE * noise.SIGNIFICANT, ["light-tailed-residuals"]),
        (MORE * noise.LIGHT, -MORE * noise.SIGNIFICANT, []),
        (LESS * noise.LIGHT, -LESS * noise.SIGNIFICANT, []),
        (MORE * noise.HEAVY, MORE * noise.SIGNIFICANT, ["heavy-tailed-residuals"]),
        (LESS * noise.HEAVY, MORE * noise.SIGNIFICANT, []),
        (MORE * noise.HEAVY, LESS * noise.SIGNIFICANT, []),
    ],
)
def test_tails_of_the_residuals(monkeypatch, moment, deviations, codes):
    monkeypatch.setattr(noise, "fourth_moment", lambda _: (moment, deviations))
    assert [w.code for w in noise.tails(None)] == codes


def test_many_rejected_points():
    def said(lost):
        used = np.arange(1000) >= lost
        data = SimpleNamespace(point_count=1000, used=used, blocks=SimpleNamespace(counts=np.array([1000])))
        data.per_block = lambda m: np.array([m.sum()])
        facts = SimpleNamespace(solution=SimpleNamespace(observations=data), views=[SimpleNamespace(id="a")])
        return severities(rejected.many_rejected(facts))

    many, fifth = round(1000 * rejected.MANY), round(1000 * rejected.A_FIFTH)
    assert said(many) == [] and said(many + 1) == ["note"]
    assert said(fifth) == ["note"] and said(fifth + 1) == ["doubtful"]


def test_cameras_of_the_folds():
    def said(ratio, px):
        facts = SimpleNamespace(holdout={"difference": {"ratio": ratio, "median_px": px}})
        return severities(folds.views_disagree(facts))

    assert said(LESS * folds.DISAGREE, 9.0) == [] and said(MORE * folds.DISAGREE, 9.0) == ["doubtful"]
    far, seen = folds.FAR_APART, folds.VISIBLE_PX
    assert said(MORE * far, MORE * seen) == ["wrong"]
    assert said(LESS * far, MORE * seen) == said(MORE * far, LESS * seen) == ["doubtful"]


# ------------------------------------------------------------------------------------ views
def facing(tilts_deg):
    """Facts of a board in the plane z = 0, tilted about x by these angles."""
    turn = np.stack([rotations.exp(np.array([np.radians(t), 0, 0])) for t in tilts_deg])
    poses = SimpleNamespace(rotations=turn, translations=np.tile([0.0, 0.0, 5.0], (len(turn), 1)))
    shapes = SimpleNamespace(axes=np.tile(np.eye(3), (len(turn), 1, 1)))
    data = SimpleNamespace(poses=poses)
    return SimpleNamespace(planar=True, views=[None] * len(turn), solution=data, shapes=shapes)


def test_boards_that_are_parallel():
    """Half of them tilted to each side by the same angle, which is the rms; then all to one side."""
    limit = views.PARALLEL_DEGREES
    for share, codes in ((LESS, ["fronto-parallel-views"]), (MORE, [])):
        assert [w.code for w in views.fronto_parallel(facing([share * limit, -share * limit]))] == codes
    for share, code in ((LESS, "fronto-parallel-views"), (MORE, "parallel-views")):
        assert [w.code for w in views.fronto_parallel(facing([share * limit] * 2))] == [code]
    for share, severity in ((LESS, "wrong"), (MORE, "doubtful")):
        angle = share * views.NOTHING_DEGREES
        assert severities(views.fronto_parallel(facing([angle, -angle]))) == [severity]


def test_views_that_repeat_another(monkeypatch):
    limit = views.SAME_PX * np.sqrt(8 / 2)
    for share, count in ((LESS, 1), (MORE, 2)):
        corners = np.zeros((2, 8))
        corners[1, 3] = share * limit
        monkeypatch.setattr(views, "_seen_corners", lambda _, c=corners: c)
        facts = SimpleNamespace(views=[None, None])
        facts.once = lambda f, of=facts: f(of)
        assert views.distinct_count(facts) == count


def test_how_many_views_repeat_another(monkeypatch):
    least = round(10 * views.REPEATED)
    for again, codes in ((least, ["repeated-view"]), (least + 1, ["duplicate-views"])):
        pairs = np.stack([np.zeros(again, int), 1 + np.arange(again)], 1)
        names = [SimpleNamespace(id=str(i)) for i in range(10)]
        facts = SimpleNamespace(views=names, once=lambda _, p=pairs: p)
        assert [w.code for w in (*views.duplicates(facts), *views.repeated(facts))] == codes


def test_a_focal_length_that_is_known_from_few_views(monkeypatch):
    monkeypatch.setattr(views, "distinct_count", lambda _: 2)
    facts = SimpleNamespace(planar=True, views=[None] * 2, free_names=["fx"] * 7, groups=lambda _: [])
    for share, severity in ((LESS, "note"), (MORE, "doubtful")):
        monkeypatch.setattr(views.parameters, "focal_sigma", lambda _, s=share: s * views.SURE_FOCAL)
        assert severities(views.few_views(facts)) == [severity]


@pytest.mark.parametrize(("free", "said"), [(18, False), (19, True)])
def test_parameters_that_six_views_determine(monkeypatch, free, said):
    monkeypatch.setattr(views, "distinct_count", lambda _: 6)
    monkeypatch.setattr(views.parameters, "focal_sigma", lambda _: 0.1)
    facts = SimpleNamespace(planar=True, views=range(6), free_names=range(free), groups=lambda _: ())
    assert bool(list(views.few_views(facts))) == said


def test_views_of_which_most_see_the_front(monkeypatch):
    def codes(count, minority):
        monkeypatch.setattr(views, "sides", lambda *_: np.arange(count) < minority)
        facts = facing([10.0] * count)
        facts.views = [SimpleNamespace(id=str(i)) for i in range(count)]
        facts.solution.observations = SimpleNamespace(is_printed=False)
        return [w.code for w in views.mirrored(facts)]

    assert codes(3, 1) == ["mirrored-views"] and codes(2, 1) == []
    most = int(12 * views.MINORITY)
    assert codes(12, most) == ["mirrored-views"] and codes(12, most + 1) == []


def test_the_plane_of_what_is_printed():
    for share, behind in ((1.0005, True), (0.9995, False)):
        facts = facing([0.0])
        cosine = share * views.ALONG_Z
        facts.shapes.axes = rotations.exp(np.array([np.arccos(cosine), 0, 0]))[None]
        facts.solution.poses.translations[:] = (0.0, 0.0, -5.0)
        assert views._from_behind(facts)[0] == behind


# ------------------------------------------------------------------------------------ causes
def test_what_parts_of_the_views_explain():
    base = SimpleNamespace(poses=[None] * causes.LEAST_FOR_EACH)
    few = SimpleNamespace(poses=[None] * (causes.LEAST_FOR_EACH - 1))

    def found(how, share, of=base):
        trial = SimpleNamespace(how=how, kind="camera")
        return Found(of, trial, False, 0.0, 0.0, 1.0, 1.0, share)

    for share, common in ((MORE * causes.MOST_OF_IT, True), (LESS * causes.MOST_OF_IT, False)):
        made = found("split", share)
        assert made.common == common and (made.cause is not None) == common
    assert found("each", 1.0).cause is not None and found("each", 1.0, few).cause is None


def test_problems_that_are_searched_for_a_cause(good, monkeypatch):
    class Searched(Exception):
        pass

    def search(_):
        raise Searched

    monkeypatch.setattr(causes, "Search", search)

    def searched(points, count):
        base = SimpleNamespace(
            observations=SimpleNamespace(point_count=points), poses=[None] * count, free=good.free
        )
        try:
            causes.find(base)
        except Searched:
            return True
        return False

    points, most, least = causes.MOST_POINTS, causes.MOST_VIEWS, causes.LEAST_VIEWS
    assert searched(points, most) and searched(points, least)
    assert not (searched(points + 1, most) or searched(points, most + 1) or searched(points, least - 1))


def test_a_cause_that_is_found(good, monkeypatch):
    """By its probability by chance, and by what it leaves."""

    def found(chance, left):
        trial = SimpleNamespace(bic=-1e9, cost=50 * left**2, numbers=0, kind="camera", how="split")
        search = SimpleNamespace(
            none=0.0,
            freedom=100,
            linear=SimpleNamespace(cost=100.0),
            all=lambda: [trial],
            by_chance=lambda _: chance,
        )
        monkeypatch.setattr(causes, "Search", lambda _: search)
        monkeypatch.setattr(causes, "_noise", lambda _: 1.0)
        monkeypatch.setattr(causes, "_share", lambda *_: 1.0)
        monkeypatch.setattr(causes, "effect_px", lambda *_: (0.0, 0.0))
        return causes.find(good)

    assert found(LESS * causes.BY_CHANCE, 1.0).trial is not None
    assert found(MORE * causes.BY_CHANCE, 1.0).trial is None
    assert not found(0.0, LESS * causes.MOST_LEFT).views and found(0.0, MORE * causes.MOST_LEFT).views


# ------------------------------------------------------------------------------------ a free board
def test_problems_whose_board_is_freed(monkeypatch):
    """Up to so many views, and points of the board."""

    class Freed(Exception):
        pass

    def step(*_):
        raise Freed

    monkeypatch.setattr(free_board, "step", step)
    monkeypatch.setattr(free_board.figures, "redundancy", lambda _: 1e6)

    def freed(views_, points):
        board = SimpleNamespace(points=np.zeros((points, 3)), size=9)
        monkeypatch.setattr(free_board, "Several", SimpleNamespace(of=lambda _: None))
        monkeypatch.setattr(free_board, "make_board", lambda *_: board)
        data = SimpleNamespace(kept=lambda: SimpleNamespace(views=[]))
        solution = SimpleNamespace(board=None, poses=[None] * views_, observations=data)
        try:
            return free_board.promise(solution) is not None
        except Freed:
            return True

    most, points = free_board.MOST_VIEWS, free_board.MOST_POINTS
    assert freed(most, points) and not freed(most + 1, points) and not freed(most, points + 1)
