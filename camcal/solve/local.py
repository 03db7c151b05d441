"""Normal equations of lens models in which each point depends on few of many coefficients (`Lens.local`).

A spline's Jacobian has hundreds of columns, but 32 entries in each row. The block of the coefficients is summed
over the cells of the spline, within which all points depend on the same ones; their coupling with the poses is a
product of a sparse matrix with few columns. All views are processed at once, as the arrays without empty columns are
small.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from camcal.model.lenses.base import Lens
from camcal.model.lenses.forms import LocalRows
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class Points:
    """The points of all views, concatenated.

    Attributes
    ----------
    view : (N,) int array, ascending
    xyz : (3, N) array, relative to the centroid of the view's points
    uv : (2, N) array
    root : (N,) array or None
        Square roots of the weights; None = 1.
    """

    view: Array
    xyz: Array
    uv: Array
    root: Array | None

    @classmethod
    def of(cls, xyz: Sequence[Array], uv: Sequence[Array], weights: Sequence[Array] | None) -> Points:
        """Concatenate arrays (N, 3), (N, 2), (N,) of each view."""
        view = np.repeat(np.arange(len(xyz)), [len(x) for x in xyz])
        root = None if weights is None else np.sqrt(np.concatenate(weights))
        return cls(view, np.concatenate(xyz).T.copy(), np.concatenate(uv).T.copy(), root)


def products(
    lens: Lens, params: Array, rotations: Array, centres: Array, points: Points
) -> tuple[Array, Array, Array] | None:
    """Sums of products of the rows of the Jacobian: parameters, rotation, translation, residual.

    Parameters
    ----------
    rotations, centres : (V, 3, 3) and (V, 3) arrays

    Returns
    -------
    own : (P, P) array, of the parameters, over all views
    coupling : (V, P, 7) array, of the parameters with pose and residual
    poses : (V, 7, 7) array, of pose and residual
        None where a point leaves the lens's domain.
    """
    count, own = len(points.view), lens.size - lens.local
    turned = np.einsum("nij,jn->in", rotations[points.view], points.xyz)
    cam = turned + centres[points.view].T
    rows = np.empty((1, own + 7, 2, count))  # dense parameters, rotation, translation, residual
    d_xyz = rows[:, own + 3 : own + 6]
    with np.errstate(all="ignore"):
        found = lens.linearise_locally(params, cam[:, None], rows[:, -1], d_xyz, rows[:, :own])
    if found is None:
        return None
    rows[0, -1] -= points.uv
    # x_cam moves by δ x (R x): the rotation's columns are (R x) x d_xyz
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        rows[0, own + i] = turned[j] * d_xyz[0, k] - turned[k] * d_xyz[0, j]
    factors = found.factors
    if points.root is not None:
        rows *= points.root
        factors = factors * points.root
    return _summed(rows[0], LocalRows(found.columns, found.basis, factors), points.view, lens.local // 2)


def _summed(rows: Array, local: LocalRows, view: Array, half: int) -> tuple[Array, Array, Array]:
    from scipy import sparse  # for splines only: importing it takes longer than calibrating most cameras

    own = len(rows) - 7
    starts = np.searchsorted(view, np.arange(view[-1] + 2))
    basis = sparse.csr_array(
        (local.basis.ravel(), local.columns.ravel(), np.arange(len(view) + 1) * local.basis.shape[1]),
        shape=(len(view), half),
    )
    # (N, 2 (own + 7)): d(u, v)/d half times each row, whose product with the basis are the sums
    mixed = np.einsum("icn,rcn->nir", local.factors, rows).reshape(len(view), -1)
    size = own + 2 * half
    total, coupling = np.zeros((size, size)), np.empty((len(starts) - 1, size, 7))
    poses = np.empty((len(starts) - 1, 7, 7))
    for v, (begin, end) in enumerate(pairwise(starts)):
        flat = rows[:, :, begin:end].reshape(own + 7, -1)
        dense = flat @ flat.T
        halves = np.asarray(basis[begin:end].T @ mixed[begin:end]).reshape(half, 2, own + 7)
        across = halves.transpose(1, 0, 2).reshape(2 * half, own + 7)
        total[:own, :own] += dense[:own, :own]
        total[own:, :own] += across[:, :own]
        coupling[v, :own], coupling[v, own:], poses[v] = dense[:own, own:], across[:, own:], dense[own:, own:]
    total[:own, own:] = total[own:, :own].T
    total[own:, own:] = _by_cell(local, half)
    return total, coupling, poses


def _by_cell(local: LocalRows, half: int) -> Array:
    """The block (2 h, 2 h) of the local coefficients; points that depend on the same ones are summed together."""
    out = np.zeros((2, half, 2, half))
    first = local.columns[:, 0]
    order = np.argsort(first, kind="stable")
    ends = np.flatnonzero(np.diff(first[order])) + 1
    weights = np.einsum("icn,jcn->ijn", local.factors, local.factors)
    for some in np.split(order, ends):
        at, basis = local.columns[some[0]], local.basis[some]
        for i, j in ((0, 0), (0, 1), (1, 1)):
            out[i, at[:, None], j, at] += (basis * weights[i, j, some, None]).T @ basis
    out[1, :, 0] = out[0, :, 1].transpose()
    return out.reshape(2 * half, 2 * half)
