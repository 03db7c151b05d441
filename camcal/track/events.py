"""Explanation of a change after an alarm: the simplest motion that explains the difference, in words."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np

from camcal.geometry import rotations
from camcal.records import dataclass
from camcal.track.decompose import FOCAL, PRINCIPAL, ROTATION, TRANSLATION, Cameras
from camcal.track.keep import stored

Array = np.ndarray


def _basis() -> dict[str, Array]:
    eye = np.eye(11)
    zoom = np.zeros((11, 1))
    zoom[FOCAL, 0] = 1.0
    return {
        "focal length": zoom,
        "rotation": eye[:, ROTATION],
        "translation": eye[:, TRANSLATION],
        "principal point": eye[:, PRINCIPAL],
        "pose": eye[:, 5:],
        "zoom": np.hstack([zoom, eye[:, PRINCIPAL]]),
        "camera": eye,
    }


#: explanations of a change, in physical coordinates with focal lengths as fractions
EXPLANATIONS = _basis()

#: of the criterion per parameter: the logarithm of the number of coordinates, for a frame of 50 points
PENALTY = float(np.log(100.0))

#: minus twice the logarithm of prior odds: a camera is turned, say, seven times as often as its sensor moves,
#: with or without the focal length, and from a single frame the two look nearly alike
ODDS = {"principal point": 4.0, "zoom": 4.0}

#: of the criterion: explanations that differ by rounding alone are equal, and the first one is taken
EQUAL = 1e-9
#: variance added to deviates of unit variance, so that a covariance that rounding made singular has a root
RIDGE = 1e-12
#: rad; a direction this near to a coordinate axis is called by it: between two axes lie 45 degrees
ALONG = np.deg2rad(15)


@stored
@dataclass(frozen=True)
class Alarm:
    """The camera before and after a change.

    Attributes
    ----------
    frame : int
        In which the alarm went.
    since : int
        Where the change began, as far as the tests tell.
    test : str
        `nis` or `cusum`.
    before, after : Cameras of one frame each
    """

    frame: int
    since: int
    test: str
    before: Cameras
    after: Cameras


@stored
@dataclass(frozen=True)
class Change:
    """The explanation of an alarm.

    Attributes
    ----------
    frame, since : int
    kind : str
        A key of `EXPLANATIONS`.
    message : str
    figures : mapping
        The change in physical units, as far as it belongs to the kind: focal (fraction), principal (px),
        rotation (deg), translation, and their sigmas.
    """

    frame: int
    since: int
    kind: str
    message: str
    figures: dict[str, Any] = field(default_factory=dict)


def difference(before: Cameras, after: Cameras) -> tuple[Array, Array]:
    """The step from one camera to the other (11,) and its covariance (11, 11).

    In physical coordinates, focal lengths and skew as fractions of the focal length; the errors of the
    two are taken as independent.
    """
    turn = after.rotation[0] @ before.rotation[0].T
    k0, k1 = before.k[0], after.k[0]
    step = np.concatenate(
        [
            [k1[0, 0] - k0[0, 0], k1[1, 1] - k0[1, 1], k1[0, 1] - k0[0, 1]],
            k1[:2, 2] - k0[:2, 2],
            rotations.log(turn),
            after.translation[0] - turn @ before.translation[0],
        ]
    )
    unit = np.ones(11)
    unit[:3] = 1 / k0[0, 0], 1 / k0[1, 1], 1 / k0[0, 0]
    factor = np.hstack([before.factor[0, :11], after.factor[0, :11]]) * unit[:, None]
    return step * unit, factor @ factor.T


def explain(alarm: Alarm) -> Change:
    """Choose the explanation of the lowest Bayesian information criterion (Schwarz 1978), with odds.

    Each is fitted by generalised least squares: the parameters of a single frame are strongly
    correlated (turning a camera and shifting its principal point look nearly alike), so that reading single
    differences off would name the wrong part.
    """
    step, covariance = difference(alarm.before, alarm.after)
    rows = np.diag(covariance) > 0  # what is held has neither changed nor an uncertainty
    scale = np.sqrt(np.where(rows, np.diag(covariance), 1.0))
    covariance = (covariance / scale / scale[:, None])[np.ix_(rows, rows)]
    half = np.linalg.cholesky(covariance + RIDGE * np.eye(len(covariance)))
    target = np.linalg.solve(half, (step / scale)[rows])
    best = None
    for kind, basis in EXPLANATIONS.items():
        used = basis[:, basis[rows].any(0)]
        if not used.size:
            continue
        design = np.linalg.solve(half, (used / scale[:, None])[rows])
        amount, _, rank, _ = np.linalg.lstsq(design, target, rcond=None)
        cost = float(((target - design @ amount) ** 2).sum()) + rank * PENALTY
        cost += ODDS.get(kind, 0.0)
        if best is None or cost < best[0] - EQUAL:
            spread = used @ np.linalg.pinv(design)
            best = cost, kind, used @ amount, np.sqrt((spread**2).sum(1))
    assert best is not None
    _, kind, change, sigma = best
    return Change(alarm.frame, alarm.since, kind, *_in_words(kind, alarm.frame, change, sigma))


def _in_words(kind: str, frame: int, change: Array, sigma: Array) -> tuple[str, dict[str, Any]]:
    figures: dict[str, Any] = {}
    parts = []
    if kind in ("rotation", "pose", "camera"):
        angle, spread = np.rad2deg(change[ROTATION]), np.rad2deg(sigma[ROTATION])
        figures |= {"rotation_deg": angle.tolist(), "sigma_rotation_deg": spread.tolist()}
        parts.append(f"{np.linalg.norm(angle):.2g} deg about {axis(angle)}")
    if kind in ("translation", "pose", "camera"):
        shift = change[TRANSLATION]
        figures |= {"translation": shift.tolist(), "sigma_translation": sigma[TRANSLATION].tolist()}
        parts.append(f"{np.linalg.norm(shift):.2g} along {axis(shift)}")
    if kind in ("focal length", "zoom", "camera"):
        ratio = float(change[FOCAL].mean())
        figures |= {"focal": ratio, "sigma_focal": float(sigma[FOCAL].max())}
    if kind in ("principal point", "zoom", "camera"):
        figures |= {"principal": change[PRINCIPAL].tolist(), "sigma_principal": sigma[PRINCIPAL].tolist()}
    if "focal" in figures and kind != "focal length":
        parts.append(f"focal length by {100 * figures['focal']:+.2g} %")
    if "principal" in figures:
        parts.append("principal point by ({:+.2g}, {:+.2g}) px".format(*figures["principal"]))
    if kind == "focal length":
        return f"focal length changed by {100 * figures['focal']:+.2g} % at frame {frame}", figures
    if kind == "principal point":
        return f"principal point moved at frame {frame}: {parts[0][len('principal point by ') :]}", figures
    verb = "moved" if kind in ("rotation", "translation", "pose") else "changed"
    return f"camera {verb} at frame {frame}: {', '.join(parts)}", figures


def axis(vector: Array) -> str:
    """The direction of a vector: `y`, `-x`, or three numbers if no axis is within 15 degrees."""
    unit = vector / max(float(np.linalg.norm(vector)), 1e-300)
    main = int(np.abs(unit).argmax())
    if abs(unit[main]) > np.cos(ALONG):
        return ("-" if unit[main] < 0 else "") + "xyz"[main]
    return "({:.2f}, {:.2f}, {:.2f})".format(*unit)
