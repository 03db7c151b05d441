"""The start of a calibration from lines, and the candidates that are single straight lines in space.

A division model is fitted first: its domain is unlimited for barrel distortion, and one coefficient bends lines as
much as fisheye lenses do. The requested lens is then fitted to its rays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camcal.errors import DataError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.lenses.regress import regress
from camcal.model.pose import Array
from camcal.routes.line_centre import fit_centred, with_doubt
from camcal.routes.line_geometry import Lines, distances
from camcal.routes.lines import LEAST_POINTS, LineFit, held
from camcal.solve.parameters import nominal

BRIDGE = "division:2"
#: First coefficients of the division model, f the longer side, from strong barrel to pincushion. Neighbouring
#: values are close enough for the fit to converge from the best.
SHAPES = (-4.0, -2.0, -1.0, -0.5, -0.25, -0.12, 0.0, 0.12, 0.25)
#: A candidate is one straight line if its rms is below this many times the median of all. A term missing in the model
#: bends some lines three or four times as much as others, and these lines determine it; curves in the scene bend tens
#: of times as much.
FAR = 5.0
#: px; lines this straight are not distinguished: detected points have at least this noise
FINE = 0.05
ROUNDS = 6  #: largest number of rounds of fitting and selecting lines


def estimate(
    lines: Lines, lens: Lens, fix: Mapping[str, float | None], robust: bool, resistant: bool = False
) -> LineFit:
    """The lens that makes the lines straightest, and with `robust` a selection of the candidates that are straight.

    `resistant`: passed to `fit`, in which points that lie on no line lose weight. The covariance of a selection
    contains the scatter between lines.

    Raises
    ------
    DataError, EstimationError
        As `fit`; if fewer than two candidates agree.
    """
    assert lines.image_size is not None
    short = np.bincount(lines.line, minlength=len(lines)) < LEAST_POINTS
    used = ~short
    bridge = _shaped(lines, used, fix, robust)
    if robust:
        used = _straight(bridge, lines, short)
    for _ in range(ROUNDS):
        chosen = lines.take(used)
        bridge = fit_centred(chosen, bridge, _held_for(bridge.lens, fix)).camera
        again = _straight(bridge, lines, short) if robust else used
        if (again == used).all():
            break
        used = again
    found = _of_model(lines, used, bridge, lens, fix)
    for _ in range(ROUNDS if robust else 0):
        again = _straight(found.camera, lines, short)
        if (again == used).all():
            break
        used = again
        found = _of_model(lines, used, found.camera, lens, fix)
    kept, what = lines.take(used), held(lens, fix)
    if resistant or robust:
        found = fit_centred(kept, found.camera, what, resistant, scatter=robust)
    return replace(with_doubt(kept, found, what, resistant), used=used)


def _held_for(lens: Lens, fix: Mapping[str, float | None]) -> dict[str, float | None]:
    """The held parameters of the division model: those held by the user that it also has."""
    return held(lens, {n: v for n, v in fix.items() if n in lens.names[:4]})


def _shaped(lines: Lines, used: Array, fix: Mapping[str, float | None], robust: bool) -> Camera:
    """The one-coefficient division model that makes the lines straightest, by the median or the mean square."""
    lens = lenses.make(BRIDGE)
    assert lines.image_size is not None
    plain = nominal(lens, lines.image_size, {n: v for n, v in fix.items() if n in lens.names[:4]})
    chosen, best = lines.take(used), (np.inf, plain)
    scale = (plain.params[0] / max(lines.image_size)) ** 2
    for shape in SHAPES:
        params = plain.params.copy()
        params[lens.index("l1")] = shape * scale
        trial = Camera(lens, params, lines.image_size)
        rms = line_rms(trial, chosen)
        score = float(np.median(rms) if robust else np.sqrt(np.mean(rms**2)))
        if score < best[0]:
            best = score, trial
    return best[1]


def _of_model(
    lines: Lines, used: Array, known: Camera, lens: Lens, fix: Mapping[str, float | None]
) -> LineFit:
    """The requested lens model, from the rays of a known lens."""
    what = held(lens, fix)
    assert lines.image_size is not None
    if lens == known.lens:
        start = known
    else:
        pinhole = nominal(lens, lines.image_size, fix)
        shared = {n: known.values[n] for n in ("cx", "cy") if n not in what}
        params = pinhole.params.copy()
        for name, value in shared.items():
            params[lens.index(name)] = value
        rays = known.unproject(lines.uv)
        if getattr(
            lens, "free_centre", False
        ):  # in focal lengths from the principal point: a shift of the plane
            for axis, (name, at, f) in enumerate((("xc", "cx", "fx"), ("yc", "cy", "fy"))):
                if name not in fix:
                    shift = (known.values[at] - pinhole.values[at]) / pinhole.values[f]
                    params[lens.index(name)] = shift
                    rays[:, axis] += shift * rays[:, 2]
        keep = np.isfinite(rays).all(1) & used[lines.line]
        # a model whose parameters define the layout of others takes them from the picture
        begin = None if lens.shaped_by_data else params
        found = regress(lens, rays[keep], lines.uv[keep], lines.image_size, list(what), begin)
        # a model that cannot bend as much starts without distortion
        start = Camera(lens, found.params if found.covered.all() else params, lines.image_size)
    return fit_centred(lines.take(used), start, what)


def _straight(camera: Camera, lines: Lines, short: Array) -> Array:
    """The lines (L,) that are straight in comparison with the rest."""
    rms = line_rms(camera, lines)
    bound = max(FAR * float(np.median(rms[~short])), FINE)
    chosen = ~short & (rms <= bound)
    if chosen.sum() < 2:
        raise DataError(
            f"of {len(lines)} lines found, {int(chosen.sum())} are consistent with straight lines in "
            "space; 2 are needed.",
            "Give pictures of long straight lines: taut strings, a printed grid, edges of buildings.",
        )
    return chosen


def line_rms(camera: Camera, lines: Lines) -> Array:
    """rms (L,) of the distances of each line's points from the image of a straight line, px; inf outside the domain."""
    off = distances(camera, lines)
    counts = np.maximum(np.bincount(lines.line, minlength=len(lines)), 1)
    rms = np.sqrt(np.bincount(lines.line, np.nan_to_num(off, nan=np.inf) ** 2, len(lines)) / counts)
    return np.where(np.isfinite(rms), rms, np.inf)
