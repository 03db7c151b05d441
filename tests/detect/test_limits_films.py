"""Numbers that decide which frames, matches and lines are kept, each just below and just above."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.detect import (
    films,
    frames,
    line_chains,
    line_points,
    lines,
    matches,
    mosaic,
    no_board,
    view_information,
)
from camcal.detect.films import Range, Shown
from camcal.detect.targets.base import Detection
from camcal.geometry import rotations
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ films
class Film:
    """A film of so many frames of the right size."""

    rate = 25.0

    def __init__(self, count):
        self.count, self.next, self.path = count, 0, "film"

    def read(self):
        self.next += 1
        return np.full((4, films.WIDTH), float(self.next - 1)) if self.next <= self.count else None

    def skip(self):
        self.next += 1
        return self.next <= self.count

    def close(self):
        pass


def chosen(monkeypatch, count, sharpness, motion):
    """The frames of one stretch that are searched, and how many were looked at."""
    asked = []
    monkeypatch.setattr(films, "MOST_SEARCHED", 1)
    monkeypatch.setattr(films, "Film", lambda _: Film(count))
    monkeypatch.setattr(films, "sharpness", lambda small: asked.append(1) or sharpness(int(small[0, 0])))
    monkeypatch.setattr(films, "_motion", lambda before, now: motion(int(now[0, 0])))
    found, _ = films.candidates(Path("film"), Range())
    return [c.number for c in found], len(asked)


@pytest.mark.parametrize(("share", "best"), [(LESS, 1), (MORE, 0)])
def test_the_motion_that_counts_as_half_of_the_sharpness(monkeypatch, share, best):
    """The second frame is twice as sharp and moves."""
    found, _ = chosen(monkeypatch, 2, lambda k: 1.0 + k, lambda k: k * share * films.HALF_AS_SHARP)
    assert found == [best]


def test_frames_of_a_stretch_whose_sharpness_is_measured(monkeypatch):
    """All of a stretch shorter than twice the number, and every second one from there on."""
    count = 2 * films.JUDGED
    for frames_, looked_at in ((count - 1, count - 1), (count, count // 2)):
        assert chosen(monkeypatch, frames_, lambda k: 1.0, lambda k: 0.0)[1] == looked_at


def frame(shift, blur=0.6, motion=0.0, sigma=0.1):
    """A tilted board of 4 x 3 points, seen on the left or on the right of a picture."""
    points = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), -1).reshape(-1, 2)
    x = np.c_[points - points.mean(0), np.zeros(12)] @ rotations.exp(np.array([0.5, 0.0, 0.0])).T
    uv = view_information.FOCAL * 800 * (x[:, :2] + (shift, 0.0)) / (x[:, 2:] + 8.0) + (399.5, 299.5)
    return Shown(
        "f", points, Detection(np.arange(12), uv, np.full(12, sigma), {"blur_px": blur}), (800, 600), motion
    )


def test_the_sharper_frames_of_a_film():
    """Of 21 frames: where so many are sharp, the others are blurred beside them."""
    quarter = int(20 * films.SHARPER / 100) + 1
    for sharp, left in ((quarter, 21 - quarter), (quarter - 1, 0)):
        film = [frame(0.1 * k, 1.0) for k in range(sharp)] + [frame(0.1 * k, 2.0) for k in range(21 - sharp)]
        reasons = films.left_out(film, 21).values()
        assert sum(r.startswith("blurred") for r in reasons) == left


@pytest.mark.parametrize(("share", "kept"), [(LESS, 0), (MORE, 1)])
def test_motion_makes_the_points_of_a_frame_uncertain(share, kept):
    """Two frames that say as much of a camera: one moved, the points of the other are less certain."""
    moved = 10.0
    still = frame(1.0, sigma=share * float(np.hypot(0.1, films.UNEXPLAINED * moved)))
    other = frame(-1.0, motion=moved)
    reasons = films.left_out([still, other], 1)
    assert list(reasons) == [1 - kept]


# ------------------------------------------------------------------------------------ matches
def test_a_descriptor_that_is_nearer_than_the_next():
    second = np.zeros((2, 128), np.float32)
    second[1, 0] = 100.0
    for share, found in ((LESS, 0), (MORE, -1)):
        first = np.zeros((1, 128), np.float32)
        first[0, 1:2] = 0.0
        # distances d and 100 - d along the first axis
        first[0, 0] = share * 100 * matches.RATIO / (1 + share * matches.RATIO)
        assert matches._nearest(first, second).tolist() == [found]


@pytest.mark.parametrize(
    ("off", "back", "kept"),
    [
        (LESS * matches.FARTHEST, LESS * matches.RETURN, True),
        (MORE * matches.FARTHEST, 0.0, False),
        (0.0, MORE * matches.RETURN, False),
    ],
)
def test_a_point_that_is_placed(monkeypatch, off, back, kept):
    """Of three points the first is off by so much, and tracked back to so far from its start."""
    a = np.array([[30.0, 30], [60, 30], [30, 60]])
    ways = iter([a + ((off, 0.0), (0, 0), (0, 0)), a + ((0.0, back), (0, 0), (0, 0))])
    monkeypatch.setattr(matches, "_tracked", lambda *_: (next(ways), np.ones(3, bool)))
    gray = np.zeros((90, 90), np.uint8)
    assert len(matches._placed(gray, gray, a, a)[0]) == 2 + kept


def test_points_that_can_be_placed_at_all(monkeypatch):
    """Half of a hundred, otherwise all stay where they are."""
    a = np.random.default_rng(0).uniform(20, 70, (100, 2))
    least = round(100 * matches.PLACED)
    for found, left in ((least, least), (least - 1, 100)):
        monkeypatch.setattr(matches, "_tracked", lambda *_, n=found: (a, np.arange(100) < n))
        gray = np.zeros((90, 90), np.uint8)
        assert len(matches._placed(gray, gray, a, a)[0]) == left


def test_the_surroundings_of_a_point_that_are_compared():
    """A change inside the window moves the point, and one beyond its derivatives does not."""
    rng = np.random.default_rng(1)
    first = cv2.GaussianBlur(rng.uniform(0, 255, (61, 61)), (0, 0), 1.5)
    first = cv2.normalize(first, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    half = matches.WINDOW // 2
    at = np.array([[30.0, 30.0]])
    for row, moved in ((30 + half - 1, True), (30 + half + 3, False)):
        second = first.copy()
        second[row, 25:36] = 255 - second[row, 25:36]
        there, _ = matches._tracked(first, second, at, at)
        assert (np.abs(there - at).max() > 1e-3) == moved


def test_pictures_of_different_exposure():
    """Contrast above the noise is raised to one level, within 8 bits; that of the noise is not."""
    stripes = np.where(np.arange(64) % 8 < 4, 1.0, -1.0)[None].repeat(64, 0)

    def spread(contrast):
        return float(matches._even(128 + contrast * stripes).astype(float).std())

    # a tenth and ten times the least contrast: proportional to it, and nearly independent of it
    low, high = matches.CONTRAST / 10, 10 * matches.CONTRAST
    assert spread(2 * low) / spread(low) > 1.7 and spread(2 * high) / spread(high) < 1.1
    even = matches._even(128 + 50.0 * stripes)
    assert even.min() > 0 and even.max() < 255  # whatever is as regular as that is not cut off
    spots = np.zeros((64, 64))
    spots[::16, ::16] = 100.0  # more than 2.7 times their own standard deviation
    assert matches._even(spots).max() == 255


# ------------------------------------------------------------------------------------ lines
def test_two_parts_that_follow_one_curve():
    """The joint deviation, in those of the parts, decides."""
    x = np.linspace(0, 100, 101)
    sign = np.where(np.arange(101) % 2, 1.0, -1.0)
    a, b = np.c_[x, 0.3 * sign], np.c_[x + 102, 0.3 * sign]
    both = lines._smooth(np.concatenate([a, b]))[1]
    for share, joined in ((LESS, True), (MORE, False)):
        own = (both / share - lines.CLOSE) / lines.AS_CLOSE
        assert (lines._joint((a, own), (b, own)) is not None) == joined
    for share, joined in (
        (LESS, True),
        (MORE, False),
    ):  # exact parts, and a joint line that is off by rounding
        made = lines._joint((a, 0.0), (b, (both / share - lines.CLOSE) / lines.AS_CLOSE))
        assert (made is not None) == joined


def test_a_curve_that_points_follow():
    """A polynomial of the order that is fitted leaves nothing, the next order does; and it needs points enough."""
    x = np.linspace(-1, 1, 201)
    for order, left in ((lines.SMOOTH, False), (lines.SMOOTH + 1, True)):
        bent = np.polynomial.chebyshev.chebval(x, np.eye(order + 1)[order])
        found = lines._smooth(np.c_[200 * x, 2 * bent])
        assert (found is None or found[1] > 0.1) == left
    for count, enough in ((2 * lines.SMOOTH, True), (2 * lines.SMOOTH - 1, False)):
        assert (lines._smooth(np.c_[10.0 * np.arange(count), np.zeros(count)]) is not None) == enough


@pytest.mark.parametrize(("share", "reached"), [(LESS, True), (MORE, False)])
def test_gaps_of_long_chains(share, reached):
    """Chains longer than the second reach are joined across so much; shorter ones only across the first gap."""
    reach, gap = line_chains.LONG
    for length, joined in ((MORE * reach, reached), (LESS * reach, False)):
        n = 61
        first = np.c_[np.linspace(-length, 0, n), np.zeros(n)]
        second = np.c_[np.linspace(share * gap, share * gap + length, n), np.zeros(n)]
        points = SimpleNamespace(uv=np.concatenate([first, second]))
        parts = line_chains.joined(points, [np.arange(n), np.arange(n, 2 * n)])
        assert (len(parts) == 1) == joined


def test_points_above_the_noise():
    """Of a picture without noise that of rounding counts; an edge of a part of that many of its deviations."""
    x = np.where(np.arange(60) < 30, 0.0, 1.0)[None].repeat(60, 0)
    response = line_points.edges(1000 * x).strength / 1000
    spread = line_points.ROUNDING / np.sqrt(8 * np.pi) / line_points.EDGE_SIGMA**2
    for share, found in ((0.99, False), (1.01, True)):
        step = share * line_points.NOISES * spread / response
        assert (len(line_points.edges(step * x)) > 0) == found


def test_a_crossing_of_thin_lines():
    """A saddle of two curvatures: a point is on the line as long as the one along it is small."""
    y, x = np.mgrid[-20.0:21, -20:21]
    for share, on_line in ((0.9, True), (1.1, False)):
        gray = 100 + 2 * (x**2 + share * line_points.CROSSING * y**2)
        found = line_points.ridges(gray, True, 1.0)
        assert bool((np.linalg.norm(found.uv - 20, axis=1) < 0.5).any()) == on_line


def test_the_frame_of_a_picture_without_points():
    for column, found in ((line_points.MARGIN, True), (line_points.MARGIN - 2, False)):
        gray = np.full((60, 60), 50.0)
        gray[:, column + 1 :] = 200.0  # an edge at column + 1/2
        assert (len(line_points.edges(gray)) > 0) == found


# ------------------------------------------------------------------------------------ pictures without a board
def level(part, low, high, count=100):
    """A picture of `count` x `count` px of a level, with a part of another one, in rows."""
    gray = np.full((count, count), float(low))
    gray.ravel()[: round(part * count**2)] = high
    return gray.astype(np.uint8)


def test_pictures_that_are_too_dark_or_too_bright():
    rng = np.random.default_rng(0)

    def reason(low, high):
        gray = rng.integers(0, 2, (100, 100)) * (high - low) + low
        return no_board.why_nothing(gray.astype(np.uint8)).reason

    assert reason(0, no_board.DARK - 1) == "too-dark" and reason(0, no_board.DARK) != "too-dark"
    assert reason(no_board.BRIGHT + 1, 255) == "too-bright" and reason(no_board.BRIGHT, 255) != "too-bright"


def test_a_reflection_in_a_dark_picture():
    low, high = no_board.RANGE
    for part, dark in ((1 - (high + 0.5) / 100, True), (1 - (high - 0.5) / 100, False)):
        assert (no_board.why_nothing(level(part, 10, 250)).reason == "too-dark") == dark
    for part, bright in (((low - 0.5) / 100, True), ((low + 0.5) / 100, False)):
        assert (no_board.why_nothing(level(part, 250, 10)).reason == "too-bright") == bright


def fine(share, part):
    """A ramp of 0 to 200 with single pixels that stand out by a share of it."""
    gray = np.linspace(0, 200, 100)[None].repeat(100, 0)
    step = int(1 / part)
    gray.ravel()[50::step] += share * 200
    return no_board.why_nothing(np.clip(np.rint(gray), 0, 255).astype(np.uint8)).reason


def test_a_picture_without_a_sharp_edge():
    """Of a single pixel the blur of 2 px leaves 1 - 1 / (8 pi) = .96; and so many of them are needed."""
    for share, reason in ((0.8, "too-blurred"), (1.2, "none")):
        assert fine(share * no_board.SHARP / 0.96, 0.02) == reason
    few = 1 - no_board.FINEST / 100
    assert fine(0.2, 0.7 * few) == "too-blurred" and fine(0.2, 1.5 * few) == "none"


def test_a_picture_is_reduced_before_its_edges_are_judged():
    """Pixel noise of a large picture is averaged away, and is a sharp edge in a small one."""
    side = no_board.LONG_SIDE
    for width, reason in ((2 * side - 1, "none"), (2 * side, "too-blurred")):
        gray = np.linspace(60, 180, width)[None].repeat(64, 0) + 20.0 * (np.indices((64, width)).sum(0) % 2)
        assert no_board.why_nothing(gray.astype(np.uint8)).reason == reason


def test_the_levels_of_a_mosaic():
    """Two of four phases brighter by a part of the mean: the levels are 1 + d / 2 and 1 - d / 2."""
    for share, raw in ((0.99, False), (1.01, True)):
        gray = np.full((160, 160), 30000.0)
        d = share * mosaic.LEAST_DIFFERENCE
        gray[::2] *= 1 + d / 2
        gray[1::2] *= 1 - d / 2
        assert (mosaic.levels(gray.astype(np.uint16)) is not None) == raw


def test_a_frame_that_is_reached_by_reading_on(monkeypatch):
    """Nearer frames are reached one by one, farther ones are asked for."""
    sought = []
    capture = SimpleNamespace(
        get=lambda what: (
            sought[-1] if what == cv2.CAP_PROP_POS_FRAMES else 1000.0 * (what == cv2.CAP_PROP_FRAME_COUNT)
        ),
        set=lambda _, number: sought.append(number),
        grab=lambda: True,
    )
    monkeypatch.setattr(frames, "_opened", lambda _: capture)
    for number, times in ((frames.SKIPPED, 0), (frames.SKIPPED + 1, 1)):
        film = frames.Film(Path("film.mp4"))
        assert film.seek(number) and film.next == number and len(sought) == times
