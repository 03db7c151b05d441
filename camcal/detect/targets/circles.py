"""Grids of black discs, in rows (`circles:10x8:2.5mm`) or staggered (`asymmetric-circles:4x11:20mm`).

`circles` has COLUMNSxROWS discs at the given distance. `asymmetric-circles` is OpenCV's grid: ROWS rows of
COLUMNS discs, with every second row shifted by half a column; the given length is the distance between rows, half
of that between neighbours in a row. A further length is the diameter; if it is omitted, it is measured in the
pictures.

The points are the images of the discs' centres. The image of a disc is not centred on this point; `apparent_shift`
computes the difference, given a camera and a pose.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from camcal.detect.board_points import LOCAL_POINTS, from_points, strays
from camcal.detect.disc_fit import fit_discs
from camcal.detect.disc_grid import Grid, find_board
from camcal.detect.discs import Discs, find_discs
from camcal.detect.evenness import unevenly_dark
from camcal.detect.fit import ROUNDING
from camcal.detect.pyramid import grey_span, noise, reduced, reductions, to_8_bits
from camcal.detect.targets.base import (
    DEFAULT_SECONDS,
    LEAST_POINTS,
    LEAST_SEEN,
    LEAST_UNASKED,
    Detection,
    Miss,
    Pattern,
    Target,
    clock,
    time_for_next,
)
from camcal.errors import UsageError
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.settings.sizes import parse_grid, parse_length

Array = np.ndarray

STRAY = 0.2  #: of the distance; a disc farther from where its neighbours predict it is another
#: of the contrast; standard deviation around a disc. It is at most 0.14 for four fifths of the discs of all real sets,
#: and at least 0.86 for half of the small squares between tags
PLAIN = 0.35
#: length over width; discs of 3 px radius measure up to 1.2, windows of a house up to 1.4
LONGISH = 1.25
#: of the contrast; residual of the fits beyond the noise of the picture. Discs of real sets have at most 0.08; windows
#: that pass as equally long and wide have 0.14
UNLIKE = 0.12
MOSTLY = 0.6  #: share of the discs; those near the edge of the sheet may have it in their surroundings
CONTOUR = 64  #: points on an outline; its centroid is then that of the disc to 1e-6 of the shift


class Circles(Target):
    """A grid of `columns` x `rows` discs at a distance of `square`."""

    kind = "circles"
    point_kind = "circle"
    staggered = False
    printed_diameter = 0.6  #: of `square`, if none is given

    def __init__(
        self,
        columns: int,
        rows: int,
        square: float = 1.0,
        unit: str = "square",
        diameter: float | None = None,
    ):
        super().__init__(columns, rows, square, unit)
        self.diameter = diameter
        if diameter is not None and not 0 < diameter < self._neighbour_distance:
            raise UsageError(
                f"discs of diameter {diameter:g} at a distance of {self._neighbour_distance:g} touch each other.",
                "The distance comes first, then the diameter.",
            )

    @property
    def _neighbour_distance(self) -> float:
        return self.square * (np.sqrt(2) if self.staggered else 1.0)

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Search for the whole grid; up to a fifth of the discs may be hidden."""
        found, others = search(gray, seconds, self.staggered, (self.columns, self.rows))
        if found is not None:
            return self._fitted(gray, found)
        if others:
            return others[0].instead_of(self.columns, self.rows, "discs", gray.shape)
        return Miss("none", "no grid of discs was found")

    def _fitted(self, gray: Array, found: Grid) -> Detection | Miss:
        scale = grey_span(gray)
        fitted = fit_discs(gray, found.discs, max(1.0, 0.5 * found.factor), scale)
        good, total = fitted.good & ~self._strays(found.ids, fitted.discs.centre), self.columns * self.rows
        order = np.argsort(found.ids)
        order = order[good[order]]
        if len(order) < max(LEAST_POINTS, LEAST_SEEN * total):
            why = max(set(fitted.reasons), key=fitted.reasons.count)
            return Miss(
                "none", f"a grid was found, but only {len(order)} of its {total} discs can be used: {why}"
            )
        missing = np.setdiff1d(np.arange(total), found.ids)
        rejected = {int(i): "not seen" for i in missing}
        named = (r or "not where its neighbours predict" for r in fitted.reasons)
        rejected |= {int(i): r for i, r, kept in zip(found.ids, named, good, strict=True) if not kept}
        radius = np.sqrt(np.abs(np.linalg.det(fitted.discs.shape[order])))
        info: dict[str, Any] = {
            "rejected": rejected,
            "radius_px": float(np.median(radius)),
            "radius": relative_radius(self, found.ids[order], fitted.discs.take(order)),
            "blur_px": float(np.median(fitted.blur[order])),
            "contrast": float(np.median(fitted.contrast[order]) * 255 / scale),
            "noise": float(np.median(fitted.noise[order]) * 255 / scale),
            "covariance": fitted.covariance[order],
        }
        sigma = np.sqrt(0.5 * np.trace(fitted.covariance[order], axis1=1, axis2=2))
        return Detection(found.ids[order], fitted.discs.centre[order], sigma, info)

    def _strays(self, ids: Array, centre: Array) -> Array:
        """Mask of the discs that are not where their neighbours predict them."""
        points = self.points[ids, :2]
        if len(ids) <= LOCAL_POINTS or not np.isfinite(centre).all():
            return ~np.isfinite(centre).all(1)
        return strays(points, centre, STRAY * self.square)

    def apparent_shift(
        self, camera: Camera, cam_from_board: Pose, point_ids: Array, radius: float | None = None
    ) -> Array:
        """The offset of the centroid of each disc's image from the image of its centre, (N, 2) px.

        Subtract it from the result of `find`. The outline is projected point by point and the centroid
        computed by Green's theorem, which is valid for any lens; for a pinhole it agrees with the formula of
        Heikkilä (2000).

        Parameters
        ----------
        camera : Camera
        cam_from_board : Pose
        point_ids : (N,) int array
        radius : float, optional
            Radius of the discs, in `unit`; by default half the `diameter`, if it is known.
        """
        if radius is None:
            radius = 0.5 * (self.diameter or self.printed_diameter * self.square)
        between = 2 * np.pi / CONTOUR
        angle = np.arange(CONTOUR) * between
        # the polygon has the disc's second moment per area, r²/4, to which the shift is proportional
        radius *= np.sqrt(3 / (2 + np.cos(between)))
        ring = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(CONTOUR)], -1)
        centre = self.points[point_ids]
        outline = camera.project(cam_from_board.apply(centre[:, None] + ring))
        middle = camera.project(cam_from_board.apply(centre))
        return centroid(outline - middle[:, None])

    @property
    def points(self) -> Array:
        """The centres (M, 3), row by row."""
        points = super().points
        if self.staggered:
            row = np.repeat(np.arange(self.rows), self.columns)
            points[:, 0] = 2 * points[:, 0] + self.square * (row % 2)
        return points

    def pattern(self) -> Pattern:
        """Black discs, with a margin of one distance around the centres."""
        points, margin = self.points, 1.25 * self.square
        radius = 0.5 * (self.diameter or self.printed_diameter * self.square)
        discs = np.c_[points[:, :2], np.full(len(points), radius)]
        low, high = points[:, :2].min(0) - margin, points[:, :2].max(0) + margin
        return Pattern((), discs, (*low.tolist(), *high.tolist()))

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> Circles:
        """Read `10x8`, `10x8:2.5mm` or `10x8:2.5mm:1.5mm`.

        Raises
        ------
        UsageError
            Where an argument is missing, unknown or does not fit the others.
        """
        if not 1 <= len(arguments) <= 3 or named:
            raise UsageError(
                f"{cls.kind} takes columns and rows, the distance of the discs and their diameter.",
                f"Try: {cls.kind}:10x8:2.5mm:1.5mm",
            )
        columns, rows = parse_grid(arguments[0])
        square, unit = parse_length(arguments[1]) if len(arguments) > 1 else (1.0, "square")
        diameter = None
        if len(arguments) == 3:
            diameter, other = parse_length(arguments[2])
            if unit != other:
                raise UsageError(
                    f"the distance is in {unit} and the diameter in {other}.", "Give both in one unit."
                )
        return cls(columns, rows, square, unit, diameter)

    def _arguments(self) -> list[str]:
        return super()._arguments() + ([self._length(self.diameter)] if self.diameter else [])

    def scaled(self, square: float, unit: str) -> Circles:
        """The same grid with another distance; see `Target.scaled`."""
        made = super().scaled(square, unit)
        assert isinstance(made, Circles)
        made.diameter = None if self.diameter is None else self.diameter * square / self.square
        return made

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        return super().describe() | {"diameter": self.diameter}


