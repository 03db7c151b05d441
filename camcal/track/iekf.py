"""The iterated extended Kalman filter on the physical parameters of the camera."""

from __future__ import annotations

from camcal.errors import EstimationError, UsageError
from camcal.model import lenses
from camcal.settings.tracking import TrackOptions
from camcal.track import first, motion
from camcal.track.frames import Frame
from camcal.track.physical_model import PhysicalModel
from camcal.track.recursive import Recursive
from camcal.track.robust import FrameFit


def physical_model(options: TrackOptions) -> PhysicalModel:
    """The model that the options request: the given camera's, or one with its own lens.

    Raises
    ------
    UsageError
        If parameters are to be held at values that are not given.
    """
    if options.camera is not None:
        return PhysicalModel(options.camera.lens, options.camera.params, options.fix)
    from_data = ("fx", "fy", "cx", "cy", "intrinsics")
    for name, value in options.fix.items():
        if name in from_data and value is None:
            raise UsageError(
                f"{name} is held, but its value is not given.",
                "Give the camera (--camera CALIBRATION.yaml) or the value (--fix cx=320).",
            )
    return PhysicalModel(lenses.make(options.model, options.skew), None, options.fix)


#: degrees, and fraction of the distance, per frame: a camera that walks less shows a plane from one side only
MOVES = {"rotation": 0.02, "translation": 5e-4}


class IteratedKalman(Recursive):
    """Gauss-Newton on each frame and its prediction together.

    Bell & Cathey, The iterated Kalman filter update as a Gauss-Newton method, IEEE Trans. Automatic Control
    38 (1993).
    """

    takes = frozenset(
        ("gain", "alpha", "motion", "drift", "velocity", "model", "skew", "camera", "fix", "iterations")
    )
    gains: tuple[str, ...] = ("kalman", "adaptive", "fixed")

    model: PhysicalModel

    def __init__(self, options: TrackOptions):
        noise = motion.figures(options.motion, options.drift)
        super().__init__(
            options, physical_model(options), noise, options.gain or self.gains[0], options.iterations
        )

    def _first(self, frame: Frame) -> FrameFit:
        """Reject intrinsics from a single view of a plane, which would look like a result."""
        lens = self.model.lens.parameters[: 5 if self.model.has_skew else 4]
        held = all(p.name in self.model.fix for p in lens)
        still = all(self.figures[group] < least for group, least in MOVES.items())
        if still and not held and len(frame) >= self.model.start_points and first.is_flat(frame.xyz):
            raise EstimationError(first.PLANE_INTRINSICS, first.PLANE_HINT)
        return super()._first(frame)
