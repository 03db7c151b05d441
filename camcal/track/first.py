"""The camera that a track starts from, and the reasons not to start."""

from __future__ import annotations

import math

import numpy as np

from camcal.errors import EstimationError
from camcal.track import noise, robust
from camcal.track.base import Frame
from camcal.track.model import Model

#: points that scatter about a camera by more than so many times the noise show no camera
SCATTER = 3.0
#: nor do points that scatter by more than this part of their own extent in the picture: of points matched
#: at random the best camera leaves about three quarters of it
BLIND = 0.2


def fit(model: Model, frame: Frame, known: float | None, probability: float) -> robust.Fit:
    """Fit a camera to the first frame, or to the first few joined.

    Parameters
    ----------
    known : float or None
        Noise of the image points, px; a factor where they bring sigmas.
    probability : float
        Of taking a good point for an outlier.

    Raises
    ------
    EstimationError
        Where the points do not determine a camera, or fit none.
    DataError
        Where they contradict every camera.
    """
    needed = model.start_points
    different = len(np.unique(frame.xyz, axis=0))
    if different < needed:
        raise EstimationError(
            f"{different} different points in the first frames; {needed} are needed to start.",
            "Give the first frames more points"
            + ("; with a known camera four do: --camera CALIBRATION.yaml --fix intrinsics" * (needed > 4)),
        )
    model.settle(frame)
    x = model.start(frame)
    spare = math.inf if known is not None else 2 * len(frame) - model.size
    found = robust.fit(model, x, frame, known, noise.gate(probability, spare), model.prior(x))
    _check_scatter(found, frame, known)
    if found.keep.sum() < needed:
        raise EstimationError(
            f"{int(found.keep.sum())} of {len(frame)} points fit one camera; {needed} are needed.",
            "Check which image point belongs to which point of the world.",
        )
    return found


def _check_scatter(found: robust.Fit, frame: Frame, known: float | None) -> None:
    if known is not None and found.scatter > SCATTER * known:
        said = f"their sigma ({known:.3g} px) says" if frame.sigma is None else "their sigmas say"
        wrong = "--sigma" if frame.sigma is None else "the column sigma"
        raise EstimationError(
            f"the points of the first frames lie {found.scatter / known:.2g} times as far from any camera as "
            f"{said}.",
            f"Correct or leave out {wrong}"
            + ("." if frame.sigma is None else ", or learn a factor of it: --learn-noise"),
        )
    own = 1.0 if frame.sigma is None else float(np.median(frame.sigma))
    extent = float(np.sqrt(frame.uv.var(0).sum()))
    if found.scatter * own > BLIND * extent:
        raise EstimationError(
            f"the points of the first frames fit no camera: the nearest leaves {found.scatter * own:.3g} px.",
            "Check which image point belongs to which point of the world.",
        )
