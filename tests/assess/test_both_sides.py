"""Numbers that decide something in checks and estimates of uncertainty, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import (
    bias,
    candidate_views,
    exchanged_points,
    holdout,
    known,
    rig_checks,
    rolling,
)
from camcal.assess.causes import words
from camcal.assess.checks import board, border, circles, coverage, fit
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import BY_CHANCE
from camcal.data.observations import View
from camcal.errors import UsageError
from tests.sides import LESS, MORE
from tests.solved import grid, solved


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


# ------------------------------------------------------------------------------------ what a cause does
@pytest.mark.parametrize(
    ("given", "severity"),
    [
        ((LESS * words.VISIBLE_PX, 0.0, False, MORE * words.WORSE), "note"),
        ((MORE * words.VISIBLE_PX, 0.0, False, 1.0), "doubtful"),
        ((0.0, MORE * words.VISIBLE_PX, False, 1.0), "doubtful"),
        ((0.0, 0.0, False, LESS * words.WORSE), "doubtful"),
        ((LESS * words.SEVERAL_PX, 0.0, False, 1.0), "doubtful"),
        ((MORE * words.SEVERAL_PX, 0.0, False, 1.0), "wrong"),
        ((LESS * words.MANY_PX, 0.0, True, 1.0), "doubtful"),
        ((MORE * words.MANY_PX, 0.0, True, 1.0), "wrong"),
        ((0.0, 0.0, False, MORE * words.OTHER_CAMERAS, "several-cameras"), "doubtful"),
        ((0.0, 0.0, False, LESS * words.OTHER_CAMERAS, "several-cameras"), "wrong"),
    ],
)
def test_the_severity_of_a_cause(given, severity):
    assert words.severity(*given) == severity


def trial(kind):
    camera = SimpleNamespace(params=np.array([800.0, 800, 320, 240]))
    return SimpleNamespace(kind=kind, camera=camera, warp=SimpleNamespace(centre=np.array([320.0, 240.0])))


def test_resized_pictures():
    wanted = (1.1 - 1) * np.array([320.5, 240.5])
    for part, resized in ((LESS, True), (MORE, False)):
        shift = wanted * (1 + part * words.ALIKE)
        assert words._is_resized(1.1, shift, trial("camera")) == resized
    for part, resized in ((MORE, True), (LESS, False)):
        scale = np.exp(part * words.RESIZED)
        shift = (scale - 1) * np.array([320.5, 240.5])
        assert words._is_resized(scale, shift, trial("camera")) == resized


def test_views_in_a_sentence(good):
    found = SimpleNamespace(base=good)
    for count, rest in ((words.NAMED, False), (words.NAMED + 1, True)):
        assert ("..." in words._names(found, np.arange(8) < count)) == rest


# ------------------------------------------------------------------------------------ checks
def test_a_board_of_another_shape(good):
    def said(p_value, after):
        free = SimpleNamespace(p_value=p_value, after=after, before=1.0, rms_offset=0.01)
        return bool(list(board.not_flat(SimpleNamespace(free_board=free, solution=good))))

    assert said(0.0, LESS * board.GAIN) and not said(0.0, MORE * board.GAIN)
    assert said(LESS * BY_CHANCE, 0.5) and not said(MORE * BY_CHANCE, 0.5)


def test_circles_and_a_bent_board(good):
    """The board's own shape promises .19 of the cost: circles explain half of it or are a part of its errors."""
    bent = SimpleNamespace(p_value=0.0, before=1.0, after=0.9)
    facts = SimpleNamespace(free_board=bent, solution=good)
    half = circles.LEAST_OF_BOARD * 0.19 * good.fit.cost
    for share, more in ((LESS, True), (MORE, False)):
        assert circles._board_explains_more(facts, SimpleNamespace(gain=share * half)) == more
    bent.p_value = MORE * BY_CHANCE
    assert not circles._board_explains_more(facts, SimpleNamespace(gain=0.0))


def test_radii_that_circles_have(good, monkeypatch):
    asked = []  # whether the board explains more, which is asked only of circles
    monkeypatch.setattr(circles, "_board_explains_more", lambda *_: asked.append(1) or True)
    for deviations, radius, looked in (
        (MORE * circles.SIGNIFICANT, 0.3, True),
        (LESS * circles.SIGNIFICANT, 0.3, False),
        (99.0, MORE * circles.SMALLEST, True),
        (99.0, LESS * circles.SMALLEST, False),
        (99.0, LESS * circles.LARGEST, True),
        (99.0, MORE * circles.LARGEST, False),
    ):
        asked.clear()
        found = SimpleNamespace(deviations=deviations, radius=radius)
        monkeypatch.setattr(circles, "circles", lambda *_, f=found: f)
        list(circles.circle_centres(SimpleNamespace(solution=good, design=1)))
        assert bool(asked) == looked


