"""Exact pictures of a target through any camera: area-sampled, blurred, with noise and shading.

Each pixel is divided into samples. The ray of a sample is intersected with the board, and the mean blackness of its
footprint there is computed analytically (`detect/black_area.py`). Only pixels crossed by an edge are divided; the blur
is applied at the resolution of the samples, so that the picture equals (pattern * pixel's area * Gaussian) to about
1e-3.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from scipy.interpolate import RectBivariateSpline

from camcal.detect.black_area import BlackArea
from camcal.detect.targets.base import Pattern
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray
Surface = Callable[[Array], Array]

LEAST_NODES = 4  #: across a small picture; a cubic spline needs as many
UNMIXED = 1e-9  #: fraction of a pixel that is rounding: smaller ones count as 0, those within it of 1 as 1
#: of the height of a sheet where a ray meets it: the error shrinks by about its slope each time, which is below .1
SHEET_STEPS = 12
NODE_STEP = 4  #: px between the rays that are computed; a spline interpolates the others to about 1e-5 px


@dataclass(frozen=True)
class Look:
    """The effects of shading, lens and sensor on a picture; grey levels are those of 8 bits.

    Attributes
    ----------
    blur : float
        Standard deviation of the Gaussian blur, px, besides the pixel's own area.
    noise : float
        Standard deviation of the noise of each pixel, grey levels.
    black, white, background : float
        Grey levels of the print, the sheet and the background.
    gradient : float
        Relative change of the brightness from one side of the picture to the other.
    direction : float
        Direction in which it grows, rad; 0 is to the right, π/2 downward.
    vignetting : float
        Fraction of the brightness that is lost in the picture's corners.
    bits : 8 or 16
    """

    blur: float = 0.8
    noise: float = 0.0
    black: float = 40.0
    white: float = 215.0
    background: float = 110.0
    gradient: float = 0.0
    direction: float = 0.0
    vignetting: float = 0.0
    bits: int = 8


def render(
    pattern: Pattern,
    camera: Camera,
    cam_from_board: Pose,
    look: Look | None = None,
    rng: np.random.Generator | None = None,
    samples: int = 4,
    surface: Surface | None = None,
) -> Array:
    """Draw a picture of a pattern.

    Parameters
    ----------
    pattern : Pattern
    camera : Camera
        Its `image_size` is the size of the picture.
    cam_from_board : Pose
        In the pattern's unit.
    look : Look, optional
    rng : Generator, optional
        For the noise; required if there is noise.
    samples : int
        Samples of a pixel in each direction.
    surface : function, optional
        Height z(xy (..., 2)) of a sheet that is not flat, in the pattern's unit; |slope| well below 1.

    Returns
    -------
    (height, width) uint8 or uint16 array
    """
    look = look or Look()
    if look.noise and rng is None:
        raise ValueError("noise needs a random generator")
    grey = exposure(pattern, camera, cam_from_board, look, samples, surface) * illumination(
        camera.image_size, look
    )
    if look.noise:
        assert rng is not None
        grey = grey + rng.normal(0.0, look.noise, grey.shape)
    top = 2**look.bits - 1
    return np.clip(np.rint(grey * (top / 255.0)), 0, top).astype(np.uint8 if look.bits == 8 else np.uint16)


def exposure(
    pattern: Pattern,
    camera: Camera,
    cam_from_board: Pose,
    look: Look,
    samples: int = 4,
    surface: Surface | None = None,
) -> Array:
    """The noise-free picture without shading, (height, width) grey levels of 8 bits, not rounded."""
    assert camera.image_size is not None, "a camera without an image size cannot take pictures"
    width, height = camera.image_size
    margin = int(np.ceil(4 * look.blur)) + 1
    sheet = np.array(pattern.extent, float)
    black = BlackArea(pattern)
    paper = BlackArea(
        Pattern((sheet[[0, 1, 2, 1, 2, 3, 0, 3]].reshape(4, 2),), np.zeros((0, 3)), pattern.extent)
    )

    rays = pixel_rays(camera, width, height, margin + 1)  # one more for the differences at the border
    scene = _Scene(black, paper, cam_from_board.inverse(), surface, look)
    xy, front = scene.meet(rays)
    centre, footprint = xy[1:-1, 1:-1], _footprint(xy)
    seen = front[1:-1, 1:-1] & np.isfinite(footprint).all(-1) & np.isfinite(centre).all(-1)
    grey, crossed = scene.classify(centre, footprint, seen)

    fine = np.repeat(np.repeat(grey.astype(np.float32), samples, 0), samples, 1)
    rows, columns = np.nonzero(crossed)
    fine_view = fine.reshape(grey.shape[0], samples, grey.shape[1], samples)
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    local = _local_rays(rays, rows + 1, columns + 1)
    sample_width = footprint[rows, columns] / samples
    for j, dv in enumerate(offsets):
        for i, du in enumerate(offsets):
            at, ahead = scene.meet(_taylor(local, du, dv))
            fine_view[rows, j, columns, i] = scene.grey(at, sample_width, ahead)
    if look.blur > 0:
        size = 2 * int(np.ceil(4 * look.blur * samples)) + 1
        fine = cv2.GaussianBlur(fine, (size, size), look.blur * samples, borderType=cv2.BORDER_REPLICATE)
    coarse = fine.reshape(grey.shape[0], samples, grey.shape[1], samples).mean((1, 3), dtype=float)
    return coarse[margin : margin + height, margin : margin + width]


def illumination(image_size: tuple[int, int] | None, look: Look) -> Array:
    """The relative brightness of each pixel, (height, width); 1 in the centre."""
    assert image_size is not None
    width, height = image_size
    u = (np.arange(width) - (width - 1) / 2) / max(width, height)
    v = (np.arange(height) - (height - 1) / 2)[:, None] / max(width, height)
    corner = (width**2 + height**2) / (4 * max(width, height) ** 2)
    slope = look.gradient * (np.cos(look.direction) * u + np.sin(look.direction) * v)
    return (1 + slope) * (1 - look.vignetting * (u * u + v * v) / corner)


def pixel_rays(camera: Camera, width: int, height: int, margin: int) -> Array:
    """Rays (height + 2 margin, width + 2 margin, 3) of the pixels' centres, NaN outside the lens's domain."""
    u, v = np.arange(-margin, width + margin, dtype=float), np.arange(-margin, height + margin, dtype=float)
    nodes_u, nodes_v = _nodes(u), _nodes(v)
    at_nodes = camera.unproject(np.stack(np.meshgrid(nodes_u, nodes_v), -1))
    if not np.isfinite(at_nodes).all():  # a spline would spread the gap to its neighbours
        return camera.unproject(np.stack(np.meshgrid(u, v), -1))
    return np.stack([RectBivariateSpline(nodes_v, nodes_u, at_nodes[..., k])(v, u) for k in range(3)], -1)


def _nodes(values: Array) -> Array:
    count = max(int(np.ceil((values[-1] - values[0]) / NODE_STEP)) + 1, LEAST_NODES)
    return np.linspace(values[0], values[-1], count)


@dataclass(frozen=True)
class _Scene:
    """A printed sheet, seen by a camera."""

    black: BlackArea
    paper: BlackArea
    board_from_cam: Pose
    surface: Surface | None
    look: Look

    def meet(self, rays: Array) -> tuple[Array, Array]:
        """The intersections of rays (..., 3) of the camera's frame with the sheet: xy (..., 2), and whether in
        front.
        """
        origin = self.board_from_cam.translation
        direction = rays @ self.board_from_cam.rotation.T
        with np.errstate(all="ignore"):
            length = -origin[2] / direction[..., 2]
            if self.surface is not None:
                for _ in range(SHEET_STEPS):
                    height = self.surface(origin[:2] + length[..., None] * direction[..., :2])
                    length = (height - origin[2]) / direction[..., 2]
            xy = origin[:2] + length[..., None] * direction[..., :2]
            front = (length > 0) & np.isfinite(length)
        return xy, front

    def coverage(self, xy: Array, width: Array, front: Array) -> tuple[Array, Array]:
        """The fractions of each box that are sheet, and of the sheet that are black; 0 to 1."""
        paper = np.where(front, self.paper.mean(xy, width), 0.0)
        if self.board_from_cam.translation[2] >= 0:
            return paper, np.zeros_like(paper)  # the printed side faces negative z; the other is blank
        return paper, self.black.mean(xy, width)

    def grey(self, xy: Array, width: Array, front: Array) -> Array:
        """Grey levels of boxes of the sheet and of the background."""
        return self.shade(*self.coverage(xy, width, front))

    def shade(self, paper: Array, black: Array) -> Array:
        """Grey level of a mixture."""
        look = self.look
        return look.background + paper * (look.white - look.background) - black * (look.white - look.black)

    def classify(self, xy: Array, width: Array, seen: Array) -> tuple[Array, Array]:
        """The grey level of each pixel, and whether an edge crosses or approaches it."""
        grey = np.full(seen.shape, self.look.background)
        crossed = np.zeros_like(seen)
        low, high = np.array(self.black.pattern.extent).reshape(2, 2)
        near = seen & ((xy > low - 2 * width) & (xy < high + 2 * width)).all(-1)
        # twice the footprint: a box along the board's axes may miss the corner of a rotated pixel
        paper, black = self.coverage(xy[near], 2 * width[near], np.ones(near.sum(), bool))
        grey[near] = self.shade(paper, black)
        crossed[near] = _mixed(paper) | _mixed(black)
        return grey, crossed


def _mixed(part: Array) -> Array:
    return (part > UNMIXED) & (part < 1 - UNMIXED)


def _footprint(xy: Array) -> Array:
    """Sides (..., 2) of the box with the same second moments as a pixel's image on the board."""
    along_u = (xy[1:-1, 2:] - xy[1:-1, :-2]) / 2
    along_v = (xy[2:, 1:-1] - xy[:-2, 1:-1]) / 2
    with np.errstate(all="ignore"):
        return np.hypot(along_u, along_v)


def _local_rays(rays: Array, rows: Array, columns: Array) -> tuple[Array, ...]:
    """Value, first and second derivatives of the rays at some pixels, by central differences."""
    centre, left, right = rays[rows, columns], rays[rows, columns - 1], rays[rows, columns + 1]
    up, down = rays[rows - 1, columns], rays[rows + 1, columns]
    mixed = (
        rays[rows + 1, columns + 1]
        - rays[rows + 1, columns - 1]
        - rays[rows - 1, columns + 1]
        + rays[rows - 1, columns - 1]
    ) / 4
    return (
        centre,
        (right - left) / 2,
        (down - up) / 2,
        right - 2 * centre + left,
        mixed,
        down - 2 * centre + up,
    )


def _taylor(local: tuple[Array, ...], du: float, dv: float) -> Array:
    value, ru, rv, ruu, ruv, rvv = local
    return value + du * ru + dv * rv + du * du / 2 * ruu + du * dv * ruv + dv * dv / 2 * rvv
