"""Numbers of scenes, wands, self-calibration and lines, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.routes import lines, scene, scene_fit, scene_start, scene_vote, selfcalib, wand_start
from camcal.routes.line_geometry import Lines
from tests.routes import test_lines
from tests.sides import LESS, MORE

SIZE = (1000, 800)


def at(*middles):
    """Short lines about given places."""
    return Lines.of(
        [np.array([[u - 1.0, v], [u, v], [u + 1.0, v]]) for u, v in middles], [str(m) for m in middles], SIZE
    )


def test_lines_that_share_their_errors():
    reach = scene_fit.REACH * max(SIZE)
    both = at((100, 100), (100 + LESS * reach, 100), (100 + MORE * reach, 100))
    shared = scene_fit._shared(both, np.zeros(3, int))[0]
    assert shared[1] > 0 == shared[2]
    half = scene_fit._shared(at((100, 100), (200, 100), (100, 200)), np.array([0, 0, 0]))
    assert half[0, 1] == pytest.approx(0.5) and half[0, 2] == pytest.approx(
        0.5
    )  # 200 px are a fifth of the width


def test_the_width_of_a_line_s_vote():
    """At a distance of one width from the vanishing point a line has exp(-1/2) of its vote."""
    frame = np.eye(3)[None]
    f = np.array([0.8])
    for off in (0.0, scene_start.SOFT):
        ends = np.array([[[-0.1, 0.02], [0.1, 0.02]]])
        ends[0] += [[0, -off / 1000], [0, off / 1000]]
        (miss,) = scene_start._misses(ends * 1000, f * 1000, frame).min(2)
        assert miss == pytest.approx(off, rel=1e-3, abs=1e-9)
        votes = scene_start._votes(ends, 1000.0, f, frame) / np.linalg.norm(ends[0, 1] - ends[0, 0])
        assert votes[0] == pytest.approx(np.exp(-0.5 * (off / 1.0) ** 2), rel=1e-3)


def test_frames_that_are_refined(monkeypatch):
    """The best five of ten that differ, and all of four."""
    ends = np.zeros((9, 2, 2))
    for count, kept in ((10, 5), (4, 4)):
        f = 2.0 ** np.arange(count)
        monkeypatch.setattr(scene_start, "_sampled", lambda *_, f=f: (f, np.tile(np.eye(3), (len(f), 1, 1))))
        monkeypatch.setattr(scene_start, "_votes", lambda own, width, f, rotation: f)
        found = scene_start.frames(ends, np.zeros(2), 1.0)
        assert [focal for focal, _ in found] == sorted(f.tolist(), reverse=True)[:kept]
    assert scene_start.KEPT == 5


@pytest.mark.parametrize(
    ("picture", "noise"), [(False, [0.3, 0.3]), (True, [np.hypot(0.2, 0.0015 * 20), np.hypot(0.2, 0.6)])]
)
def test_the_noise_of_the_ends_of_lines(picture, noise):
    """Of a table .3 px; of a picture .2 px and .003 rad of half the length, of 20 px and of 400 px."""
    both = Lines.of([np.array([[100.0, 100], [120, 100]]), np.array([[100.0, 300], [500, 300]])], "ab", SIZE)
    assert scene_vote.seen_lines(both, picture).noise == pytest.approx(noise)


def test_factors_on_sigma_while_lines_are_chosen(monkeypatch):
    """It begins at twice and ends at once, where it ends as soon as the choice is settled."""
    asked, fits = [], []
    same = SimpleNamespace(family=np.repeat([0, 1], 5))
    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)
    found = SimpleNamespace(camera=camera, rotation=np.eye(3))

    def families(_, __, ___, wider):
        asked.append(wider)
        return same

    monkeypatch.setattr(scene, "families", families)
    monkeypatch.setattr(scene, "fit_scene", lambda *_: fits.append(1) or found)
    scene._followed(None, camera, {}, 800.0, np.eye(3), None)
    assert asked == [2.0, 1.5, 1.0] and len(fits) == 2
    assert scene.WIDER[0] == 2.0 and min(scene.WIDER) == scene.WIDER[-1] == 1.0


def test_directions_that_are_out_of_square(monkeypatch):
    """Each pair that the scene has is turned by its standard deviation, and the changes add up."""
    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)
    turned = []

    def fit(*arguments):
        square = arguments[-1]
        angle = np.pi / 2 - np.arccos(np.clip(np.abs(np.triu(square.T @ square, 1)).max(), 0, 1))
        turned.append(angle)
        moved = Camera(camera.lens, camera.params + [angle * 1000, 0, 0, 0], SIZE)
        return SimpleNamespace(camera=moved)

    monkeypatch.setattr(scene, "families", lambda *_: None)
    monkeypatch.setattr(scene, "fit_scene", fit)
    monkeypatch.setattr(scene, "replace", lambda _, covariance: covariance)
    before = SimpleNamespace(
        camera=camera, rotation=None, start=None, assumed=(), covariance=np.zeros((4, 4))
    )
    for directions, pairs in (((0, 1, 2), 3), ((0, 1), 1)):
        turned.clear()
        before.directions = directions
        covariance = scene._out_of_square(None, before, {}, None)
        assert turned == pytest.approx([np.arctan(scene.OUT_OF_SQUARE)] * pairs)
        assert np.sqrt(covariance[0, 0] / pairs) == pytest.approx(15.0, rel=1e-3)  # .015 rad


# ------------------------------------------------------------------------------------ focal lengths
def test_spreads_of_a_bar_that_are_not_distinguished(monkeypatch):
    """Of two focal lengths the one with the smaller spread, but not by one link alone below what markers allow."""
    monkeypatch.setattr(wand_start.epipolar, "FOCAL", np.array([1.0, 2.0]))
    monkeypatch.setattr(wand_start, "with_focal", lambda *a: a[2])
    finest = wand_start.FINEST
    for share, chosen in ((LESS, 1.0), (MORE, 2.0)):
        # (0 + F) (b + F) of the first against (F + F)² of the second: equal where b is 3 F
        spreads = {1.0: (0.0, share * 3 * finest), 2.0: (finest, finest)}
        monkeypatch.setattr(
            wand_start, "placed", lambda link, part, _, s=spreads: SimpleNamespace(spread=s[part][link])
        )
        assert wand_start.focal_part([0, 1], None, None, None) == chosen


def test_minima_of_the_focal_length_that_are_not_distinguished(monkeypatch):
    """A pair that is exact by chance at one focal length counts no more than one at the limit of noise."""
    monkeypatch.setattr(selfcalib.epipolar, "FOCAL", np.array([1.0, 2.0]))
    monkeypatch.setattr(selfcalib.epipolar, "axes_apart", lambda *_: 1e9)
    sharp = selfcalib.SHARP
    for share, chosen in ((LESS, 1.0), (MORE, 2.0)):
        # (0 + S) (b + S) of the first against (S + S)² of the second: equal where b is 3 S
        costs = np.array([[0.0, sharp], [share * 3 * sharp, sharp]])
        monkeypatch.setattr(selfcalib.epipolar, "focal_costs", lambda *_, c=costs: c)
        pairs = [SimpleNamespace(matrix=np.eye(3))] * 2
        assert selfcalib._focal(pairs, (1, 1)) == chosen


# ------------------------------------------------------------------------------------ lines
@pytest.mark.parametrize("factor", [0.1, 10])
def test_the_hold_on_what_lines_leave_undetermined(monkeypatch, factor):
    """A flexible model takes half the steps that it takes with a tenth of the hold, or ten times it, or fewer."""
    made = test_lines.lines_of(test_lines.BROWN, count=20, noise_px=0.1, points=15)
    lens = lenses.make("polynomial:5")
    start = Camera(lens, lens.pinhole(1280, 1280, 639.5, 479.5), test_lines.SIZE)
    usual = lines.fit(made, start, {}).iterations
    monkeypatch.setattr(lines, "PROXIMAL", factor * lines.PROXIMAL)
    assert 2 * usual <= lines.fit(made, start, {}).iterations
