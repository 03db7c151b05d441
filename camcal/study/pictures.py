"""Pictures of a target with a known truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from camcal.detect.targets.base import Target
from camcal.model.camera import Camera
from camcal.model.placement import Spread, simulate_poses
from camcal.model.pose import Poses
from camcal.study.render import Look, Surface, render

Array = np.ndarray


def board_poses(
    target: Target, camera: Camera, rng: np.random.Generator, views: int, spread: Spread | None = None
) -> Poses:
    """Poses that keep the whole sheet of a target in the picture, including its quiet margin."""
    x0, y0, x1, y1 = target.pattern().extent
    x, y = np.linspace(x0, x1, 9), np.linspace(y0, y1, 9)
    # the outline with points between the corners: its edges are curved in a picture with distortion
    outline = np.concatenate(
        [np.c_[x, 0 * x + y0], np.c_[x, 0 * x + y1], np.c_[0 * y + x0, y], np.c_[0 * y + x1, y]]
    )
    return simulate_poses(np.c_[outline, np.zeros(len(outline))], camera, rng, views, spread)


def simulate_pictures(
    target: Target,
    camera: Camera,
    poses: Poses,
    rng: np.random.Generator,
    look: Look | Sequence[Look] | None = None,
    surface: Surface | None = None,
) -> Iterator[Array]:
    """Draw one picture (height, width) per pose, one at a time.

    `look` is one for all or one per picture.
    """
    pattern = target.pattern()
    looks = list(look) if isinstance(look, Sequence) else [look or Look()] * len(poses)
    for pose, each in zip(poses, looks, strict=True):
        if target.negative:
            each = replace(each, black=each.white, white=each.black)
        yield render(pattern, camera, pose, each, rng, surface=surface)


def uneven_looks(base: Look, rng: np.random.Generator, count: int) -> list[Look]:
    """A `Look` for each picture, with light from a different side."""
    return [
        Look(**{**base.__dict__, "gradient": rng.uniform(0, 0.4), "direction": rng.uniform(0, 2 * np.pi)})
        for _ in range(count)
    ]


def bowed_sheet(target: Target, bow: float) -> Surface:
    """A sheet that bulges along x: its middle is `bow` nearer to the camera than its edges."""
    x0, _, x1, _ = target.pattern().extent
    middle, half = (x0 + x1) / 2, (x1 - x0) / 2

    def height(xy: Array) -> Array:
        return -bow * (1 - ((xy[..., 0] - middle) / half) ** 2)

    return height
