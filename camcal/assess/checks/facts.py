"""Quantities shared by several checks, computed once and on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from camcal.assess.causes import Found
from camcal.assess.covariance import Covariance
from camcal.assess.curvature import accuracy
from camcal.assess.design import Design
from camcal.assess.difference import grid_of
from camcal.assess.free_board import Promise, promise
from camcal.data.observations import Observations
from camcal.data.shape import Shapes
from camcal.model.pose import Array
from camcal.solve.calibration import Calibration

T = TypeVar("T")

#: targets that identify their points
CODED = ("charuco", "aprilgrid", "tags", "markers")


class Facts:
    """A solution with the quantities that the checks derive from it."""

    def __init__(
        self,
        solution: Calibration,
        holdout: Mapping[str, Any] | None = None,
        found: Found | None = None,
        design: Design | None = None,
    ):
        self.solution, self.holdout, self.found, self._design = solution, holdout, found, design
        self.camera = solution.camera
        self.views = solution.observations.views
        self.image_size = solution.camera.image_size or solution.observations.image_size
        self._known: dict[Callable[[Facts], Any], Any] = {}

    def once(self, quantity: Callable[[Facts], T]) -> T:
        """A quantity that several checks need, computed for the first of them."""
        if quantity not in self._known:
            self._known[quantity] = quantity(self)
        return self._known[quantity]  # type: ignore[no-any-return]

    @cached_property
    def covariance(self) -> Covariance:
        """The covariance of parameters and poses, infinite for invalid sigmas."""
        return accuracy(self.solution)

    @cached_property
    def design(self) -> Design | None:
        """The linearised problem; None if a used point lies outside the lens's domain or nothing was estimated."""
        design = self._design or Design(self.solution)
        if not design.transform.shape[1]:
            return None
        try:
            _ = design.products
        except ValueError:
            return None
        return design

    @cached_property
    def free_board(self) -> Promise | None:
        """The gain predicted for a board of free shape; None if the data do not permit one."""
        return promise(self.solution)

    @cached_property
    def shapes(self) -> Shapes:
        """The plane of each view's points."""
        return self.solution.observations.shapes

    @cached_property
    def planar(self) -> bool:
        """Whether every view shows a plane."""
        return bool(len(self.views)) and bool(self.shapes.planar.all())

    @cached_property
    def blameless(self) -> bool:
        """Whether it is excluded that single views are mirrored or show another board.

        Either a common cause explains the views, or the points are identified by printed codes.
        """
        data = self.solution.observations
        return (self.found is not None and self.found.common) or identified(data)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """The names of the estimated parameters of the camera."""
        rows = np.any(self.solution.free, axis=1)
        return tuple(n for n, free in zip(self.camera.lens.names, rows, strict=True) if free)

    def groups(self, *wanted: str) -> list[str]:
        """The names of the estimated parameters of these groups (focal, principal, skew, distortion)."""
        group = {p.name: p.group for p in self.camera.lens.parameters}
        return [n for n in self.free_names if group[n] in wanted]

    @cached_property
    def image_points(self) -> Array:
        """All used image points (M, 2), px."""
        return self.solution.observations.uv[self.solution.used]

    @cached_property
    def low_high(self) -> tuple[Array, Array]:
        """The corners (2,) of the image, or of the bounding box of the points if its size is not known."""
        if self.image_size is not None:
            return np.zeros(2), np.subtract(self.image_size, 1.0)
        return self.image_points.min(0), self.image_points.max(0)

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of the image, px."""
        low, high = self.low_high
        return float(np.linalg.norm(high - low))

    @cached_property
    def unseen(self) -> Array | None:
        """Pixels (K, 2) of a grid over the image for which the lens has no ray; None without an image size."""
        if self.image_size is None:
            return None
        grid = grid_of(self.image_size)
        return grid[~self.camera.lens.unproject(self.camera.params, grid)[1]]


def identified(data: Observations) -> bool:
    """Whether points are identified by printed codes; a mirrored or foreign code would not have been read.

    If the kind of target is unknown, this is inferred from views that show different subsets of the ids.
    """
    kind = (data.target or {}).get("kind")
    if kind is not None:
        return kind in CODED
    ids = [v.point_ids for v in data.views]
    if any(i is None for i in ids):
        return False
    return len({tuple(np.sort(i)) for i in ids if i is not None}) > 1
