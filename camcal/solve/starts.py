"""Where a refinement begins when a pinhole camera is no good beginning: wide lenses, and larger models.

A closed form that takes the lens for a pinhole camera fails beyond some 120 degrees. Then the radial
alignment constraint gives poses and a rough lens of any width, and the model at hand is fitted to its rays. A
model that still ends badly gets the optimum of the models that it contains as a further start, so that it
never ends worse than they do.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from camcal.data.observations import Correspondences
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.containment import embed
from camcal.model.lenses.regress import minima, regress
from camcal.model.pose import Poses
from camcal.solve.parameters import ASPECT, apply_fixed
from camcal.solve.solution import Solution, Stage
from camcal.solve.solve import refine, residuals
from camcal.start import assumptions, radial

#: a pinhole start with a larger rms than this part of the image's half diagonal is too far from the truth:
#: at 120 degrees it is 1 %, at 150 degrees 4 %
POOR_START = 0.02
#: a refinement that leaves a larger median error than this part, or does not converge, is doubted
POOR_END = 0.002
#: to what part of a model's own limit, and to what angle at most, rad, views are pushed into its domain
CONES = ((0.98, np.deg2rad(88)), (0.9, np.deg2rad(84)))
#: the lens that stands in for one that cannot hold all rays of the rough start
GENERAL = "kb4"


@dataclass(frozen=True)
class Begin:
    """A start: camera, poses, and the stage that says how it was come by."""

    camera: Camera
    poses: Poses
    stage: Stage


def poor(rms_point: float, correspondences: Correspondences) -> bool:
    """Whether a start is too far away to begin from."""
    return not rms_point <= POOR_START * _half_diagonal(correspondences)


def doubtful(solution: Solution) -> bool:
    """Whether a solution may be a wrong minimum."""
    lengths = np.linalg.norm(solution.used_residuals, axis=1)
    bound = POOR_END * _half_diagonal(solution.correspondences)
    return not solution.fit.converged or not np.median(lengths) <= bound


def _half_diagonal(correspondences: Correspondences) -> float:
    return float(1 / assumptions.unit_coordinates(correspondences)[0][0, 0])


class RadialAlignment:
    """Starts by radial alignment, its figures worked out once for all models that ask.

    Parameters
    ----------
    correspondences : Correspondences
        The points to rest on.
    """

    def __init__(self, correspondences: Correspondences):
        self.correspondences = correspondences
        self._begins: dict[str, list[Begin]] = {}

    @cached_property
    def stage(self) -> Stage:
        """The rough camera, symmetric about its axis, and the poses.

        Raises
        ------
        DataError, EstimationError
            Where the radial alignment constraint determines no camera.
        """
        begin = time.perf_counter()
        rough = radial.estimate(self.correspondences)
        error = np.concatenate(residuals(rough.camera, rough.poses, self.correspondences))
        rms = float(np.sqrt(np.nanmean((error**2).sum(1))))
        return Stage(
            "radial",
            rms,
            rough.camera.matrix,
            time.perf_counter() - begin,
            camera=rough.camera,
            poses=rough.poses,
            info=rough.info,
        )

    @cached_property
    def general(self) -> tuple[Camera, Poses]:
        """The same refined with a lens that holds rays of all directions."""
        assert self.stage.camera is not None and self.stage.poses is not None
        camera = regressed(make(GENERAL), self.stage.camera, self.correspondences)
        solved = refine(camera, self.stage.poses, self.correspondences)
        return solved.camera, solved.poses

    def begin(self, lens: Lens, fix: Mapping[str, float | None] | None = None) -> list[Begin]:
        """Starts for a model.

        A model that cannot hold rays as far from the axis as there are gets views pushed away from the
        camera until it can.

        Parameters
        ----------
        fix : mapping
            As in `refine`; a parameter without a value is held where a lens without distortion has it.

        Raises
        ------
        DataError, EstimationError
            Where the radial alignment constraint determines no camera.
        """
        key = repr((lens, sorted((fix or {}).items())))
        if key not in self._begins:
            self._begins[key] = self._begin(lens, fix)
        return self._begins[key]

    def _begin(self, lens: Lens, fix: Mapping[str, float | None] | None) -> list[Begin]:
        assert self.stage.camera is not None and self.stage.poses is not None
        camera = regressed(lens, self.stage.camera, self.correspondences, fix)
        if _holds(camera, self.stage.poses, self.correspondences):
            return [Begin(camera, self.stage.poses, self.stage)]
        general, poses = self.general
        camera = regressed(lens, general, self.correspondences, fix)
        limit = lens.limit_angle(camera.params)
        tried = [
            poses,
            *(_pushed(poses, self.correspondences, min(part * limit, top)) for part, top in CONES),
        ]
        held = [p for p in tried if _holds(camera, p, self.correspondences)]
        return [Begin(camera, p, self.stage) for p in held]


def _pushed(poses: Poses, correspondences: Correspondences, angle: float) -> Poses:
    """The poses, moved away along the axis until no point is farther from it than an angle, rad."""
    moved = poses.translations.copy()
    for view, r, t in zip(correspondences.views, poses.rotations, moved, strict=True):
        x, y, z = (view.xyz @ r.T + t).T
        t[2] += max(float((np.hypot(x, y) / np.tan(angle) - z).max()), 0.0)
    return Poses(poses.rotations, moved)


def regressed(
    lens: Lens,
    camera: Camera,
    correspondences: Correspondences,
    fix: Mapping[str, float | None] | None = None,
) -> Camera:
    """The camera of a model that is nearest to another camera at the observed pixels."""
    uv = np.concatenate([v.uv for v in correspondences.views])
    rays = camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    size = correspondences.image_size
    params = regress(lens, rays[seen], uv[seen], size).params
    named = [n for n in fix or {} if n != ASPECT]
    if fix:
        plain = lens.from_matrix(lens.matrix(params))
        for name in named:
            params[lens.index(name)] = plain[lens.index(name)]
        params = apply_fixed(lens, params, fix)
        held = (*lens.default_fixed, *named)
        params = regress(lens, rays[seen], uv[seen], size, hold=held, start=params).params
        params = apply_fixed(lens, params, fix)
    return Camera(lens, params, size)


def _holds(camera: Camera, poses: Poses, correspondences: Correspondences) -> bool:
    """Whether all points project; without it a refinement cannot begin."""
    return bool(np.isfinite(np.concatenate(residuals(camera, poses, correspondences))).all())


def adopted(lens: Lens, inner: Solution, fix: Mapping[str, float | None]) -> tuple[Camera, Poses]:
    """The solution of a model that `lens` contains, as a start."""
    held = embed(lens, inner.camera.lens, inner.camera.params)
    assert held is not None, f"{lens} does not contain {inner.camera.lens}"
    params = apply_fixed(lens, held, fix)
    return Camera(lens, params, inner.camera.image_size), inner.poses


def twins(solution: Solution) -> list[Camera]:
    """Cameras of the model that fit the solution's rays nearly as well, and may fit the points better."""
    lens, camera = solution.camera.lens, solution.camera
    pairs = zip(solution.correspondences.views, solution.inliers, strict=True)
    uv = np.concatenate([v.uv[m] for v, m in pairs])
    rays = camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    fixed = ~np.any(solution.free, axis=1)
    held = [n for n, hold in zip(lens.names, fixed, strict=True) if hold]
    found = minima(lens, rays[seen], uv[seen], camera.image_size, held)
    return [Camera(lens, p, camera.image_size) for p in found]


def best(solutions: Sequence[Solution]) -> Solution:
    """The solution with the lowest cost; a converged one where costs are equal to rounding."""
    lowest = min(solutions, key=lambda s: s.fit.cost)
    equal = [s for s in solutions if s.fit.cost <= lowest.fit.cost * (1 + 1e-12)]
    return next((s for s in equal if s.fit.converged), lowest)


def has(lens: Lens, name: str) -> bool:
    """Whether `--fix NAME` means something to a lens."""
    return name == ASPECT or name in lens.names
