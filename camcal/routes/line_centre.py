"""The fit to lines with the centre of the lens free only where the lines determine it.

Lines of one direction leave the centre undetermined along them, and lines without distortion leave it undetermined
altogether: a fit with it free follows rounding and noise for a hundred steps and more, to anywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from camcal.errors import EstimationError
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.routes import assumed_centre
from camcal.routes.line_geometry import Lines
from camcal.routes.lines import LineFit, fit, foreseen
from camcal.solve.parameters import nominal


def fit_centred(
    lines: Lines,
    start: Camera,
    fix: Mapping[str, float | None],
    resistant: bool = False,
    scatter: bool = False,
) -> LineFit:
    """As `lines.fit`, with undetermined coordinates of the centre in the middle of the picture (`assumed`).

    The centre of the start is held first. Whether the lines determine it is foreseen there, by the normal equations
    with it free, and confirmed by its standard deviations.
    """
    names = _centre(start, fix)
    solve = partial(fit, resistant=resistant, scatter=scatter)
    if not names:
        return solve(lines, start, fix)
    found = solve(lines, start, {**fix, **dict.fromkeys(names)})
    sigmas = foreseen(lines, found, fix)
    assumed = assumed_centre.undetermined(found.camera, sigmas, names)
    while len(assumed) < len(names):
        held = {**fix, **dict.fromkeys(assumed)}
        found = solve(lines, _in_the_middle(found.camera, assumed, fix), held)
        free = [n for n in names if n not in assumed]
        further = assumed_centre.undetermined(found.camera, np.sqrt(np.diagonal(found.covariance)), free)
        if not further:
            return replace(found, assumed=assumed)
        assumed += further
    middle = _in_the_middle(found.camera, names, fix)
    if (middle.params != found.camera.params).any() or found.free.shape[1] == 0:
        found = solve(lines, middle, {**fix, **dict.fromkeys(names)})
    return replace(found, assumed=assumed)


def with_doubt(lines: Lines, found: LineFit, fix: Mapping[str, float | None], resistant: bool) -> LineFit:
    """The covariance including the uncertainty of assumed coordinates of the centre."""

    def refitted(moved: Camera, _: str) -> Array | None:
        try:
            return fit(lines, moved, {**fix, **dict.fromkeys(found.assumed)}, resistant).camera.params
        except EstimationError:  # points outside the domain
            return None

    more = assumed_centre.doubt(found.camera, found.assumed, refitted)
    return replace(found, covariance=found.covariance + more)


def _centre(start: Camera, fix: Mapping[str, float | None]) -> tuple[str, ...]:
    """The free coordinates of the centre."""
    own = getattr(start.lens, "free_centre", False)
    names = assumed_centre.FOCAL_LENGTHS if own else assumed_centre.PIXELS
    return tuple(n for n in names if n in start.lens.names and n not in fix)


def _in_the_middle(camera: Camera, names: tuple[str, ...], fix: Mapping[str, float | None]) -> Camera:
    assert camera.image_size is not None
    values, params = nominal(camera.lens, camera.image_size, fix).values, camera.params.copy()
    for name in names:
        params[camera.lens.names.index(name)] = values[name]
    return replace(camera, params=params)
