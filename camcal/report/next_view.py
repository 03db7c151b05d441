"""The next best view in words, as a document and as a picture of where to hold the target."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from camcal.assess.candidate_views import lattice, rotations_onto, surround, target_points
from camcal.assess.checks.facts import Facts
from camcal.assess.holdout import CHEAP_PARAMETERS
from camcal.assess.next_view import NextView, Suggestion
from camcal.errors import CamcalError, DataError, EstimationError
from camcal.geometry.hull import hull as hull_of
from camcal.model.pose import Pose
from camcal.plan.solution import Solution
from camcal.report.charts.base import Chart, Layer, Line, Points, Tone, short
from camcal.report.charts.coverage import unit_of
from camcal.report.charts.residuals import picture_limits, thinned

Array = np.ndarray

#: a target that is tilted by less counts as facing the camera
FACING_DEGREES = 8.0
#: the largest number of pictures tried for a requested uncertainty
MOST_PICTURES = 100
#: points along an edge of the drawn target: straight edges are curved in a picture with distortion
_STEPS = 7
CENTRAL = 0.08  #: fraction of the picture's side within which a position counts as the middle
_ASIDE = 0.4  #: share of a tilt along an axis above which it is reported
_MOST_CELLS = 1000  #: more would be a grey surface
_TITLE_WIDTH = 62


def suggest(
    solution: Solution, count: int = 1, distance: float = np.inf, target: float | None = None, seed: int = 0
) -> tuple[dict[str, Any], list[Suggestion]]:
    """The answer of `camcal next`, and the poses behind it.

    Raises
    ------
    DataError
        If nothing of the camera was estimated, or its image size is not known.
    EstimationError
        If the residuals carry no information on the noise.
    """
    if not solution.free.any():
        raise DataError(
            "no parameter of this camera was estimated, so no picture can improve it.",
            "Give the report of a calibration, not of `camcal evaluate`.",
        )
    if solution.camera.image_size is None:
        raise DataError("the report has no image size.", "Calibrate with --image-size.")
    search = NextView(solution, distance, seed=seed)
    if not np.isfinite(search.design.sigma_0):
        raise EstimationError("there are no more coordinates than unknowns: the noise is not known.")
    found = search.best(count)
    worst, median = search.before
    answer: dict[str, Any] = {
        "schema": "camcal-next/1",
        "distance": distance,
        "now": {"worst_px": worst, "median_px": median},
        "suggestions": [_entry(solution, search.candidates.points, s) for s in found],
    }
    if target is not None:
        more = search.pictures_until(target, MOST_PICTURES)
        answer["target"] = {"worst_px": target, "more_pictures": more, "tried": MOST_PICTURES}
    return answer, found


#: pictures that are suggested at once on a page and by the doctor
MORE = 3


class _Same:
    """A cache key that is equal only for the same solution object."""

    def __init__(self, solution: Solution):
        self.solution = solution

    def __hash__(self) -> int:
        return id(self.solution)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.solution is self.solution


def next_ones(solution: Solution) -> tuple[dict[str, Any], list[Suggestion]]:
    """`suggest` for `MORE` pictures, cached per solution, since both the page and its findings use it."""
    return _next_ones(_Same(solution))


@lru_cache(maxsize=1)
def _next_ones(key: _Same) -> tuple[dict[str, Any], list[Suggestion]]:
    return suggest(key.solution, MORE)


def _entry(solution: Solution, points: Array, found: Suggestion) -> dict[str, Any]:
    outline = _outline(solution, points, found.pose)
    return {
        "words": words(solution, points, found.pose),
        "worst_px": found.worst,
        "median_px": found.median,
        "cam_from_board": found.pose.entry(),
        "outline": np.round(outline, 1).tolist(),
    }


def _outline(solution: Solution, points: Array, pose: Pose) -> Array:
    """Corners (K, 2) of the hull of the target's image with its outermost cells, px."""
    return hull_of(solution.camera.project(pose.apply(np.concatenate([points, surround(points)]))))


def words(solution: Solution, points: Array, pose: Pose) -> str:
    """Where to hold the target: position in the picture, tilt, size, distance."""
    facts = Facts(solution)
    outline = _outline(solution, points, pose)
    x, y = picture_limits(facts)
    middle = (outline.min(0) + outline.max(0)) / 2
    place = _place((middle[0] - x[0]) / (x[1] - x[0]), (middle[1] - y[0]) / (y[1] - y[0]))
    fills = np.ptp(outline, axis=0) / [x[1] - x[0], y[1] - y[0]]
    size = f"over {100 * float(fills.max()):.0f} % of its {('width', 'height')[int(fills.argmax())]}"
    far = float(np.linalg.norm(pose.apply(points.mean(0))))
    said = f"{place} of the picture, {size}, {short(far)} {unit_of(solution)} away"
    return f"{said}, {_tilt(points, pose)}" if facts.planar else said


def _place(u: float, v: float) -> str:
    across = "" if abs(u - 0.5) < CENTRAL else ("left" if u < 0.5 else "right")
    down = "" if abs(v - 0.5) < CENTRAL else ("top" if v < 0.5 else "bottom")
    return " ".join(w for w in (down, across) if w) or "middle"