def test_noise_that_grows_towards_the_border(good, monkeypatch):
    facts = Facts(good)
    monkeypatch.setattr(border, "_differ", lambda *_: True)
    monkeypatch.setattr(border, "_named", lambda *_: "fx")
    for ratio, severities in (
        (LESS * border.TOO_SMALL, []),
        (MORE * border.TOO_SMALL, ["note"]),
        (LESS * border.FAR_TOO_SMALL, ["note"]),
        (MORE * border.FAR_TOO_SMALL, ["doubtful"]),
    ):
        monkeypatch.setattr(border, "too_small", lambda *_, r=ratio: np.array([1.0, r]))
        assert [w.severity for w in border.noise_by_radius(facts)] == severities


def test_points_of_rings(good):
    facts = SimpleNamespace(camera=good.camera)
    for count, known_ in (
        (border.RINGS * border.LEAST_POINTS, True),
        (border.RINGS * border.LEAST_POINTS - 1, False),
    ):
        facts.image_points = np.random.default_rng(0).uniform(0, 400, (count, 2))
        made = border.rings(facts)
        assert (made is not None) == known_


def test_a_board_that_covers_little(good, monkeypatch):
    for share, severities in (
        (MORE * coverage.LEAST_AREA, []),
        (LESS * coverage.LEAST_AREA, ["note"]),
        (MORE * coverage.SMALL_AREA, ["note"]),
        (LESS * coverage.SMALL_AREA, ["doubtful"]),
    ):
        side = np.sqrt(share * 640 * 480)
        square = np.array([[0, 0], [side, 0], [0, side], [side, side]]) + 1.0
        facts = SimpleNamespace(image_points=square, image_size=(640, 480))
        assert [w.severity for w in coverage.poor(facts)] == severities


def test_coordinates_an_unknown(monkeypatch):
    unknown = 100
    for observed, severities in (
        (fit.REDUNDANT * unknown, []),
        (fit.REDUNDANT * unknown - 1, ["note"]),
        (fit.BARELY * unknown, ["note"]),
        (fit.BARELY * unknown - 1, ["doubtful"]),
    ):
        monkeypatch.setattr(fit.figures, "redundancy", lambda _, n=observed: n - unknown)
        facts = SimpleNamespace(solution=SimpleNamespace(free_count=unknown))
        assert [w.severity for w in fit.little_redundancy(facts)] == severities


# ------------------------------------------------------------------------------------ data of a known camera
def test_a_median_that_is_worse_than_the_calibration_s(good):
    solution = replace(good, residuals=np.full_like(good.residuals, 1.0))
    found = known.median_of(solution)
    for ratio, severities in (
        (LESS * known.WORSE, []),
        (MORE * known.WORSE, ["doubtful"]),
        (LESS * known.FAR, ["doubtful"]),
        (MORE * known.FAR, ["wrong"]),
    ):
        promise = SimpleNamespace(median=found / ratio)
        assert [w.severity for w in known._worse(Facts(solution), promise)] == severities
    small = replace(good, residuals=np.full_like(good.residuals, LESS * known.SEVERAL_PX / np.sqrt(2)))
    promise = SimpleNamespace(median=known.median_of(small) / (MORE * known.FAR))
    assert [w.severity for w in known._worse(Facts(small), promise)] == ["doubtful"]


def test_a_change_that_explains_the_points(good, monkeypatch):
    for share, named in ((LESS, True), (MORE, False)):
        left = share * known.EXPLAINS * known.median_of(good)
        monkeypatch.setattr(known, "_median_after", lambda *_, m=left: m)
        assert (known._named(good, good.observations) is not None) == named


# ------------------------------------------------------------------------------------ exchanged points
def test_a_point_where_another_is_predicted():
    xyz = grid()
    for part, swapped in ((LESS, 1), (MORE, 0)):
        uv = 20.0 * xyz[:, :2] + 50
        seen = uv.copy()
        seen[[3, 12]] = uv[[12, 3]] + [part * exchanged_points.NEAR * 20.0, 0.0]
        found = exchanged_points.in_view(View("v", xyz, seen), uv, np.array([3, 12]))
        assert len(found.swapped) == swapped


