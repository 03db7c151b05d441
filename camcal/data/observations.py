"""Observations: where the points of a target were seen, in which view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camcal.errors import DataError

Array = np.ndarray


@dataclass(frozen=True)
class View:
    """The correspondences of one picture.

    Attributes
    ----------
    id : str
        What the user calls it: the file's name, or the value of the `view` column.
    xyz : (N, 3) array
        Points in the board's or the world's frame, in the unit of the data.
    uv : (N, 2) array
        Their images, px.
    sigma : (N,) array or None
        Standard deviation of each image point in each coordinate, px.
    point_ids : (N,) int array or None
        Which point of the target each row is; the same number is the same physical point in every view.
    """

    id: str
    xyz: Array
    uv: Array
    sigma: Array | None = None
    point_ids: Array | None = None

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, rows: Array) -> View:
        """Return the view with only `rows` (a mask or indices) of its points."""

        def pick(a: Array | None) -> Array | None:
            return None if a is None else a[rows]

        return View(self.id, self.xyz[rows], self.uv[rows], pick(self.sigma), pick(self.point_ids))


@dataclass(frozen=True)
class SkippedView:
    """A picture or a view that gave no usable points, and why.

    `status` is one of the report's: `not_found`, `unreadable` or `rejected`. `rms_point`, px, is that of its
    points at the pose with which most of them agree, where there are points and a camera.
    """

    id: str
    status: str
    reason: str
    points: int = 0
    rms_point: float | None = None


@dataclass(frozen=True)
class Correspondences:
    """All views of one camera.

    Attributes
    ----------
    views : tuple of View
    image_size : (width, height) or None
    target : mapping or None
        What the report says under `target`: kind, columns, rows, square, unit, detected.
    skipped : tuple of SkippedView
        Pictures without points, in the order they were met.
    files : tuple of mappings
        `{path, sha256}` of each input file.
    picture_quality : mapping of view id -> mapping
        Figures on each picture (sharpness, exposure, ...), where pictures were read.
    """

    views: tuple[View, ...]
    image_size: tuple[int, int] | None = None
    target: Mapping[str, Any] | None = None
    skipped: tuple[SkippedView, ...] = ()
    files: tuple[Mapping[str, str], ...] = ()
    picture_quality: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def from_views(
        cls, views: Sequence[Any], image_size: tuple[int, int] | None = None, **more: Any
    ) -> Correspondences:
        """Make correspondences from `[(xyz (N, 3) or (N, 2), uv (N, 2)), ...]` or from `View` objects.

        Two-column points lie on the plane z = 0.

        Raises
        ------
        DataError
            Where shapes do not match or a value is not finite.
        """
        made = []
        for index, item in enumerate(views):
            if isinstance(item, View):
                made.append(item)
                continue
            xyz, uv = (np.array(a, dtype=float, ndmin=2) for a in item[:2])
            if xyz.shape[1] == 2:
                xyz = np.c_[xyz, np.zeros(len(xyz))]
            sigma = np.asarray(item[2], float) if len(item) > 2 else None
            made.append(View(f"view{index + 1}", xyz, uv, sigma))
        for view in made:
            _check_view(view)
        size = (int(image_size[0]), int(image_size[1])) if image_size is not None else None
        return cls(tuple(made), size, **more)

    def __len__(self) -> int:
        return len(self.views)

    @property
    def point_count(self) -> int:
        """Number of points over all views."""
        return sum(len(v) for v in self.views)


def _check_view(view: View) -> None:
    if view.xyz.ndim != 2 or view.xyz.shape[1] != 3 or view.uv.shape != (len(view.xyz), 2):
        raise DataError(
            f"view '{view.id}' holds points of shape {view.xyz.shape} and {view.uv.shape}; "
            "(N, 3) and (N, 2) are needed."
        )
    if not (np.isfinite(view.xyz).all() and np.isfinite(view.uv).all()):
        raise DataError(f"view '{view.id}' holds a NaN or infinite coordinate.", "Remove that row.")
    if view.sigma is not None and not (np.isfinite(view.sigma) & (view.sigma > 0)).all():
        raise DataError(f"view '{view.id}' holds a sigma that is not positive.", "Sigmas are px, > 0.")