def _tilt(points: Array, pose: Pose) -> str:
    facing = _facing(points, pose)
    normal = facing[:, 2] * (1 if facing[2, 2] >= 0 else -1)
    angle = math.degrees(math.acos(min(1.0, float(normal[2]))))
    if angle < FACING_DEGREES:
        return "facing the camera"
    # with the normal pointing away from the camera, the side towards which it leans is the nearer one
    x, y = float(normal[0]), float(normal[1])
    side = ("right" if x > 0 else "left") if abs(x) > _ASIDE * math.hypot(x, y) else ""
    edge = ("bottom" if y > 0 else "top") if abs(y) > _ASIDE * math.hypot(x, y) else ""
    nearer = " ".join(w for w in (edge, side) if w)
    return f"turned by {angle:.0f} degrees with its {nearer} side towards the camera"


def _facing(points: Array, pose: Pose) -> Array:
    """The target's rotation (3, 3) relative to the line of sight to its centre."""
    middle = pose.apply(points.mean(0))
    return rotations_onto(middle[None] / np.linalg.norm(middle))[0].T @ pose.rotation


def chart(solution: Solution) -> Chart | None:
    """A chart of where to hold the target next; None if that cannot be computed, or only slowly."""
    if solution.camera.lens.size > CHEAP_PARAMETERS:
        return None
    try:
        found = next_ones(solution)[1][0]
    except CamcalError:
        return None
    return replace(drawing(solution, found), title="Where to hold the target next")


def drawing(solution: Solution, found: Suggestion, number: int = 1) -> Chart:
    """The picture with the target at the suggested position, over the existing points."""
    facts = Facts(solution)
    points = target_points(solution)
    x, y = picture_limits(facts)
    uv = facts.image_points
    layers: list[Layer] = [Points(uv[thinned(len(uv))], tone="faint", radius=1.3, label="points so far")]
    layers += _flat_target(solution, points, found.pose) or [
        Line(_outline(solution, points, found.pose), tone="second", closed=True)
    ]
    said = words(solution, points, found.pose)
    return Chart(
        f"Picture {number}: where to hold the target\n" + textwrap.fill(said, _TITLE_WIDTH),
        f"Hold it at the {said}. After it the worst projection uncertainty is {found.worst:.2g} px.",
        "u, px",
        "v, px",
        x,
        y,
        tuple(layers),
        picture=True,
    )


def _flat_target(solution: Solution, points: Array, pose: Pose) -> list[Layer]:
    """A flat grid drawn as a checkerboard with its nearer sides marked; nothing for other targets."""
    around = surround(points)
    if not len(around):
        return []

    def line(
        corners: Sequence[tuple[float, float]], tone: Tone, label: str = "", filled: bool = False
    ) -> Line:
        path = _path(np.array(corners))
        path = np.c_[path, np.full(len(path), around[0, 2])]
        return Line(solution.camera.project(pose.apply(path)), tone, label, closed=filled, filled=filled)

    columns, rows = lattice(np.concatenate([points, around]))
    cells = [(r, c) for r in range(len(rows) - 1) for c in range(len(columns) - 1) if (r + c) % 2 == 0]
    layers: list[Layer] = []
    for r, c in cells if len(cells) <= _MOST_CELLS else []:
        x0, x1, y0, y1 = columns[c], columns[c + 1], rows[r], rows[r + 1]
        layers.append(line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], "text", filled=True))
    x0, x1, y0, y1 = columns[0], columns[-1], rows[0], rows[-1]
    layers.append(line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], "second"))
    near = _nearer_sides(_facing(points, pose), (x0, x1), (y0, y1))
    sides = [line(s, "accent", "" if i else "nearer to the camera") for i, s in enumerate(near)]
    return [*layers, *(replace(side, heavy=True) for side in sides)]


def _nearer_sides(
    facing: Array, x: tuple[float, float], y: tuple[float, float]
) -> list[list[tuple[float, float]]]:
    """The one or two sides of a rectangle that are nearer to the camera; none if it faces the camera."""
    tilt_x, tilt_y = (float(facing[2, i]) for i in (0, 1))  # depth gained per unit along x and y
    steep = math.hypot(tilt_x, tilt_y)
    if steep < math.sin(math.radians(FACING_DEGREES)):
        return []
    sides = []
    if abs(tilt_x) > _ASIDE * steep:
        at = x[0] if tilt_x > 0 else x[1]
        sides.append([(at, y[0]), (at, y[1])])
    if abs(tilt_y) > _ASIDE * steep:
        at = y[0] if tilt_y > 0 else y[1]
        sides.append([(x[0], at), (x[1], at)])
    return sides


def _path(corners: Array) -> Array:
    """Points (N, 2) along the lines between corners (K, 2)."""
    part = np.linspace(0, 1, _STEPS)[:, None]
    return np.concatenate([a + part * (b - a) for a, b in itertools.pairwise(corners)])
