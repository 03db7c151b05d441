"""The poses of a robot's hand, from a table: by view, or as a stream with times."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.columns import plain
from camcal.data.labelled import header, read_labelled
from camcal.data.rotation_forms import FORMS, Form, form_of
from camcal.errors import DataError, UsageError
from camcal.geometry import rotations as so3
from camcal.model.pose import Poses
from camcal.records import dataclass

Array = np.ndarray

#: columns of a rotation -> what they mean where nothing else is said: names as plain text, in the order of the numbers
COLUMNS: dict[tuple[str, ...], str] = {
    ("rx", "ry", "rz"): "vector",
    ("qw", "qx", "qy", "qz"): "quaternion-wxyz",
    ("q0", "q1", "q2", "q3"): "quaternion-wxyz",
    ("q1", "q2", "q3", "q4"): "quaternion-wxyz",
    ("a", "b", "c"): "zyx-deg",
    ("w", "p", "r"): "fixed-xyz-deg",
    ("yaw", "pitch", "roll"): "zyx-deg",
    ("o", "a", "t"): "zyz-deg",
}
#: names that say which number is which: no other form of a quaternion is tried
_SAID = ("qw", "qx", "qy", "qz")
PLACES = (("x", "y", "z"), ("tx", "ty", "tz"), ("px", "py", "pz"))
VIEWS = ("view", "image", "img", "frame", "file", "picture", "name")
TIMES = ("time", "stamp", "timestamp", "t")
#: squared lengths of quaternions that are rounded to three digits stay within this of 1
UNIT_QUATERNION = 0.01


@dataclass(frozen=True)
class RobotPoses:
    """Poses base_from_hand as stored in a file, before the rotation is interpreted.

    Attributes
    ----------
    path : str
    names : tuple of str, or None
        Of the views.
    times : (N,) array, or None
        s.
    places : (N, 3) array
    numbers : (N, 3 or 4) array
        Of the rotation.
    form : Form
        What the names of the columns say.
    certain : bool
        Whether they leave no doubt.
    """

    path: str
    names: tuple[str, ...] | None
    times: Array | None
    places: Array
    numbers: Array
    form: Form
    certain: bool

    def __len__(self) -> int:
        return len(self.places)

    def poses(self, form: Form | None = None, inverse: bool = False) -> Poses:
        """base_from_hand (N,), with the rotation read in a given form; `inverse` if the file holds hand_from_base."""
        found = Poses((form or self.form).rotations(self.numbers), self.places)
        turned: Any = found.inverse() if inverse else found
        return turned

    def take(self, rows: Sequence[int] | Array) -> RobotPoses:
        """Select some of the poses by their indices."""
        at = np.asarray(rows, int)
        names = None if self.names is None else tuple(self.names[i] for i in at)
        times = None if self.times is None else self.times[at]
        return replace(self, names=names, times=times, places=self.places[at], numbers=self.numbers[at])

    def scaled(self, factor: float) -> RobotPoses:
        """Return the same poses in another unit of length."""
        return replace(self, places=self.places * factor)


def read_robot_poses(path: str | os.PathLike, form: str | None = None) -> RobotPoses:
    """Read a table of robot poses.

    Parameters
    ----------
    path : path
        With a header: `view` (or `time`), `x,y,z`, and a rotation: `rx,ry,rz`, `qx,qy,qz,qw`, `q1,q2,q3,q4` (ABB),
        `a,b,c` (KUKA), `w,p,r` (Fanuc), `yaw,pitch,roll` or `o,a,t` (Kawasaki).
    form : str, optional
        The form of the rotation, of `FORMS`; without it the names of the columns say it.

    Raises
    ------
    DataError
        If a column is missing, a view occurs twice, a quaternion has not the length 1, or times do not increase.
    UsageError
        If the requested form takes another number of values.
    """
    columns = {plain(name): name for name in header(path)}
    places, rotation = _find(columns, PLACES, path, "x,y,z"), _find(columns, tuple(COLUMNS), path, "rx,ry,rz")
    view = next((columns[n] for n in VIEWS if n in columns), None)
    time = next((columns[n] for n in TIMES if n in columns and n not in rotation), None)
    if view is None and time is None:
        raise DataError(
            f"'{path}' has no column view and no column time.", "Give the view of each pose, or its time."
        )
    numbers = [columns[n] for n in (*places, *rotation)] + ([time] if time else [])
    table = read_labelled(path, [] if view is None else [view], numbers)
    values: Mapping[str, Array] = table.values
    names = None if view is None else tuple(table.names[view][i] for i in table.labels[view])
    made = RobotPoses(
        str(path),
        names,
        None if time is None else values[time],
        np.stack([values[columns[n]] for n in places], 1),
        np.stack([values[columns[n]] for n in rotation], 1),
        FORMS[COLUMNS[rotation]],
        form is not None or rotation == _SAID,
    )
    _check(made, table.rows)
    return made if form is None else _in_form(made, form_of(form))


def _in_form(made: RobotPoses, form: Form) -> RobotPoses:
    if form.count != made.numbers.shape[1]:
        raise UsageError(
            f"'{made.path}' has {made.numbers.shape[1]} numbers for a rotation; '{form.name}' takes {form.count}.",
            "Choose another --rotation, or leave it out.",
        )
    return replace(made, form=form)


def _find(
    columns: Mapping[str, str], known: Sequence[tuple[str, ...]], path: str | os.PathLike, needed: str
) -> tuple[str, ...]:
    for names in known:
        if all(n in columns for n in names):
            return names
    listed = "; ".join(",".join(n) for n in known)
    raise DataError(
        f"the header of '{path}' ({', '.join(columns)}) has no columns {needed}.", f"It may have: {listed}."
    )


def _check(made: RobotPoses, rows: Array) -> None:
    """Reject values that cannot be poses."""
    if made.names is not None:
        seen: dict[str, int] = {}
        for name, row in zip(made.names, rows.tolist(), strict=True):
            if name in seen:
                raise DataError(
                    f"{made.path}:{row}: the view '{name}' has a pose already, in line {seen[name]}.",
                    "Leave one of them out.",
                )
            seen[name] = row
    if made.names is None and made.times is not None and not (np.diff(made.times) > 0).all():
        at = int(np.flatnonzero(np.diff(made.times) <= 0)[0]) + 1
        raise DataError(
            f"{made.path}:{rows[at]}: its time {made.times[at]:g} is not after the one before.",
            "Sort by time.",
        )
    if made.form.kind == "quaternion":
        off = np.abs(np.square(made.numbers).sum(1) - 1)
        if off.max(initial=0) > UNIT_QUATERNION:
            at = int(off.argmax())
            raise DataError(
                f"{made.path}:{rows[at]}: a quaternion of length {np.linalg.norm(made.numbers[at]):.4g}; 1 is needed.",
                "Check which columns hold the rotation.",
            )


def matched(poses: RobotPoses, views: Sequence[str]) -> tuple[list[int], list[int]]:
    """The pose of each view: by name, otherwise by file name, otherwise by file name without extension.

    Returns
    -------
    rows, places : lists of int
        Indices into the poses and the views.
    """
    assert poses.names is not None
    for key in (str, _file, _stem):
        by_key: dict[str, list[int]] = {}
        for row, name in enumerate(poses.names):
            by_key.setdefault(key(name), []).append(row)
        keys = [key(v) for v in views]
        if any(len(r) > 1 for r in by_key.values()) or len(set(keys)) < len(keys):
            continue
        found = [(by_key[k][0], place) for place, k in enumerate(keys) if k in by_key]
        if found:
            return [row for row, _ in found], [place for _, place in found]
    return [], []


def _file(name: str) -> str:
    return name.replace("\\", "/").rpartition("/")[2]


def _stem(name: str) -> str:
    return Path(_file(name)).stem


@dataclass(frozen=True)
class Stream:
    """Poses with times, interpolated with constant velocity and constant angular velocity.

    Attributes
    ----------
    times : (N,) array, s
    poses : Poses
        base_from_hand (N,).
    """

    times: Array
    poses: Poses

    def at(self, times: Array) -> tuple[Poses, Array]:
        """Poses (V,) at times, and velocities (V, 6): angular in the base's frame, rad/s, and linear.

        Before the first time and after the last the hand goes on as in the interval next to it.
        """
        i = np.clip(np.searchsorted(self.times, times) - 1, 0, len(self.times) - 2)
        span = self.times[i + 1] - self.times[i]
        part = (times - self.times[i]) / span
        r, t = self.poses.rotation, self.poses.translation
        turn = so3.log(r[i + 1] @ np.swapaxes(r[i], 1, 2))
        shift = t[i + 1] - t[i]
        moved = Poses(so3.exp(part[:, None] * turn) @ r[i], t[i] + part[:, None] * shift)
        return moved, np.concatenate([turn, shift], 1) / span[:, None]

    def covers(self, times: Array) -> Array:
        """Return which times (V,) lie within the stream."""
        return (times >= self.times[0]) & (times <= self.times[-1])
