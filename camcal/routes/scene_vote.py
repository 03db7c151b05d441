"""Assignment of the lines of a picture to three directions, by a mixture of four components.

A line of direction i misses the vanishing point of i by m px at its ends, with the expected deviation σ; m / σ follows
Student's t, whose tails represent lines that are only nearly in the direction. A line of no direction has any angle.
The shares of the four sources are those of maximum likelihood (the EM algorithm; Dempster, Laird & Rubin 1977), so that
no threshold decides on membership.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.routes.line_geometry import Lines
from camcal.routes.scene_start import misses

#: least number of lines of a direction: two always meet, the third confirms the point
LEAST_LINES = 3
#: px; noise of the ends of lines: of points in a table, and of segments fitted to sub-pixel maxima (greatest
#: likelihood over twelve pictures of streets and rooms, of 0.1, 0.2, 0.3)
TABLE_NOISE, PICTURE_NOISE = 0.3, 0.2
#: rad; additional deviation of edges of buildings and furniture from their direction (greatest likelihood of 0.003
#: and 0.006). Lines of tables are taken as exact.
LOOSE = 0.003
#: degrees of freedom of t (of 2 and 4, the greater likelihood)
TAIL = 2.0
#: a line is used if it belongs to its direction with at least this probability: more likely than not
LIKELY = 0.5
#: steps of EM; the shares of a few hundred lines no longer change in the third digit
STEPS = 30
#: of `Vote.growth`: for residuals of the model it is 0.4; below this they are clutter
LEAST_GROWTH = 0.2


class Seen(NamedTuple):
    """End points (L, 2, 2), their standard deviations (L,) and the lengths (L,), px."""

    ends: Array
    noise: Array
    length: Array


class Vote(NamedTuple):
    """Which lines belong to which direction.

    Attributes
    ----------
    family : (L,) int array
        -1 for none.
    roots : (L,) array
        Of the weights.
    growth : float
        Growth of the scores with the residuals relative to the weighted Jacobian, as the weights decrease:
        Σ ψ' / Σ w (Huber, Robust statistics, 1981, section 7.6).
    likelihood : float
        Its logarithm, relative to lines of no direction.
    """

    family: Array
    roots: Array
    growth: float
    likelihood: float


def seen_lines(lines: Lines, picture: bool) -> Seen:
    """Lines found in a picture or given in a table, with the expected deviations of their ends."""
    ends = line_ends(lines)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    noise = np.hypot(PICTURE_NOISE, LOOSE * length / 2) if picture else np.full(len(length), TABLE_NOISE)
    return Seen(ends, noise, length)


def families(seen: Seen, camera: Camera, rotation: Array, wider: float = 1.0) -> Vote:
    """The direction of each line, -1 if it probably has none, and its weight; `wider` multiplies σ."""
    ends, noise, length = seen
    flat = ends if camera.lens.name == "pinhole" else _flat(camera, ends)
    sigma = wider * noise
    miss = misses(flat, camera.params[2:4], float(camera.params[0]), rotation) / sigma[:, None]
    # relative to a line of no direction, whose ends miss by up to half its length, at any angle
    ratio = _student(miss) * (np.pi * length / 2 / sigma)[:, None]
    share, chances = np.full(4, 0.25), ratio
    for _ in range(STEPS):
        parts = np.c_[ratio, np.ones(len(ratio))] * share
        chances = parts / parts.sum(1, keepdims=True)
        share = chances.mean(0)
    likelihood = float(np.log(parts.sum(1)).sum()) if len(ratio) else 0.0
    family = chances[:, :3].argmax(1)
    chance, off = (x[np.arange(len(x)), family] for x in (chances, miss))
    family = np.where(chance > LIKELY, family, -1)
    few = np.bincount(family[family >= 0], minlength=3) < LEAST_LINES
    family = np.where((family >= 0) & few[family], -1, family)
    weight = chance * (TAIL + 1) / (TAIL + off**2)
    slope = weight * (TAIL - off**2) / (TAIL + off**2)
    used = family >= 0
    growth = float(slope[used].sum() / weight[used].sum()) if used.any() else 1.0
    return Vote(family, np.sqrt(weight) / sigma, max(growth, LEAST_GROWTH), likelihood)


def _student(x: Array) -> Array:
    """The density of Student's t with two degrees of freedom."""
    return 1 / (2 * np.sqrt(2) * (1 + x**2 / 2) ** 1.5)


def _flat(camera: Camera, ends: Array) -> Array:
    rays = camera.unproject(ends)
    return rays[..., :2] / rays[..., 2:] * camera.params[:2] + camera.params[2:4]


def line_ends(lines: Lines) -> Array:
    """End points (L, 2, 2) of the straight lines nearest to the points."""
    out = np.empty((len(lines), 2, 2))
    for i in range(len(lines)):
        uv = lines.uv[lines.line == i]
        centre = uv.mean(0)
        main = np.linalg.eigh((uv - centre).T @ (uv - centre))[1][:, 1]
        along = (uv - centre) @ main
        out[i] = centre + np.outer([along.min(), along.max()], main)
    return out
