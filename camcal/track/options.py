"""How to track: the options that the estimators take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from camcal.errors import UsageError

if TYPE_CHECKING:
    from camcal.model.camera import Camera


@dataclass(frozen=True)
class TrackOptions:
    """How to track; each estimator takes what concerns it and refuses what contradicts it.

    Attributes
    ----------
    gain : str or None
        A name of `GAINS`; None is the estimator's own.
    forgetting : float
        Factor per frame by which past frames lose weight.
    alpha : float
        The fixed gain.
    motion : str
        A name of `camcal.track.motion.MOTIONS`.
    drift : mapping of group -> float
        Figures that replace those of the motion; see `camcal.track.motion`.
    velocity : bool
        Constant velocity instead of a random walk: the drift figures are then changes of velocity.
    sigma : float or None
        Standard deviation of the image points, px; None: estimated from what no camera explains.
    gate : float
        Probability that a good point is taken for an outlier.
    false_alarm : float
        Expected false alarms per frame.
    min_points : int or None
        Frames with fewer are predicted only; None is the model's own least number.
    rate : float
        Frames per second to which the drift figures refer; used where frames have times.
    model : str
        Lens model of the estimators on K, R, t.
    skew : bool
    camera : Camera or None
        Where K and the distortion start, for the estimators on K, R, t.
    fixed : mapping of name -> value or None
        Parameters of the lens that are held, at a value or where they start; `intrinsics` holds all.
    learn_noise : bool
        Estimate the noise factor also where the points bring sigmas.
    iterations : int
        Relinearisations of a frame, at most.
    window : int
        Frames in the sliding window.
    """

    gain: str | None = None
    forgetting: float = 0.98
    alpha: float = 0.1
    motion: str = "thermal"
    drift: Mapping[str, float] = field(default_factory=dict)
    velocity: bool = False
    sigma: float | None = None
    gate: float = 1e-4
    false_alarm: float = 1e-6
    min_points: int | None = None
    rate: float = 30.0
    model: str = "pinhole"
    skew: bool = False
    camera: Camera | None = None
    fixed: Mapping[str, float | None] = field(default_factory=dict)
    learn_noise: bool = False
    iterations: int = 4
    window: int = 10

    def __post_init__(self) -> None:
        for name, low, high in _RANGES:
            value = getattr(self, name)
            if value is not None and not low < value <= high:
                raise UsageError(f"{name} = {value:g}; more than {low:g} and at most {high:g} is needed.")


_RANGES = (
    ("forgetting", 0.0, 1.0),
    ("alpha", 0.0, 1.0),
    ("sigma", 0.0, np.inf),
    ("gate", 0.0, 0.5),
    ("false_alarm", 0.0, 0.1),
    ("min_points", 0.0, np.inf),
    ("rate", 0.0, np.inf),
    ("iterations", 0.0, 100.0),
    ("window", 1.0, 1000.0),
)
