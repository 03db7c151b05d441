"""The board shape of an earlier report, for the next calibration with the same board."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences
from camcal.errors import DataError
from camcal.report.yaml import read_document
from camcal.solve.board_points import by_number, on_board

#: a point of the board is identified with one of the report within this fraction of a square
_SAME = 1e-3


def on_known_board(correspondences: Correspondences, path: str | os.PathLike) -> Correspondences:
    """Move the points of a board to the positions in a report's `target.shape`.

    Raises
    ------
    DataError
        If the report contains no shape, or that of another board.
    """
    target = read_document(path).get("target") or {}
    shape = target.get("shape") or {}
    if "boards" in shape:
        return _on_known_boards(correspondences, target, path)
    if "points" not in shape:
        raise DataError(
            f"{path} has no board shape; a report with an estimated shape is needed.",
            "Make one with --board-shape free or auto.",
        )
    square = float((correspondences.target or {}).get("square") or target.get("square") or 1.0)
    ideal, points = np.array(shape["ideal"], float) * square, np.array(shape["points"], float) * square
    for view in correspondences.views:
        gaps = np.linalg.norm(view.xyz[:, None] - ideal[None], axis=2).min(1)
        if gaps.max() > _SAME * square:
            raise DataError(
                f"{path} has the shape of another board: it lacks points of view '{view.id}'.",
                "Give the report that was made with this board.",
            )
    return _known(on_board(correspondences, ideal, points), shape, path)


def _on_known_boards(
    correspondences: Correspondences, target: Mapping[str, Any], path: str | os.PathLike
) -> Correspondences:
    """The same with several boards, each by its own entry."""
    own, shape = correspondences.target or {}, target["shape"]
    if any(own.get(k) != target.get(k) for k in ("boards", "first_ids")):
        found = ", ".join(map(str, own.get("boards") or ())) or "a single one"
        raise DataError(
            f"{path} has the shapes of the boards {', '.join(map(str, target['boards']))}; these data have {found}.",
            "Give the report that was made with these boards.",
        )
    square = float(own.get("square") or 1.0)
    for entry in shape["boards"].values():
        correspondences = by_number(
            correspondences, np.array(entry["numbers"]), square * np.array(entry["points"], float)
        )
    return _known(correspondences, shape, path)


def _known(
    correspondences: Correspondences, shape: Mapping[str, Any], path: str | os.PathLike
) -> Correspondences:
    used = {**dict(correspondences.target or {}), "shape": {**shape, "kind": "known", "from": str(path)}}
    return replace(correspondences, target=used)
