"""What travels through this room - frames in, states out - and what an estimator is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from camcal.errors import UsageError

if TYPE_CHECKING:
    from camcal.model.camera import Camera
    from camcal.track.events import Alarm
    from camcal.track.model import Model

Array = np.ndarray


@dataclass(slots=True)
class Frame:
    """The correspondences of one moment.

    Attributes
    ----------
    number : int
        Frames are processed in ascending order; a gap counts as that much time.
    xyz : (N, 3) array, in the world's frame
    uv : (N, 2) array, px
    sigma : (N,) array or None
        Standard deviation of each image point in each coordinate, px, known up to the noise factor.
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
    """All points of several frames as one, with the number and time of the last."""
    last = frames[-1]
    sigma = None if any(f.sigma is None for f in frames) else np.concatenate([f.sigma for f in frames])
    xyz, uv = (np.concatenate([getattr(f, name) for f in frames]) for name in ("xyz", "uv"))
    return Frame(last.number, xyz, uv, sigma, last.time)


def pack_frames(frames: Sequence[Frame]) -> list[dict[str, Any]]:
    """Frames as dicts of arrays, for a checkpoint."""
    return [{name: getattr(f, name) for name in ("number", "xyz", "uv", "sigma", "time")} for f in frames]


def unpack_frames(packed: Sequence[Mapping[str, Any]]) -> list[Frame]:
    """The frames of `pack_frames`."""
    return [Frame(**one) for one in packed]


@dataclass(slots=True)
class State:
    """What is known after a frame.

    Attributes
    ----------
    frame : int
    status : str
        `waiting` (no estimate yet), `started`, `updated`, `predicted` (too few points), `rejected`
        (the points fit no camera; predicted), `restarted` (after a change).
    estimate : object or None
        The model's own representation; `Model.describe` turns it into K, R, t.
    factor : (p, p) array or None
        L with covariance L Lᵀ in the model's coordinates.
    points, used : int
        Points in the frame, and those that passed the gate.
    innovation : float
        Root mean square distance between the points and where they were predicted, px.
    nis : float
        Normalised innovation squared, of the part that a change of the camera can explain.
    nis_dof : int
    score : float
        `nis` as a standard normal deviate; what the change test adds up.
    cusum : float
    changed : bool
    gain : float
        The fraction of its own correction that the frame was granted, 0 to 1.
    effective : float
        How many frames like this one the estimate is worth.
    noise : float
        Standard deviation of the image points, px (a factor of it where the points bring sigmas).
    alarm : Alarm or None
        What changed, in a frame with `changed`.
    """

    frame: int
    status: str
    estimate: Any = None
    factor: Array | None = None
    points: int = 0
    used: int = 0
    innovation: float = np.nan
    nis: float = np.nan
    nis_dof: int = 0
    score: float = np.nan
    cusum: float = np.nan
    changed: bool = False
    gain: float = np.nan
    effective: float = np.nan
    noise: float = np.nan
    alarm: Alarm | None = None


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


class Estimator(ABC):
    """Takes frames in ascending order and says after each what the camera is.

    Attributes
    ----------
    model : Model
        Of what the estimates are; None of its parts changes after the first estimate.
    ignored : int
        Frames that were not newer than the one before, in number or time: they change nothing.
    """

    model: Model
    #: whether the states of `update` are provisional, and those of `finish`, for all frames, final
    offline = False
    #: fields of `TrackOptions` that mean something to it, besides those that mean something to all
    takes: frozenset[str] = frozenset()
    #: gains that the estimator can work with, its own first
    gains: tuple[str, ...] = ()

    def __init__(self, options: TrackOptions):
        self.options = options
        self.ignored = 0
        self.last: int | None = None
        self.time: float | None = None
        if options.gain is not None and options.gain not in self.gains:
            raise UsageError(
                f"this method does not work with the gain '{options.gain}'.",
                f"It takes {', '.join(self.gains)}." if self.gains else "Leave the gain out.",
            )

    def update(self, frame: Frame) -> State | None:
        """Take a frame; None where it is late or repeated and was ignored."""
        step = self._step(frame)
        if step is None:
            self.ignored += 1
            return None
        self.last, self.time = frame.number, frame.time
        return self._update(frame, step)

    def _step(self, frame: Frame) -> float | None:
        """How many frames have passed since the last one; None where the frame is not newer."""
        if self.last is None:
            return 1.0
        if frame.number <= self.last:
            return None
        if frame.time is None or self.time is None:
            return float(frame.number - self.last)
        return (frame.time - self.time) * self.options.rate if frame.time > self.time else None

    @abstractmethod
    def _update(self, frame: Frame, step: float) -> State:
        """Take a frame that came `step` frames after the one before."""

    def finish(self) -> Iterable[State]:
        """The states that were held back until the end of the stream, in order."""
        return ()

    def state(self) -> dict[str, Any]:
        """All that `restore` needs to go on as before: nested dicts and lists of arrays and scalars."""
        return {"ignored": self.ignored, "last": self.last, "time": self.time}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up a state of `state`."""
        self.ignored, self.last, self.time = (state[k] for k in ("ignored", "last", "time"))
