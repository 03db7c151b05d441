"""Several boards of markers in the same pictures; each board in a picture is a separate view.

The relative poses of the boards are not used, so that they may be moved between pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.data.observations import View
from camcal.detect.examine import Outcome
from camcal.detect.recognition.decide import Answer
from camcal.detect.targets.base import Target
from camcal.detect.targets.tag_board import TagBoard
from camcal.records import dataclass

#: px; corners of two boards closer than this are one corner, found twice to some hundredths
SAME_CORNER = 1.0
LEAST_PICTURES = 2  #: least number that show a further board: markers in one picture may be misread

Array = np.ndarray


@dataclass(frozen=True)
class Searched:
    """A target and the outcome of each picture that was searched for it."""

    target: Target
    outcomes: list[Outcome]


def further(best: Answer, found: Sequence[Answer]) -> list[Answer]:
    """The boards besides the most frequent one, each with its own markers."""
    if not isinstance(best.target, TagBoard):
        return []
    taken, chosen = _markers(best.target), []
    for answer in found:
        board = answer.target
        if (
            isinstance(board, TagBoard)
            and len(answer.pictures) >= LEAST_PICTURES
            and not _markers(board) & taken
        ):
            chosen.append(answer)
            taken |= _markers(board)
    return chosen


def _markers(board: TagBoard) -> set[tuple[str, int, int]]:
    return {(board.dictionary, board.border, int(tag)) for tag in board.tag_ids}


def merged(searched: Sequence[Searched]) -> list[Outcome]:
    """The outcome of the first board that each picture shows, otherwise that of the first target."""
    return [
        next((o for o in of_picture if o.detection is not None), of_picture[0])
        for of_picture in zip(*(s.outcomes for s in searched), strict=True)
    ]


def views_of(searched: Sequence[Searched], picture: int, name: str) -> list[View]:
    """The views of one picture; if it shows several boards, the number of the board is appended to the name."""
    shown = _apart([None if (d := s.outcomes[picture].detection) is None else d.uv for s in searched])
    first = np.cumsum([0, *(len(s.target.points) for s in searched)])  # distinct ids for all boards
    views = []
    for k in shown:
        d, target = searched[k].outcomes[picture].detection, searched[k].target
        assert d is not None
        own = name if len(shown) == 1 else f"{name} board {k + 1}"
        views.append(View(own, target.points[d.point_ids], d.uv, d.sigma, d.point_ids + int(first[k])))
    return views


def _apart(seen: Sequence[Array | None]) -> list[int]:
    """The boards of a picture that do not duplicate the corners of others.

    A misread marker may make a second board of the corners of the first: of two boards that share most corners of the
    smaller one, the larger is kept.
    """
    order = sorted((k for k, uv in enumerate(seen) if uv is not None), key=lambda k: -len(seen[k]))  # type: ignore[arg-type]
    kept: list[int] = []
    for k in order:
        own = np.asarray(seen[k])
        shared = (
            (np.linalg.norm(own[:, None] - np.asarray(seen[j]), axis=2).min(1) < SAME_CORNER).mean()
            for j in kept
        )
        if all(s < 0.5 for s in shared):  # 0.5: most
            kept.append(k)
    return sorted(kept)


def described(searched: Sequence[Searched]) -> dict[str, Any]:
    """The report's entry `target`; `boards` has the specs if there are several."""
    said = searched[0].target.describe()
    if len(searched) == 1:
        return said
    first = np.cumsum([0, *(len(s.target.points) for s in searched[:-1])])
    return said | {"boards": [s.target.spec for s in searched], "first_ids": first.tolist()}
