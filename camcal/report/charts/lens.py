"""Charts of the camera: its distortion, and the uncertainty of its projection."""

from __future__ import annotations

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.difference import image_grid
from camcal.assess.uncertainty import board_distance, map_over_image, projection_uncertainty
from camcal.geometry.hull import hull as hull_of
from camcal.plan.solution import Solution
from camcal.report.charts.base import Arrows, Cells, Chart, Line, short
from camcal.report.charts.coverage import unit_of
from camcal.report.charts.residuals import enlargement, picture_limits

#: degrees from the axis beyond which the image of a pinhole camera is too far out for a comparison
PINHOLE_DEGREES = 75.0
#: fx, fy, cx, cy and skew: a lens with no more parameters is a pinhole camera, unless one is of distortion
PINHOLE_SIZE = 5


def curve(solution: Solution) -> Chart | None:
    """The angle from the optical axis against the distance from the principal point, to four sides."""
    facts = Facts(solution)
    camera = facts.camera
    centre = camera.params[2:4]
    (left, right), (top, bottom) = picture_limits(facts)
    corners = np.array([[left, top], [right, top], [left, bottom], [right, bottom]])
    reach = float(np.linalg.norm(corners - centre, axis=1).max())
    radius = np.linspace(0, reach, 80)[1:]
    found = []
    for corner in corners:
        direction = (corner - centre) / np.linalg.norm(corner - centre)
        rays = camera.unproject(centre + radius[:, None] * direction)
        found.append(np.degrees(np.arccos(np.clip(rays[:, 2], -1, 1))))
    angles = np.array(found)
    if np.isnan(angles).all():
        return None
    mean = np.nanmean(np.where(np.isnan(angles).all(0), 0.0, angles), axis=0)
    mean[np.isnan(angles).all(0)] = np.nan
    focal = float(np.abs(camera.params[:2]).mean())
    pinhole = np.degrees(np.arctan(radius / focal))
    top_angle = float(np.nanmax(angles))
    seen = float(np.linalg.norm(facts.image_points - centre, axis=1).max())
    return Chart(
        "Distortion curve",
        "The angle of a pixel's ray from the optical axis, mean over the directions to the four corners: "
        f"{top_angle:.1f} degrees in the farthest corner, {pinhole[-1]:.1f} without distortion. "
        f"Data reach {seen:.0f} px.",
        "distance from the principal point, px",
        "angle from the axis, degrees",
        (0.0, reach),
        (0.0, 1.05 * max(top_angle, float(pinhole[-1]))),
        (
            Line(np.c_[radius, pinhole], tone="faint", dashed=True, label="without distortion"),
            Line(np.c_[radius, mean], label="this lens"),
            Line(np.array([[seen, 0.0], [seen, 400.0]]), tone="second", dashed=True, label="data end"),
        ),
    )


def field(solution: Solution) -> Chart | None:
    """The position of each pixel's ray in a picture without distortion."""
    facts = Facts(solution)
    camera = facts.camera
    if not facts.groups("distortion") and camera.lens.size <= PINHOLE_SIZE:
        return None
    x, y = picture_limits(facts)
    pixels = image_grid(*facts.low_high, columns=18)
    rays = camera.unproject(pixels)
    with np.errstate(invalid="ignore", divide="ignore"):
        narrow = rays[:, 2] > np.cos(np.radians(PINHOLE_DEGREES))
        ab = rays[:, :2] / rays[:, 2:]
    ideal = np.c_[ab, np.ones(len(ab))] @ camera.matrix[:2].T
    shift = (pixels - ideal)[narrow]
    if not len(shift):
        return None
    longest = float(np.linalg.norm(shift, axis=1).max())
    scale = min(enlargement(np.linalg.norm(shift, axis=1), 1.5 * (x[1] - x[0])), 1.0)
    drawn = f"drawn at {scale:g} of its length" if scale < 1 else "at its true length"
    return Chart(
        "Distortion field",
        f"Displacement of a point by the lens relative to a pinhole camera,  {drawn}; the largest displacement is "
        f"{longest:.1f} px."
        + ("" if narrow.all() else f" Rays beyond {PINHOLE_DEGREES:.0f} degrees are omitted."),
        "u, px",
        "v, px",
        x,
        y,
        (Arrows(pixels[narrow] - scale * shift, scale * shift),),
        picture=True,
    )


def uncertainty_at_board(solution: Solution) -> Chart | None:
    """The map of the projection uncertainty at the median board distance."""
    if not solution.free.shape[1] or not len(solution.poses):
        return None
    distance = board_distance(solution)
    return _uncertainty(
        solution, distance, f"at the boards' distance ({short(distance)} {unit_of(solution)})"
    )


def uncertainty_at_infinity(solution: Solution) -> Chart | None:
    """The map of the projection uncertainty at infinity."""
    if not solution.free.shape[1] or not len(solution.poses):
        return None
    return _uncertainty(solution, np.inf, "at infinity")


def _uncertainty(solution: Solution, distance: float, where: str) -> Chart | None:
    facts = Facts(solution)
    found = map_over_image(projection_uncertainty(solution, facts.covariance), *facts.low_high, distance, 32)
    u, v, worst = found.worst
    if np.isnan(worst):
        return None
    x, y = picture_limits(facts)
    hull = hull_of(facts.image_points)
    said = (
        "the data do not determine the projection there"
        if np.isinf(worst)
        else f"the worst is {worst:.3g} px at ({u:.0f}, {v:.0f}), the median {found.median:.3g} px"
    )
    return Chart(
        f"Projection uncertainty {where}",
        "Standard deviation, in the worst direction, of the projection of a point that is fixed to the boards: "
        f"{said}.",
        "u, px",
        "v, px",
        x,
        y,
        (
            Cells(found.pixels[0, :, 0], found.pixels[:, 0, 1], found.sigmas, "± px", logarithmic=True),
            *([Line(hull, tone="hull", closed=True, label="the data")] if len(hull) else []),
        ),
        picture=True,
    )


def holdout_map(solution: Solution) -> Chart | None:
    """The difference between the cameras of the folds over the picture."""
    found = (solution.holdout or {}).get("difference")
    if not found or not found.get("map"):
        return None
    facts, drawn = Facts(solution), found["map"]
    values = np.array(drawn["found_px"], float)
    if np.isnan(values).all():
        return None
    x, y = picture_limits(facts)
    hull = hull_of(facts.image_points)
    return Chart(
        "Cameras from different views",
        "Difference in projection at infinity between cameras estimated without a part of the views and "
        f"the camera of all views (rms over the folds): {found['median_px']:.3g} px in the median, "
        f"{found['max_px']:.3g} at most; noise alone "
        f"explains {found['predicted_px']:.3g}.",
        "u, px",
        "v, px",
        x,
        y,
        (
            Cells(np.array(drawn["u"]), np.array(drawn["v"]), values, "px", logarithmic=True),
            *([Line(hull, tone="hull", closed=True, label="the data")] if len(hull) else []),
        ),
        picture=True,
    )
