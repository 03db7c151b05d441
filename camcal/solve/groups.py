"""Views of one camera that are processed together so that their rows stay in the processor's cache."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from camcal.data.observations import View
from camcal.records import dataclass

Array = np.ndarray

#: `Lens.linearise` without the parameters
Linearise = Callable[[Array, Array, Array, Array, Array, Array], "bool | Array"]

#: numbers in the Jacobian rows of a group of views; as doubles they fill a second-level cache of 1 MB, and the overhead
#: of each numpy call is negligible
ROW_BUDGET = 120_000


@dataclass(frozen=True)
class Group:
    """Views of a camera, padded to equal length with points of weight 0."""

    camera: int  #: which of the problem's
    members: Array  #: (G,) indices of the views
    xyz: Array  #: (G, 3, N) points relative to the centroid of the view's instant
    uv: Array  #: (G, 2, N)
    weights: Array | None  #: (G, 1, 1, N) square roots of the weights, None = 1
    ids: Array | None = None  #: (G, N) which point of the board each is, where that has a shape

    def alone(self, index: int) -> Group:
        """Return a single view as a group."""
        at = slice(index, index + 1)
        return Group(
            self.camera,
            self.members[at],
            self.xyz[at],
            self.uv[at],
            None if self.weights is None else self.weights[at],
            None if self.ids is None else self.ids[at],
        )


def make_groups(
    camera: int,
    members: Array,
    rows: int,
    views: Sequence[View],
    offsets: Array,
    weights: Sequence[Array] | None,
) -> list[Group]:
    """The groups of a camera's views, the shortest first.

    Parameters
    ----------
    members : (B,) int array
        Which of the views are the camera's.
    rows : int
        Number of Jacobian rows: parameters, pose and residual.
    offsets : (len(views), 3) array
        Subtracted from each view's points.
    """
    lengths = np.array([len(views[i].uv) for i in members], int)
    by_length = np.argsort(lengths, kind="stable")
    order, longest = members[by_length], lengths[by_length].tolist()
    groups, begin = [], 0
    while begin < len(order):
        end = begin + 1
        while end < len(order) and (end + 1 - begin) * longest[end] * 2 * rows <= ROW_BUDGET:
            end += 1
        groups.append(_group(camera, order[begin:end], views, offsets, weights))
        begin = end
    return groups


def _group(
    camera: int, members: Array, views: Sequence[View], offsets: Array, weights: Sequence[Array] | None
) -> Group:
    chosen = [views[i] for i in members]
    counts = np.array([len(v.uv) for v in chosen])
    xyz = _stacked([v.xyz for v in chosen], counts)
    if weights is None and (counts == counts[0]).all():
        root = None
    else:
        given = [np.ones(c) for c in counts] if weights is None else [weights[i] for i in members]
        padded = np.zeros((len(members), counts.max()))
        for row, w in zip(padded, given, strict=True):
            row[: len(w)] = np.sqrt(w)
        root = None if (padded == 1.0).all() else padded[:, None, None, :]
    return Group(
        camera,
        members,
        np.ascontiguousarray((xyz - offsets[members][:, None]).transpose(0, 2, 1)),
        np.ascontiguousarray(_stacked([v.uv for v in chosen], counts).transpose(0, 2, 1)),
        root,
    )


def row_block(uv: Array, parameters: int, scratch: Array | None = None) -> Array:
    """An array (G, P + 6 + 1, 2, N) for the rows of views with the points uv (G, 2, N); in `scratch` where that is
    given.
    """
    shape = len(uv), parameters + 7, 2, uv.shape[2]
    return np.empty(shape) if scratch is None else scratch[: math.prod(shape)].reshape(shape)


def fill_rows(
    block: Array,
    project: Linearise,
    rotations: Array,
    centres: Array,
    xyz: Array,
    uv: Array,
    weights: Array | None,
) -> bool | Array:
    """Fill the rows of views: parameters, rotation and translation of the pose, residual.

    Parameters
    ----------
    block : (G, P + 6 + 1, 2, N) array
    project : callable
        `Lens.linearise` of the cameras' parameters.
    rotations, centres : (G, 3, 3) and (G, 3) arrays
    xyz, uv, weights : as in `Group`

    Returns
    -------
    bool
        False where a point leaves the lens's domain: the rows are then not to be used. By view where `project` says so.
    """
    p = block.shape[1] - 7
    turned = rotations @ xyz
    cam = turned + centres[:, :, None]
    x, y, z = (np.ascontiguousarray(cam[:, i]) for i in range(3))
    d_xyz = block[:, p + 3 : p + 6]
    inside = project(x, y, z, block[:, -1], d_xyz, block[:, :p])
    if inside is False:
        return False
    block[:, -1] -= uv
    # x_cam moves by δ x (R x): the rotation's columns are (R x) x d_xyz
    tx, ty, tz = (turned[:, i, None] for i in range(3))
    dx, dy, dz = d_xyz[:, 0], d_xyz[:, 1], d_xyz[:, 2]
    np.subtract(ty * dz, tz * dy, out=block[:, p])
    np.subtract(tz * dx, tx * dz, out=block[:, p + 1])
    np.subtract(tx * dy, ty * dx, out=block[:, p + 2])
    if weights is not None:
        block *= weights
    return inside


def products(block: Array) -> Array:
    """Products (G, R, R) of the rows (G, R, 2, N) of each view.

    The last row is omitted on one side: the product of a matrix with its own transpose uses BLAS's syrk, which
    takes twice the time of a general product for such small matrices.
    """
    flat = block.reshape(*block.shape[:2], -1)
    found = np.empty((len(flat), flat.shape[1], flat.shape[1]))
    np.matmul(flat[:, :-1], flat.transpose(0, 2, 1), out=found[:, :-1])
    found[:, -1, :-1] = found[:, :-1, -1]
    last = flat[:, -1]
    found[:, -1, -1] = (last[:, None] @ last[:, :, None])[:, 0, 0]
    return found


def _stacked(arrays: list[Array], counts: Array) -> Array:
    """Stack arrays (N, d) of views as (G, max N, d), padded with each view's first row."""
    if (counts == counts[0]).all():
        return np.stack(arrays)
    return np.stack([np.r_[a, np.repeat(a[:1], counts.max() - len(a), 0)] for a in arrays])
