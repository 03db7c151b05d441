"""Descriptions of causes: what it is, the estimated value, and a remedy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.assess.causes import Found
from camcal.assess.causes.search import Trial
from camcal.assess.warning import CalibrationWarning, Severity
from camcal.geometry.numbers import TINY
from camcal.model.pose import Array
from camcal.solve.warp import FIELDS

#: A camera with an error of this many px is wrong (`checks/fit.py`); with a fifth of it, about the error of a good
#: detector's corner, it is worse than it looks.
SEVERAL_PX, VISIBLE_PX = 1.0, 0.2
#: Parameters of each view also absorb other errors of single views: their effect on the camera is relied upon only from
#: several px on (the sheet of DBAT's demonstration, bowed differently in each view, moves the principal point by
#: 1.3 px).
MANY_PX = 3.0
#: sigmas that an unmodelled cause enlarges by this factor are unreliable (as in `checks/board.py`)
WORSE = 0.85
#: parts taken by different cameras are misinterpreted data, however small the error of the mean camera: this is assumed
#: if half of the remaining variance is due to it (0.7 = sqrt(1/2); two cameras of one kind side by side give
#: 0.58, a set of one camera with heavy tails .95)
OTHER_CAMERAS = 0.7
#: A shift of the principal point is attributed to resized pictures if it agrees within this fraction, and to rotated
#: pictures if the two principal points are symmetric about the centre within this fraction of their distance.
ALIKE = 0.1
#: Scales this close (difference of logarithms) are due to zoom or focus: resizing changes more.
RESIZED = 0.02
NAMED = 4  #: views in a sentence
_AT = {name: i for i, name in enumerate(FIELDS)}
_APART = "Calibrate the two groups of views separately, as two cameras."


def warning_of(found: Found) -> CalibrationWarning | None:
    """The warning of a cause; None without one."""
    trial = found.cause
    if trial is None:
        return None
    code, what, hint = _WORDS[trial.how](found, trial)
    off = f" A single camera for all views has an error of {found.effect:.2g} px (rms over the picture)"
    if not found.effect > 0:
        off = " These views do not determine the effect on the camera"
    if found.scatter > found.effect > 0:
        off += f", and each picture by {found.scatter:.2g} px"
    unit = "px" if found.base.observations.sigma is None else "times those given"
    left = f" With {_numbers(trial.numbers)} more, sigma falls from {found.before:.3g} to {found.sigma:.3g} {unit}."
    grave = severity(found.effect, found.scatter, trial.how == "each", found.sigma / found.before, code)
    return CalibrationWarning(code, f"{what}{left}{off}.", hint, grave)


def severity(effect: float, scatter: float, each: bool, ratio: float, code: str = "") -> Severity:
    """The severity of a cause.

    Parameters
    ----------
    effect, scatter : float
        Error of the camera, px; pictures that scatter about a correct camera make it doubtful.
    each : bool
        Whether every view has its own parameters.
    ratio : float
        Sigma with the cause relative to that without.
    code : str
        Of the warning.
    """
    if code == "several-cameras" and ratio < OTHER_CAMERAS:
        return "wrong"
    if effect > (MANY_PX if each else SEVERAL_PX):
        return "wrong"
    return "doubtful" if max(effect, scatter) > VISIBLE_PX or ratio < WORSE else "note"


def _numbers(count: int) -> str:
    return "one number" if count == 1 else f"{count} numbers"


def _names(found: Found, mask: Array) -> str:
    ids = [found.base.observations.view_ids[int(i)] for i in np.flatnonzero(mask)]
    return f"{len(ids)} views ({', '.join(ids[:NAMED])}{', ...' if len(ids) > NAMED else ''})"


def _parts(found: Found, trial: Trial) -> tuple[str, str, str]:
    """Two parts: the parameters are those of the second relative to the first."""
    theta = trial.theta[trial.parts][0]
    scale, unit = 1 + float(theta[_AT["scale"]]), trial.warp.unit
    shift = theta[[_AT["shift-u"], _AT["shift-v"]]] * unit
    ids = found.base.observations.view_ids
    first = int(np.flatnonzero(trial.parts)[0])
    if trial.how == "sides":
        return (
            "mirrored-picture",
            f"{_names(found, trial.parts)} of {len(ids)} show the target from its other side, with the principal point "
            f"moved by ({shift[0]:.1f}, {shift[1]:.1f}) px: the pictures of one of the two parts are mirrored.",
            "Find out which part is mirrored, and mirror its pictures back.",
        )
    if trial.how == "split":
        where = f"from view '{ids[first]}' on ({int(trial.parts.sum())} of {len(ids)} views)"
    else:
        where = f"in {_names(found, trial.parts)} of {len(ids)}"
    if _is_resized(scale, shift, trial):
        size = found.base.camera.image_size
        of = f", as of {round(size[0] * scale)}x{round(size[1] * scale)} pictures" if size else ""
        return (
            "resized-pictures",
            f"{where} the pictures are resized by a factor of {scale:.4g} (1 : {1 / scale:.4g}){of}: the "
            f"pictures have mixed sizes.",
            "Use unmodified pictures from the camera, all at one resolution.",
        )
    if trial.kind == "cropped":
        return _moved(found, trial, where, shift)
    longer = f"{abs(scale - 1):.2%} {'longer' if scale > 1 else 'shorter'}"
    if trial.kind == "camera" or trial.how == "groups":
        moved = (
            f", the principal point moved by ({shift[0]:.1f}, {shift[1]:.1f}) px"
            if trial.kind == "camera"
            else ""
        )
        return (
            "several-cameras",
            f"{where} another camera (or another zoom or focus of it) was used: focal length {longer}{moved}.",
            _APART,
        )
    return (
        "zoom-or-refocus",
        f"{where} the focal length is {longer}: the lens was zoomed or refocused.",
        "Keep zoom and focus fixed, or calibrate the views before and after the change separately.",
    )


def _is_resized(scale: float, shift: Array, trial: Trial) -> bool:
    """Return whether the principal point moves as it does when whole pictures are resized."""
    if trial.kind == "resized":
        return True
    wanted = (scale - 1) * (trial.camera.params[2:4] + 0.5)
    if trial.kind != "camera" or abs(np.log(max(scale, TINY))) < RESIZED:
        return False
    # the centre of the fields is not exactly the principal point
    centred = shift + (scale - 1) * (trial.camera.params[2:4] - trial.warp.centre)
    return bool(np.linalg.norm(centred - wanted) < ALIKE * np.linalg.norm(wanted))


def _moved(found: Found, trial: Trial, where: str, shift: Array) -> tuple[str, str, str]:
    size = found.base.camera.image_size
    if size is not None:
        opposite = np.subtract(size, 1) - 2 * trial.camera.params[2:4]
        if np.linalg.norm(shift - opposite) < ALIKE * float(np.linalg.norm(shift)):
            return (
                "turned-pictures",
                f"{where} the principal point is on the opposite side, ({shift[0]:.1f}, {shift[1]:.1f}) "
                f"px away: these pictures were rotated by 180 degrees.",
                "Rotate them back (check how the orientation of the pictures was stored and applied).",
            )
    return (
        "cropped-pictures",
        f"{where} the principal point is moved by ({shift[0]:.1f}, {shift[1]:.1f}) px: these pictures were cropped.",
        "Use unmodified pictures from the camera.",
    )


def _each(found: Found, trial: Trial) -> tuple[str, str, str]:
    """Separate parameters for each view, which sum to zero."""
    theta, unit = trial.theta, float(trial.warp.unit)
    if trial.kind == "rolling":
        size = found.base.camera.image_size
        height = float(size[1]) if size else 2 * unit
        lean: Array = np.linalg.norm(theta[:, [_AT["lean"], _AT["stretch"]]], axis=1) * height
        usual = np.sqrt((lean**2).mean())
        most = float(lean.max())
        worst = found.base.observations.view_ids[int(lean.argmax())]
        return (
            "rolling-shutter",
            f"the points of each view are displaced in proportion to their row, by {usual:.2g} px (rms) from the first "
            f"row to the last, {most:.2g} px in view '{worst}': camera or target moved while a rolling shutter "
            "read the picture.",
            "Mount camera and target on stands, or use a global shutter.",
        )
    if trial.kind == "cropped":
        shift = np.linalg.norm(theta[:, [_AT["shift-u"], _AT["shift-v"]]], axis=1) * unit
        return (
            "principal-point-moves",
            f"the principal point moves from view to view, by {np.sqrt((shift**2).mean()):.3g} px (rms): an image "
            "stabiliser (as of stabilised film), a loose lens, or pictures cropped differently.",
            "Switch off the stabiliser (including an optical one), fix the lens, and do not crop.",
        )
    spread = float(np.sqrt((theta[:, _AT["scale"]] ** 2).mean()))
    if trial.kind == "resized":
        return (
            "resized-pictures",
            f"the scale of the pictures differs from view to view, by {spread:.2%} (rms): resized differently.",
            "Use unmodified pictures from the camera, all at one resolution.",
        )
    return (
        "zoom-or-refocus",
        f"the focal length differs from view to view, by {spread:.2%} (rms): "
        "the lens was focused or zoomed between views.",
        "Switch off autofocus, and keep zoom and focus fixed.",
    )


_WORDS: dict[str, Callable[[Found, Trial], tuple[str, str, str]]] = {
    "split": _parts,
    "groups": _parts,
    "sides": _parts,
    "each": _each,
}
