"""Streams of frames with known truth: a camera that is still, warms up, is knocked, rotates, or zooms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field

import numpy as np

from camcal.errors import UsageError
from camcal.geometry import projective, rotations
from camcal.geometry.picture import in_picture
from camcal.records import dataclass
from camcal.track import SEQUENCES
from camcal.track.decompose import noise_columns
from camcal.track.frames import Frame
from camcal.track.motion import figures, scaled
from camcal.track.table import MATRIX, PARAMETERS

Array = np.ndarray


@dataclass(frozen=True)
class Scene:
    """The simulated scene, except for the motion.

    Attributes
    ----------
    points : int
        Points in a cube of side 2.
    distance : float
        From the camera to the middle of the cube.
    noise : float, px
    outliers : float
        Part of the points that lie anywhere in the picture.
    knock : int
        The frame in which the camera of `knock` is turned.
    angle : float
        By how much, degrees about y, about the camera's centre.
    image_size : (width, height) or None
        Points outside are missing; None: all are seen.
    thickness : float
        Extent of the points in z against that of the cube; 0 is a plane.
    drift : mapping of group -> float
        Figures that replace those of the sequence's motion.
    """

    points: int = 50
    distance: float = 5.0
    noise: float = 0.3
    outliers: float = 0.0
    knock: int = 100
    angle: float = 0.3
    image_size: tuple[int, int] | None = (640, 480)
    thickness: float = 1.0
    drift: Mapping[str, float] = field(default_factory=dict)


@dataclass
class Truth:
    """The camera of a frame: K (3, 3), R (3, 3), t (3,), and which points are not outliers."""

    k: Array
    rotation: Array
    translation: Array
    good: Array

    @property
    def matrix(self) -> Array:
        """K [R | t]."""
        return projective.compose(self.k, self.rotation, self.translation)


def simulate(
    kind: str, count: int, seed: int = 0, scene: Scene | None = None
) -> Iterator[tuple[Frame, Truth]]:
    """Frames with their truth.

    The camera walks by the process noise of its motion (camcal.track.motion), so that a filter that is
    given the motion has the exact statistics, and its covariances can be tested.

    Raises
    ------
    UsageError
        For an unknown kind.
    """
    if kind not in SEQUENCES:
        raise UsageError(f"unknown sequence '{kind}'.", "Known: " + ", ".join(SEQUENCES) + ".")
    scene = scene or Scene()
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (scene.points, 3)) * [1, 1, scene.thickness]
    k = np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
    rotation = rotations.exp(rng.normal(0, 0.1, 3))
    translation = np.array([0.0, 0.0, scene.distance])
    noise = {**figures(SEQUENCES[kind], {}), **scene.drift}
    for number in range(count):
        if number:
            columns = noise_columns(scaled(noise, k[0, 0], float(np.linalg.norm(translation))), 1.0)
            step = columns @ rng.normal(size=columns.shape[1]) if columns.size else np.zeros(11)
            k, rotation, translation = _moved(k, rotation, translation, step)
        if kind == "knock" and number == scene.knock:
            knock = np.zeros(11)
            knock[6] = np.deg2rad(scene.angle)
            k, rotation, translation = _moved(k, rotation, translation, knock)
        truth = Truth(k, rotation, translation, np.ones(0, bool))
        yield _seen(number, xyz, truth, scene, rng), truth


def _moved(k: Array, rotation: Array, translation: Array, step: Array) -> tuple[Array, Array, Array]:
    """Take a step (11,) in physical coordinates."""
    turn = rotations.exp(step[5:8])
    k = k + np.array([[step[0], step[2], step[3]], [0, step[1], step[4]], [0, 0, 0]])
    return k, turn @ rotation, turn @ translation + step[8:]


def _seen(number: int, xyz: Array, truth: Truth, scene: Scene, rng: np.random.Generator) -> Frame:
    uv = projective.project(truth.matrix, xyz) + rng.normal(0, scene.noise, (len(xyz), 2))
    wild = rng.random(len(xyz)) < scene.outliers
    size = np.array(scene.image_size or (640, 480))
    uv[wild] = rng.uniform(0, size, (int(wild.sum()), 2))
    inside = np.ones(len(uv), bool)
    if scene.image_size is not None:
        inside &= in_picture(uv, size)
    truth.good = ~wild[inside]
    return Frame(number, xyz[inside], uv[inside])


def frame_rows(frames: Iterable[Frame]) -> str:
    """The table `frame,X,Y,Z,u,v` of frames, to 1e-6 of a unit and 1e-4 px."""
    lines = ["frame,X,Y,Z,u,v\n"]
    for frame in frames:
        for x, y, z, u, v in np.hstack([frame.xyz, frame.uv]).tolist():
            lines.append(f"{frame.number},{x:.6f},{y:.6f},{z:.6f},{u:.4f},{v:.4f}\n")
    return "".join(lines)


def truth_rows(pairs: Iterable[tuple[Frame, Truth]]) -> str:
    """The true cameras as a table with the same columns as a track; m34 = 1."""
    lines = [",".join(["frame", *MATRIX, *PARAMETERS]) + "\n"]
    for frame, true in pairs:
        k, matrix = true.k, true.matrix / true.matrix[2, 3]
        numbers = [*matrix.ravel(), k[0, 0], k[1, 1], k[0, 1], k[0, 2], k[1, 2]]
        numbers += [*rotations.log(true.rotation), *true.translation]
        lines.append(",".join([str(frame.number), *(f"{x:.12g}" for x in numbers)]) + "\n")
    return "".join(lines)
