"""Two-view geometry: fundamental matrices, the focal length derived from them, and the motion.

R. Hartley & A. Zisserman, Multiple view geometry (2003), chapters 9, 11 and 19.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry import projective, rotations
from camcal.least_squares.scales import MAD, of_small_sample
from camcal.model.pose import Array, Pose

#: samples of eight: with three of ten matches wrong, at least one is free of them in all but 1 of 1e4 pairs
SAMPLES = 150
#: matches on which the samples are scored, by their median: that of 500 is within 5 % of that of all
SCORED = 500
LEAST = 8  #: points of a sample: those of the linear eight-point algorithm
FREEDOM = 7  #: parameters of a fundamental matrix: nine numbers, less scale and det F = 0
#: robust standard deviations of the Sampson distance within which matches are inliers, and the least limit, px
FAR, LEAST_FAR = 3.5, 0.5
#: reweightings of the linear estimate to Sampson distances: without any, the distances of matches with .5 px of noise
#: are 1.5 times as large; after the first, five digits do not change (40 pairs of 60 matches)
WEIGHTINGS = 3
ROUNDS = 10  #: largest number of refits to the matches that agree
#: focal lengths tried, in widths of the picture: horizontal fields of view of 10 to 125 degrees
FOCAL = np.geomspace(0.26, 6.0, 60)
#: imaginary part of a root, relative to the real part, that counts as noise
COMPLEX = 1e-3
#: least number of matches of two views or cameras: twice those of a sample, so that as many verify the result
LEAST_MATCHES = 2 * LEAST
#: rad; least angle between rays that determine a point: 1 degree, at which 1 px at f = 1000 px is 6 % of the distance
LEAST_ANGLE = np.radians(1.0)
#: least sin² of the angle between two rays, a divisor: below it, 1e-8 rad, the angle is rounding error
PARALLEL = 1e-16


def fundamental(
    first: Array, second: Array, seed: int = 0, least: float = LEAST_FAR
) -> tuple[Array, Array] | None:
    """F (3, 3) with x2ᵀ F x1 = 0 for matches (N, 2), and which of them agree (N,); None for fewer than eight.

    Least median of squares over samples of eight, then the normalised eight-point algorithm (section 11.2), weighted
    to approximate Sampson distances (11.4), over the matches that agree.
    """
    if len(first) < LEAST:
        return None
    t1, t2 = projective.normalisation(first[None])[0], projective.normalisation(second[None])[0]
    scale = np.sqrt(t1[0, 0] * t2[0, 0])  # normalised units of a px
    f, good = agreeing(_mapped(first, t1), _mapped(second, t2), least * scale, seed)
    f = t2.T @ f @ t1
    return f / np.linalg.norm(f), good


def agreeing(a: Array, b: Array, least: float, seed: int = 0, axes: int = 2) -> tuple[Array, Array]:
    """F (3, 3) with bᵀ F a = 0, and which pairs agree (N,), for at least eight homogeneous points or unit rays (N,
    3).

    Parameters
    ----------
    least : float
        Pairs below this Sampson distance always agree; in the unit of the coordinates for `axes` = 2, an angle (rad)
        between unit rays for `axes` = 3.
    """
    rng = np.random.default_rng(seed)
    count = len(a)
    samples = np.stack([rng.choice(count, LEAST, replace=False) for _ in range(SAMPLES)])
    found = linear(a[samples], b[samples])
    some = rng.choice(count, SCORED, replace=False) if count > SCORED else np.arange(count)
    medians = np.median(np.abs(sampson(found, a[some], b[some], axes)), axis=1)
    f = found[int(medians.argmin())]
    spread = MAD * float(np.median(np.abs(sampson(f[None], a, b, axes)))) * of_small_sample(count, FREEDOM)
    good = np.ones(count, bool)
    for _ in range(ROUNDS):
        off = sampson(f[None], a, b, axes)[0]
        again = np.abs(off) <= max(FAR * spread, least)
        if again.sum() < LEAST:
            break
        f = _weighted(f, a[again], b[again], axes)
        off = sampson(f[None], a, b, axes)[0]
        spread = float(np.sqrt(np.square(off[again]).sum() / max(again.sum() - FREEDOM, 1)))
        if (again == good).all():
            break
        good = again
    return f, good


def _mapped(uv: Array, t: Array) -> Array:
    return projective.homogeneous(uv) @ t.T


def linear(a: Array, b: Array, roots: Array | None = None) -> Array:
    """F (..., 3, 3) of rank 2 from homogeneous points (..., N, 3)."""
    rows = (b[..., :, None] * a[..., None, :]).reshape(*a.shape[:-1], 9)
    if roots is not None:
        rows = rows * roots[..., None]
    # the ninth vector of eight rows; of more, a full U (N, N) is not needed
    f = np.linalg.svd(rows, full_matrices=rows.shape[-2] < 9)[2][..., 8, :].reshape(*a.shape[:-2], 3, 3)
    u, s, vt = np.linalg.svd(f)
    s[..., 2] = 0
    return (u * s[..., None, :]) @ vt


def _weighted(f: Array, a: Array, b: Array, axes: int) -> Array:
    for _ in range(WEIGHTINGS):
        f = linear(a, b, 1 / np.maximum(_gradient(f[None], a, b, axes)[0], 1e-12))
    return f


def _gradient(f: Array, a: Array, b: Array, axes: int) -> Array:
    """|∂(bᵀ F a)| (H, N) with respect to the first `axes` coordinates of both points."""
    return _steepness(f @ a.T, np.swapaxes(f, 1, 2) @ b.T, axes)


def _steepness(fa: Array, fb: Array, axes: int) -> Array:
    return np.sqrt(np.square(fa[:, :axes]).sum(1) + np.square(fb[:, :axes]).sum(1))


def sampson(f: Array, a: Array, b: Array, axes: int = 2) -> Array:
    """Signed Sampson distances (H, N) of homogeneous points (N, 3) for matrices (H, 3, 3) (eq. 11.9).

    With `axes` = 3, for unit rays, they are angles: a change along a ray scales bᵀ F a, which is 0 to first order.
    """
    fa, fb = f @ a.T, np.swapaxes(f, 1, 2) @ b.T
    return (b.T * fa).sum(1) / np.maximum(_steepness(fa, fb, axes), 1e-300)


def axes_apart(f: Array, centre: Array) -> float:
    """The distance, px, of a principal point from the epipolar line of the other one, the larger of the two.

    If it is 0, the optical axes meet (or are parallel), and F does not determine the focal length
    (section 19.3, where Bougnoux's formula becomes 0 / 0; Sturm, On focal length calibration from two views, 2001).
    """
    p = np.array([*centre, 1.0])
    second, first = f @ p, f.T @ p
    return float(max(abs(p @ line) / max(np.hypot(line[0], line[1]), 1e-300) for line in (first, second)))


def focal_costs(matrices: Array, centre: Array, width: float) -> Array:
    """The deviation of E = Kᵀ F K from an essential matrix for each focal length of `FOCAL`, (H, 60).

    1 - σ2 / σ1 of its singular values (Mendonça & Cipolla, A simple technique for self-calibration, 1999).
    """
    k = np.zeros((len(FOCAL), 3, 3))
    k[:, 0, 0] = k[:, 1, 1] = FOCAL * width
    k[:, :2, 2], k[:, 2, 2] = centre, 1
    e = np.swapaxes(k, 1, 2)[None] @ matrices[:, None] @ k[None]
    s = np.linalg.svd(e, compute_uv=False)
    return 1 - s[..., 1] / np.maximum(s[..., 0], 1e-300)


def kruppa(matrices: Array, centre: Array, width: float) -> Array:
    """The focal lengths (P,), px, by Kruppa's equations for each F (P, 3, 3); NaN where f² < 0.

    With F = U diag(r, s, 0) Vᵀ about the principal point and ω* = diag(f², f², 1),

        r² v1ᵀω*v1 : r s v1ᵀω*v2 : s² v2ᵀω*v2 = u2ᵀω*u2 : -u1ᵀω*u2 : u1ᵀω*u1

    (R. Hartley, Kruppa's equations derived from the fundamental matrix, PAMI 1997; f alone: P. Sturm, On focal length
    calibration from two views, CVPR 2001). The first and last ratios give a quadratic equation in f²; of its positive
    roots, the one that agrees best with the middle ratio is taken.
    """
    to_px = np.array([[width, 0, centre[0]], [0, width, centre[1]], [0, 0, 1]])
    u, d, vt = np.linalg.svd(to_px.T @ matrices @ to_px)
    out = np.full(len(matrices), np.nan)
    for i, (left, (r, s, _), right) in enumerate(zip(u, d, vt, strict=True)):

        def form(a: Array, b: Array) -> Array:
            return np.array([a[:2] @ b[:2], a[2] * b[2]])  # of f², and constant

        u11, u12, u22 = (form(left[:, j], left[:, k]) for j, k in ((0, 0), (0, 1), (1, 1)))
        v11, v12, v22 = (form(right[j], right[k]) for j, k in ((0, 0), (0, 1), (1, 1)))
        quadratic = r**2 * np.polymul(v11, u11) - s**2 * np.polymul(v22, u22)
        roots = np.roots(quadratic)
        # noise turns a double root into a complex pair
        real = roots.real[(roots.real > 0) & (np.abs(roots.imag) <= COMPLEX * np.abs(roots.real))]
        if len(real):
            middle = r * np.polymul(v11, u12) + s * np.polymul(v12, u22)
            size = np.polymul(np.abs(v11), np.abs(u11)) + np.polymul(np.abs(v22), np.abs(u22))
            off = np.abs(np.polyval(middle, real)) / np.polyval(size, real)
            out[i] = width * np.sqrt(real[int(off.argmin())])
    return out


def motions(essential: Array) -> list[Pose]:
    """The four motions (second from first, |t| = 1) of an essential matrix (section 9.6.2)."""
    u, _, vt = np.linalg.svd(essential)
    w = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turns = [u @ m @ vt for m in (w, w.T)]
    turns = [r * np.sign(np.linalg.det(r)) for r in turns]
    return [Pose(rotations.nearest(r), s * u[:, 2]) for r in turns for s in (1.0, -1.0)]


def two_view_points(motion: Pose, first: Array, second: Array) -> tuple[Array, Array]:
    """Points (N, 3) in the first camera's frame nearest to two rays (N, 3) each, and the angles (N,) between them."""
    d2 = second @ motion.rotation
    centre = -motion.rotation.T @ motion.translation
    dot = (first * d2).sum(1)
    across = np.maximum(1 - dot**2, PARALLEL)
    a, b = first @ centre, d2 @ centre
    s, t = (a - dot * b) / across, (dot * a - b) / across
    points = (s[:, None] * first + centre + t[:, None] * d2) / 2
    points[(s <= 0) | (t <= 0)] = np.nan
    return points, np.arccos(np.clip(dot, -1, 1))
