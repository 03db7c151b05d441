"""Numbers that decide about single views, half turns and groups of points, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import bias, board_shape, causes, covariance, half_turns, next_instant, next_view, outliers
from camcal.assess.causes import search
from camcal.assess.checks import border, group, mirror, parameters
from camcal.assess.warning import BY_CHANCE
from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses
from tests.sides import LESS, MORE
from tests.solved import grid, solved


class Reached(Exception):
    """What a decision lets happen."""


def reach(*_, **__):
    raise Reached


def reaches(function, *args):
    try:
        function(*args)
    except Reached:
        return True
    return False


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


# ------------------------------------------------------------------------------------ suspected views
def suspects(good, monkeypatch, own, other=0.0, chance=0.0, views=8):
    """The suspected views where the first leaves `own` times the usual residual, as another board `other`."""
    data = SimpleNamespace(
        used=good.used,
        per_block=lambda _: np.full(views, 54),
        split=lambda _: [np.ones(54, bool)] * views,
        views=list(good.observations.views[:views]),
    )
    usual = np.sqrt(54 / (2 * 54 - 6))
    monkeypatch.setattr(outliers.figures, "rms_of_views", lambda _: np.r_[own, np.ones(views - 1)])
    made = SimpleNamespace(ratio=1.1, rms=other * usual / np.sqrt(54 / (2 * 54 - 8)))
    monkeypatch.setattr(outliers, "proportions", lambda *_, **__: made)
    monkeypatch.setattr(outliers, "f_exceeded", lambda *_: chance)
    monkeypatch.setattr(outliers.fit, "systematic", lambda _: [])
    monkeypatch.setattr(outliers, "Facts", lambda _: None)
    return [s.index for s in outliers._suspects(SimpleNamespace(observations=data, camera=None))]


def test_views_that_are_suspected(good, monkeypatch):
    limit, least = outliers.SUSPECT, causes.LEAST_VIEWS
    assert suspects(good, monkeypatch, MORE * limit, 0.1) == [0]
    assert suspects(good, monkeypatch, LESS * limit, 0.1) == []
    assert suspects(good, monkeypatch, 3.0, LESS * 3 / limit) == [0]
    assert suspects(good, monkeypatch, 3.0, MORE * 3 / limit) == []
    assert suspects(good, monkeypatch, 3.0, 0.1, LESS * outliers.BY_CHANCE) == [0]
    assert suspects(good, monkeypatch, 3.0, 0.1, MORE * outliers.BY_CHANCE) == []
    assert suspects(good, monkeypatch, 9.0, 0.1, views=least) == [0]
    monkeypatch.setattr(outliers, "median", np.min)  # of two, one is the median view
    assert suspects(good, monkeypatch, 9.0, 0.1, views=least - 1) == []


def test_sets_that_are_searched_for_mirror_images(monkeypatch):
    monkeypatch.setattr(mirror, "per_view", reach)
    monkeypatch.setattr(mirror.fit, "systematic", lambda _: [])
    for count, searched in ((causes.LEAST_VIEWS, True), (causes.LEAST_VIEWS - 1, False)):
        facts = SimpleNamespace(planar=True, image_size=(640, 480), views=[None] * count, solution=None)
        assert reaches(mirror.mirrored_views, facts) == searched


# ------------------------------------------------------------------------------------ half turns
VIEWS = 4
SIGNS = np.array([1.0, 1, 1, -1])


def turns(monkeypatch, evidence, chance, final=None, views=VIEWS):
    """Whether turns are believed, of this evidence promised by one step, and after the fits."""
    gram = np.outer(SIGNS, SIGNS) * evidence / (VIEWS**2 - 4)  # 16 explained with signs, 4 without
    monkeypatch.setattr(half_turns, "half_turn", lambda _: Pose(np.eye(3), np.zeros(3)))
    monkeypatch.setattr(half_turns, "_gram", lambda *_: (gram, 9))
    monkeypatch.setattr(half_turns, "_variance", lambda _: 1.0)
    monkeypatch.setattr(half_turns, "redundancy", lambda _: 100)
    chances = iter(chance)
    monkeypatch.setattr(half_turns, "_logarithm_of_chance", lambda *_: next(chances))
    monkeypatch.setattr(half_turns, "replace", lambda flat, **_: flat)
    monkeypatch.setattr(half_turns, "turned", lambda *_: None)
    monkeypatch.setattr(half_turns, "renamed", lambda *_: None)
    fits = iter((1.0, np.exp(-(final if final is not None else evidence) / 100)))
    monkeypatch.setattr(half_turns, "refit", lambda *_: SimpleNamespace(fit=SimpleNamespace(cost=next(fits))))
    data = SimpleNamespace(view_ids=tuple("abcd"))
    flat = SimpleNamespace(observations=data, poses=[None] * views, fit=SimpleNamespace(cost=1e6))
    return half_turns.decided(flat, None) is not None


def test_turns_that_are_believed(monkeypatch):
    least = half_turns.EVIDENCE + 2 * np.log(2) * VIEWS
    most = np.log(board_shape.SIGNIFICANT) - (VIEWS - 1) * np.log(2)
    below, above = most + np.log(LESS), most + np.log(MORE)
    assert turns(monkeypatch, MORE * least, (below, below))
    assert not turns(monkeypatch, LESS * least, (below, below), 99.0)
    assert not turns(monkeypatch, 99.0, (below, below), LESS * least)
    assert not turns(monkeypatch, 99.0, (above, below)) and not turns(monkeypatch, 99.0, (below, above))
    assert turns(monkeypatch, 99.0, (below, below), views=causes.LEAST_VIEWS)
    assert not turns(monkeypatch, 99.0, (below, below), views=causes.LEAST_VIEWS - 1)


def test_turns_that_a_known_shape_decides(monkeypatch):
    least = half_turns.EVIDENCE + 2 * np.log(2) * VIEWS
    data = SimpleNamespace(
        view_ids=tuple("abcd"), target={"shape": {"ideal": []}}, kept=lambda: data, views=[]
    )
    monkeypatch.setattr(half_turns, "half_turn", lambda *_: Pose(np.eye(3), np.zeros(3)))
    monkeypatch.setattr(half_turns, "redundancy", lambda _: 100)
    monkeypatch.setattr(half_turns, "renamed", lambda *_: data)
    monkeypatch.setattr(half_turns, "turned", lambda *_: None)
    for evidence, believed in ((MORE * least, True), (LESS * least, False)):
        costs = iter([(0, np.ones(4)), (0, np.array([2, 2, 2, 0.5]))] + [(0, np.ones(4))] * 2)
        monkeypatch.setattr(half_turns, "refine_poses", lambda *_, c=costs: next(c))
        fit, after = (
            SimpleNamespace(observations=data, poses=[None] * 4, camera=None, fit=SimpleNamespace(cost=cost))
            for cost in (1.0, np.exp(-evidence / 100))
        )
        monkeypatch.setattr(half_turns, "refit", lambda *_, a=after: a)
        found = half_turns.decided_by_known(fit, None)
        assert (found is not None) == believed and (found is None or found.views == ("d",))


# ------------------------------------------------------------------------------------ outlying views of a search
def test_views_that_can_be_outlying():
    most = search.MOST_OUTLYING
    for count, outlying in ((2 * most - 1, 1), (2 * most, 2)):
        chosen = []
        of = SimpleNamespace(
            count=count,
            columns={search.OF_ONE: np.zeros((1, 1))},
            linear=SimpleNamespace(gains_of_views=lambda _, some: np.arange(len(some))),
            promised=lambda gain, numbers, choices: -numbers,
            fit=lambda *a, c=chosen: c.append(int(a[3].sum())),
            _some=search.Search._some,
        )
        assert list(search.Search.outlying(of)) == [] and chosen == [outlying]


def test_what_a_predicted_step_may_leave():
    of = SimpleNamespace(linear=SimpleNamespace(cost=2.0))
    least = search.LEAST_LEFT
    for left, expected in ((MORE * least, MORE * least), (LESS * least, least), (-1.0, least)):
        made = search.Search._left(of, 2.0 * (1 - left))
        assert made == pytest.approx(2 * expected, rel=1e-6)


# ------------------------------------------------------------------------------------ checks
def test_rings_that_differ(monkeypatch):
    lengths, ring = np.random.default_rng(0).rayleigh(size=240), np.arange(240) % border.RINGS
    for share, differ in ((LESS, True), (MORE, False)):
        monkeypatch.setattr(border, "f_exceeded", lambda *_, s=share: s * BY_CHANCE)
        assert border._differ(lengths, ring) == differ


def test_sizes_of_groups():
    """The others have to determine where a group belongs."""
    rng = np.random.default_rng(0)
    for size in group.SIZES:
        least = round(size / group.MOST_PART)
        for count, taken in ((least, True), (least - 1, False)):
            found = {len(g) for g in group.groups(rng.normal(size=(count, 3)))}
            assert (size in found) == taken
    assert {len(g) for g in group.groups(rng.normal(size=(60, 3)))} == set(group.SIZES)


def test_correlations_that_are_listed():
    for share, listed in ((MORE, True), (LESS, False)):
        matrix = np.eye(2)
        matrix[0, 1] = matrix[1, 0] = share * covariance.STRONG
        of = SimpleNamespace(matrix=matrix, names=("fx", "k1"), transform=np.eye(2))
        assert bool(covariance.Covariance.strong_correlations(of)) == listed


def test_correlations_of_one_message(good):
    for count, more in ((parameters.NAMED, False), (parameters.NAMED + 1, True)):
        known = SimpleNamespace(strong_correlations=lambda n=count: [("fx", "k1", 0.99)] * n)
        (said,) = parameters.correlated(SimpleNamespace(camera=good.camera, covariance=known))
        assert said.message.count("fx with k1") == parameters.NAMED and ("..." in said.message) == more


# ------------------------------------------------------------------------------------ residuals
def test_freedom_of_a_bias_ratio(monkeypatch):
    monkeypatch.setattr(bias, "redundancy", lambda _: 1000)
    monkeypatch.setattr(bias, "_by_size", lambda _: [[np.arange(9)]])
    rows = SimpleNamespace(view=0, residuals=np.ones((54, 2)))
    design = SimpleNamespace(rows=lambda: [rows], views=[SimpleNamespace(xyz=grid())], calibration=None)
    for freedom, known in ((bias.LEAST_FREEDOM, True), (bias.LEAST_FREEDOM - 1, False)):
        monkeypatch.setattr(bias, "_without_poses", lambda *_, f=freedom: (1.0, f))
        assert (bias.bias_ratio(design) is not None) == known


def test_points_of_a_ring():
    def rings(count):
        return len(set(bias._rings(np.arange(count)).tolist()))

    of_one, most = bias.OF_A_RING, bias.RINGS
    assert (rings(3 * of_one), rings(3 * of_one - 1)) == (3, 2)
    assert (rings(most * of_one), rings(most * of_one - 1), rings(2 * most * of_one)) == (
        most,
        most - 1,
        most,
    )


def test_points_that_a_camera_has_to_see(monkeypatch):
    monkeypatch.setattr(next_instant, "_problem", reach)
    here = Pose(rotations.exp(np.zeros(3)), np.zeros(3))
    for count, seen in ((next_instant.LEAST_POINTS, True), (next_instant.LEAST_POINTS - 1, False)):
        uv = np.full((20, 2), 50.0)
        uv[count:] = -1.0
        cameras = {n: SimpleNamespace(project=lambda _, uv=uv: uv, image_size=(100, 100)) for n in "ab"}
        rig = SimpleNamespace(cameras=cameras, cam_from_rig=dict.fromkeys("ab", here))
        assert reaches(next_instant._added, SimpleNamespace(rig=rig), here, np.zeros((20, 3))) == seen


def test_suggestions_that_are_refined():
    """After so many the best candidate is taken as it is."""
    known = SimpleNamespace(
        sigmas=lambda _: np.array([[2.0], [1.0]]), candidates=SimpleNamespace(around=reach)
    )
    state, poses = np.zeros(1), Poses(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))
    for count, refined in ((next_view.MOVED - 1, True), (next_view.MOVED, False)):
        taken = [None] * count
        assert reaches(next_view.NextView._moved, known, state, poses, np.zeros(2), taken, None) == refined