class AsymmetricCircles(Circles):
    """OpenCV's asymmetric grid: `rows` rows of `columns` discs; `square` is the distance between rows."""

    kind = "asymmetric-circles"
    staggered = True
    printed_diameter = 0.8


def search(
    gray: Array, seconds: float, staggered: bool | None, size: tuple[int, int] | None
) -> tuple[Grid | None, list[Grid]]:
    """Search for a grid of discs from coarse to fine.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    seconds : float
    staggered : bool or None
        None for either kind.
    size : (columns, rows) or None
        None for any size.

    Returns
    -------
    grid : Grid or None
        In px of the full picture.
    others : list of Grid
        The complete grids that were seen, if none was as requested.
    """
    began, picture = clock(), to_8_bits(gray)
    others: list[Grid] = []
    for factor in reductions(picture.shape):
        start = clock()
        discs = find_discs(reduced(picture, factor)).scaled(factor)
        found, seen = find_board(discs, staggered, size, factor)
        if found is not None:
            return found, others
        others += seen
        if not time_for_next(clock() - start, seconds - (clock() - began)):
            break
    return None, others


def find_any(gray: Array, seconds: float) -> Grid | None:
    """A grid of printed discs, if a picture shows one.

    Windows of a house, meshes, and the small squares between the tags of an AprilTag grid also form rows. Printed
    discs have nothing around them, are as dark as their neighbours, are as long as they are wide in the grid, and
    are fitted well by discs.
    """
    grid, _ = search(gray, seconds, None, None)
    if grid is None or len(grid.ids) < LEAST_UNASKED:
        return None
    target = (AsymmetricCircles if grid.staggered else Circles)(grid.columns, grid.rows)
    plain, contrast = _on_plain_ground(to_8_bits(gray), grid.discs)
    if plain.mean() < MOSTLY or unevenly_dark(contrast, grid.discs.centre):
        return None
    if _elongation(target, grid) > LONGISH:
        return None
    found = target.find(gray, seconds)
    return grid if isinstance(found, Detection) and _like_discs(gray, found) else None


