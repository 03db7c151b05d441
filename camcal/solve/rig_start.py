"""Relative poses of the cameras of a rig, from the poses of boards with respect to each.

Two cameras that saw a board at the same instant give their relative pose, a_from_b = P_a P_b⁻¹. A board that looks the
same after a half turn (or a quarter turn) may have been read differently by one of them: the relative pose is then
P_a s P_b⁻¹ with a symmetry s of the board, and only the correct s gives the same one at every instant. A spanning tree
of the pairs of cameras with most information connects all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from camcal.data.observations import Observations
from camcal.errors import EstimationError
from camcal.model.pose import Pose, Poses
from camcal.records import dataclass
from camcal.solve.turns import Renaming

Array = np.ndarray

#: relative poses of so many instants are tried for a pair of cameras: if half are good, the probability that none is
#: good is 2⁻¹⁶
TRIED = 16
#: a rotated reading is accepted if it reduces the scatter over the instants by this factor. A static board has the same
#: pose in both cameras at every instant, rotated or not.
NEARER = 0.5
#: instants whose distance from the relative pose of a pair exceeds the median by this factor are excluded
FAR = 5.0


@dataclass(frozen=True)
class Pictures:
    """The pictures of a rig, one per block of its observations, each with its cam_from_board.

    Attributes
    ----------
    camera, view : (B,) int arrays
    poses : Poses
        cam_from_board (B,).
    variance : (B,) array
        Variance of the position of the board's points, squared unit of the data.
    """

    camera: Array
    view: Array
    poses: Poses
    variance: Array


@dataclass(frozen=True)
class Link:
    """The relative pose of two cameras, and the evidence for it.

    Attributes
    ----------
    pose : Pose
        a_from_b.
    information : float
        Sum of 1 / variance over the instants that agree.
    shared : int
        Number of instants that both saw.
    scatter : float
        Median distance between an instant's boards as seen by the two cameras, relative to the distance from the
        camera.
    expected : float
        The same, as expected from the noise of the image points.
    """

    pose: Pose
    information: float
    shared: int
    scatter: float
    expected: float


#: the link of each pair of cameras (a < b)
Links = Mapping[tuple[int, int], Link]


def corners_of(xyz: Array) -> Array:
    """Four points (4, 3) that span a board with these points (N, 3)."""
    low, high = xyz.min(0), xyz.max(0)
    return np.array([[x, y, (low[2] + high[2]) / 2] for x in (low[0], high[0]) for y in (low[1], high[1])])


def _distances(a: Poses, b: Poses, relative: Poses, turns: Sequence[Pose], corners: Array) -> Array:
    """The distance between the boards of two cameras (K, S, W), relative to their distance from camera a.

    Parameters
    ----------
    a, b : Poses
        cam_from_board (W,) at the same instants.
    relative : Poses
        K candidates of a_from_b.
    turns : sequence of S Pose
        The symmetries of the board, one of which is applied to the board of b.
    """
    seen = Poses.of(b)[:, None].apply(corners).reshape(-1, 3)
    from_b = (seen @ relative.rotations.transpose(0, 2, 1) + relative.translations[:, None]).reshape(
        len(relative), len(b), len(corners), 3
    )
    far = np.maximum(np.linalg.norm(from_b.mean(2), axis=-1), np.finfo(float).tiny)
    off = [Poses.of(a @ turn)[:, None].apply(corners) - from_b for turn in turns]
    return np.stack([np.sqrt(np.einsum("kwci,kwci->kw", o, o) / len(corners)) / far for o in off], 1)


def link(a: Poses, b: Poses, variance: Array, turns: Sequence[Pose], corners: Array) -> Link:
    """The relative pose of two cameras from W shared instants, with the variance (W,) of each."""
    tried = np.unique(np.linspace(0, len(a) - 1, min(len(a), TRIED)).round().astype(int))
    back = b[tried].inverse()
    found = []
    for turn in turns:
        candidates = Poses.of(a[tried] @ turn @ back)
        scatter = np.median(_distances(a, b, candidates, turns, corners).min(1), axis=1)
        found.append((float(scatter.min()), candidates[int(scatter.argmin())]))
    plain, turned = found[0], min(found[1:], key=lambda f: f[0], default=found[0])
    return _averaged(a, b, variance, (turned if turned[0] < NEARER * plain[0] else plain)[1], turns, corners)


def _averaged(
    a: Poses, b: Poses, variance: Array, relative: Pose, turns: Sequence[Pose], corners: Array
) -> Link:
    """The mean relative pose of the instants that agree with one, weighted by their information."""
    apart = _distances(a, b, Poses.stack([relative]), turns, corners)[0]
    chosen, nearest = _nearest(apart), apart.min(0)
    agree = nearest <= FAR * max(float(np.median(nearest)), np.finfo(float).eps)
    turn = Poses.stack(list(turns))[chosen[agree]]
    each = a[agree] @ turn @ b[agree].inverse()
    weight = 1 / variance[agree]
    mean = np.tensordot(weight, each.rotation, 1)
    u, _, vt = np.linalg.svd(mean)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt  # the nearest rotation (Schonemann 1966)
    shift = weight @ each.translation / weight.sum()
    expected = float(np.median(np.sqrt(variance) / np.linalg.norm(a.apply(corners.mean(0)), axis=1)))
    return Link(Pose(rotation, shift), float(weight.sum()), len(a), float(np.median(nearest)), expected)


def _nearest(apart: Array) -> Array:
    """The symmetry (W,) that aligns two boards: the identity, unless another fits much better."""
    best = apart.argmin(0)
    return np.where(apart.min(0) < NEARER * apart[0], best, 0)


def links(
    pictures: Pictures, turns: Sequence[Pose], corners: Array, cameras: int
) -> dict[tuple[int, int], Link]:
    """The link of each pair of cameras (a < b) that share instants."""
    found = {}
    for a in range(cameras):
        for b in range(a + 1, cameras):
            i, j = shared(pictures, a, b)
            if len(i):
                variance = pictures.variance[i] + pictures.variance[j]
                found[a, b] = link(pictures.poses[i], pictures.poses[j], variance, turns, corners)
    return found


def shared(pictures: Pictures, a: int, b: int, lag: int = 0) -> tuple[Array, Array]:
    """The blocks of camera a at each instant that b also saw, and those of b, which may be `lag` instants later."""
    i, j = np.flatnonzero(pictures.camera == a), np.flatnonzero(pictures.camera == b)
    _, first, second = np.intersect1d(pictures.view[i] + lag, pictures.view[j], return_indices=True)
    return i[first], j[second]


def spanning_tree(found: Links, names: Sequence[str]) -> tuple[Poses, list[tuple[int, int]]]:
    """cam_from_rig of each camera, the first being the reference, and the pairs that connect them.

    The tree of the largest information (Prim 1957).

    Raises
    ------
    EstimationError
        If instants connect only some of the cameras.
    """
    reached = {0: Pose.identity()}
    tree: list[tuple[int, int]] = []
    while len(reached) < len(names):
        ways = [(k, v) for k, v in found.items() if (k[0] in reached) != (k[1] in reached)]
        if not ways:
            raise _not_connected(found, names)
        (a, b), best = max(ways, key=lambda way: way[1].information)
        if a in reached:
            reached[b] = best.pose.inverse() @ reached[a]
        else:
            reached[a] = best.pose @ reached[b]
        tree.append((a, b))
    return Poses.stack([reached[i] for i in range(len(names))]), tree


def _not_connected(found: Links, names: Sequence[str]) -> EstimationError:
    """The error that names the parts of a rig which no instant connects, and a remedy."""
    group = list(range(len(names)))
    for a, b in found:
        group = [group[a] if g == group[b] else g for g in group]
    parts = [[n for n, g in zip(names, group, strict=True) if g == i] for i in dict.fromkeys(group)]
    said = "; ".join(f"{' and '.join(p)}" for p in parts)
    return EstimationError(
        f"the cameras are not connected: they form {len(parts)} groups that never see a board at the same instant "
        f"({said}).",
        f"Take pictures that connect them: the board seen at one instant by {parts[0][0]} and by "
        f"{parts[1][0]}, or by any "
        "other two cameras of these groups. For cameras without a common field of view, fix several "
        "boards to each other, and rotate the rig among them about two axes (docs/rigs.md).",
    )


def placed(
    pictures: Pictures, rig: Poses, data: Observations, turns: Sequence[Pose], corners: Array
) -> tuple[Observations, Poses, int]:
    """The boards of a rig whose relative poses are known.

    At each instant the board is that of the picture with which the others agree best; in pictures that were read
    from another end, points are renamed.

    Returns
    -------
    data : Observations
    poses : Poses
        rig_from_board of each instant.
    turned : int
        How many pictures were read from another end.
    """
    renamed = data.xyz.copy(), None if data.point is None else data.point.copy()
    board = Renaming.of(data)
    poses, turned = [], 0
    for instant in range(len(data)):
        blocks = np.flatnonzero(pictures.view == instant)
        boards = Poses.stack([rig[pictures.camera[b]].inverse() @ pictures.poses[b] for b in blocks])
        tried = [_agreement(boards, i, turns, corners) for i in range(len(blocks))]
        anchor = int(np.argmin([c for c, _ in tried] + np.sqrt(pictures.variance[blocks])))
        own = tried[anchor][1]
        usual = int(np.bincount(own).argmax())  # the board as most pictures have it
        poses.append(boards[anchor] @ turns[usual].inverse())
        for block in blocks[own != usual]:
            turn = turns[own[blocks == block][0]] @ turns[usual].inverse()
            board.rename(renamed, data.slices[block], turn.inverse())
            turned += 1
    return replace(data, xyz=renamed[0], point=renamed[1]), Poses.stack(poses), turned


def _agreement(boards: Poses, anchor: int, turns: Sequence[Pose], corners: Array) -> tuple[float, Array]:
    """The summed distance of the boards (B,) of an instant from one of them, and the symmetries (B,) applied."""
    there = boards[anchor].apply(corners)
    apart = np.array(
        [
            np.sqrt(np.square(Poses.of(boards @ t)[:, None].apply(corners) - there).sum(-1).mean(-1))
            for t in turns
        ]
    )
    return float(apart.min(0).sum()), _nearest(apart)
