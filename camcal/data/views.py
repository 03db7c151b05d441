"""Views: the points of single pictures, and the pictures that gave none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.errors import DataError
from camcal.records import dataclass

Array = np.ndarray

#: the number of a point that is not known; any other may be an id
NO_ID = int(np.iinfo(int).min)


@dataclass(frozen=True)
class View:
    """The rows of one picture, for code that works picture by picture.

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

    @property
    def root_weights(self) -> Array:
        """The square roots (N,) of the points' weights: 1 / sigma, or 1."""
        return np.ones(len(self)) if self.sigma is None else 1 / self.sigma

    def take(self, rows: Array) -> View:
        """Return the view with only `rows` (a mask or indices) of its points."""

        def pick(a: Array | None) -> Array | None:
            return None if a is None else a[rows]

        return View(self.id, self.xyz[rows], self.uv[rows], pick(self.sigma), pick(self.point_ids))


@dataclass(frozen=True)
class SkippedView:
    """A picture or a view without usable points, and the reason.

    `status` is one of the report's: `not_found`, `unreadable` or `rejected`. `rms_point`, px, is that of its
    points at the pose with which most of them agree, where there are points and a camera.
    """

    id: str
    status: str
    reason: str
    points: int = 0
    rms_point: float | None = None
    camera: str | None = None  #: which took it, of a rig


@dataclass(frozen=True)
class Blocks:
    """The runs of rows of one picture each.

    Attributes
    ----------
    camera, view : (B,) int arrays
        Which camera and which view a block is of.
    starts : (B + 1,) int array
        Block b is the rows starts[b] to starts[b + 1].
    """

    camera: Array
    view: Array
    starts: Array

    def __len__(self) -> int:
        return len(self.view)

    @property
    def counts(self) -> Array:
        """Number of rows (B,) of each block."""
        return np.diff(self.starts)


def named_view(name: str, item: Sequence[Any]) -> View:
    """A view of (xyz, uv) or (xyz, uv, sigma); planar points may omit Z."""
    xyz, uv = (_as_rows(a) for a in item[:2])
    if xyz.ndim == 2 and xyz.shape[1] == 2:
        xyz = np.c_[xyz, np.zeros(len(xyz))]
    sigma = np.asarray(item[2], float) if len(item) > 2 and item[2] is not None else None
    return View(name, xyz, uv, sigma)


def _as_rows(values: Any) -> Array:
    """Points as rows; cv2 stores them as (N, 1, k)."""
    points = np.array(values, dtype=float, ndmin=2)
    return points[:, 0] if points.ndim == 3 and points.shape[1] == 1 else points


def stacked(views: Sequence[View]) -> dict[str, Any]:
    """The columns of a table with these views' rows."""
    counts = [len(v) for v in views]

    def column(parts: list[Array | None], default: float, kind: type) -> Array | None:
        if all(p is None for p in parts):
            return None
        return np.concatenate(
            [
                np.full(n, default, kind) if p is None else np.asarray(p)
                for p, n in zip(parts, counts, strict=True)
            ]
        )

    return {
        "xyz": np.concatenate([v.xyz for v in views]) if views else np.zeros((0, 3)),
        "uv": np.concatenate([v.uv for v in views]) if views else np.zeros((0, 2)),
        "view": np.repeat(np.arange(len(views)), counts),
        "view_ids": tuple(v.id for v in views),
        "camera": np.zeros(sum(counts), int),
        "point": column([v.point_ids for v in views], NO_ID, int),
        "sigma": column([v.sigma for v in views], np.nan, float),
    }


def check_views(views: Sequence[View]) -> None:
    """Raise a DataError if the points of a view have a wrong shape, or are not finite."""
    for view in views:
        _check_shape(view)
    every = [v.xyz for v in views], [v.uv for v in views]
    if all(np.isfinite(np.concatenate(a)).all() for a in every if a) and all(v.sigma is None for v in views):
        return  # at once, as nearly always
    for view in views:
        _check_finite(view)


def _check_shape(view: View) -> None:
    if view.xyz.ndim != 2 or view.xyz.shape[1] != 3 or view.uv.shape != (len(view.xyz), 2):
        raise DataError(
            f"view '{view.id}' holds points of shape {view.xyz.shape} and {view.uv.shape}; "
            "(N, 3) and (N, 2) are needed."
        )


def _check_finite(view: View) -> None:
    if not (np.isfinite(view.xyz).all() and np.isfinite(view.uv).all()):
        raise DataError(f"view '{view.id}' holds a NaN or infinite coordinate.", "Remove that row.")
    if view.sigma is not None and not (np.isfinite(view.sigma) & (view.sigma > 0)).all():
        raise DataError(
            f"view '{view.id}' holds a sigma that is not positive.", "Sigmas are in px and greater than 0."
        )
