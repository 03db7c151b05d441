"""The iterated extended Kalman filter on the physical parameters of the camera."""

from __future__ import annotations

from camcal import lenses
from camcal.errors import UsageError
from camcal.tracking import motion
from camcal.tracking.base import TrackOptions
from camcal.tracking.physical_model import PhysicalModel
from camcal.tracking.recursive import Recursive


def physical_model(options: TrackOptions) -> PhysicalModel:
    """The model that the options ask for: that of the given camera, or of its own lens.

    Raises
    ------
    UsageError
        Where parameters are to be held at values that are not given.
    """
    if options.camera is not None:
        return PhysicalModel(options.camera.lens, options.camera.params, options.fixed)
    from_data = ("fx", "fy", "cx", "cy", "intrinsics")
    for name, value in options.fixed.items():
        if name in from_data and value is None:
            raise UsageError(
                f"{name} is to be held, but its value is not given.",
                "Give the camera (--camera CALIBRATION.yaml) or the value (--fix cx=320).",
            )
    return PhysicalModel(lenses.make(options.model, options.skew), None, options.fixed)


class IteratedKalman(Recursive):
    """Gauss-Newton on each frame and its prediction together.

    Bell & Cathey, The iterated Kalman filter update as a Gauss-Newton method, IEEE Trans. Automatic Control
    38 (1993).
    """

    takes = frozenset(
        ("gain", "alpha", "motion", "drift", "velocity", "model", "skew", "camera", "fixed", "iterations")
    )
    gains: tuple[str, ...] = ("kalman", "adaptive", "fixed")

    def __init__(self, options: TrackOptions):
        noise = motion.figures(options.motion, options.drift)
        super().__init__(
            options, physical_model(options), noise, options.gain or self.gains[0], options.iterations
        )
