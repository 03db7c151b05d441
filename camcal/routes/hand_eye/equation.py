"""The robot's pose implied by X, Z and a view, and its derivatives.

    in-hand   B = Z C⁻¹ X⁻¹          to-hand   B = X C Z⁻¹

Both are B = O M I⁻¹ with an outer, a middle and an inner transformation. All rotations are perturbed on the left.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose, Poses


class Derivatives(NamedTuple):
    """Derivatives of (rotation, translation) of B with respect to those of X, Z and C, each (V, 6, 6)."""

    by_x: Array
    by_z: Array
    by_c: Array


def robot_pose(setup: str, x: Pose, z: Pose, c: Poses) -> Poses:
    """base_from_hand of each view (V,)."""
    outer, inner = (z, x) if setup == "in-hand" else (x, z)
    middle = c.inverse() if setup == "in-hand" else c
    found: Any = outer @ middle @ inner.inverse()
    return found


def derivatives(setup: str, x: Pose, z: Pose, c: Poses) -> Derivatives:
    """The derivatives of `robot_pose`."""
    b = robot_pose(setup, x, z, c)
    if setup == "in-hand":
        return Derivatives(_by_inner(b, x), _by_outer(b, z), _by_inverse(x, z, c))
    return Derivatives(_by_outer(b, x), _by_inner(b, z), _by_middle(x, z, c))


def residuals(setup: str, x: Pose, z: Pose, c: Poses, measured: Poses) -> Array:
    """Rotation vector (rad, in the base's frame) and translation (..., V, 6) of the implied poses relative to the
    measured ones.
    """
    b = robot_pose(setup, x, z, c)
    turn = so3.log(b.rotation @ np.swapaxes(measured.rotation, 1, 2))
    return np.concatenate([turn, b.translation - measured.translation], -1)


def from_left(turn: Array) -> Array:
    """d residual with respect to the left perturbation of B, (V, 6, 6), at residual rotations (V, 3)."""
    out = np.zeros((len(turn), 6, 6))
    out[:, :3, :3] = np.linalg.inv(so3.left_jacobian(turn))
    out[:, 3:, 3:] = np.eye(3)
    return out


def _by_outer(b: Poses, outer: Pose) -> Array:
    out = np.broadcast_to(np.eye(6), (len(b), 6, 6)).copy()
    out[:, 3:, :3] = -so3.skew(b.translation - outer.translation)
    return out


def _by_inner(b: Poses, inner: Pose) -> Array:
    return _blocks(-b.rotation, -b.rotation @ so3.skew(inner.translation), -b.rotation)


def _by_inverse(x: Pose, z: Pose, c: Poses) -> Array:
    """The derivative by C if the middle factor is C⁻¹."""
    q = z.rotation @ np.swapaxes(c.rotation, 1, 2)
    w = x.inverse().translation - c.translation
    return _blocks(-q, q @ so3.skew(w), -q)


def _by_middle(x: Pose, z: Pose, c: Poses) -> Array:
    turned = c.rotation @ z.inverse().translation
    r = np.broadcast_to(x.rotation, c.rotation.shape)
    return _blocks(r, -r @ so3.skew(turned), r)


def _blocks(rotation: Array, mixed: Array, translation: Array) -> Array:
    """[rotation 0; mixed translation]."""
    out = np.zeros((len(rotation), 6, 6))
    out[:, :3, :3], out[:, 3:, :3], out[:, 3:, 3:] = rotation, mixed, translation
    return out
