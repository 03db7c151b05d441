"""The motion of the target in the kept frames of a film, from neighbouring frames.

A rolling shutter displaces a point by its velocity times the time at which its row is read. If the velocities are
known, this displacement can be distinguished from other errors of a camera (`assess/checks/film.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from camcal.detect.examine import Outcome
from camcal.detect.sources import split
from camcal.detect.targets.base import Detection
from camcal.geometry.plane_flow import fit_flow

#: frames for whose motion further frames are searched; if their neighbours were searched anyway, motion costs nothing
MOST_FRAMES = 40


def with_motion(
    outcomes: Sequence[Outcome], search: Callable[[list[Path]], list[Outcome]], searched: Sequence[Outcome]
) -> list[Outcome]:
    """Add `flow` to the quality of the outcomes of frames: px per frame, see `geometry/plane_flow.py`.

    Parameters
    ----------
    outcomes : sequence of Outcome
        In the order of the film.
    search : callable
        Returns the outcomes of further frames.
    searched : sequence of Outcome
        All frames that were searched, including those that were not kept.
    """
    kept = [i for i, o in enumerate(outcomes) if o.detection is not None and _number(o.path) is not None]
    known = {o.path: o for o in searched}
    alone = [i for i in kept if not _neighbours(outcomes[i], known)]
    chosen = alone[:: max(1, -(-len(alone) // MOST_FRAMES))]
    missing = [beside(outcomes[i].path, 1) for i in chosen]
    known |= {o.path: o for o in search(missing)} if missing else {}
    result = list(outcomes)
    for i in kept:
        flow = _flow(outcomes[i], _neighbours(outcomes[i], known))
        if flow is not None:
            result[i] = replace(outcomes[i], quality=outcomes[i].quality | {"flow": flow})
    return result


def _number(path: Path) -> int | None:
    return split(path)[1]


def beside(path: Path, step: int) -> Path:
    """The name of the frame `step` frames after this one."""
    film, number = split(path)
    return film.with_name(f"{film.name}#{(number or 0) + step}")


def _neighbours(outcome: Outcome, known: Mapping[Path, Outcome]) -> dict[int, Detection]:
    """The detections in the previous (-1) and the next (1) frame, if they show the target."""
    number = _number(outcome.path) or 0
    found = {step: known.get(beside(outcome.path, step)) for step in (-1, 1) if number + step >= 0}
    return {
        step: o.detection
        for step, o in found.items()
        if o is not None and o.detection is not None and o.size == outcome.size
    }


def _flow(outcome: Outcome, neighbours: Mapping[int, Detection]) -> list[float] | None:
    """The mean of the motions from the previous and to the next frame, or whichever of them is known."""
    own, flows = outcome.detection, []
    if own is None or outcome.size is None:
        return None
    for step, other in neighbours.items():
        _, a, b = np.intersect1d(own.point_ids, other.point_ids, return_indices=True)
        flow = fit_flow(own.uv[a], step * (other.uv[b] - own.uv[a]), outcome.size)
        if flow is not None:
            flows.append(flow)
    return [round(float(v), 4) for v in np.mean(flows, 0)] if flows else None
