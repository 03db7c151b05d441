"""Recognition of the set-up and of the robot's rotation convention, from the residuals of a closed form.

With the correct ones, G Z = X C holds in all views up to noise (X and Z by Shah's closed form); with others the
residuals are as large as the motions. Rotations alone do not distinguish all readings: a quaternion in another
order is the inverse of a rotation between two constant ones (an improper rotation of its four numbers), which is
equivalent to the other set-up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.data.robot_poses import RobotPoses
from camcal.data.rotation_forms import Form, candidates
from camcal.errors import EstimationError, UsageError
from camcal.geometry import rotations as so3
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.routes.hand_eye import SETUPS, shah
from camcal.routes.hand_eye.closed_forms import length_unit
from camcal.routes.hand_eye.views import Views, views_of

#: A reading replaces another if the residuals make it this many times as likely.
ODDS = 1000.0
#: rad, and relative length; smaller residuals are rounding of numbers written with six digits
ROUNDING = 1e-6
#: decimals to which logarithms of residuals are compared: readings that differ by rounding alone are equal
DIGITS = 9
#: rad, 10 degrees. Robots repeat to hundredths of a degree and are accurate to one degree; poses assigned to wrong
#: views leave several tens of degrees.
NO_ROBOT = np.radians(10.0)


@dataclass(frozen=True)
class Reading:
    """A set-up and a rotation convention, and the residuals of the robot's poses under them.

    Attributes
    ----------
    setup : str
    form : Form
    misfit : float
        Root mean square rotation, rad.
    shift : float
        Root mean square translation, relative to that of all translations.
    """

    setup: str
    form: Form
    misfit: float
    shift: float = 0.0

    @property
    def words(self) -> str:
        """Describe the reading for messages."""
        return f"{self.setup}, rotations as {self.form.name}"


def readings(robot: RobotPoses, cameras: Poses, setups: Sequence[str], inverse: bool) -> list[Reading]:
    """All readings of the poses (V,), those of `robot.form` and of the first set-up first."""
    made = []
    for form in candidates(robot.numbers.shape[1], robot.form.name):
        poses = robot.poses(form, inverse)
        made += [Reading(s, form, *misfits(views_of(s, poses, cameras))) for s in setups]
    return made


def misfits(views: Views) -> tuple[float, float]:
    """The rms residuals of Shah's closed form: rotation, rad, and translation, as a fraction of the total."""
    x, z = shah.solve(views)
    left, right = views.robot @ z, x @ views.camera
    turn = so3.log(left.rotation @ np.swapaxes(right.rotation, 1, 2))
    shift = left.translation - right.translation
    parts = [float(np.sqrt(np.square(part).sum(1).mean())) for part in (turn, shift)]
    return parts[0], parts[1] / length_unit(views)


def log_odds(better: Reading, other: Reading, views: int) -> float:
    """The log-likelihood ratio of one reading to another, from their residuals.

    Each has six parameters for the rotations and six for the translations.
    """
    ratios = [
        (theirs + ROUNDING) / (ours + ROUNDING)
        for ours, theirs in ((better.misfit, other.misfit), (better.shift, other.shift))
    ]
    return (3 * views - 6) * float(np.log(ratios).sum())


def likeliest(found: Sequence[Reading]) -> Reading:
    """The reading with the smallest residuals, the first of equal ones."""
    return min(found, key=lambda r: np.log([r.misfit + ROUNDING, r.shift + ROUNDING]).sum().round(DIGITS))


def choose(found: Sequence[Reading], robot: RobotPoses, setup: str | None, views: int) -> Reading:
    """The reading to use.

    What was specified (`setup`, a form that is `certain`) is kept; for the rest the most likely reading is used if it
    is at least `ODDS` times as likely as that of the column names.

    Raises
    ------
    UsageError
        If the set-up was not specified and the poses do not determine it.
    EstimationError
        If no reading fits.
    """
    allowed = [
        r
        for r in found
        if r.setup in ([setup] if setup else SETUPS) and (not robot.certain or r.form == robot.form)
    ]
    best = likeliest(allowed)
    named = [r for r in allowed if r.form == robot.form]
    first = likeliest(named)
    taken = best if log_odds(best, first, views) > np.log(ODDS) else first
    if taken.misfit > NO_ROBOT:
        elsewhere = likeliest(found)
        raise EstimationError(
            f"the rotations of the robot and of the camera do not match: as {taken.words}, "
            f"{np.degrees(taken.misfit):.3g} deg are left.",
            f"As {elsewhere.words}, {np.degrees(elsewhere.misfit):.2g} deg are left."
            if elsewhere.misfit <= NO_ROBOT
            else "Check which pose belongs to which view, --rotation, and that the poses are base_from_hand (else "
            "--inverse).",
        )
    if setup is None:
        other = next(r for r in allowed if r.form == taken.form and r.setup != taken.setup)
        if abs(log_odds(taken, other, views)) <= np.log(ODDS):
            raise UsageError(
                f"the poses fit a camera in the hand ({_deg(taken, other, 'in-hand')} deg are left) and "
                f"one fixed beside the robot ({_deg(taken, other, 'to-hand')} deg).",
                "Specify the set-up: --setup in-hand or --setup to-hand.",
            )
    return taken


def better_reading(found: Sequence[Reading], taken: Reading, views: int) -> Reading | None:
    """A reading other than the one taken that is at least `ODDS` times as likely, or None."""
    best = likeliest(found)
    return best if log_odds(best, taken, views) > np.log(ODDS) else None


def _deg(a: Reading, b: Reading, setup: str) -> str:
    return f"{np.degrees((a if a.setup == setup else b).misfit):.2g}"
