"""The information of matches between the pictures of one instant about the poses of a rig's cameras, without a board.

A point that cameras a and b see along the unit rays d_a and d_b (each in its camera's frame) fulfils

    c = t̂ · (R d_a x d_b) = 0,     (R, t) = b_from_a,  t̂ = t / |t|                                        (1)

whatever its distance (Hartley & Zisserman, Multiple View Geometry, 2004, section 9.6). Divided by the length of its
gradient by the four pixel coordinates, c is Sampson's distance e in px of the pictures as taken (section 11.4.3): the
least movement of both points together that fulfils (1). With steps δ of the cameras and errors θ of the calibration,

    e = e₀ + A δ + B θ + noise                                                                            (2)

gives normal equations of δ, as a board does (`rig_equations`). They lack the place of the rig as a whole and the
length of one distance: a pair shows rotation and the direction of its baseline, five numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.least_squares.scales import MAD, TUKEY
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.records import dataclass
from camcal.track.rig_equations import Instant, inverse

Array = np.ndarray

#: Gauss-Newton steps; from a degree off, three are enough, and weights settle in some more
STEPS = 12
#: of the scatter of a match; steps that move no residual by more are the end
SETTLED = 1e-3


@dataclass(frozen=True)
class Rays:
    """Unit rays of a camera (N, 3), and how they move: with pixels (N, 3, 2), and with the calibration (N, 3, F)."""

    direction: Array
    by_pixel: Array
    by_calibration: Array

    def where(self, kept: Array) -> Rays:
        """Some of them."""
        return Rays(self.direction[kept], self.by_pixel[kept], self.by_calibration[kept])


def rays_of(camera: Camera, uv: Array, free: Array) -> Rays:
    """The rays of pixels (N, 2); NaN outside the lens's domain.

    Parameters
    ----------
    free : (P, F) array
        d parameters of the camera / d variables of the calibration.
    """
    direction = camera.unproject(uv)
    shown = np.isfinite(direction).all(1)
    by_pixel = np.full((len(uv), 3, 2), np.nan)
    by_calibration = np.full((len(uv), 3, free.shape[1]), np.nan)
    _, by_ray, by_params, _ = camera.lens.jacobians(camera.params, direction[shown])
    by_pixel[shown] = np.linalg.pinv(by_ray)  # u depends on the direction alone: its null space is the ray
    by_calibration[shown] = -by_pixel[shown] @ (by_params @ free)
    return Rays(direction, by_pixel, by_calibration)


@dataclass(frozen=True)
class PairMatches:
    """Matches of cameras `first` and `second`, by their rays (N,) of each."""

    first: int
    second: int
    rays: tuple[Rays, Rays]

    def __len__(self) -> int:
        return len(self.rays[0].direction)


@dataclass(frozen=True)
class Matched:
    """The equations of an instant, and the residuals of its matches after the best-fitting motion of the cameras.

    `left` has an array (N,) for each pair, px.
    """

    instant: Instant
    left: tuple[Array, ...]


def instant_of_matches(
    name: str, pairs: Sequence[PairMatches], rig: Sequence[Pose], by_rig: Array
) -> Matched:
    """The equations (2) of the matches of one instant.

    Gauss-Newton with the weights of Tukey gives the places at which the matches fit best; the equations have their
    solution there, with the derivatives at the calibrated places, so that all instants lack the same directions. The
    noise is the scatter that is left.

    Parameters
    ----------
    rig : sequence of C Pose
        cam_from_rig.
    by_rig : (C, 6, F) array
        d cam_from_rig (rotation on the left, translation) / d variables of the calibration.
    """
    places = list(rig)
    for _ in range(STEPS):
        e, a, _ = _stacked(pairs, places, by_rig)
        scale = max(MAD * float(np.median(np.abs(e))), np.finfo(float).tiny)
        inside = np.clip(1 - np.square(e / (TUKEY * scale)), 0, None)
        weight = inside**2
        inverted, rank = inverse(a.T @ (weight[:, None] * a))
        step = -inverted @ (a.T @ (weight * e))
        if np.abs(a @ step).max() <= SETTLED * scale:
            break
        places = [p.moved(step[6 * k : 6 * k + 6]) for k, p in enumerate(places)]
    per_match = _information(e, inside, rank) * len(e) / float(weight.sum())
    moved = [r.step_to(p) for p, r in zip(places, rig, strict=True)]
    _, a, b = _stacked(pairs, rig, by_rig)
    normal = per_match * a.T @ (weight[:, None] * a)
    made = Instant(
        name,
        tuple(sorted({k for p in pairs for k in (p.first, p.second)})),
        normal,
        normal @ np.concatenate(moved),
        -per_match * a.T @ (weight[:, None] * b),
        1 / (per_match * float(weight.sum())),
    )
    return Matched(made, tuple(np.split(e, np.cumsum([len(p) for p in pairs])[:-1])))


def _information(e: Array, inside: Array, rank: int) -> float:
    """Information of a match, px⁻²: (mean ψ')² / mean ψ², Tukey's ψ (P. Huber, Robust statistics, 1981, eq. 7.6.2)."""
    psi, slope = inside**2 * e, inside * (5 * inside - 4)  # inside = 1 - u², ψ' = (1 - u²)(1 - 5 u²)
    spread = float(np.square(psi).sum()) / max(len(e) - rank, 1)
    return float(slope.mean()) ** 2 / max(spread, np.finfo(float).tiny)


def _stacked(
    pairs: Sequence[PairMatches], places: Sequence[Pose], by_rig: Array
) -> tuple[Array, Array, Array]:
    """e (N,), A (N, 6 C) and B (N, F) of all pairs."""
    residuals, by_place, by_calibration = [], [], []
    for pair in pairs:
        e, own, by_rays = epipolar(pair, places)
        a = np.zeros((len(e), 6 * len(places)))
        for side, camera in enumerate((pair.first, pair.second)):
            a[:, 6 * camera : 6 * camera + 6] = own[side]
        residuals.append(e)
        by_place.append(a)
        by_calibration.append(by_rays + a @ by_rig.reshape(a.shape[1], by_rig.shape[2]))
    return np.concatenate(residuals), np.concatenate(by_place), np.concatenate(by_calibration)


def epipolar(pair: PairMatches, places: Sequence[Pose]) -> tuple[Array, tuple[Array, Array], Array]:
    """e (N,) of (2), its derivatives (N, 6) by the step of either camera, and (N, F) by the lenses alone."""
    one, two = places[pair.first], places[pair.second]
    a, b = pair.rays
    turn = two.rotation @ one.rotation.T
    t = two.translation - turn @ one.translation
    length = float(np.linalg.norm(t))
    along = t / length
    q = a.direction @ turn.T
    plane = np.cross(q, b.direction)
    to_second = np.cross(b.direction, along)  # d c / d q
    by_first, by_second = to_second @ turn, np.cross(along, q)  # d c / d d_a, d c / d d_b
    size = np.sqrt(
        np.square(np.einsum("ni,nij->nj", by_first, a.by_pixel)).sum(1)
        + np.square(np.einsum("ni,nij->nj", by_second, b.by_pixel)).sum(1)
    )
    by_shift = (plane - np.outer(plane @ along, along)) / length  # d c / d t: t̂ turns, its length is not seen
    carried = turn @ one.translation
    # cam_from_rig moves to exp(δ) R, t + δ: of b, dq = δ x q and dt = δt - δ x (R t_a); of a, both with R δ, negative
    of_second = np.c_[np.cross(q, to_second) - np.cross(carried, by_shift), by_shift]
    of_first = -np.c_[of_second[:, :3] @ turn, by_shift @ turn]
    lenses = np.einsum("ni,nif->nf", by_first, a.by_calibration)
    lenses += np.einsum("ni,nif->nf", by_second, b.by_calibration)
    scaled = 1 / size[:, None]
    return (plane @ along) / size, (of_first * scaled, of_second * scaled), lenses * scaled
