"""Numbers by which the routes choose pairs, views, points and models, each just below and just above."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import (
    assumed_centre,
    epipolar,
    lifted,
    lines,
    picture_tracks,
    projective_views,
    reconstruct,
    scene,
    scene_bend,
    scene_start,
    selfcalib,
    wand,
    wand_start,
)
from camcal.routes.bundle import Tracks
from camcal.solve.parameters import nominal
from tests.routes.test_lines import lines_of
from tests.sides import LESS, MORE

SIZE = (1000, 800)
PINHOLE = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)


# ------------------------------------------------------------------------------------ distortion of two views
def kind_of(monkeypatch, gain, f_value=0.0):
    """The model chosen where a division model gains so much, and the full one has this F value."""
    pair = np.zeros((207, 2))
    monkeypatch.setattr(
        lifted,
        "_robust",
        lambda rays, *_: (1 - gain if rays[2, 0] == -0.3 else 1.0, np.ones(len(pair), bool)),
    )
    freedom = 200 - 1 - lifted.MORE
    squares = iter((1 + f_value * lifted.MORE / freedom, 1.0))
    monkeypatch.setattr(lifted, "_least_squares", lambda rays, *_: rays)
    monkeypatch.setattr(lifted, "_off", lambda *_: np.sqrt([next(squares)]))
    return lifted.of_matches([(pair, pair)], SIZE).kind


def test_distortion_that_is_significant(monkeypatch):
    assert kind_of(monkeypatch, LESS * lifted.GAIN) == "pinhole"
    assert kind_of(monkeypatch, MORE * lifted.GAIN) == "division"
    assert kind_of(monkeypatch, 0.5, LESS * lifted.F_WORTH) == "division"
    assert kind_of(monkeypatch, 0.5, MORE * lifted.F_WORTH) == "rational"


def test_matches_that_determine_distortion(monkeypatch):
    used = []
    made = SimpleNamespace(kind="pinhole")
    monkeypatch.setattr(lifted, "of_matches", lambda matches, *_: used.append(len(matches)) or made)
    uv, lens = np.zeros((200, 2)), lenses.make("division:1")
    rows = [np.repeat(np.arange(n)[:, None], 2, 1) for n in (selfcalib.LEAST_BENT, selfcalib.LEAST_BENT - 1)]
    tracks, pairs = SimpleNamespace(uv=uv), [SimpleNamespace(matches=r) for r in rows]
    assert selfcalib._bent(pairs, tracks, lens, SIZE, {}, 0) is None and used == [1]
    assert selfcalib._bent(pairs[1:], tracks, lens, SIZE, {}, 0) is None and used == [1]


# ------------------------------------------------------------------------------------ self-calibration
def test_focal_lengths_that_are_one_start(monkeypatch):
    monkeypatch.setattr(selfcalib, "_misses", lambda *_: 1.0)
    for share, starts in ((LESS, 1), (MORE, 2)):
        tried = []
        selfcalib._best_start(
            [1000.0, 1000 * np.exp(share * selfcalib.SAME)], lambda f, t=tried: (t.append(f), None), None
        )
        assert len(tried) == starts


def test_axes_that_meet(monkeypatch):
    pair = SimpleNamespace(matrix=np.eye(3))
    monkeypatch.setattr(epipolar, "focal_costs", lambda *_: np.ones((1, len(epipolar.FOCAL))))
    limit = assumed_centre.CENTRE * max(SIZE)
    monkeypatch.setattr(epipolar, "axes_apart", lambda *_: MORE * limit)
    assert selfcalib._focal([pair], SIZE) > 0
    monkeypatch.setattr(epipolar, "axes_apart", lambda *_: LESS * limit)
    assert selfcalib._focal([pair, pair], SIZE) > 0
    with pytest.raises(EstimationError, match="optical axes of the two views nearly intersect"):
        selfcalib._focal([pair], SIZE)


# ------------------------------------------------------------------------------------ growing a reconstruction
def bundle_of(views, points=30):
    bundle = reconstruct.empty(PINHOLE, views, points)
    bundle.translations[:2] = 0.0
    bundle.points[:] = 1.0
    uv = np.zeros((views * points, 2))
    return bundle, Tracks(np.repeat(np.arange(views), points), np.tile(np.arange(points), views), uv)


def test_adjustments_while_views_are_added(monkeypatch):
    """After each view at first, and then after `EVERY` views."""
    seen = []
    monkeypatch.setattr(
        reconstruct, "settled", lambda bundle, *_: seen.append(int(bundle.known_views.sum())) or bundle
    )
    monkeypatch.setattr(reconstruct, "_pose", lambda *_: Pose(np.eye(3), np.zeros(3)))
    monkeypatch.setattr(reconstruct, "with_points", lambda bundle, _: bundle)
    every = reconstruct.EVERY
    reconstruct.grow(*bundle_of(4 * every + 1), None)
    assert seen == [*range(2, 2 * every + 1), 3 * every, 4 * every, 4 * every + 1]


def test_images_far_from_their_points(monkeypatch):
    bundle, tracks = bundle_of(2, 1)
    for share, known in ((LESS, True), (MORE, False)):
        off = np.array([[share * reconstruct.ROUGH * max(SIZE), 0], [0, 0]])
        placed = SimpleNamespace(residuals=lambda _, off=off: off, points=bundle.points, camera=PINHOLE)
        assert np.isfinite(reconstruct._without_bad(placed, tracks)).all() == known


def test_pairs_tried_as_the_first(monkeypatch):
    monkeypatch.setattr(reconstruct, "_placed", lambda pair, *_: (pair, None))
    known = list(range(2 * reconstruct.PAIRS))
    assert reconstruct.first_pair(known, None, None, None)[0] == reconstruct.PAIRS - 1


def test_neighbours_and_similar_pictures(monkeypatch):
    """Votes of all pairs are equal: the similar ones of each are the first in the list."""
    count = picture_tracks.ALL_PAIRS + 4
    points = [SimpleNamespace(largest=lambda most, i=i: (i, most)) for i in range(count)]
    asked = []

    def matched(a, b):
        asked.append(a[1])
        return [0] * (1 if b[0] - a[0] > picture_tracks.NEIGHBOURS else 0)

    monkeypatch.setattr(picture_tracks, "matched", matched)
    pairs = picture_tracks._pairs(points)
    near = [(a, b) for a, b in combinations(range(count), 2) if b - a <= picture_tracks.NEIGHBOURS]
    assert set(near) <= set(pairs)
    last = [a for a, b in pairs if b == count - 1 and b - a > picture_tracks.NEIGHBOURS]
    assert last == list(range(picture_tracks.ALIKE)) and set(asked) == {picture_tracks.VOTERS}


@pytest.mark.parametrize("module", [reconstruct, wand_start])
def test_angles_beyond_which_a_pair_is_no_better(monkeypatch, module):
    """The score grows with the median angle up to the limit."""
    scores = [score_of(monkeypatch, module, share * module.WIDE) for share in (0.5, LESS, MORE, 2.0)]
    assert scores == pytest.approx([0.5 * module.WIDE * 20, LESS * module.WIDE * 20] + [module.WIDE * 20] * 2)


def score_of(monkeypatch, module, angle):
    count = 20
    monkeypatch.setattr(epipolar, "motions", lambda _: [Pose(np.eye(3), np.ones(3))])
    monkeypatch.setattr(epipolar, "two_view_points", lambda *_: (np.ones((count, 3)), np.full(count, angle)))
    rows = np.repeat(np.arange(count)[:, None], 2, 1)
    if module is reconstruct:
        tracks = Tracks(np.zeros(count, int), np.arange(count), np.full((count, 2), 500.0))
        pair = SimpleNamespace(matches=rows, agree=np.ones(count, bool), matrix=np.eye(3), first=0, second=1)
        return reconstruct._placed(pair, PINHOLE, tracks, reconstruct.empty(PINHOLE, 2, count))[0]
    monkeypatch.setattr(wand_start, "_lengths", lambda *_: np.ones(count))
    uv = np.full((count, 2), 500.0)
    link = wand_start.Link(0, 1, rows, (uv, uv), np.eye(3), np.ones(count, bool))
    return wand_start.placed(link, [PINHOLE] * 2, None).weight


# ------------------------------------------------------------------------------------ projective cameras
def third_view(monkeypatch, count, off):
    """What becomes of a third view that shares `count` points, by their distances from their projections.

    Whether there was one, whether it was refused, and how many images are left.
    """
    monkeypatch.setattr(projective_views, "_cameras", lambda xyz, *_: np.ones((len(xyz), 3, 4)))
    monkeypatch.setattr(
        projective_views, "_distances", lambda *_: np.tile(off, (projective_views.SAMPLES, 1))
    )
    state = SimpleNamespace(
        points=np.ones((count, 4)), point=np.arange(count), view=np.full(count, 2), q=np.ones((count, 3)),
        good=np.ones(count, bool), known=np.array([True, True, False]), refused=np.zeros(3, bool),
        cameras=np.zeros((3, 3, 4)), least=0.1, _place=lambda: None,
    )  # fmt: skip
    return projective_views._State.add(state), bool(state.refused[2]), int(state.good.sum())


def test_points_of_a_third_view(monkeypatch):
    least = projective_views.LEAST
    assert third_view(monkeypatch, least, np.zeros(least)) == (True, False, least)
    assert not third_view(monkeypatch, least - 1, np.zeros(least - 1))[0]
    for near, refused in ((least, False), (least - 1, True)):
        off = np.where(np.arange(least + 5) < near, 0.0, 1e9)
        assert third_view(monkeypatch, least + 5, off)[1] == refused


def test_images_of_a_third_view(monkeypatch):
    limit = projective_views.FAR * projective_views.MAD
    off = np.r_[np.ones(30), LESS * limit, MORE * limit]
    assert third_view(monkeypatch, 32, off) == (True, False, 31)
    tracks = Tracks(np.zeros(1, int), np.zeros(1, int), np.zeros((1, 2)))
    asked = []
    monkeypatch.setattr(
        projective_views,
        "_State",
        lambda *args: (
            asked.append(args[2])
            or SimpleNamespace(
                begin=lambda *_: None, known=np.ones(2, bool), add=lambda: False, alternate=lambda _: None
            )
        ),
    )
    monkeypatch.setattr(projective_views, "_off_plane", lambda *_: 0)
    pair = SimpleNamespace(matrix=np.eye(3))
    assert projective_views.of_pairs([pair], tracks, np.zeros(2), 100.0) is None
    assert asked == [projective_views.LEAST_FAR / 100]


def test_the_number_of_projective_views(monkeypatch):
    known = np.zeros(40, bool)
    known[:2] = True

    def add():
        known[known.sum()] = True
        return True

    state = SimpleNamespace(
        begin=lambda *_: None, known=known, add=add, alternate=lambda _: None, cameras=np.zeros((40, 3, 4))
    )
    monkeypatch.setattr(projective_views, "_State", lambda *_: state)
    monkeypatch.setattr(projective_views, "_off_plane", lambda *_: 0)
    tracks = Tracks(np.zeros(1, int), np.zeros(1, int), np.zeros((1, 2)))
    found = projective_views.of_pairs([SimpleNamespace(matrix=np.eye(3))], tracks, np.zeros(2), 1.0)
    assert len(found) == projective_views.MOST_VIEWS


# ------------------------------------------------------------------------------------ bars
def test_images_of_bars_for_each_camera(monkeypatch):
    class Adjusted(Exception):
        pass

    def adjust(*_):
        raise Adjusted

    monkeypatch.setattr(wand, "adjust", adjust)
    moving = SimpleNamespace(cameras=[PINHOLE] * 3, residuals=lambda _: np.ones((100, 2)))
    seen = SimpleNamespace(take=lambda _: None)
    least = 3 * wand.LEAST_IMAGES
    for count, enough in ((least, True), (least - 1, False)):
        monkeypatch.setattr(wand, "_usable", lambda *_, n=count: np.arange(n))
        if enough:
            with pytest.raises(Adjusted):
                wand._settled(moving, seen, [{}] * 3)
        else:
            assert wand._settled(moving, seen, [{}] * 3) is moving


def test_images_far_from_their_bars(monkeypatch):
    bounds = []
    monkeypatch.setattr(wand, "_usable", lambda _, off, bound: bounds.append(off <= bound) or np.arange(0))
    limit = wand.ROUGH * max(SIZE)
    off = np.array([[LESS * limit, 0], [MORE * limit, 0]])
    wand._settled(SimpleNamespace(cameras=[PINHOLE], residuals=lambda _: off), None, [{}])
    assert bounds[0].tolist() == [True, False]


# ------------------------------------------------------------------------------------ scenes and lines
def judged(monkeypatch, focal=1.0, centre=np.inf):
    """Whether the principal point is known, of a scene with these sigmas."""

    class Made(SimpleNamespace):
        pass

    sigmas = np.array([focal, focal, centre, centre])
    made = Made(
        camera=PINHOLE,
        start=None,
        rotation=np.eye(3),
        directions=(0, 1, 2),
        covariance=np.diag(sigmas**2),
        assumed=(),
    )
    monkeypatch.setattr(scene, "replace", lambda found, **new: Made(**{**vars(found), **new}))
    monkeypatch.setattr(scene, "_followed", lambda *_: made)
    monkeypatch.setattr(scene, "at_infinity", lambda *_: False)
    monkeypatch.setattr(scene, "_undetermined", lambda *_: EstimationError("undetermined", ""))
    monkeypatch.setattr(scene, "_with_centre", lambda _, found, *__: found)
    return scene._judged(SimpleNamespace(image_size=SIZE), made, {}, None).assumed == ()


def test_what_a_scene_determines(monkeypatch):
    limit = assumed_centre.CENTRE * max(SIZE)
    assert judged(monkeypatch, centre=LESS * limit) and not judged(monkeypatch, centre=MORE * limit)
    assert not judged(monkeypatch, focal=LESS * scene.FOCAL * 800)
    with pytest.raises(EstimationError, match="undetermined"):
        judged(monkeypatch, focal=MORE * scene.FOCAL * 800)


def changed(monkeypatch, apart, bend, picture):
    """Whether an estimate with distortion is taken: f is off by sigmas of 10 px, the distortion by those of .1."""
    monkeypatch.setattr(scene_bend, "common_bend", lambda *_: 0.0 if picture else bend)
    here = SimpleNamespace(family=np.zeros(3, int), camera=PINHOLE, covariance=np.diag([10.0**2]))
    camera = SimpleNamespace(params=np.array([800 + 10 * apart, bend * 0.1]))
    other = SimpleNamespace(camera=camera, covariance=np.diag([1.0, 0.1**2]))
    monkeypatch.setattr(scene_bend, "estimate", lambda *_: other)
    return scene_bend.with_distortion(here, SimpleNamespace(take=lambda _: None), {}, 0, picture) is other


@pytest.mark.parametrize("picture", [False, True])
def test_a_distortion_that_changes_the_focal_length(monkeypatch, picture):
    off, bent = scene_bend.OFF, scene_bend.BENT
    assert changed(monkeypatch, MORE * off, 9.0, picture) and not changed(
        monkeypatch, LESS * off, 9.0, picture
    )
    assert changed(monkeypatch, 9.0, MORE * bent, picture) and not changed(
        monkeypatch, 9.0, LESS * bent, picture
    )


def test_focal_lengths_of_scenes():
    """Two pairs of lines that meet at vanishing points of a known focal length."""
    for width, known in (
        (LESS * scene_start.FOCAL[1], True),
        (MORE * scene_start.FOCAL[1], False),
        (MORE * scene_start.FOCAL[0], True),
        (LESS * scene_start.FOCAL[0], False),
    ):
        ends = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2, 2))
        assert bool(len(scene_start._sampled(ends, np.random.default_rng(0), width)[0])) == known


def test_parameters_that_lines_leave_undetermined(monkeypatch):
    """A direction that changes one parameter, and another by a part of it."""
    seen, start = lines_of(PINHOLE, 12), nominal(lenses.make("division:1"), SIZE, {})
    found = lines._basis
    for share, undetermined in ((LESS, False), (MORE, True)):

        def with_lost(*args, share=share):
            lost = np.zeros((len(start.params), 1))
            lost[-1], lost[2] = 1.0, share * lines.NOTICEABLE
            return found(*args)[0], lost

        monkeypatch.setattr(lines, "_basis", with_lost)
        made = lines.fit(seen, start, {})
        assert (start.lens.names[2] in made.undetermined) == undetermined


def test_images_of_a_view_that_is_solved_again(monkeypatch):
    """In the rounds for all cameras a view of fewer images keeps its camera."""
    least = projective_views.LEAST
    monkeypatch.setattr(projective_views, "_cameras", lambda xyz, *_: np.ones((len(xyz), 3, 4)))
    monkeypatch.setattr(projective_views, "_distances", lambda _, q: np.zeros((1, len(q))))
    for count, solved in ((least, True), (least - 1, False)):
        state = SimpleNamespace(
            points=np.ones((count, 4)), point=np.arange(count), view=np.zeros(count, int), q=np.ones((count, 3)),
            known=np.array([True]), cameras=np.zeros((1, 3, 4)), least=0.1, _place=lambda: None,
            _usable=lambda everything=False, n=count: np.ones(n, bool), _weights=lambda rows: np.ones(len(rows)),
            _seen=lambda rows: np.ones((len(rows), 3)),
        )  # fmt: skip
        projective_views._State.alternate(state, 1)
        assert state.cameras.any() == solved