def _like_discs(gray: Array, found: Detection) -> bool:
    """Return whether the residuals of the fits hardly exceed the noise of the picture."""
    everywhere = np.hypot(noise(gray), ROUNDING) * 255 / grey_span(gray)
    more = found.info["noise"] ** 2 - everywhere**2
    return bool(more < (UNLIKE * found.info["contrast"]) ** 2)


def _elongation(target: Circles, grid: Grid) -> float:
    """The median ratio of length to width of the discs on the board, assuming equal spacing in both directions."""
    points = target.points[grid.ids, :2]
    _, jacobian, certain = from_points(points, points, grid.discs.centre)
    if not certain.any():
        return np.inf
    axes = np.linalg.svd(np.linalg.solve(jacobian[certain], grid.discs.shape[certain]), compute_uv=False)
    return float(np.median(axes[:, 0] / axes[:, 1]))


def _on_plain_ground(gray: Array, discs: Discs) -> tuple[Array, Array]:
    """Mask (K,) of the discs with nothing around them half way to the nearest other one, and their contrast (K,)."""
    apart = (discs.centre[:, None] - discs.centre)[..., None]  # from each disc to each other one
    in_radii = np.linalg.norm((np.linalg.inv(discs.shape)[:, None] @ apart)[..., 0], axis=2)
    np.fill_diagonal(in_radii, np.inf)
    half = 0.5 * in_radii.min(1)
    angle = np.arange(CONTOUR) * (2 * np.pi / CONTOUR)
    ring = discs.shape @ np.stack([np.cos(angle), np.sin(angle)])  # (K, 2, CONTOUR)
    at = discs.centre[:, None] + np.stack([0.5 * ring, half[:, None, None] * ring], 1).transpose(1, 0, 3, 2)
    u, v = np.moveaxis(at.astype(np.float32), -1, 0)
    u, v = u.reshape(2 * len(half), -1), v.reshape(2 * len(half), -1)
    values = cv2.remap(gray, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    inside, around = values.reshape(2, len(half), -1)
    contrast = np.abs(np.median(around, 1) - np.median(inside, 1))
    return around.std(1) < PLAIN * contrast, contrast


def centroid(outline: Array) -> Array:
    """Centroids (N, 2) of the areas within closed outlines (N, K, 2), by Green's theorem."""
    x, y = outline[..., 0], outline[..., 1]
    x1, y1 = np.roll(x, -1, 1), np.roll(y, -1, 1)
    cross = x * y1 - x1 * y
    area = 3 * cross.sum(1)
    return np.stack([((x + x1) * cross).sum(1), ((y + y1) * cross).sum(1)], -1) / area[:, None]


def relative_radius(target: Circles, ids: Array, discs: Discs) -> float:
    """The radius of the discs in the target's unit, from their images and the distances between them.

    The parallelogram of neighbouring centres and the ellipse are foreshortened equally, so that the ratio of their
    areas is that on the board.
    """
    grid = np.full((target.rows, target.columns, 2), np.nan)
    area = np.full((target.rows, target.columns), np.nan)
    grid.reshape(-1, 2)[ids] = discs.centre
    area.ravel()[ids] = np.abs(np.linalg.det(discs.shape))
    # a staggered grid repeats after two rows
    down = 2 if target.staggered else 1
    a = (grid[down:-down, 2:] - grid[down:-down, :-2]) / 2
    b = (grid[2 * down :, 1:-1] - grid[: -2 * down, 1:-1]) / (2 * down)
    cell = np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    ratio = area[down:-down, 1:-1] / cell
    per_cell = (2.0 if target.staggered else 1.0) * target.square**2
    known = ratio[np.isfinite(ratio)]
    return float(np.sqrt(np.median(known) * per_cell)) if len(known) else float("nan")
