"""Several boards in one set of observations: the board of each row, and which boards are rigidly connected.

The target of such observations has

    boards         what each board is called: its spec, or its name in the table
    first_ids      the smallest number of a point of each; the ids of a board follow one another
    board_groups   of a rig, which boards are fixed to each other: the number of each one's group. The first board
                   of a group holds its frame
    board_poses    group_from_board of each: {rotation_vector, translation}

A point's coordinates are those of its board until the boards are placed (`camcal.plan.rig_boards`), then those of its
group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.data.observations import Observations
from camcal.model.pose import Pose

Array = np.ndarray


def names_of(target: Mapping[str, Any] | None) -> tuple[str, ...]:
    """The names of the boards within view names: as in the table; those of pictures are numbered from 1."""
    target = target or {}
    boards = target.get("boards") or ()
    if "kind" in target:  # specs of boards in pictures
        return tuple(str(k + 1) for k in range(len(boards)))
    return tuple(boards)


def labels(data: Observations) -> Array | None:
    """The board (N,) of each row, an index into the target's `boards`; None if there is only one board."""
    first = (data.target or {}).get("first_ids") or ()
    if len(first) < 2 or data.point is None:
        return None
    return board_of_ids(data.target or {}, data.point)


def board_of_ids(target: Mapping[str, Any], ids: Array) -> Array:
    """The board (N,) of each of the point ids (N,)."""
    return np.searchsorted(np.asarray(target["first_ids"]), ids, "right") - 1


def parts(data: Observations) -> Array | None:
    """The estimated board (N,) of each row, counted from 0; -1 for boards that define a frame.

    None where no board is placed.
    """
    groups, which = (data.target or {}).get("board_groups"), labels(data)
    if groups is None or which is None:
        return None
    placed = movable(data.target or {})
    if not placed:
        return None
    number = np.full(len(groups), -1)
    number[placed] = np.arange(len(placed))
    return number[which]


def movable(target: Mapping[str, Any]) -> list[int]:
    """The boards whose poses are estimated together with the cameras, in order: all but the first of each group."""
    groups = target.get("board_groups") or ()
    return [k for k, g in enumerate(groups) if g in groups[:k]]


def moved(data: Observations, motions: Sequence[Pose]) -> Observations:
    """The observations after moving each estimated board in the frame of its group."""
    part = parts(data)
    assert part is not None and data.target is not None
    xyz, poses = data.xyz.copy(), list(data.target["board_poses"])
    for k, (board, motion) in enumerate(zip(movable(data.target), motions, strict=True)):
        xyz[part == k] = motion.apply(xyz[part == k])
        poses[board] = (motion @ Pose.from_entry(poses[board])).entry()
    return replace(data, xyz=xyz, target={**data.target, "board_poses": poses})


def frames(target: Mapping[str, Any]) -> tuple[Pose, ...]:
    """group_from_board of each board; identities where no board is placed."""
    given = target.get("board_poses")
    if given is None:
        return (Pose.identity(),) * len(target.get("first_ids") or ())
    return tuple(Pose.from_entry(p) for p in given)


def view_name(view: str, board: str) -> str:
    """The name of the view of one board of a picture."""
    return f"{view} board {board}"


def picture_name(view: str) -> str:
    """The name of the picture of a view named by `view_name`."""
    return view.rpartition(view_name("", ""))[0] or view


def by_board(data: Observations) -> tuple[Observations, dict[str, str], dict[str, int]]:
    """One camera's observations with a view per board, and the picture and board of each view.

    Returns
    -------
    data : Observations
    pictures : mapping of view -> picture
        The view itself where there is one board.
    boards : mapping of view -> board
        Empty where there is one board.
    """
    which, names = labels(data), names_of(data.target)
    if which is None:
        return data, {v: v for v in data.view_ids}, {}
    keys, view = np.unique(data.view * len(names) + which, return_inverse=True)
    ids, pictures, boards = [], {}, {}
    counts = np.bincount(keys // len(names), minlength=len(data))
    for own, board in zip(*np.divmod(keys, len(names)), strict=True):
        picture = data.view_ids[own].removesuffix(view_name("", names[board]))
        name = view_name(picture, names[board]) if counts[own] > 1 else data.view_ids[own]
        ids.append(name)
        pictures[name], boards[name] = picture, int(board)
    order = np.argsort(view.reshape(-1), kind="stable")
    return _in_views(data, order, view.reshape(-1)[order], ids), pictures, boards


def _in_views(data: Observations, order: Array, view: Array, ids: Sequence[str]) -> Observations:
    """Reorder the rows into other views."""
    columns = ("xyz", "uv", "camera", "used", "reason", "point", "sigma", "set_aside", "weight")
    moved: dict[str, Any] = {
        c: None if getattr(data, c) is None else getattr(data, c)[order] for c in columns
    }
    return replace(data, view=view, view_ids=tuple(ids), **moved)
