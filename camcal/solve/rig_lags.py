"""Test whether the cameras of a rig took their pictures at the same instants.

A camera that lags by k frames shows in picture v + k the board that the others show in v. The relative poses from
pictures k apart then agree, and those from pictures of the same number do not, if the board moves in between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.model.pose import Pose
from camcal.solve.rig_start import Link, Links, Pictures, link, shared

Array = np.ndarray

#: frames by which a camera may lag: triggers lose a frame or two, recordings start some frames apart
MOST = 5
#: smallest number of pairs of pictures that decide on a lag: fewer agree by chance, as a pose has six free numbers
LEAST = 6
#: a lag is accepted if it reduces the distance between the boards by this factor. A hand moves a board from frame to
#: frame by several times the uncertainty of a pose; if it does not move, all lags are equivalent.
NEARER = 0.4


def lags(
    pictures: Pictures, found: Links, tree: Sequence[tuple[int, int]], turns: Sequence[Pose], corners: Array
) -> dict[int, int]:
    """The lag, in frames, of cameras behind the majority: camera -> frames; empty if all are synchronous.

    Parameters
    ----------
    pictures : Pictures
        Their views numbered in the order of time.
    found : mapping of (a, b) -> Link
    tree : sequence of (a, b)
        Pairs that connect all cameras, beginning at camera 0.
    """
    behind = {0: 0}
    for a, b in tree:
        lag = _lag(pictures, a, b, found[a, b], turns, corners)
        if a in behind:
            behind[b] = behind[a] + lag
        else:
            behind[a] = behind[b] - lag
    values, counts = np.unique(list(behind.values()), return_counts=True)
    usual = (
        0 if counts.max() == 1 or counts[values == 0].sum() == counts.max() else int(values[counts.argmax()])
    )
    return {camera: lag - usual for camera, lag in behind.items() if lag != usual}


def _lag(pictures: Pictures, a: int, b: int, known: Link, turns: Sequence[Pose], corners: Array) -> int:
    """The lag of camera b behind camera a in frames; 0 if none is significant."""
    best, least = 0, NEARER * known.scatter
    if least < known.expected:  # noise sets a lower limit to the distance
        return 0
    for lag in (k for size in range(1, MOST + 1) for k in (size, -size)):
        i, j = shared(pictures, a, b, lag)
        if len(i) < LEAST:
            continue
        variance = pictures.variance[i] + pictures.variance[j]
        apart = link(pictures.poses[i], pictures.poses[j], variance, turns, corners).scatter
        if apart < least:
            best, least = lag, apart
    return best
