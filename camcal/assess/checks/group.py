"""Neighbouring points with a common shift: a column, a row or a mark that was mistaken for its neighbour.

In a small set such points attract the fit, and no single residual stands out. With C the two columns that shift a
group of points in u and v and M = I - H of the solution (`design.py`), a common shift reduces the cost by

    ½ bᵀ (Cᵀ M C)⁻¹ b,    b = Cᵀ r                                                                        (1)

which, relative to the remaining cost, follows F(2, ν - 2) if there is no shift (Cook & Weisberg, Residuals and
Influence in Regression, 1982, section 2.2.2, of groups).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess import figures
from camcal.assess.checks import fit
from camcal.assess.checks.facts import Facts
from camcal.assess.design import Design, Rows
from camcal.assess.warning import CalibrationWarning
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.numbers import TINY
from camcal.least_squares.distributions import f_exceeded
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.system.text import listed

#: points up to which groups are searched: in larger sets a group no longer attracts the fit, and is found by the test
#: of single points
MOST_POINTS = 200
#: least points of a group, and its largest share of the view: the other points must determine its correct position
SIZES, MOST_PART = range(3, 9), 1 / 3
#: probability that any group shifts as far by chance
BY_CHANCE = 1e-3
#: ratio of eigenvalues that is zero up to rounding: the fit follows any shift of the group
ROUNDING = 1e-9


@dataclass(frozen=True)
class Group:
    """The most significantly shifted group: its view, its rows among the used points there, and the shift, px."""

    view: int
    rows: Array
    shift: Array
    p_value: float


def shifted_group(facts: Facts) -> Iterator[CalibrationWarning]:
    """A group of neighbouring points that is shifted as a whole."""
    found = shifted(facts)
    if found is None or not found.p_value < BY_CHANCE:
        return
    solution, view = facts.solution, facts.views[found.view]
    used = np.flatnonzero(solution.used[solution.observations.slices[found.view]])
    rows = used[found.rows]
    mask = np.zeros(len(solution.used), bool)
    mask[np.arange(len(solution.used))[solution.observations.slices[found.view]][rows]] = True
    moved, _ = fit.moved_without(facts, mask[solution.used])
    yield CalibrationWarning(
        "shifted-group",
        f"points {listed([str(int(r)) for r in np.sort(rows)], 8)} of view '{view.id}' (rows, counted from 0) lie "
        f"({found.shift[0]:+.1f}, {found.shift[1]:+.1f}) px from the places that all other points predict; "
        f"without them the projections change by {moved:.2g} px (rms).",
        "Check these points for a mark mistaken for its neighbour or wrong coordinates; remove them and compare.",
        "doubtful" if moved > fit.SEVERAL_PX else "note",
    )


def shifted(facts: Facts) -> Group | None:
    """The group with the least probable shift; its p-value accounts for the number of groups."""
    design = facts.design
    freedom = figures.redundancy(facts.solution)
    if design is None or not freedom > 2 or int(facts.solution.used.sum()) > MOST_POINTS:
        return None
    total = sum(float((rows.residuals**2).sum()) for rows in design.rows())
    best, count = None, 0
    for rows in design.rows():
        left = _left(design, rows)
        for members in groups(design.views[rows.view].xyz):
            count += 1
            gain, shift = _of_shift(rows, left, members)
            if best is None or gain > best[0]:
                best = gain, rows.view, members, shift
    if best is None or not total > best[0] > 0:
        return None
    statistic = best[0] / 2 / ((total - best[0]) / (freedom - 2))
    chance = min(1.0, count * float(f_exceeded(statistic, 2, freedom - 2)))
    return Group(best[1], best[2], best[3], chance)


def groups(xyz: Array) -> list[Array]:
    """Groups of points (N, 3) of a view: each point with its nearest ones, and consecutively listed points."""
    found: dict[tuple[int, ...], None] = {}
    for size in SIZES:
        if size > MOST_PART * len(xyz):
            break
        nearest = Neighbours(xyz).query(xyz, size)[1]
        windows = np.arange(len(xyz) - size + 1)[:, None] + np.arange(size)
        for members in np.sort(np.concatenate([nearest, windows]), axis=1).tolist():
            found[tuple(members)] = None
    return [np.array(members) for members in found]


def _left(design: Design, rows: Rows) -> Array:
    """I - H of a view's points, (N, 2, N, 2)."""
    count = len(rows.residuals)
    own = design.of_camera(rows).reshape(2 * count, -1)
    pose = rows.pose.reshape(2 * count, 6)
    hat = own @ design.inverse @ own.T + pose @ design.poses.inverse[rows.view] @ pose.T
    return (np.eye(2 * count) - hat).reshape(count, 2, count, 2)


def _of_shift(rows: Rows, left: Array, members: Array) -> tuple[float, Array]:
    """Twice (1), and the shift (2,) of the observed points, px."""
    roots = rows.roots[members]
    b = roots @ rows.residuals[members]
    inner = np.einsum("i,icjd,j->cd", roots, left[members][:, :, members], roots)
    values, vectors = np.linalg.eigh(inner)
    if not values[0] > ROUNDING * max(values[1], TINY):
        return 0.0, np.zeros(2)  # the fit follows any shift of the group
    shift = vectors @ ((vectors.T @ b) / values)
    return float(b @ shift), -shift
