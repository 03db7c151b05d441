"""All poses of a calibrated camera that are local minima of the object-space error.

Only points and rays are used, so that any lens and field of view is supported, with three or more points in
space or on a plane. With the rays d of unit length and Q = I - d dᵀ, the error Σ w |Q (R x + t)|² (Lu, Hager &
Mjolsness, Fast and globally convergent pose estimation from video images, 2000, eq. 19) is linear least squares
in t; what remains is rᵀ Ω r, with r the nine entries of R and Ω (9, 9) a constant of the data (Terzakis &
Lourakis, A consistently fast and globally optimal solution to the perspective-n-point problem, 2020, eq. 8).
Its minima over the rotations are found from the eigenvectors of Ω and from the 24 rotations of a cube.
"""

from __future__ import annotations

import itertools

import numpy as np

from camcal.geometry import projective, rotations
from camcal.least_squares import Normal, Options, Small, minimise
from camcal.model.pose import Poses

Array = np.ndarray

#: Gauss-Newton steps: from the 24 rotations of a cube, every minimum of 10,000 random views converges in fewer
STEPS = 40
#: rad; minima closer together than this count as one: the refinement in px leads to the same pose from both
SAME = 1e-3
#: a minimum with more than this fraction of the points behind the camera is not a pose
BEHIND = 0.5
#: a search ends if the predicted decrease is below this fraction of the error: the refinement in px follows
SETTLED = 1e-9


def candidates(xyz: Array, rays: Array, weights: Array | None = None) -> Poses:
    """The local minima of the object-space error with the points in front of the camera, the lowest first.

    Parameters
    ----------
    xyz : (N, 3) array
        Three or more points, not collinear.
    rays : (N, 3) array of unit length, in the camera's frame
    weights : (N,) array, optional

    Returns
    -------
    Poses
        cam_from_world; empty if no minimum has most points in front of the camera.
    """
    w = np.ones(len(xyz)) if weights is None else weights
    origin, axes, spread = projective.fit_plane(xyz)
    scale = np.linalg.norm(spread)
    local = (xyz - origin) @ axes / scale
    omega, to_translation = _system(local, rays, w)
    found = _minima(omega, _starts(omega))
    flat = found.reshape(-1, 9)
    translations = flat @ to_translation.T
    ahead = np.einsum("hij,nj,ni->hn", found, local, rays) + translations @ rays.T
    keep = (ahead <= 0).mean(1) <= BEHIND
    found, translations, flat = found[keep], translations[keep], flat[keep]
    order = np.argsort(np.einsum("hi,ij,hj->h", flat, omega, flat), kind="stable")
    order = _distinct(found, order)
    rotation = found[order] @ axes.T
    return Poses(rotation, translations[order] * scale - rotation @ origin)


def _system(x: Array, rays: Array, w: Array) -> tuple[Array, Array]:
    """Ω (9, 9), for r by rows, and the matrix (3, 9) that maps r to t."""
    q = (np.eye(3) - rays[:, :, None] * rays[:, None]) * w[:, None, None]
    q = q.reshape(-1, 9)
    squares = (q.T @ (x[:, :, None] * x[:, None]).reshape(-1, 9)).reshape(3, 3, 3, 3)  # i j a b
    mixed = (q.T @ x).reshape(3, 9)
    total = q.sum(0).reshape(3, 3)
    to_translation = -np.linalg.pinv(total) @ mixed
    omega = squares.transpose(0, 2, 1, 3).reshape(9, 9) + mixed.T @ to_translation
    return (omega + omega.T) / 2, to_translation


def _starts(omega: Array) -> Array:
    """Rotations (H, 3, 3) nearest to the eigenvectors of Ω and of its part for points with z = 0, and those of the
    cube.
    """
    vectors = np.linalg.eigh(omega)[1].T.reshape(-1, 3, 3)
    flat = np.linalg.eigh(omega.reshape(3, 3, 3, 3)[:, :2, :, :2].reshape(6, 6))[1][:, :3].T.reshape(-1, 3, 2)
    full = np.concatenate([flat, np.cross(flat[..., 0], flat[..., 1])[..., None]], -1)
    return np.concatenate(
        [rotations.nearest(vectors), rotations.nearest(-vectors), rotations.nearest(full), _CUBE]
    )


def _cube() -> Array:
    """The 24 rotations that map a cube to itself (24, 3, 3)."""
    signed = (
        np.eye(3)[list(p)] * np.array(s)[:, None]
        for p in itertools.permutations(range(3))
        for s in itertools.product((1.0, -1.0), repeat=3)
    )
    return np.stack([m for m in signed if np.linalg.det(m) > 0])


_CUBE = _cube()
_GENERATORS = rotations.skew(np.eye(3))


def _minima(omega: Array, r: Array) -> Array:
    """Lower rᵀ Ω r from each rotation (H, 3, 3)."""
    return np.asarray(minimise(_Rotations(omega, len(r)), r, Options(SETTLED, STEPS)).state)


class _Rotations(Small):
    """½ rᵀ Ω r of rotations (H, 3, 3): residuals Lᵀ r, Ω = L Lᵀ, of which rounding may make eigenvalues negative."""

    def __init__(self, omega: Array, count: int):
        values, vectors = np.linalg.eigh(omega)
        self.half, self.count = vectors * np.sqrt(np.maximum(values, 0.0)), count
        self.rounding = np.finfo(float).eps * float(np.trace(omega))

    def linearise(self, state: Array, members: Array) -> Normal:
        """The derivatives are those of exp(δ) R."""
        tangent = (_GENERATORS @ state[:, None]).reshape(-1, 3, 9)
        return Normal.of(state.reshape(-1, 9) @ self.half, tangent @ self.half)

    def retract(self, state: Array, step: Array) -> Array:
        """exp(δ) R."""
        return rotations.exp(step) @ state


def _distinct(r: Array, order: Array) -> Array:
    """The members of `order` whose rotation differs from all before them."""
    kept: list[int] = []
    for i in order:
        angles = np.linalg.norm(rotations.log(r[kept] @ r[i].T), axis=-1) if kept else np.array([np.inf])
        if angles.min() > SAME:
            kept.append(int(i))
    return np.array(kept, int)
