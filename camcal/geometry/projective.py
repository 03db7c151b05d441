"""Projective geometry: homogeneous points, Hartley's normalisation, P <-> K [R | t], RQ."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations

Array = np.ndarray

#: sine of the angle between a ray and the image plane below which x / z means little: there (3 degrees) an error of the
#: ray's angle counts 400 times
FLAT_RAY = 0.05


def homogeneous(points: Array) -> Array:
    """Append a coordinate 1: (..., d) -> (..., d + 1)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1)


def dehomogenise(points: Array) -> Array:
    """Divide by the last coordinate: (..., d + 1) -> (..., d)."""
    return points[..., :-1] / points[..., -1:]


def _mean(points: Array) -> Array:
    """Centroids (..., d) of points (..., N, d); einsum sums a short last axis faster than mean."""
    return np.einsum("...nd->...d", points) / points.shape[-2]


def normalisation(points: Array) -> Array:
    """The similarity that brings points to centroid 0 and mean distance sqrt(d).

    Hartley, In Defense of the Eight-Point Algorithm (1997); Hartley & Zisserman, section 4.4.4.

    Parameters
    ----------
    points : (..., N, d) array

    Returns
    -------
    (..., d + 1, d + 1) array T; T @ homogeneous(x) is normalised. Scale 1 where all points coincide.
    """
    d = points.shape[-1]
    centre = _mean(points)
    centred = points - centre[..., None, :]
    distance = np.sqrt(np.einsum("...nd,...nd->...n", centred, centred)).mean(-1)
    scale = np.where(distance > 0, np.sqrt(d) / np.where(distance > 0, distance, 1), 1.0)
    t = np.zeros((*points.shape[:-2], d + 1, d + 1))
    t[..., range(d), range(d)] = scale[..., None]
    t[..., :d, d] = -scale[..., None] * centre
    t[..., d, d] = 1
    return t


def rq(m: Array) -> tuple[Array, Array]:
    """Factor M (3, 3) = K R with K upper triangular of positive diagonal; det R has the sign of det M."""
    flip = np.eye(3)[::-1]
    q, r = np.linalg.qr((flip @ m).T)
    k, rot = flip @ r.T @ flip, flip @ q.T
    signs = np.where(np.diag(k) < 0, -1.0, 1.0)
    return k * signs, rot * signs[:, None]


def project(matrix: Array, xyz: Array) -> Array:
    """Image points (..., 2) of xyz (..., 3) under a projection matrix (3, 4)."""
    return dehomogenise(homogeneous(xyz) @ matrix.T)


def compose(k: Array, rotation: Array, translation: Array) -> Array:
    """The projection matrix K [R | t] (3, 4)."""
    return k @ np.c_[rotation, translation]


def decompose(matrix: Array, xyz: Array | None = None) -> tuple[Array, Array, Array, bool]:
    """Split a projection matrix (3, 4), of any scale and sign, into K, R, t.

    RQ of the left 3x3 block with a positive diagonal of K (Hartley & Zisserman, section 6.2.4). The sign of
    the matrix is chosen so that `xyz` (N, 3) lies in front of the camera; without points, so that det R = +1.

    Returns
    -------
    k : (3, 3) array with k[2, 2] = 1
    rotation : (3, 3) array, always of determinant +1
    translation : (3,) array
    mirrored : bool
        True where the points lie in front only with det R = -1: the world's frame is left-handed. The
        returned R, t then belong to the matrix with the scene behind the camera.
    """
    m = np.array(matrix, float)
    mirrored = False
    if xyz is not None:
        depth = homogeneous(xyz) @ m[2]
        if np.median(depth) < 0:
            m = -m
        mirrored = bool(np.linalg.det(m[:, :3]) < 0)
    if np.linalg.det(m[:, :3]) < 0:
        m = -m
    k, rotation = rq(m[:, :3])
    translation = np.linalg.solve(k, m[:, 3])
    return k / k[2, 2] + 0.0, rotations.nearest(rotation), translation, mirrored


def fit_plane(xyz: Array) -> tuple[Array, Array, Array]:
    """The plane nearest to points (..., N, 3).

    The directions are the eigenvectors of the scatter matrix, largest extent first, each with its largest
    component positive (the normal follows from the other two).

    Returns
    -------
    origin : (..., 3) array, the centroid
    axes : (..., 3, 3) array, a rotation whose columns are the two in-plane directions and the normal
    spread : (..., 3) array, root mean square extent along those directions, descending
    """
    origin = _mean(xyz)
    centred = xyz - origin[..., None, :]
    _, vectors = np.linalg.eigh(np.swapaxes(centred, -1, -2) @ centred)
    axes = vectors[..., ::-1].copy()
    largest = np.take_along_axis(axes, np.abs(axes).argmax(-2)[..., None, :], -2)
    axes *= np.where(largest < 0, -1.0, 1.0)
    axes[..., 2] *= np.linalg.det(axes)[..., None]
    # measured along the directions, not from the eigenvalues, whose roots keep half of the digits
    along = centred @ axes
    spread = np.sqrt(np.einsum("...nd,...nd->...d", along, along) / xyz.shape[-2])
    return origin, axes, spread


def principal_spreads(points: Array) -> Array:
    """Root mean square extents (..., d) of points (..., N, d) along principal directions, descending.

    Extents below 1e-8 of the largest are lost in the rounding of second moments.
    """
    centred = points - _mean(points)[..., None, :]
    values = np.linalg.eigvalsh(np.swapaxes(centred, -1, -2) @ centred / points.shape[-2])
    return np.sqrt(np.maximum(values[..., ::-1], 0))
