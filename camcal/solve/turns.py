"""Rotational symmetries of boards, and the renumbering of points by one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.observations import Observations
from camcal.geometry import rotations
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.numbers import distinct, distinct_rows
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray

#: targets that look the same from two sides; those with markers do not
SYMMETRIC = ("checkerboard", "circles", "symmetric-circles", "asymmetric-circles", None)
#: points of a board agree with the rotated board to this fraction of its extent: rounding of printed coordinates
SAME_POINT = 1e-6
#: least points of a board; two or three always look the same after some rotation
LEAST_POINTS = 4


def symmetries(data: Observations) -> tuple[Pose, ...]:
    """The rotations of the board in its plane after which it looks the same, the identity first."""
    return turns_of(distinct(data.xyz, axis=0)) if may_turn(data.target or {}) else (Pose.identity(),)


def may_turn(target: Mapping[str, Any]) -> bool:
    """Return whether a target may be read from several ends, as neither markers nor its first square identify one."""
    kind = target.get("kind")
    odd = (target.get("columns", 0) + target.get("rows", 0)) % 2
    return kind in SYMMETRIC and not (
        kind == "checkerboard" and odd
    )  # its first square is black, the last one white


def turns_of(points: Array) -> tuple[Pose, ...]:
    """The rotations of points (M, 3) in their plane that map them onto themselves, the identity first."""
    nothing = (Pose.identity(),)
    low, high = points.min(0), points.max(0)
    extent = float((high - low).max())
    if len(points) < LEAST_POINTS or high[2] - low[2] > SAME_POINT * extent:
        return nothing
    middle, tree = (low + high) / 2, Neighbours(points)
    found = list(nothing)
    for angle in (np.pi, np.pi / 2, -np.pi / 2):
        turn = rotations.exp(np.array([0.0, 0.0, angle]))
        pose = Pose(turn, middle - turn @ middle)
        if tree.query(pose.apply(points))[0].max() < SAME_POINT * extent:
            found.append(pose)
    return tuple(found)


@dataclass(frozen=True)
class Renaming:
    """The points (M, 3) of a board and their ids, to renumber them after a rotation."""

    points: Array
    ids: Array | None
    tree: Neighbours

    @classmethod
    def of(cls, data: Observations) -> Renaming:
        """Make it from the points that views show."""
        first, _ = distinct_rows(data.xyz)
        points = data.xyz[first]
        return cls(points, None if data.point is None else data.point[first], Neighbours(points))

    def rename(self, columns: tuple[Array, Array | None], rows: slice, turn: Pose) -> None:
        """Renumber the points of some rows."""
        xyz, ids = columns
        which = self.tree.query(turn.apply(xyz[rows]))[1]
        xyz[rows] = self.points[which]
        if ids is not None and self.ids is not None:
            ids[rows] = self.ids[which]
