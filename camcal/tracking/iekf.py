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
    held = [name for name in options.fixed if name != "aspect"]
    lens = lenses.make(options.model, options.skew)
    free_start = {"fx", "fy", "cx", "cy", "skew", "intrinsics"}
    if bad := [name for name in held if name in free_start]:
        raise UsageError(
            f"{bad[0]} is to be held, but its value is not given.",
            "Give the camera: --camera CALIBRATION.yaml",
        )
    return PhysicalModel(lens, None, options.fixed)


class IteratedKalman(Recursive):
    """Gauss-Newton on each frame and its prediction together.

    Bell & Cathey, The iterated Kalman filter update as a Gauss-Newton method, IEEE Trans. Automatic Control
    38 (1993).
    """

    gains: tuple[str, ...] = ("kalman", "adaptive", "fixed")

    def __init__(self, options: TrackOptions):
        noise = motion.figures(options.motion, options.drift)
        super().__init__(
            options, physical_model(options), noise, options.gain or self.gains[0], options.iterations
        )
