"""Orthogonal vanishing points of unlabelled lines: samples of two pairs of lines, and a vote.

Two pairs of lines give two vanishing points; where these are of orthogonal directions, the principal point known,
f² = -(v1 - c) · (v2 - c) (Caprile & Torre, Using vanishing points for camera calibration, 1990, section 3), and the
third direction follows. The frame that most lines agree with is the start of a fit.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry.projective import homogeneous

Array = np.ndarray

#: samples: one in thirty is correct if a fifth of the lines is clutter and no family dominates the rest
SAMPLES = 4000
#: lines that vote: the longest ones
VOTERS = 250
#: px; a line votes by exp(-e²/2 s²), e the distance of its ends from the line through its middle and the point
SOFT = 1.0
#: focal lengths in widths of the picture: horizontal fields of view of 10 to 140 degrees
FOCAL = (0.18, 6.0)
#: frames that are refined
KEPT = 5
#: rad, and relative focal length: frames closer than this are one
SAME, SAME_FOCAL = 0.05, 0.1
SAMPLE = 4  #: lines of a sample: two meet in each of two vanishing points
BLOCK = 200  #: samples whose votes are counted at a time: with 250 lines, 5 MB per array


def frames(
    ends: Array, centre: Array, width: float, seed: int = 0, focal: float | None = None
) -> list[tuple[float, Array]]:
    """Focal lengths, px, and rotations (3, 3) cam_from_scene of the frames with the most agreeing lines, the best
    first.

    Parameters
    ----------
    ends : (N, 2, 2) array
        End points of the lines, px, the longest lines first.
    centre : (2,) array
        The principal point, px.
    width : float
        Of the picture, px.
    focal : float, optional
        The focal length, if it is known.
    """
    own = (ends[:VOTERS] - centre) / width
    rng = np.random.default_rng(seed)
    f, rotation = _sampled(own, rng, None if focal is None else focal / width)
    if not len(f):
        return []
    scores = np.concatenate(
        [_votes(own, width, f[i : i + BLOCK], rotation[i : i + BLOCK]) for i in range(0, len(f), BLOCK)]
    )
    found: list[tuple[float, Array]] = []
    for i in np.argsort(-scores, kind="stable"):
        if len(found) == KEPT:
            break
        if not any(_same(f[i] * width, rotation[i], g, r) for g, r in found):
            found.append((float(f[i] * width), rotation[i]))
    return found


def misses(ends: Array, centre: Array, f: float, rotation: Array) -> Array:
    """Distances (N, 3) of the lines' ends from the lines through their midpoints and each vanishing point, px."""
    return _misses(ends - centre, np.array([f]), rotation[None])[0]


def _sampled(own: Array, rng: np.random.Generator, focal: float | None) -> tuple[Array, Array]:
    """Focal lengths (H,) in widths and rotations (H, 3, 3) of the samples with a solution."""
    count = len(own)
    if count < SAMPLE:
        return np.zeros(0), np.zeros((0, 3, 3))
    lines = np.cross(homogeneous(own[:, 0]), homogeneous(own[:, 1]))
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    length = np.linalg.norm(own[:, 1] - own[:, 0], axis=1)
    chosen = rng.choice(count, (SAMPLES, SAMPLE), p=length / length.sum())
    first, second = (np.cross(lines[chosen[:, i]], lines[chosen[:, i + 1]]) for i in (0, 2))
    size = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    with np.errstate(all="ignore"):
        f2 = -(first[:, :2] * second[:, :2]).sum(1) / (first[:, 2] * second[:, 2])
        f = np.sqrt(f2) if focal is None else np.full(len(f2), focal)
    good = np.isfinite(f) & (f > FOCAL[0]) & (f < FOCAL[1]) & (size > 0)
    f, first, second = f[good], first[good], second[good]
    one = first / np.c_[f, f, np.ones(len(f))]
    two = second / np.c_[f, f, np.ones(len(f))]
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two -= one * (one * two).sum(1, keepdims=True)  # with a focal length given they need not be orthogonal
    norm = np.linalg.norm(two, axis=1)
    # sin(30 degrees): least angle between the two directions
    keep = norm > 0.5
    one, two, f = one[keep], two[keep] / norm[keep, None], f[keep]
    return f, np.stack([one, two, np.cross(one, two)], 2)


def _votes(own: Array, width: float, f: Array, rotation: Array) -> Array:
    miss = _misses(own * width, f * width, rotation).min(2)
    length = np.linalg.norm(own[:, 1] - own[:, 0], axis=1)
    return (np.exp(-0.5 * (miss / SOFT) ** 2) * length).sum(1)


def _misses(ends: Array, f: Array, rotation: Array) -> Array:
    """Distances (H, N, 3), px; `ends` from the principal point."""
    points = (
        rotation * np.stack([f, f, np.ones(len(f))], 1)[:, :, None]
    )  # (H, 3, 3): a vanishing point a column
    middle = homogeneous(ends.mean(1))
    through = np.cross(middle[None, :, None], np.swapaxes(points, 1, 2)[:, None])
    end = homogeneous(ends[:, 0])
    off = np.abs(np.einsum("hnfi,ni->hnf", through, end))
    return off / np.maximum(np.linalg.norm(through[..., :2], axis=-1), 1e-12)


def _same(f: float, rotation: Array, g: float, other: Array) -> bool:
    """Return whether two frames have the same three axes, in any order and sense."""
    if abs(f / g - 1) > SAME_FOCAL:
        return False
    along = np.abs(rotation.T @ other)
    return bool((along.max(0) > np.cos(SAME)).all())
