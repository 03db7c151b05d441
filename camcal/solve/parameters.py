"""The estimated parameters: from `--fix` to the matrix d params / d free parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array

#: not a parameter but a constraint: fy = fx times the initial ratio, or times the given value
ASPECT = "aspect"


def check_held(model: str, skew: bool, fix: Mapping[str, float | None]) -> None:
    """Raise a UsageError as `apply_fixed`, and for a model that does not exist.

    `auto` tries the ordinary model first; the models of `select` have no names in common.
    """
    if model != "select":
        lens = lenses.make(lenses.ORDINARY if model == "auto" else model, skew)
        apply_fixed(lens, lens.neutral, fix)


def nominal(lens: Lens, image_size: tuple[int, int], fix: Mapping[str, float | None]) -> Camera:
    """The lens without distortion: f is the longer side, the principal point central, with the values of `fix`."""
    f = float(max(image_size))
    params = lens.pinhole(f, f, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2)
    return Camera(lens, apply_fixed(lens, params, dict(fix)), image_size)


def apply_fixed(lens: Lens, params: Array, fix: Mapping[str, float | None]) -> Array:
    """The start with the values of `fix` applied (name -> value; None keeps the current value).

    `aspect` without a value means fy = fx: both become their mean.

    Raises
    ------
    UsageError
        For a name that the model does not have, a value that it cannot have, or a contradiction.
    """
    params = np.array(params, float)
    for name, value in fix.items():
        if name == ASPECT:
            continue
        index = lens.index(name)
        if value is not None:
            lens.check_value(name, value)
            params[index] = value
    if ASPECT in fix:
        ratio = fix[ASPECT] or 1.0
        fixed = [n for n in ("fx", "fy") if n in fix]
        if len(fixed) == 2:
            raise UsageError(
                "fx, fy and their ratio are all fixed; at most two of them can be.",
                "Omit 'aspect', or one of fx and fy.",
            )
        if not fixed:
            params[0] = 0.5 * (params[0] + params[1] / ratio)
        if "fy" in fixed:
            params[0] = params[1] / ratio
        params[1] = params[0] * ratio
    return params


def free_matrix(lens: Lens, params: Array, fix: Mapping[str, float | None]) -> Array:
    """d params / d free parameters, (P, F): one column per free parameter; with `aspect`, fx and fy share one.

    Raises
    ------
    UsageError
        For a name that the model does not have.
    """
    fixed = {lens.index(name) for name in fix if name != ASPECT}
    columns = []
    tied = ASPECT in fix and not fixed & {0, 1}
    if ASPECT in fix:
        fixed |= {1} if tied else {0, 1}
    for index in range(lens.size):
        if index in fixed:
            continue
        column = np.zeros(lens.size)
        column[index] = 1.0
        if index == 0 and tied:
            column[1] = params[1] / params[0]
        columns.append(column)
    return np.array(columns).T.reshape(lens.size, len(columns))
