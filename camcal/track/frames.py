"""Frames: the correspondences of one instant each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from camcal.track.keep import stored

if TYPE_CHECKING:
    from camcal.data.observations import Correspondences

Array = np.ndarray


@stored
@dataclass(slots=True)
class Frame:
    """The correspondences of one instant.

    Attributes
    ----------
    number : int
        Frames are processed in ascending order; a gap counts as that much time.
    xyz : (N, 3) array, in the world's frame
    uv : (N, 2) array, px
    sigma : (N,) array or None
        Standard deviation of u and of v of each point, px, up to the noise factor.
    time : float or None, s
    """

    number: int
    xyz: Array
    uv: Array
    sigma: Array | None = None
    time: float | None = None

    def __len__(self) -> int:
        return len(self.xyz)


def join(frames: Sequence[Frame]) -> Frame:
    """All points of several frames as one frame, with the number and time of the last."""
    last = frames[-1]
    sigma = None if any(f.sigma is None for f in frames) else np.concatenate([f.sigma for f in frames])
    xyz, uv = (np.concatenate([getattr(f, name) for f in frames]) for name in ("xyz", "uv"))
    return Frame(last.number, xyz, uv, sigma, last.time)


def from_pictures(correspondences: Correspondences) -> Iterator[Frame]:
    """Pictures as frames, numbered from 0 in order; a picture without the target gives a frame without points.

    Parameters
    ----------
    correspondences : Correspondences
        Of `camcal.detect.images.detect_images`.
    """
    from camcal.detect.listing import view_ids

    views = {view.id: view for view in correspondences.views}
    for number, name in enumerate(view_ids([Path(f["path"]) for f in correspondences.files])):
        view = views.get(name)
        if view is None:
            yield Frame(number, np.zeros((0, 3)), np.zeros((0, 2)))
        else:
            yield Frame(number, view.xyz, view.uv, view.sigma)
