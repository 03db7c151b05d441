"""Evaluation of a known rig on data: the rig is held, the pose of the board at each instant is refitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from camcal.data.observations import Observations
from camcal.data.rig_table import RigViews, joined
from camcal.errors import DataError
from camcal.model.pose import Poses
from camcal.model.rig import Rig
from camcal.plan.known_camera import evaluate
from camcal.plan.rig_boards import arranged
from camcal.plan.rig_cameras import naming, pictures_of
from camcal.plan.run import usable
from camcal.plan.solution import RigSolution
from camcal.routes.hand_eye.scale import SAME_UNIT
from camcal.solve import outliers, robust
from camcal.solve.calibration import RigCalibration
from camcal.solve.losses import LOSSES
from camcal.solve.refine import How, board_kind, refine
from camcal.solve.rig_start import Pictures, corners_of, placed
from camcal.solve.turns import symmetries

#: of their distance: cameras of a rig that was calibrated well have the board at the same place to a few percent
APART = 0.1


def evaluate_rig(
    rig: Rig,
    data: Observations | Mapping[str, Observations] | RigViews,
    method: str = "none",
    seed: int = 0,
) -> RigSolution:
    """Fit the pose of each instant's board to a fixed rig.

    Parameters
    ----------
    rig : Rig
    data : as of `calibrate_rig`
        Data that the rig was not calibrated with; they may be of some of its cameras only.
    method : str
        How outliers are treated, as in a calibration.
    seed : int

    Returns
    -------
    RigSolution
        With the given rig; residuals, poses and fit are of these data.

    Raises
    ------
    DataError
        If the data name a camera that the rig does not have, or a picture's points do not determine its pose.
    """
    views = RigViews.of(data, least=1)
    unknown = [n for n in views.parts if n not in rig.cameras]
    if unknown:
        raise DataError(f"the rig has no camera '{unknown[0]}'.", f"It has: {', '.join(rig.cameras)}.")
    some = _part(rig, list(views.parts))
    views = views.ordered(some.reference)
    alone = {}
    for name, part in views.parts.items():
        with naming(name):
            alone[name] = evaluate(some.cameras[name], usable(part), method, seed)
    fits, views, _ = arranged(alone, views, "auto", some.cam_from_rig)
    together = joined({n: f.observations for n, f in fits.items()}, views.instants, views.order)
    if method in ("none", "auto"):
        together = replace(together, weight=None)
    pictures = pictures_of(fits, views, together)
    places = Poses.stack([some.cam_from_rig[n] for n in views.parts])
    _check_scale(pictures, places, together)
    together, poses, _ = placed(pictures, places, together, symmetries(together), corners_of(together.xyz))
    fix = {f"{n}.{p}": None for n, c in some.cameras.items() for p in c.lens.names}
    how = How(fix, hold_rig=True, board=board_kind(together))
    fit = _judged(refine(some, poses, together, how), how, method)
    return RigSolution(**{f.name: getattr(fit, f.name) for f in fields(RigCalibration)})


def _check_scale(pictures: Pictures, rig: Poses, data: Observations) -> None:
    """Raise a DataError if the board's lengths are in another unit than the rig's.

    With s times as large a board, two cameras have it at the same place where s (Ra' xa - Rb' xb) = Ra' ta - Rb' tb for
    its centre xa, xb in their frames.
    """
    centre, scales, off = data.xyz.mean(0), [], []
    for view in np.unique(pictures.view):
        blocks = np.flatnonzero(pictures.view == view)
        for a, b in pairwise(blocks):
            one, other = rig[pictures.camera[a]], rig[pictures.camera[b]]
            x = pictures.poses[a].apply(centre)
            d = one.rotation.T @ x - other.rotation.T @ pictures.poses[b].apply(centre)
            e = one.rotation.T @ one.translation - other.rotation.T @ other.translation
            scales.append(float(d @ e / (d @ d)))
            off.append(
                np.linalg.norm([d - e, scales[-1] * d - e], axis=1) / np.linalg.norm(x) / [1, abs(scales[-1])]
            )
    if not scales:
        return
    scale, (now, then) = float(np.median(scales)), np.median(off, axis=0)
    # a negative one is no unit: cameras that are exchanged, or poses the other way round
    if now > APART and then < now / 2 and scale > 0 and not 1 / SAME_UNIT < scale < SAME_UNIT:
        square = float((data.target or {}).get("square") or 0.0)
        wanted = f"Try: --square {scale * square:.4g}" if square else f"Multiply X, Y and Z by {scale:.4g}"
        raise DataError(
            f"the rig's lengths are {scale:.4g} times as long as the board's: the rig is in another "
            f"unit, or its size was not given.",
            f"{wanted}, so that both are in the unit of the rig.",
        )


def _part(rig: Rig, names: list[str]) -> Rig:
    """Some of the cameras, in the frame of the rig's reference if that is among them."""
    reference = rig.reference if rig.reference in names else names[0]
    moved = rig.with_reference(reference)
    ordered = [reference, *(n for n in names if n != reference)]
    return Rig({n: rig.cameras[n] for n in ordered}, {n: moved.cam_from_rig[n] for n in ordered}, reference)


def _judged(fit: RigCalibration, how: How, method: str) -> RigCalibration:
    """The fit after the treatment of outliers."""
    if method == "none":
        return fit
    if method != "auto":
        return robust.reweight(fit, how, LOSSES[method])
    return fit if outliers.is_clean(fit) else robust.reject(fit, how)
