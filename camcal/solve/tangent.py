"""Steps as vectors: the free parameters first, then the six numbers of each pose.

For methods that are written for vectors. The matrix JᵀJ is never formed; its product with a vector, its
diagonal and the gradient come from the blocks.
"""

from __future__ import annotations

import numpy as np

from camcal.solve.problem import Blocks, Step

Array = np.ndarray


def flat(step: Step) -> Array:
    """A step as a vector (F + 6 V,)."""
    return np.concatenate([step.intrinsics, step.poses.ravel()])


def unflat(vector: Array, free: int, width: int = 6) -> Step:
    """The step of a vector whose first `free` entries belong to the free parameters."""
    return Step(vector[:free], vector[free:].reshape(-1, width))


def sizes(blocks: Blocks) -> tuple[int, int]:
    """Number of free parameters and of pose coordinates."""
    return len(blocks.gradient), blocks.poses.shape[2]


def gradient(blocks: Blocks) -> Array:
    """Jᵀr, (F + 6 V,)."""
    return np.concatenate([blocks.gradient, blocks.pose_gradients.ravel()])


def diagonal(blocks: Blocks) -> Array:
    """The diagonal of JᵀJ, (F + 6 V,): squared lengths of the Jacobian's columns."""
    return np.concatenate([np.diag(blocks.intrinsics), np.einsum("vii->vi", blocks.poses).ravel()])


def multiply(blocks: Blocks, vector: Array) -> Array:
    """JᵀJ times a vector (F + 6 V,)."""
    free = len(blocks.gradient)
    own, poses = vector[:free], vector[free:].reshape(blocks.pose_gradients.shape)
    upper = blocks.intrinsics @ own + np.einsum("vfi,vi->f", blocks.coupling, poses)
    lower = np.einsum("vfi,f->vi", blocks.coupling, own) + np.einsum("vij,vj->vi", blocks.poses, poses)
    return np.concatenate([upper, lower.ravel()])


def inverse_lengths(squares: Array) -> Array:
    """1 / sqrt of squared lengths; 1 for a zero column."""
    return 1.0 / np.sqrt(np.where(squares > 0, squares, 1.0))
