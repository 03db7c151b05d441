"""Observations in one flat table: the pixel of each target point in each view of each camera.

A row is one point in one picture. Rows are sorted by camera, then by view, so that the points of a picture are a
run of rows (a block). One camera is the case of one camera: its blocks are its views.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from camcal.data.shape import Shapes, shapes, shapes_of
from camcal.data.views import NO_ID, Blocks, SkippedView, View, check_views, named_view, stacked
from camcal.geometry.numbers import median
from camcal.records import dataclass

Array = np.ndarray

#: why a row takes no part, by its code in `Observations.reason`
REASONS = ("", "outlier", "outside the domain of the lens")
KEPT, OUTLIER, OUTSIDE = range(len(REASONS))


@dataclass(frozen=True, eq=False)
class Observations:
    """A flat table of image points with their attributes.

    Attributes
    ----------
    xyz : (N, 3) array
        Points in the frame of the board or the world, unit of the data.
    uv : (N, 2) array
        Their images, px; (0, 0) is the centre of the top-left pixel.
    view : (N,) int array
        Index into `view_ids`; a view is an instant, the same for all cameras.
    view_ids : tuple of str
    camera : (N,) int array
        Index into `cameras`; rows are sorted by camera, then view.
    cameras : tuple of str
    point : (N,) int array or None
        Which point of the target a row is, `NO_ID` where that is not known.
    sigma : (N,) array or None
        Standard deviation in each coordinate, px; NaN where none was given.
    set_aside : (N,) array or None
        The sigmas that `unweighted` took away, px: no weight in an estimate, but known to the outlier test.
    weight : (N,) array or None
        Of a robust loss, 0 to 1; None = 1.
    used : (N,) bool array
        Whether the row takes part in an estimate.
    reason : (N,) uint8 array
        Why not: an index into `REASONS`.
    image_sizes : tuple of (width, height) or None
        Of each camera.
    target : mapping or None
        What the report says under `target`: kind, columns, rows, square, unit, detected.
    skipped : tuple of SkippedView
        Pictures without points and views that were left out, in the order they were met.
    files : tuple of mappings
        `{path, sha256}` of each input file.
    picture_quality : mapping of view id -> mapping
        Figures on each picture (sharpness, exposure, ...), where pictures were read.
    pictures : mapping of (camera, view id) -> str
        Of a rig, what a picture is called where that is not the id of its instant.
    """

    xyz: Array
    uv: Array
    view: Array
    view_ids: tuple[str, ...]
    camera: Array
    cameras: tuple[str, ...] = ("camera",)
    point: Array | None = None
    sigma: Array | None = None
    set_aside: Array | None = None
    weight: Array | None = None
    used: Array = field(default_factory=lambda: np.zeros(0, bool))  #: all rows by default
    reason: Array = field(default_factory=lambda: np.zeros(0, np.uint8))
    image_sizes: tuple[tuple[int, int] | None, ...] = (None,)
    target: Mapping[str, Any] | None = None
    skipped: tuple[SkippedView, ...] = ()
    files: tuple[Mapping[str, str], ...] = ()
    picture_quality: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    pictures: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.xyz)
        if len(self.used) != count:
            object.__setattr__(self, "used", np.ones(count, bool))
        if len(self.reason) != count:
            object.__setattr__(self, "reason", np.zeros(count, np.uint8))

    @classmethod
    def from_views(
        cls, views: Sequence[Any], image_size: tuple[int, int] | None = None, **more: Any
    ) -> Observations:
        """Make the observations of one camera.

        Parameters
        ----------
        views : sequence
            `(xyz, uv)` or `(xyz, uv, sigma)` of each view, or `View` objects. xyz is (N, 3), or (N, 2) for points
            of the plane z = 0; uv is (N, 2); sigma (N,) is in px. The (N, 1, k) arrays of cv2 are taken, too.
        image_size : (width, height), optional
        **more
            Other attributes: target, skipped, files, picture_quality.

        Raises
        ------
        DataError
            If shapes do not match or a value is not finite.
        """
        made = [v if isinstance(v, View) else named_view(f"view{i + 1}", v) for i, v in enumerate(views)]
        check_views(made)
        size = None if image_size is None else (int(image_size[0]), int(image_size[1]))
        return cls(**stacked(made), image_sizes=(size,), **more)

    # ------------------------------------------------------------------------------------------ what it holds
    def __len__(self) -> int:
        return len(self.view_ids)

    def __repr__(self) -> str:
        names = "" if len(self.cameras) == 1 else f"{len(self.cameras)} cameras, "
        return f"<Observations: {names}{len(self.view_ids)} views, {self.point_count} points>"

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) of the first camera's pictures; None if unknown."""
        return self.image_sizes[0]

    @property
    def point_count(self) -> int:
        """Number of rows."""
        return len(self.xyz)

    @property
    def usual_board_shape(self) -> str:
        """`auto` for points of a printed target, whose shape may differ from the design; otherwise `flat`."""
        return "auto" if self.is_printed else "flat"

    @property
    def is_printed(self) -> bool:
        """Whether the points belong to a printed target: found in pictures, or declared so by their table."""
        return self.target is not None and ("kind" in self.target or bool(self.target.get("printed")))

    @cached_property
    def blocks(self) -> Blocks:
        """The runs of rows of one picture each; for one camera, those of every view, including empty ones."""
        count = len(self.view_ids)
        if len(self.cameras) == 1:
            starts = np.searchsorted(self.view, np.arange(count + 1))
            return Blocks(np.zeros(count, int), np.arange(count), starts)
        keys, starts = np.unique(self.camera * count + self.view, return_index=True)
        return Blocks(keys // count, keys % count, np.r_[starts, len(self.view)])

    @cached_property
    def views(self) -> tuple[View, ...]:
        """The blocks as `View` objects, which share the table's memory."""
        return tuple(
            View(self.view_ids[v], self.xyz[rows], self.uv[rows], _known(self.sigma, rows), self._ids(rows))
            for v, rows in zip(self.blocks.view, self.slices, strict=True)
        )

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The rows of each block."""
        starts = self.blocks.starts.tolist()
        return tuple(slice(a, b) for a, b in pairwise(starts))

    def picture(self, block: int) -> str:
        """The name of the picture of a block: the view's id unless it has its own name."""
        view, camera = self.view_ids[self.blocks.view[block]], self.cameras[self.blocks.camera[block]]
        return self.pictures.get((camera, view), view)

    def split(self, values: Array) -> list[Array]:
        """Split an array with one row per row of the table into blocks."""
        return [values[rows] for rows in self.slices]

    @cached_property
    def block_of_row(self) -> Array:
        """The block (N,) of each row."""
        return np.repeat(np.arange(len(self.blocks)), self.blocks.counts)

    def per_block(self, values: Array) -> Array:
        """Sums (B,) of a number (N,) per row over each block."""
        return np.bincount(self.block_of_row, values, len(self.blocks))

    @cached_property
    def shapes(self) -> Shapes:
        """Plane and extent of the points of each block."""
        return shapes(self.views)

    @staticmethod
    def fit_shapes(sets: Sequence[Observations]) -> None:
        """Determine the `shapes` of many at once, in less time."""
        for one, found in zip(sets, shapes_of([s.views for s in sets]), strict=True):
            vars(one)["shapes"] = found  # where the property keeps it

    @property
    def precision(self) -> Array | None:
        """The weight of each row's squared residual (N,): weight / sigma², 1 if neither is given; None if all are 1.

        The only place that forms it.
        """
        if self.sigma is None:
            return self.weight
        given = np.where(np.isnan(self.sigma), 1.0, self.sigma) ** -2.0
        return given if self.weight is None else given * self.weight

    @property
    def precision_by_view(self) -> list[Array] | None:
        """`precision`, an array (N,) for each block; None if all are 1."""
        return None if self.precision is None else self.split(self.precision)

    def standardised(self, residuals: Array) -> Array:
        """Lengths (N,) of residuals (N, 2) in units of sigma (px if none is given); inf for non-finite ones."""
        lengths = np.sqrt(np.einsum("ij,ij->i", residuals, residuals))
        lengths = np.where(np.isfinite(lengths), lengths, np.inf)
        return lengths if self.sigma is None else lengths / np.where(np.isnan(self.sigma), 1.0, self.sigma)

    def allowance(self) -> Array:
        """The sigma of each row (N,) relative to the median sigma, at least 1.

        From the sigmas that `unweighted` took away; 1 where there are none.
        """
        if self.set_aside is None or np.isnan(self.set_aside).all():
            return np.ones(len(self.uv))
        return np.fmax(self.set_aside / median(self.set_aside[~np.isnan(self.set_aside)]), 1.0)

    def _ids(self, rows: slice) -> Array | None:
        ids = None if self.point is None else self.point[rows]
        return None if ids is None or (ids[:1] == NO_ID).any() else ids

    # ------------------------------------------------------------------------------------- parts of it, changed
    def where(self, rows: Array) -> Observations:
        """Keep only the rows of a mask (N,); every view stays, even without points."""
        if rows.all():
            return self
        return self._rows(rows, self.view_ids)

    def kept(self) -> Observations:
        """Keep only the used rows."""
        return self.where(self.used)

    def of_views(self, index: Array | Sequence[int]) -> Observations:
        """Keep only some views, in the order of `index` (K,)."""
        index = np.asarray(index, int)
        if np.array_equal(index, np.arange(len(self.view_ids))):
            return self
        place = np.full(len(self.view_ids), -1)
        place[index] = np.arange(len(index))
        moved = place[self.view]
        rows = np.flatnonzero(moved >= 0)
        rows = rows[np.lexsort((moved[rows], self.camera[rows]))]
        return replace(self._rows(rows, tuple(self.view_ids[i] for i in index)), view=moved[rows])

    def without(self, left_out: Mapping[int, str]) -> Observations:
        """Remove the blocks of these indices; they become `skipped` as rejected, with the given reasons.

        One camera's blocks are its views. An instant goes where no camera has a picture of it left.
        """
        if not left_out:
            return self
        alone = len(self.cameras) == 1
        said = tuple(
            SkippedView(
                self.picture(i),
                "rejected",
                left_out[i],
                int(self.blocks.counts[i]),
                camera=None if alone else self.cameras[self.blocks.camera[i]],
            )
            for i in sorted(left_out)
        )
        rest = self.where(~np.isin(self.block_of_row, list(left_out))).of_views(self.views_left(left_out))
        return replace(rest, skipped=(*self.skipped, *said))

    def views_left(self, left_out: Collection[int]) -> Array:
        """The indices of the views that remain without these blocks: those with another block, or with none
        before.
        """
        touched = np.isin(np.arange(len(self.view_ids)), self.blocks.view[list(left_out)])
        shown = np.isin(np.arange(len(self.view_ids)), np.delete(self.blocks.view, list(left_out)))
        return np.flatnonzero(~touched | shown)

    def with_used(self, used: Array, reason: int = OUTLIER) -> Observations:
        """Replace the mask of used rows (N,); unused ones get the reason."""
        return replace(self, used=used, reason=np.where(used, KEPT, reason).astype(np.uint8))

    def with_views(self, views: Sequence[View]) -> Observations:
        """Replace all rows by the rows of these views; whole views may be missing. One camera only."""
        nothing = np.zeros(0)
        return replace(self, weight=None, used=nothing, reason=nothing, **stacked(views))

    def map_views(self, change: Callable[[View], View]) -> Observations:
        """Replace each view by a function of it that keeps its number of points; the used rows stay the same."""
        return replace(self.with_views([change(v) for v in self.views]), used=self.used, reason=self.reason)

    def unweighted(self) -> Observations:
        """Remove weights and sigmas."""
        if self.sigma is None and self.weight is None:
            return self
        aside = self.set_aside if self.sigma is None else self.sigma
        return replace(self, sigma=None, set_aside=aside, weight=None)

    def _rows(self, rows: Array, view_ids: tuple[str, ...]) -> Observations:
        def pick(a: Array | None) -> Any:
            return None if a is None else a[rows]

        return replace(
            self,
            xyz=self.xyz[rows],
            uv=self.uv[rows],
            view=self.view[rows],
            view_ids=view_ids,
            camera=self.camera[rows],
            point=pick(self.point),
            sigma=pick(self.sigma),
            set_aside=pick(self.set_aside),
            weight=pick(self.weight),
            used=self.used[rows],
            reason=self.reason[rows],
        )


#: the name under which users know the observations of one camera
Correspondences = Observations


def _known(values: Array | None, rows: slice) -> Array | None:
    """Part of a column; None if it holds no values."""
    if values is None or np.isnan(values[rows]).all():
        return None
    return values[rows]
