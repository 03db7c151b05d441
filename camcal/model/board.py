"""A calibration object: points with ids and known coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.errors import DataError
from camcal.records import dataclass

Array = np.ndarray

#: largest distance of points from their plane, as a part of their extent, for the board to count as planar:
#: rounding of coordinates given with six digits; the sheet metal of a real board is bent by a hundred times that
PLANAR = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class Board:
    """Points of a calibration object in its own frame.

    Attributes
    ----------
    points : (N, 3) array
        Coordinates, in `unit`. A planar board that camcal finds itself has z = 0.
    ids : (N,) int array, optional
        The ids of the points, by default 0 to N - 1.
    unit : str
        `square` where no length is known.

    Raises
    ------
    DataError
        If there are no points, coordinates are not finite, or ids are repeated.
    """

    points: Array
    ids: Array | None = None
    unit: str = "square"

    def __post_init__(self) -> None:
        points = np.array(self.points, float)
        if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
            raise DataError(f"a board needs points of shape (N, 3), not {points.shape}.")
        if points.shape[1] == 2:
            points = np.c_[points, np.zeros(len(points))]
        if not np.isfinite(points).all():
            row = int(np.flatnonzero(~np.isfinite(points).all(1))[0])
            raise DataError(f"point {row} of the board has a coordinate that is not finite.")
        ids = np.arange(len(points)) if self.ids is None else np.array(self.ids)
        if ids.shape != (len(points),) or not np.issubdtype(ids.dtype, np.integer):
            raise DataError(f"a board of {len(points)} points needs as many integer ids.")
        values, counts = np.unique(ids, return_counts=True)
        if (counts > 1).any():
            raise DataError(f"the board has {counts.max()} points with the id {values[counts.argmax()]}.")
        points.setflags(write=False)
        ids.setflags(write=False)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "ids", ids)

    @classmethod
    def grid(cls, columns: int, rows: int, spacing: float = 1.0, unit: str = "square") -> Board:
        """Points on the plane z = 0, numbered along x first: id = row * columns + column."""
        x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
        return cls(spacing * np.c_[x.ravel(), y.ravel()], unit=unit)

    def __len__(self) -> int:
        return len(self.points)

    def of(self, ids: Sequence[int] | Array) -> Array:
        """The coordinates (M, 3) of points by their ids (M,); DataError for an id that is not on the board."""
        own = np.asarray(self.ids)
        order = np.argsort(own)
        at = np.clip(np.searchsorted(own, ids, sorter=order), 0, len(own) - 1)
        rows = order[at]
        if (missing := own[rows] != np.asarray(ids)).any():
            raise DataError(f"the board has no point with the id {np.asarray(ids)[missing][0]}.")
        return np.asarray(self.points[rows])

    @property
    def extent(self) -> float:
        """The diagonal of the bounding box, in `unit`."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def planar(self) -> bool:
        """Whether all points lie in one plane, within `PLANAR` of the extent."""
        centred = self.points - self.points.mean(0)
        normal = np.linalg.svd(centred, full_matrices=len(self) < 3)[2][-1]
        return bool(np.abs(centred @ normal).max() <= PLANAR * self.extent)

    def __repr__(self) -> str:
        """Return one line: the number of points and the extent."""
        kind = "planar" if self.planar else "3D"
        return f"<Board of {len(self)} points, {kind}, {self.extent:.5g} {self.unit} across>"
