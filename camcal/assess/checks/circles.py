"""Points that are the centroids of circles' images; `camcal.assess.causes.circles` computes the effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from camcal.assess.causes.circles import Circles, circles
from camcal.assess.causes.words import severity
from camcal.assess.checks import fit
from camcal.assess.checks.facts import Facts
from camcal.assess.difference import difference
from camcal.assess.fold_difference import covered_pixels
from camcal.assess.warning import BY_CHANCE, CalibrationWarning

#: standard deviations of r² above which circles are reported: false alarms in 1e-3 of all runs. Of 24 sets of 15 views
#: of circles of radius .4 with .02 px of noise one has less than 4 (3.8, its camera off by five of its sigmas)
SIGNIFICANT = 3.1
#: range of radii of a target's circles, relative to the spacing of neighbouring centres: smaller ones have no effect
#: (their images are a few pixels across), and larger ones touch. Bent boards and unsuitable lens models give other
#: values, or negative ones.
SMALLEST, LARGEST = 0.15, 0.5
#: A non-ideal board is the alternative explanation: its residuals repeat at the same points, which the deviations above
#: treat as noise (8 of them on the bent board of a real stereo pair). The decrease of the cost by circles is .9 to 1.6
#: times that predicted for a free board if there are circles (rendered, radius .2 to .4), and .03 times on that board.
LEAST_OF_BOARD = 0.5


def circle_centres(facts: Facts) -> Iterator[CalibrationWarning]:
    """Centroids of circles' images; targets that camcal found itself are already corrected."""
    found = circles(facts.solution, facts.design) if facts.design is not None else None
    if found is None or not (found.deviations > SIGNIFICANT and SMALLEST < found.radius < LARGEST):
        return
    if _board_explains_more(facts, found):
        return
    moved, pixels = replace(facts.camera, params=found.params), covered_pixels(facts.solution)
    apart = difference(moved, facts.camera, pixels).rms_px
    grave = severity(apart, apart, False, 1.0)
    if grave == "note" and apart > fit.SIGMAS * fit.stated_px(facts.solution, pixels):
        grave = "doubtful"  # small, but far above the camera's stated uncertainty
    yield CalibrationWarning(
        "circle-centres",
        f"the points match the centroids of images of circles with a radius of {found.radius:.2g} of "
        f"their spacing ({found.deviations:.0f} standard deviations): the image of a circle seen from the side is not "
        f"centred on that of its centre. The camera is off by {apart:.2g} px (rms over the picture).",
        "Let camcal find the circles in the pictures, which corrects for it (camcal images --target circles:9x6).",
        grave,
    )


def _board_explains_more(facts: Facts, found: Circles) -> bool:
    """Return whether the board's own shape predicts so large a gain that circles are a small part of the error."""
    bent = facts.free_board
    if bent is None or bent.p_value > BY_CHANCE:
        return False
    of_board = 1 - (bent.after / bent.before) ** 2
    return found.gain < LEAST_OF_BOARD * of_board * facts.solution.fit.cost
