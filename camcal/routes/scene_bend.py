"""Detection of lens distortion from a common bend of the lines in a picture, towards its centre or away from it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.errors import CamcalError
from camcal.geometry.numbers import distinct
from camcal.least_squares.scales import NORMAL_95
from camcal.model.lenses import make
from camcal.model.pose import Array
from camcal.routes.line_geometry import Lines
from camcal.routes.scene import estimate
from camcal.routes.scene_fit import Scene

#: points of a line whose bend is measured: a parabola has three numbers, and some have to be left to average
LEAST_POINTS = 5
#: Standard errors of the common bend from which it is asked what a lens with distortion makes of the focal length; by
#: chance one of 370 pictures. A bend of 0.3 px at the ends of 60 lines of 100 px has 3.5
BENT = 3.0
#: standard deviations by which the focal length then has to change: the 95 % interval does not hold it
OFF = NORMAL_95
#: the lens with one term of distortion
WITH_DISTORTION = "division:1"


def common_bend(lines: Lines, centre: Array) -> float:
    """The bend that all lines share, in standard errors; NaN for fewer than two usable lines.

    Lines without enough different points are not usable; NaN is also returned if no lens bends the lines (all pass
    through the centre), or if they are straight to the last digit.

    One term of distortion k moves a point by k r² of its distance r from the centre: a line at the distance d with the
    half length a is bent by b = k d a² in its middle, and k is the regression of the b on d a². The standard error is
    that of lines that are off by different amounts (White 1980).
    """
    found = []
    for index in range(len(lines)):
        uv = lines.uv[lines.line == index]
        if len(distinct(uv, axis=0)) < LEAST_POINTS:
            continue
        middle = uv.mean(0)
        axes = np.linalg.svd(uv - middle, full_matrices=False)[2]
        along, across = (uv - middle) @ axes[0], (uv - middle) @ axes[1]
        half = np.ptp(along) / 2
        found.append(((middle - centre) @ axes[1] * half**2, np.polyfit(along, across, 2)[0] * half**2))
    if len(found) < 2:
        return float("nan")
    expected, bend = np.array(found).T
    lever = float(expected @ expected)
    k = float(expected @ bend) / lever if lever > 0 else 0.0
    error = float(np.linalg.norm(expected * (bend - k * expected)))
    return k * lever / error if error > 0 else float("nan")


def with_distortion(
    scene: Scene, lines: Lines, fix: Mapping[str, float | None], seed: int, picture: bool
) -> Scene | None:
    """The estimate with one term of distortion where the lines show it and it has another focal length; else None."""
    if not picture and not abs(common_bend(lines.take(scene.family >= 0), scene.camera.params[2:4])) > BENT:
        return None
    try:
        other = estimate(lines, make(WITH_DISTORTION), fix, seed, picture)
    except CamcalError:
        return None
    # segments of pictures are too short to be bent: together they show distortion by where they meet
    sigmas = np.sqrt(np.diagonal(other.covariance))
    if picture and not abs(other.camera.params[-1]) > BENT * sigmas[-1]:
        return None
    apart = abs(other.camera.params[0] - scene.camera.params[0])
    return other if apart > OFF * np.sqrt(scene.covariance[0, 0]) else None
