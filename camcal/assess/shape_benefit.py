"""Whether estimating a board's shape improves the camera, or only reduces the residuals.

A board whose every point is free fits better, and fits views held out better, as soon as its points are not quite
where they should be. The camera does not necessarily improve: its parameters become noisier, and with few views this
can outweigh the reduction of the bias. Let x = (c, θ) be the camera's free parameters and the shape's, S their normal
matrix with the poses eliminated, x̂ the estimate with the shape. The simpler board is the limit of a prior on the
points' offsets, each Gaussian with deviation τ in x, y and z (less what a camera cannot see of them: position,
orientation and size of the board), as τ -> 0; the free one is the limit τ -> ∞. The truth lies between, at

    x_τ = x̂ - (S + λ Q)⁻¹ λ Q x̂,     λ = σ² / τ²                                                         (1)

with Q the prior's matrix in θ, and τ is known from what the shape gains in cost (empirical Bayes: Efron & Morris,
JASA 68, 1973; the expectation of a quadratic form),

    2 (C_simple - C_shape) = σ² (B - b) + τ² tr(S_θθ·c Q⁻¹)                                               (2)

b being the parameters of the simpler board, S_θθ·c what is left of S after they and the camera are eliminated.
Of the two boards, that whose camera projects nearer to that of (1) has the smaller expected error: errors about
the mean of a posterior add its variance to both alike.
"""

from __future__ import annotations

import numpy as np

from camcal.assess.covariance import eliminate_poses, reduce
from camcal.assess.difference import grid_of
from camcal.assess.figures import sigma_0
from camcal.assess.fold_difference import covered_pixels
from camcal.geometry import rotations
from camcal.geometry.numbers import distinct
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Estimate, ShapedBoard
from camcal.solve.several_boards import similarities

#: columns of the grid over the picture
COLUMNS = 20


@dataclass(frozen=True)
class Change:
    """The effect of a shape on the camera.

    Attributes
    ----------
    tau : float
        Deviation of the points' offsets that the simpler board does not explain, unit of the data.
    simple_px, shaped_px : float
        Root mean square distance of the cameras with the simpler board and with the shape from that of (1), over
        the picture (where its size is not known, over what the points cover) and after the best-fitting rotation.
    """

    tau: float
    simple_px: float
    shaped_px: float

    @property
    def better(self) -> bool:
        """Return whether the shape has the smaller expected error."""
        return self.shaped_px < self.simple_px


def change(simple: Estimate, shaped: Estimate) -> Change:
    """Compare a board with a simpler one, estimated from the same points."""
    board, inner = shaped.board, simple.board
    assert board is not None
    s = reduce(shaped.normal, eliminate_poses(shaped.normal))
    f = len(s) - board.size + board.placed  # the places of several boards count with the camera
    d = _seen(board, board.directions()[:, board.placed :])
    q = d.T @ d

    def coordinates(offsets: Array) -> Array:
        return np.linalg.solve(q, d.T @ offsets)

    theta = coordinates((board.points - board.ideal).reshape(-1))
    inside = theta[:, None][:, :0] if inner is None else coordinates(inner.directions()[:, inner.placed :])
    q_inside = q @ inside
    q_left = q - q_inside @ np.linalg.pinv(inside.T @ q_inside) @ q_inside.T
    left = _eliminated(s, f, inside)
    sigma2 = sigma_0(shaped) ** 2
    gain = theta @ left @ theta - sigma2 * (len(theta) - inside.shape[1])
    tau2 = max(float(gain), 0.0) / float(np.trace(np.linalg.solve(q, left)))
    simplest = _without(s, f, inside, theta)
    middle = _shrunk(s, q_left, theta, sigma2 / tau2) if tau2 > 0 else simplest
    moves = _projections(shaped)[:, :f]
    if not len(moves):
        return Change(float(np.sqrt(tau2)), 0.0, np.inf)
    simple_px, shaped_px = (
        float(np.sqrt(2 * np.mean((moves @ m) ** 2))) for m in (middle - simplest, middle)
    )
    return Change(float(np.sqrt(tau2)), simple_px, shaped_px)


def _known(s: Array, f: int, inside: Array) -> Array:
    """Columns (F + B, .) of the camera's parameters and of the shape's indispensable ones."""
    known = np.zeros((len(s), f + inside.shape[1]))
    known[:f, :f], known[f:, f:] = np.eye(f), inside
    return known


def _eliminated(s: Array, f: int, inside: Array) -> Array:
    """S_θθ·c: the remainder of S after eliminating the camera and a part of the shape."""
    known = _known(s, f, inside)
    left = s - s @ known @ np.linalg.lstsq(known.T @ s @ known, known.T @ s, rcond=None)[0]
    return np.asarray(left[f:, f:])


def _without(s: Array, f: int, inside: Array, theta: Array) -> Array:
    """The change (F,) of the camera if all of the shape except `inside` is omitted."""
    known = _known(s, f, inside)
    x = np.r_[np.zeros(f), theta]
    return np.asarray((known @ np.linalg.lstsq(known.T @ s @ known, known.T @ s @ x, rcond=None)[0])[:f])


def _shrunk(s: Array, q: Array, theta: Array, weight: float) -> Array:
    """The camera's part (F,) of (1) minus that of x̂."""
    f = len(s) - len(theta)
    prior = np.zeros_like(s)
    prior[f:, f:] = weight * q
    return np.asarray(-np.linalg.solve(s + prior, np.r_[np.zeros(f), weight * q @ theta])[:f])


def _seen(board: ShapedBoard, offsets: Array) -> Array:
    """Offsets (3 M, B) without their part that is a motion of a board or a change of its size."""
    label = np.zeros(len(board.ideal), int) if board.label is None else board.label
    rest = offsets.reshape(len(label), 3, -1).copy()
    for own in (np.flatnonzero(label == k) for k in distinct(label)):
        basis, some = np.linalg.qr(similarities(board.ideal[own]))[0], rest[own].reshape(3 * len(own), -1)
        rest[own] = (some - basis @ (basis.T @ some)).reshape(len(own), 3, -1)
    return rest.reshape(offsets.shape)


def _projections(solution: Estimate) -> Array:
    """d pixels / d variables (2 N, F) over the pictures of all cameras, after the best-fitting rotation of each."""
    ends = np.cumsum([0, *(c.lens.size for c in solution.cameras)])
    found = []
    for index, camera in enumerate(solution.cameras):
        lens, params, size = camera.lens, camera.params, camera.image_size
        pixels = covered_pixels(solution, index) if size is None else grid_of(size, COLUMNS)
        rays, seen = lens.unproject(params, pixels)
        _, by_xyz, by_params, _ = lens.jacobians(params, rays[seen])
        turns = (by_xyz @ rotations.skew(rays[seen])).reshape(-1, 3)
        moves = (by_params @ solution.free[ends[index] : ends[index + 1]]).reshape(len(turns), -1)
        found.append(moves - turns @ np.linalg.lstsq(turns, moves, rcond=None)[0])
    return np.concatenate(found)
