"""Shared parts of the comparisons with cv2.fisheye.calibrate and cv2.omnidir.calibrate.

Both take float64 points and know skew; both begin by themselves, from boards in z = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from camcal.geometry import rotations
from camcal.model.pose import Array, Poses
from camcal.peers.base import NotComparableError, Task
from camcal.solve.calibration import Calibration

#: parameters that are estimated or held together, and the name of the flag that holds them
Groups = Sequence[tuple[tuple[str, ...], str]]
#: cv2's projection: (points (N, 1, 3), rotation vector, translation) -> pixels
Project = Callable[[Array, Array, Array], Array]


def refuse_rigs(task: Task, name: str) -> None:
    """Raise NotComparableError if the points are not boards in z = 0."""
    if any(np.abs(xyz[:, 2]).max() > 0 for xyz, _ in task.views):
        raise NotComparableError(f"{name} accepts only boards in z = 0")


def held(solution: Calibration, groups: Groups, name: str) -> list[str]:
    """The flags for the parameters that are not estimated.

    Raises
    ------
    NotComparableError
        If cv2 cannot hold exactly those.
    """
    lens, values = solution.camera.lens, solution.camera.values
    estimated = {n for n, row in zip(lens.names, solution.free, strict=True) if row.any()}
    if (np.count_nonzero(solution.free, axis=0) > 1).any():
        raise NotComparableError(f"{name} cannot tie parameters to one another")
    known = {n for group, _ in groups for n in group}
    stuck = sorted(set(lens.names) - known - estimated)
    if stuck:
        raise NotComparableError(f"{name} cannot hold {stuck[0]}")
    flags = []
    for group, flag in groups:
        inside = [n in estimated for n in group if n in lens.names]
        if any(inside) and not all(inside):
            raise NotComparableError(f"{name} cannot hold one of {', '.join(group)} alone")
        if not any(inside):
            flags.append(flag)
            if any(values.get(n, 0.0) != 0 for n in group):
                raise NotComparableError(
                    f"{name} uses its own start and can hold {', '.join(group)} only at 0"
                )
    return flags


def poses_of(task: Task, rvecs: Iterable[Array], tvecs: Iterable[Array]) -> tuple[Poses, Array, Array]:
    """The poses in the data's frame, and cv2's own (V, 3) about the centroids."""
    turns, shifts = (np.array([np.ravel(r) for r in v], float) for v in (rvecs, tvecs))
    turned = rotations.exp(turns)
    return Poses(turned, shifts - np.einsum("vij,vj->vi", turned, task.centroids)), turns, shifts


def rms_of(task: Task, project: Project, rvecs: Array, tvecs: Array) -> float:
    """rms_point over the points by cv2's own projection."""
    total, count = 0.0, 0
    for (xyz, uv), rvec, tvec in zip(task.views, rvecs, tvecs, strict=True):
        seen = np.reshape(project(xyz.reshape(-1, 1, 3), rvec, tvec), (-1, 2))
        total += float(np.square(seen - uv).sum())
        count += len(uv)
    return float(np.sqrt(total / count))
