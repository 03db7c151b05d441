"""Kinds of changes between views: each is a few columns of numbers for the fields of `camcal.solve.warp`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.model.pose import Array
from camcal.solve.warp import FIELDS, Warp

_AT = {name: i for i, name in enumerate(FIELDS)}


def _columns(*names: str) -> Callable[[Warp], Array]:
    def kind(warp: Warp) -> Array:
        return np.eye(len(FIELDS))[:, [_AT[n] for n in names]]

    return kind


def _resized(warp: Warp) -> Array:
    """A scale about the corner of the first pixel; the principal point moves with it."""
    column = np.zeros((len(FIELDS), 1))
    column[_AT["scale"]] = 1.0
    column[[_AT["shift-u"], _AT["shift-v"]], 0] = (warp.centre + 0.5) / warp.unit
    return column


#: kind -> columns (K, M) of its M numbers over all fields
KINDS: dict[str, Callable[[Warp], Array]] = {
    "focal": _columns("scale"),
    "focus": _columns("scale", "radial"),
    "resized": _resized,
    "cropped": _columns("shift-u", "shift-v"),
    "camera": _columns("scale", "radial", "shift-u", "shift-v"),
    "rolling": _columns("lean", "stretch"),
}
#: kinds that a part of the views can share, and kinds with separate parameters for each view
OF_PARTS = ("focal", "focus", "resized", "cropped", "camera")
OF_EACH = ("focal", "resized", "cropped", "rolling")
#: parameters of an outlying view: with its pose, all that a view of a plane determines
OF_ONE = "rolling"


def contrasts(count: int) -> Array:
    """Numbers of `count` views that sum to zero: an orthonormal basis (count, count - 1)."""
    basis, _ = np.linalg.qr(np.c_[np.ones(count), np.eye(count)[:, 1:]])
    return basis[:, 1:]


def shared(weights: Array, columns: Array) -> Array:
    """The design (V, K, M G) of numbers shared by views: weights (V, G), columns (K, M)."""
    count = len(weights)
    return np.einsum("vg,km->vkmg", weights, columns).reshape(count, len(columns), -1)
