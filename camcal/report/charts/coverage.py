"""Charts of the coverage: the picture, the directions, the distances."""

from __future__ import annotations

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.geometry.hull import area as hull_area
from camcal.geometry.hull import hull as hull_of
from camcal.plan.solution import Solution
from camcal.report.charts.base import Chart, Line, Points, short
from camcal.report.charts.residuals import picture_limits, thinned

Array = np.ndarray

MOST_POINTS = 6000  #: largest number of dots, which limits the size of the page
#: circles of the tilt chart, degrees
CIRCLES = (15, 30, 45)
LEAST_REACH = 50.0  #: degrees; the outermost circle is always on the chart
EVERYTHING = 100.0  #: %
LEAST_HULL = 3  #: points that enclose an area


def image(solution: Solution) -> Chart | None:
    """All image points and their convex hull."""
    facts = Facts(solution)
    uv = facts.image_points
    if len(uv) < LEAST_HULL:
        return None
    x, y = picture_limits(facts)
    lost = np.concatenate([solution.observations.uv[~solution.used]])
    share = hull_area(uv) / ((x[1] - x[0]) * (y[1] - y[0]))
    some = thinned(len(uv), MOST_POINTS)
    layers: list = [Points(uv[some], radius=1.3, label="used points")]
    if len(lost):
        layers.append(Points(lost, tone="bad", radius=2.2, label="rejected"))
    hull = hull_of(uv)
    if len(hull):
        layers.insert(0, Line(hull, tone="faint", closed=True, filled=True))
    return Chart(
        "Coverage of the picture",
        f"The points of all views; the hull around them covers {100 * share:.0f} % of the picture. "
        f"Outside it, the lens model is extrapolated.",
        "u, px",
        "v, px",
        x,
        y,
        tuple(layers),
        picture=True,
    )


def unit_of(solution: Solution) -> str:
    """The unit of lengths in space, as text."""
    unit = str((solution.observations.target or {}).get("unit") or "unit")
    return {"square": "squares", "unit": "units"}.get(unit, unit)


def board_normals(facts: Facts) -> Array:
    """Unit normals (V, 3) of the boards in the camera's frame, pointing away from the camera."""
    normals = np.einsum("vij,vj->vi", facts.solution.poses.rotations, facts.shapes.axes[:, :, 2])
    return normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)


def tilts(solution: Solution) -> Chart | None:
    """The tilt of each board relative to the image plane, by direction."""
    facts = Facts(solution)
    if not facts.planar or len(facts.views) < 2:
        return None
    normals = board_normals(facts)
    angle = np.degrees(np.arccos(np.clip(normals[:, 2], -1, 1)))
    around = np.arctan2(normals[:, 1], normals[:, 0])
    reach = max(LEAST_REACH, 1.1 * float(angle.max()))
    turn = np.linspace(0, 2 * np.pi, 73)
    circles = [Line(c * np.c_[np.cos(turn), np.sin(turn)], tone="faint") for c in CIRCLES]
    dots = angle[:, None] * np.c_[np.cos(around), np.sin(around)]
    titles = [f"{v.id}: {a:.0f} degrees" for v, a in zip(facts.views, angle, strict=True)]
    return Chart(
        "Tilt of the boards",
        f"Each dot is a board: how far it is tilted (degrees, median {np.median(angle):.0f}) and to which "
        "side. Dots all around, 20 to 45 degrees from the middle, determine the focal length best.",
        "tilt to the right, degrees",
        "tilt down, degrees",
        (-reach, reach),
        (-reach, reach),
        (*circles, Points(dots, radius=4, titles=titles)),
        picture=True,
    )


def distances(solution: Solution) -> Chart | None:
    """The distance of each board and the fraction of the picture that it fills."""
    facts = Facts(solution)
    if len(facts.views) < 2:
        return None
    x, y = picture_limits(facts)
    area = (x[1] - x[0]) * (y[1] - y[0])
    far, share, titles = [], [], []
    for view, pose in zip(solution.observations.kept().views, solution.poses, strict=True):
        if len(view) < LEAST_HULL:
            continue
        far.append(float(np.linalg.norm(pose.apply(view.xyz.mean(0)))))
        share.append(100 * hull_area(view.uv) / area)
        titles.append(f"{view.id}: at {short(far[-1])}, {share[-1]:.0f} % of the picture")
    if len(far) < 2:
        return None
    unit = unit_of(solution)
    return Chart(
        "Distance and size of the boards",
        f"Each dot is a view. Boards are {short(min(far))} to {short(max(far))} {unit} away and fill "
        f"{min(share):.0f} to {max(share):.0f} % of the picture; a mixture of distances is good.",
        f"distance from the camera, {unit}",
        "share of the picture, %",
        (0.0, 1.08 * max(far)),
        (0.0, min(EVERYTHING, 1.15 * max(share))),
        (Points(np.c_[far, share], radius=4, titles=titles),),
    )
