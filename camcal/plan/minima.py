"""Attempts at a lower minimum: from nested models, other principal points, other cameras with the same rays.

A least squares search ends in the minimum whose basin it begins in. Where the data determine a camera well there is one
that matters, and nothing here is tried. Otherwise:

- a model that contains others begins at the optimum of each of these, found in the same way, the smallest first: it is
  never worse than one of them;
- where focal length or principal point are weak, the search begins again at places all over their joint interval;
- models with several minima for the same rays (`Lens.several_minima`) try all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from camcal.assess.checks.facts import Facts
from camcal.assess.checks.parameters import WEAK
from camcal.assess.covariance import covariance
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.containment import contained, embed
from camcal.model.pose import Poses
from camcal.plan.better import Candidate, lowest
from camcal.plan.camera import FROM_START, starts_from_nothing
from camcal.plan.progress import Attempt, Change, Progress, advance
from camcal.solve import starts
from camcal.solve.calibration import Calibration
from camcal.solve.optimizers.base import Options as Stopping
from camcal.solve.refine import How, refine

#: iterations after which the starts of a search are compared, and how many of them are followed to their end: on 30
#: hand-clicked points the lowest minimum stands out after 80 steps and not after 40, while its valley takes 400
SCREENED, FOLLOWED = 80, 3
#: starts whose costs then differ by less than this part are one minimum
SAME = 1e-6
#: how often a search that reached its limit of iterations is continued: it began far from the minimum
CONTINUED = 4
#: points up to which principal points are searched: minima apart by the principal point were met on 24 to 30 points of
#: one view; at 200 the 34 searches take 2 s, and sets of 500 and more had no such minimum
SEARCHED = 200
#: free parameters of the camera up to which they are searched, and up to which it is asked whether curved directions
#: make them weak. Larger models begin at the minima of those inside; searched themselves they take half a minute for 20
#: points, and following their directions takes longer than the fit (opencv8, 10 views of 54 points: 1.8 s against .09)
MOST_PARAMETERS = 10


# ------------------------------------------------------------------------------------------------ weak cameras
def weak(fit: Calibration) -> bool:
    """Return whether focal length or principal point are weak, as in the warning `weak-parameters`, or
    undetermined.
    """
    facts = Facts(fit)
    focal = float(abs(fit.camera.params[:2]).max())
    sizes = dict.fromkeys(facts.groups("focal"), focal) | dict.fromkeys(
        facts.groups("principal"), facts.diagonal
    )

    def any_weak(sigmas: Mapping[str, float]) -> bool:
        return any(not sigmas[n] <= WEAK * size for n, size in sizes.items())

    if any_weak(covariance(fit).sigmas):
        return True
    return int(fit.free.any(0).sum()) <= MOST_PARAMETERS and any_weak(facts.covariance.sigmas)


def _searchable(fit: Calibration) -> bool:
    """Return whether a fit has so few points and parameters that its principal points can be searched."""
    return int(fit.used.sum()) <= SEARCHED and int(fit.free.any(0).sum()) <= MOST_PARAMETERS


def _lowest_centre(fit: Calibration, progress: Progress) -> Calibration:
    """The lowest fit from other principal points, if these are to be searched: few points that determine it
    weakly.
    """
    wanted = progress.options.lowest and _searchable(fit) and weak(fit)
    return spread(fit, progress.how) if wanted else fit


def spread(fit: Calibration, how: How) -> Calibration:
    """The lowest fit from principal points across their joint 95 % interval; the given one if none is lower.

    It is searched once: about the minimum that is found, a second search found no lower one in any case tried (30
    points of a cube, clicked by hand and simulated).
    """
    # intervals along curves are longer; on the 30 points of a cube their profile took 20 of 28 s, and the starts
    # about the linear ones find the same minima
    other = _lowest_of(starts.about(fit, covariance(fit).sigmas, how.fix), fit, how)
    return to_its_end(other, how) if other is not None and lowest([fit, other]) is other else fit


def _lowest_of(begins: Sequence[tuple[Camera, Poses]], fit: Calibration, how: How) -> Calibration | None:
    """The lowest fit from several starts, most of which are abandoned early."""
    stopping = how.stopping or Stopping()
    short = replace(
        how, stopping=replace(stopping, max_iterations=min(SCREENED, stopping.max_iterations or SCREENED))
    )
    distinct: list[Calibration] = []
    for found in sorted(_fits(begins, fit, short), key=lambda f: f.fit.cost):
        if not distinct or found.fit.cost > distinct[-1].fit.cost * (1 + SAME):
            distinct.append(found)
    ends = _fits([(f.camera, f.poses) for f in distinct[:FOLLOWED]], fit, how)
    return lowest(ends) if ends else None


def _fits(begins: Sequence[tuple[Camera, Poses]], fit: Calibration, how: How) -> list[Calibration]:
    found = []
    for camera, poses in begins:
        try:
            found.append(refine(camera, poses, fit.observations, how))
        except EstimationError:
            continue  # the points do not project from there
    return found


def to_its_end(fit: Calibration, how: How) -> Calibration:
    """The fit after its search has converged, or has been continued often enough."""
    for _ in range(CONTINUED):
        if fit.fit.converged:
            break
        fit = refine(fit.camera, fit.poses, fit.observations, how)
    return fit


# ------------------------------------------------------------------------------------------------- models inside
def from_nested(progress: Progress) -> Calibration | None:
    """The lowest fit that starts from the optimum of a nested model; None if there is none."""
    fits: list[Calibration] = []
    stuck = progress.best is not None and not progress.fit.fit.converged
    for spec in reversed(contained(progress.lens, every=stuck)):
        inner = make(spec, progress.lens.has_skew)
        found = _settled(_with(progress, inner), fits)
        if found is not None:
            fits.append(found)
    ends = _from(fits, progress)
    return lowest(ends) if ends else None


def _with(progress: Progress, lens: Lens) -> Progress:
    """The start of a progress with another lens and the same points."""
    fix = {n: v for n, v in progress.options.fix.items() if starts.has(lens, n)}
    options = replace(progress.options, model=lens.name, fix=fix, robust="none")
    return Progress(options, lens, options.how(lens), progress.given, progress.data)


def _settled(progress: Progress, inside: Sequence[Calibration]) -> Calibration | None:
    """The lowest fit of a model from its own starts and those of its nested models."""
    progress = advance((*starts_from_nothing(), *FROM_START), progress)
    found = [] if progress.best is None else [progress.fit]
    found += _from(inside, progress)
    if not found:
        return None
    return _lowest_centre(lowest(found), progress)


def _from(inside: Sequence[Calibration], progress: Progress) -> list[Calibration]:
    """Fits of the current model that start at those of its nested models."""
    lens, found = progress.lens, []
    for fit in inside:
        if embed(lens, fit.camera.lens, fit.camera.params) is None:
            continue
        begin = starts.adopted(lens, fit, progress.how.fix)
        try:
            found.append(refine(*begin, progress.data, progress.how))
        except (EstimationError, DataError):
            continue  # a value that is held does not suit that minimum
    return found


# ------------------------------------------------------------------------------------------------------ attempts
def _not_looked_at(progress: Progress, lowest: bool) -> bool:
    """Return whether other starts were not tried for these points."""
    return progress.start is not None and progress.notes.get("minima_of") != _looked_at(progress, lowest)


def _wants_other_starts(progress: Progress) -> bool:
    """Return whether the fit is missing or doubtful; False while outliers are still to be found, which make any
    fit doubtful.
    """
    settled = progress.options.robust == "none" or progress.restarts > 0
    bad = progress.best is None or starts.doubtful(progress.fit) or _has_several_minima(progress)
    return _not_looked_at(progress, False) and bad and (settled or _has_several_minima(progress))


def _wants_lowest(progress: Progress) -> bool:
    """Return whether the points are final and their fit may not be the lowest."""
    if progress.best is None or not progress.options.lowest or not _not_looked_at(progress, True):
        return False
    return _has_several_minima(progress) or starts.doubtful(progress.fit) or weak(progress.fit)


def _has_several_minima(progress: Progress) -> bool:
    return progress.best is not None and progress.lens.several_minima


def _looked_at(progress: Progress, lowest: bool) -> tuple[bytes, tuple[str, ...], bool]:
    """The points that a fit uses and whether principal points are searched, for comparison."""
    data, searched = progress.data, lowest and progress.best is not None and _searchable(progress.fit)
    return data.used.tobytes(), data.view_ids, searched


def _other_starts(progress: Progress) -> Change:
    """The lowest fit from nested models and other principal points."""
    found = [] if progress.best is None else [progress.fit]
    nested = from_nested(progress)
    found += [] if nested is None else [nested]
    notes = {"minima_of": _looked_at(progress, progress.options.lowest)}
    best = _lowest_centre(lowest(found), progress) if found else None
    if best is None or (progress.best is not None and best is progress.fit):
        return Change(notes=notes)
    return Change(fit=Candidate(best), notes=notes)


def _wants_other_cameras(progress: Progress) -> bool:
    return _has_several_minima(progress) and not progress.options.fix


def _other_cameras(progress: Progress) -> Change | None:
    """The best of the minima of a model that has several; the start decides which one is reached."""
    begins = [(camera, progress.fit.poses) for camera in starts.other_minima(progress.fit)]
    found = _fits(begins, progress.fit, progress.how)
    return Change(fit=Candidate(lowest(found))) if found else None


def _nested_starts(progress: Progress) -> Change:
    """The lowest fit from nested models; principal points are searched once the points are final (`LOWEST`)."""
    return _other_starts(replace(progress, options=replace(progress.options, lowest=False)))


OTHER_STARTS = Attempt("other-starts", _wants_other_starts, _nested_starts)
LOWEST: tuple[Attempt, ...] = (
    Attempt("other-starts", _wants_lowest, _other_starts),
    Attempt("other-minima", _wants_other_cameras, _other_cameras),
)


def from_nothing() -> tuple[Attempt, ...]:
    """Estimate a camera from the current rows."""
    return (*starts_from_nothing(), *FROM_START, OTHER_STARTS)
