"""The initial value of the offset between the clocks of a stream of poses and of the camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.data.robot_poses import Stream
from camcal.errors import DataError
from camcal.model.pose import Array, Poses
from camcal.routes.hand_eye.joint import Measured
from camcal.routes.hand_eye.recognise import misfits
from camcal.routes.hand_eye.views import views_of

#: largest number of offsets tried on either side
MOST_STEPS = 2000


def robot_at(stream: Stream, times: Array) -> Callable[[float], Measured]:
    """The robot's poses at the views' times (V,) plus an offset."""
    return lambda offset: Measured(*stream.at(times + offset))


def search(setup: str, stream: Stream, times: Array, cameras: Poses, reach: float) -> float:
    """The offset, s, within ± `reach` at which the rotations agree best.

    Steps are the stream's median interval. Offsets at which a view lies outside the stream are not tried.

    Raises
    ------
    DataError
        If all offsets put views outside the stream.
    """
    step = max(float(np.median(np.diff(stream.times))), reach / MOST_STEPS)
    tried = np.arange(-np.floor(reach / step), np.floor(reach / step) + 1) * step
    inside = [o for o in tried if stream.covers(times + o).all()]
    if not inside:
        raise DataError(
            f"the views' times ({times.min():.6g} to {times.max():.6g} s) lie outside the poses' "
            f"({stream.times[0]:.6g} to {stream.times[-1]:.6g} s) at every offset within {reach:g} s.",
            "Both must be in seconds from the same origin; --max-offset widens the search.",
        )

    def left(offset: float) -> float:
        return float(np.prod(misfits(views_of(setup, stream.at(times + offset)[0], cameras))))

    return float(min(inside, key=left))
