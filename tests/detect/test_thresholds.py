"""Numbers that decide something about discs, chains of points, windows and pictures, each just below and just above."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.detect import (
    aliasing,
    blur_shape,
    disc_fit,
    disc_grid,
    disc_model,
    grid,
    line_chains,
    mosaic,
    no_board,
    quality,
)
from camcal.detect.discs import Discs
from camcal.detect.recognition import quads
from camcal.detect.targets import base, dictionaries, tag_board
from camcal.detect.windows import Windows
from tests.detect.scenes import make
from tests.sides import LESS, MORE

# ------------------------------------------------------------------------------------ discs
RADIUS = 20.0


def judged(change, last=0.0, others=0.0):
    """What is said of the last of nine discs; `change(params, inside)` is made before.

    `last` and `others` are what their fits leave, grey levels.
    """
    count = 9
    x, y = np.meshgrid(np.arange(-30.0, 31), np.arange(-30.0, 31))
    params = np.zeros((count, disc_model.COUNT))
    params[:, [disc_model.L11, disc_model.L22]] = 1 / RADIUS
    params[:, disc_model.BLUR], params[:, disc_model.STEP], params[:, disc_model.OFFSET] = 1.0, 100.0, 60.0
    inside = np.ones(count)
    change(params, inside)
    flat = np.repeat([x.ravel()], count, 0), np.repeat([y.ravel()], count, 0)
    band = disc_model.Band(*flat, np.zeros((count, x.size)), np.ones((count, x.size), bool), inside, 255.0)
    exact = disc_fit.residuals(band, params)[0]
    value = exact.copy()  # predicted less measured, of measured values 0: the model itself
    signs = np.where(np.arange(x.size) % 2, 1.0, -1.0)
    value[-1] += last * signs
    value[:-1] += others * signs
    band = disc_model.Band(*flat, value, np.ones((count, x.size), bool), inside, 255.0)
    discs = Discs(np.full((count, 2), 40.0), np.repeat([RADIUS * np.eye(2)], count, 0))
    return disc_fit._judged(band, discs, params, 255.0).reasons[-1]


def sets(column, value):
    def change(params, inside):
        params[-1, column] = value

    return change


def area(ratio):
    def change(params, inside):
        params[-1, [disc_model.L11, disc_model.L22]] = 1 / (RADIUS * np.sqrt(ratio))

    return change


def at_border(share):
    def change(params, inside):
        inside[-1] = share

    return change


@pytest.mark.parametrize(
    ("word", "good", "bad"),
    [
        ("border", at_border(disc_fit.LEAST_INSIDE), at_border(LESS * disc_fit.LEAST_INSIDE)),
        (
            "contrast",
            sets(disc_model.STEP, MORE * disc_fit.LEAST_CONTRAST),
            sets(disc_model.STEP, LESS * disc_fit.LEAST_CONTRAST),
        ),
        (
            "blurred",
            sets(disc_model.BLUR, LESS * disc_fit.SOFT * RADIUS),
            sets(disc_model.BLUR, MORE * disc_fit.SOFT * RADIUS),
        ),
        ("like a disc", area(1 + LESS * disc_fit.MOST_CHANGE), area(1 + MORE * disc_fit.MOST_CHANGE)),
        (
            "uncertain",
            sets(disc_model.CX, LESS * (disc_fit.MOST_SHIFT * RADIUS + 0.5)),
            sets(disc_model.CX, MORE * (disc_fit.MOST_SHIFT * RADIUS + 0.5)),
        ),
    ],
)
def test_what_a_disc_must_pass(word, good, bad):
    assert judged(good) == "" and word in judged(bad)


def test_the_misfit_of_a_disc():
    for share, said in ((0.99, False), (1.01, True)):
        assert ("like a disc" in judged(lambda *_: None, share * disc_fit.MOST_MISFIT * 100)) == said


def test_the_noise_of_most_discs():
    """Where most discs leave more than a disc may, the others are compared with them."""
    for share, said in ((0.99, False), (1.01, True)):
        assert ("like a disc" in judged(lambda *_: None, share * disc_fit.RARE * 50, 50)) == said


def test_discs_that_are_a_board():
    full = np.arange(20).reshape(4, 5)
    seen = round(20 * base.LEAST_SEEN)
    for count, board in ((seen, True), (seen - 1, False)):
        index = full.copy()
        index.reshape(-1)[[6, 8, 11, 13, 7][: 20 - count]] = -1
        assert disc_grid._Layout(index, False).full == board
    assert disc_grid._Layout(full[:2, :3], False).full
    assert not disc_grid._Layout(full[:1, : grid.LEAST_NODES - 1], False).full


# ------------------------------------------------------------------------------------ chains of points
def chain(start, angle=0.0, count=61):
    step = np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(start, float) + np.arange(count)[:, None] * step


def pairs_of(*parts):
    """Pairs of chains of which each is the best continuation of the other, at the shorter of both reaches."""
    uv = np.concatenate(parts)
    ends = np.cumsum([0, *map(len, parts)])
    rows = [np.arange(a, b) for a, b in pairwise(ends)]
    return line_chains._continuations(SimpleNamespace(uv=uv), rows, *line_chains.SHORT).tolist()


FIRST = chain((-60, 0))  # ends at (0, 0)
SIX = np.arccos(line_chains.STRAIGHT_ON)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        (chain((LESS * line_chains.SHORT[1], 0)), chain((MORE * line_chains.SHORT[1], 0))),
        (
            chain((10, LESS * (line_chains.BESIDE + 10 * line_chains.ASIDE))),
            chain((10, 1.01 * (line_chains.BESIDE + 10 * line_chains.ASIDE))),
        ),
        (chain((1, 0), LESS * SIX), chain((1, 0), MORE * SIX)),
        (chain((-LESS * line_chains.OVERLAP, 0.5)), chain((-MORE * line_chains.OVERLAP, 0.5))),
    ],
)
def test_a_chain_that_continues_another(good, bad):
    assert pairs_of(FIRST, good) == [[0, 1]]
    assert pairs_of(FIRST, bad) == []


def test_the_straighter_of_two_continuations():
    """8 px farther and straight, against a part of that aside."""
    straight = chain((20, 0))
    limit = 8 / line_chains.STRAIGHTER
    for aside, taken in ((0.99 * limit, 2), (1.01 * limit, 1)):
        assert pairs_of(FIRST, straight, chain((12, aside)))[0] == [0, taken]


def test_points_of_an_end():
    """Three points give a direction even where they are farther apart than the reach."""
    bent = np.array([[0.0, 0], [30, 0], [60, 30], [90, 90]])
    outward = line_chains._end(bent, 24.0)[1]
    assert outward[1] < -0.1  # the third point lies aside
    np.testing.assert_allclose(outward, line_chains._end(bent[: line_chains.LEAST_POINTS], 1e3)[1])
    assert np.abs(outward - line_chains._end(bent, 1e3)[1]).max() > 0.1  # the fourth has no part in it


def test_points_of_a_chain():
    for count, kept in ((line_chains.SHORTEST, 1), (line_chains.SHORTEST - 1, 0)):
        uv = chain((0, 0), 0.1, count)
        along = np.tile([np.cos(0.1), np.sin(0.1)], (count, 1))
        assert len(line_chains.chains(Points(uv, along))) == kept


class Points(SimpleNamespace):
    def __init__(self, uv, along):
        super().__init__(uv=uv, along=along)

    def __len__(self):
        return len(self.uv)


def test_the_next_point_of_a_chain():
    tree = line_chains.cKDTree
    far, most = line_chains.STEP + line_chains.REACH, np.arccos(line_chains.NEXT)
    for gap, turn, found in (
        (LESS * far, 0, True),
        (MORE * far, 0, False),
        (1.0, LESS * most, True),
        (1.0, MORE * most, False),
    ):
        points = Points(np.array([[0.0, 0], [gap, 0]]), np.array([[1.0, 0], [np.cos(turn), np.sin(turn)]]))
        assert (line_chains._neighbour(points, tree(points.uv), points.along)[0] == 1) == found


# ------------------------------------------------------------------------------------ windows
def test_windows_of_a_board_with_markers():
    """The window keeps away from the marker where that is within the band of the fit."""
    board = make("charuco:9x7:40mm:20mm:4X4_100")
    share, cell = board.clear / board.cell, 1.5
    room = tag_board.BAND * cell + 2 * tag_board.START_ERROR
    narrow = tag_board.WINDOW_SHARE * share
    assert narrow < 0.35
    for part, half in ((LESS, narrow), (MORE, 0.35)):
        sides = part * room / share * np.eye(2)[None]
        assert board._half(sides, cell, 0.35)[0] == pytest.approx(half)


def test_a_picture_without_grey_between_black_and_white():
    count = 1000
    limit = round(aliasing.BETWEEN * count)
    for grey, aliased in ((limit - 1, True), (limit, False)):
        value = np.where(np.arange(count) % 2, 255.0, 0.0)[None]
        value[0, :grey] = 100.0
        windows = Windows(np.zeros((1, 2)), None, value, np.ones((1, count), bool), np.ones(1))
        assert aliasing.is_aliased(np.zeros((4, 4), np.uint8), windows) == aliased


def test_a_blur_that_is_not_round():
    sides = 20.0 * np.eye(2)[None]
    for ratio, shaped in ((LESS * blur_shape.ROUND, False), (MORE * blur_shape.ROUND, True)):
        assert (blur_shape.shape_of((1.0, ratio), sides) is not None) == shaped


# ------------------------------------------------------------------------------------ pictures
def raw(apart, level=0.5, blocks=8):
    """A picture whose pixels of one colour are brighter than the others by a share of the mean of all."""
    side = mosaic.BLOCK * blocks
    gray = np.full((side, side), level * 65535)
    gray[::2, ::2] *= 1 + apart
    return gray.astype(np.uint16)


def test_a_picture_of_a_colour_mosaic():
    assert mosaic.levels(raw(0.1)) is not None and mosaic.levels(raw(0.01)) is None
    least = int(np.sqrt(mosaic.LEAST_BLOCKS))
    assert mosaic.levels(raw(0.1, blocks=least)) is not None
    assert mosaic.levels(raw(0.1, blocks=least - 1)) is None
    assert mosaic.levels(raw(0.1, 1.1 * mosaic.DARK)) is not None
    assert mosaic.levels(raw(0.1, 0.9 * mosaic.DARK)) is None


def test_the_smallest_picture():
    for side, small in ((no_board.LEAST_PIXELS, False), (no_board.LEAST_PIXELS - 1, True)):
        gray = np.random.default_rng(0).integers(0, 255, (side, 40)).astype(np.uint8)
        found = no_board.why_nothing(gray)
        assert (found.reason == "too-small") == small


@pytest.mark.parametrize(
    ("word", "name", "good", "bad"),
    [
        ("blurred", "blur_px", LESS * quality.SOFT_PX, MORE * quality.SOFT_PX),
        ("blurred", "square_px", MORE * 2.0 / quality.SOFT, LESS * 2.0 / quality.SOFT),
        ("motion", "blur_ratio", LESS * quality.MOTION_RATIO, MORE * quality.MOTION_RATIO),
        ("motion", "blur_px", LESS * quality.MOTION_PX, MORE * quality.MOTION_PX),
        ("overexposed", "saturated", LESS * quality.SATURATED, MORE * quality.SATURATED),
        ("flat", "contrast", MORE * quality.FLAT / 2, LESS * quality.FLAT / 2),
        ("rough", "residual", LESS * quality.ROUGH * 60, MORE * quality.ROUGH * 60),
        ("small", "coverage", MORE * quality.SMALL, LESS * quality.SMALL),
    ],
)
def test_what_is_said_of_a_picture(word, name, good, bad):
    figures = {"blur_px": 2.0, "square_px": 40.0, "blur_ratio": 1.0, "saturated": 0.0, "contrast": 60.0}
    figures |= {"residual": 3.0, "coverage": 0.3}
    if word == "motion" and name == "blur_px":
        figures["blur_ratio"] = 2.0
    if word == "flat":
        figures["residual"] = 0.0
    for value, said in ((good, False), (bad, True)):
        assert any(w.startswith(word) for w in quality.warnings(figures | {name: value})) == said


# ------------------------------------------------------------------------------------ markers
SIDE, BORDER, CELL = 6, 1, 12


def marker(wrong=0, bright=0):
    """A picture of the first marker of 36h11, with so many wrong bits and bright border cells, and its corners."""
    cells = 1.0 - dictionaries.black_cells("APRILTAG_36h11", 0, BORDER)
    bits = cells[BORDER:-BORDER, BORDER:-BORDER].copy().ravel()
    bits[np.arange(wrong) * 5 % 36] = 1 - bits[np.arange(wrong) * 5 % 36]
    cells[BORDER:-BORDER, BORDER:-BORDER] = bits.reshape(SIDE, SIDE)
    cells[0, :bright] = 1
    gray = np.pad(np.kron(40 + 180 * cells, np.ones((CELL, CELL))), 20, constant_values=220).astype(np.uint8)
    low, high = 19.5, 19.5 + CELL * len(cells)
    return gray, np.array([[[low, low], [high, low], [high, high], [low, high]]])


def test_bits_of_a_marker_that_are_corrected():
    """A part of the five bits that the code corrects: with more, squares of other patterns are read as markers."""
    most = int(quads.CORRECTED * 5)
    for wrong, read in ((0, [0]), (most, [0]), (most + 1, [])):
        assert quads.decode(*marker(wrong), "APRILTAG_36h11", BORDER)[0].tolist() == read


def test_the_border_of_a_marker():
    """Of 28 cells."""
    most = int(28 * quads.BAD_BORDER)
    for bright, read in ((most, [0]), (most + 1, [])):
        assert quads.decode(*marker(bright=bright), "APRILTAG_36h11", BORDER)[0].tolist() == read
