"""Condition numbers of the equations of every stage, before and after normalisation of their coordinates.

A condition number κ costs log10 κ of the 16 digits of a float64; normal equations cost twice as many.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences
from camcal.geometry import dlt, projective, rotations
from camcal.geometry.numbers import distinct
from camcal.solve.calibration import Calibration, Stage
from camcal.solve.condition import condition
from camcal.solve.problem import Problem
from camcal.solve.refine import POINTS_AT_A_TIME
from camcal.solve.square_root import SquareRoot
from camcal.start import assumptions, central, conic

Array = np.ndarray


def with_conditioning(
    stages: Sequence[Stage], solution: Calibration, normalise: bool = True
) -> tuple[Stage, ...]:
    """The stages with `info["conditioning"]` = {before, after} in each that has equations.

    `after` is what was solved; without normalisation both are the same.
    """
    return tuple(_with(stage, solution, normalise) for stage in stages)


def _with(stage: Stage, solution: Calibration, normalise: bool) -> Stage:
    data = solution.observations.kept()
    found: dict[str, Any] | None
    found = refinement(solution, normalise) if stage.name == "refine" else linear(stage.name, data, normalise)
    # the equations of a start from views that were removed since cannot be formed
    alike = stage.poses is not None and len(stage.poses) == len(data.views)
    if found is not None and stage.name == "zhang" and alike:
        found["conic"] = _conic(stage, data, normalise)
    return stage if found is None else replace(stage, info={**stage.info, "conditioning": found})


def linear(name: str, data: Correspondences, normalise: bool = True) -> dict[str, Any] | None:
    """The condition numbers of a closed form's equations for the views; None for one without linear equations.

    For `zhang`, that of its homographies.
    """
    known = {"central": _central, "dlt": _dlt, "zhang": _homographies}
    return known[name](data, normalise) if name in known else None


def _pair(before: float, after: float, normalise: bool) -> dict[str, float]:
    return {"before": before, "after": after if normalise else before}


def refinement(solution: Calibration, normalise: bool = True) -> dict[str, Any]:
    """cond J at the solution: with poses about the data's origin and unscaled columns, and normalised."""
    views, camera = solution.observations.kept().views, solution.camera
    free = solution.free[:, solution.free.any(0)]
    if not free.size:  # a known camera: poses only
        return _pair(float("nan"), float("nan"), normalise)
    problem = Problem(camera.lens, views, free, weights=[np.ones(len(v)) for v in views])
    state = problem.state(camera.params, solution.poses)
    if problem.linearise(state) is None:
        return _pair(float("nan"), float("nan"), normalise)
    root = SquareRoot.of(problem, state)
    # x = exp(ω) R (X - o) + R o + t + τ about the centroid o, exp(ω) R X + t + τ' about the origin: τ = τ' + ω x R o
    about_origin = np.tile(np.eye(6), (len(state.rotations), 1, 1))
    about_origin[:, 3:, :3] = -rotations.skew((state.rotations @ problem.offsets[..., None])[..., 0])
    before = condition(root.with_poses(about_origin), scaled=False)
    return _pair(before, condition(root), normalise)


def _central(data: Correspondences, normalise: bool) -> dict[str, float]:
    view = data.views[0]
    c = central.Central(view.xyz, view.uv)
    lengths = np.linalg.norm(c, axis=0)
    return _pair(_ratio(c, 10), _ratio(c / np.where(lengths > 0, lengths, 1.0), 10), normalise)


def _dlt(data: Correspondences, normalise: bool) -> dict[str, float]:
    """The worst over views of points in space; the last of 12 singular values belongs to the solution."""
    planar = data.shapes.planar
    views = [v for v, flat in zip(data.views, planar, strict=True) if not flat]
    both = [
        max(_ratio(dlt.system(v.xyz[None], v.uv[None], None, n)[0][0], 10) for v in views)
        for n in (False, True)
    ]
    return _pair(both[0], both[1], normalise)


def _homographies(data: Correspondences, normalise: bool) -> dict[str, float]:
    """The worst over the views; the last of 9 singular values belongs to the solution."""
    form, lengths = data.shapes, np.array([len(v) for v in data.views])
    both = np.zeros(2)
    for some in _portions(lengths):
        xyz, uv = (np.stack([getattr(data.views[i], name) for i in some]) for name in ("xyz", "uv"))
        axes = form.axes[some, :, :2]
        raw, local = xyz @ axes, (xyz - form.origins[some][:, None]) @ axes
        for i, (points, pixels) in enumerate(((raw, uv), (_normalised(local), _normalised(uv)))):
            both[i] = max(both[i], _ratios(homography_equations(points, pixels), 7).max())
    return _pair(float(both[0]), float(both[1]), normalise)


def _portions(lengths: Array) -> Iterator[Array]:
    """Indices of views of one length, no more points at a time than `POINTS_AT_A_TIME` or those of one view."""
    for length in distinct(lengths):
        some = np.flatnonzero(lengths == length)
        count = max(1, POINTS_AT_A_TIME // max(int(length), 1))
        yield from (some[i : i + count] for i in range(0, len(some), count))


def homography_equations(xy: Array, uv: Array) -> Array:
    """The matrix (..., 2 N, 9) of h1·x - u h3·x = 0, h2·x - v h3·x = 0 for points xy and uv (..., N, 2)."""
    x = projective.homogeneous(xy)
    a = np.zeros((*x.shape[:-1], 2, 3, 3))
    a[..., 0, 0, :] = a[..., 1, 1, :] = x
    a[..., :, 2, :] = -uv[..., :, None] * x[..., None, :]
    return a.reshape(*x.shape[:-2], -1, 9)


def _normalised(points: Array) -> Array:
    """Points (..., N, 2) in normalised coordinates."""
    moved = projective.homogeneous(points) @ np.swapaxes(projective.normalisation(points), -1, -2)
    return projective.dehomogenise(moved)


def _conic(stage: Stage, data: Correspondences, normalise: bool) -> dict[str, float]:
    """Zhang's equations for the image of the absolute conic, skew 0, in pixels and in unit coordinates."""
    assert stage.matrix is not None and stage.poses is not None
    form = data.shapes
    axes = stage.poses.rotations @ form.axes[..., :2]
    origins = np.einsum("vij,vj->vi", stage.poses.rotations, form.origins) + stage.poses.translations
    h = stage.matrix @ np.concatenate([axes, origins[..., None]], 2)
    basis = assumptions.SETS[1].basis
    both = []
    for to_unit in (np.eye(3), assumptions.unit_coordinates(data)[0]):
        moved = to_unit @ h
        moved = moved / np.sqrt((moved[..., :2] ** 2).sum((1, 2)) / 2)[:, None, None]
        both.append(_ratio(conic.constraints(moved).reshape(-1, 6) @ basis, basis.shape[1] - 2))
    return _pair(both[0], both[1], normalise)


def _ratio(a: Array, last: int) -> float:
    """The largest singular value divided by that of index `last`; inf if that is 0 or does not exist."""
    return float(_ratios(a, last))


def _ratios(a: Array, last: int) -> Array:
    """`_ratio` of matrices (..., M, N)."""
    singular = np.linalg.svd(a, compute_uv=False)
    if singular.shape[-1] <= last:
        return np.full(a.shape[:-2], np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(singular[..., last] > 0, singular[..., 0] / singular[..., last], np.inf))
