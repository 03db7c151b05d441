"""Frames out of pictures of one fixed target."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from camcal.data.observations import Correspondences
from camcal.detect.listing import view_ids
from camcal.track.base import Frame


def frames_of(correspondences: Correspondences) -> Iterator[Frame]:
    """The pictures as frames, numbered from 0 in their order; one without the target has no points.

    Parameters
    ----------
    correspondences : Correspondences
        Of `camcal.detect.images.detect_images`.
    """
    views = {view.id: view for view in correspondences.views}
    names = view_ids([Path(f["path"]) for f in correspondences.files])
    for number, name in enumerate(names):
        view = views.get(name)
        if view is None:
            yield Frame(number, np.zeros((0, 3)), np.zeros((0, 2)))
        else:
            yield Frame(number, view.xyz, view.uv, view.sigma)