def test_points_that_are_shifted_alike():
    xyz = grid()
    uv = 20.0 * xyz[:, :2] + 50
    for count in (exchanged_points.LEAST_SHIFTED, exchanged_points.LEAST_SHIFTED - 1):
        seen, rows = uv.copy(), np.arange(count)
        seen[rows] = uv[rows + 9]  # one row further
        found = exchanged_points.in_view(View("v", xyz, seen), uv, rows)
        assert len(found.shifted) == (count if count >= exchanged_points.LEAST_SHIFTED else 0)


# ------------------------------------------------------------------------------------ films, rigs
def test_a_readout_time_that_is_sure(good, monkeypatch):
    for time, sigma, sure in (
        (0.5, 0.5 / (MORE * rolling.SURE), True),
        (0.5, 0.5 / (LESS * rolling.SURE), False),
        (-LESS * rolling.LONGEST, 0.01, True),
        (-MORE * rolling.LONGEST, 0.01, False),
    ):
        found = SimpleNamespace(time=time, sigma=sigma)
        monkeypatch.setattr(rolling, "readout", lambda _, f=found: f)
        assert (rolling.sure(good) is not None) == sure


class Asked(Exception):
    """Raised where the residuals are looked at."""


def test_frames_whose_motion_is_known(good, monkeypatch):
    def design(_):
        raise Asked

    monkeypatch.setattr(rolling, "Design", design)
    for count in (rolling.LEAST_FRAMES, rolling.LEAST_FRAMES - 1):
        monkeypatch.setattr(rolling, "_flows", lambda _, n=count: dict.fromkeys(range(n)))
        if count >= rolling.LEAST_FRAMES:
            with pytest.raises(Asked):
                rolling.readout(good)
        else:
            assert rolling.readout(good) is None


def test_a_loose_relative_pose(monkeypatch):
    rig = SimpleNamespace(cameras={"left": None, "right": None}, reference="left")
    for degrees, said in (
        (LESS * rig_checks.LOOSE_DEG, False),
        (MORE * rig_checks.LOOSE_DEG, True),
        (np.nan, True),
    ):
        sigmas = np.r_[np.radians(degrees), np.zeros(5)]
        monkeypatch.setattr(rig_checks, "relative_sigmas", lambda *_, s=sigmas: s)
        assert bool(list(rig_checks._loose(SimpleNamespace(rig=rig), None))) == said


# ------------------------------------------------------------------------------------ grids, pieces, folds
def test_points_that_are_a_grid():
    four = grid(2, 2)
    assert len(candidate_views.surround(four)) and not len(candidate_views.surround(four[:3]))
    for share, flat in ((LESS, True), (MORE, False)):
        bent = grid(4, 4)
        bent[5, 2] = share * candidate_views.UNEVEN * candidate_views.spacing(bent)
        assert bool(len(candidate_views.surround(bent))) == flat
    diagonal = grid(4, 4)[[0, 5, 10, 15]]  # four points in 16 places
    assert len(candidate_views.surround(diagonal))
    assert not len(candidate_views.surround(grid(5, 5)[[0, 6, 12, 18, 24]]))  # five in 25


def test_points_of_a_piece():
    for count, pieces in ((2 * bias.PIECE - 1, 1), (2 * bias.PIECE, 2)):
        assert len(list(bias.cut(grid(count, 1)))) == pieces


def test_folds_that_are_made_unasked(good):
    assert holdout.folds_wanted(good, None) == holdout.FOLDS
    few = replace(good, poses=good.poses[: holdout.LEAST_VIEWS - 1])
    enough = replace(good, poses=good.poses[: holdout.LEAST_VIEWS])
    assert holdout.folds_wanted(few, None) == 0 and holdout.folds_wanted(enough, 2) == 2
    with pytest.raises(UsageError, match="cannot be held out"):
        holdout.folds_wanted(few, 2)
    for count, made in ((holdout.CHEAP_POINTS, holdout.FOLDS), (holdout.CHEAP_POINTS + 1, 0)):
        large = SimpleNamespace(
            poses=good.poses,
            observations=SimpleNamespace(point_count=count),
            cameras=good.cameras,
            free=good.free,
        )
        assert holdout.folds_wanted(large, None) == made
    for size, made in ((holdout.CHEAP_PARAMETERS, holdout.FOLDS), (holdout.CHEAP_PARAMETERS + 1, 0)):
        large = SimpleNamespace(
            poses=good.poses,
            observations=good.observations,
            cameras=[SimpleNamespace(lens=SimpleNamespace(size=size))],
            free=good.free,
        )
        assert holdout.folds_wanted(large, None) == made
