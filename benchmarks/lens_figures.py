"""The figures of docs/lenses.md: the curve and the field of every model.

    python benchmarks/lens_figures.py [--folder docs/figures] [--models "kb4;mei"]

Needs matplotlib. Left, the image radius in focal lengths (of the axis) over the angle from it: the model's example
cameras along 12 directions about the axis (one line where the lens is symmetric), up to the picture's corner,
thin beyond it up to the end of the domain; dashed a perspective lens, dotted an equidistant one. Right, how far
the first camera puts a ray from where the perspective lens (or, beyond 60 degrees, the equidistant one) with
the same focal length on the axis puts it; the arrows are as long as the differences, or enlarged as said.
"""

from __future__ import annotations

import argparse
import io
import re
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from camcal.model import lenses
from camcal.model.lenses.base import Lens

Array = np.ndarray

MODELS = (
    "opencv5", "opencv8", "opencv12", "opencv14", "brown:radial=4,decentering=3,prism=1",
    "brown:radial=2,decentering=0,centre=free", "kb4", "ucm", "eucm", "ds", "mei", "fov", "division:3",
    "division:3,direction=distort", "scaramuzza", "radial-profile", "rational-function", "bicubic", "polynomial:5",
    "spline:8x6",
)  # fmt: skip
TURN = np.linspace(0, 2 * np.pi, 12, endpoint=False)
COLOURS = ("#0072B2", "#D55E00")  # Okabe and Ito
GREY = "#777777"
#: a picture that reaches farther from the axis is compared with an equidistant lens
WIDE = np.deg2rad(60)


def name_of(spec: str) -> str:
    """The file of a model's figure."""
    return "lenses-" + spec.replace(":", "-").replace(",", "-").replace("=", "") + ".svg"


def figure_of(spec: str) -> Figure:
    """Curve and field of a model."""
    lens = lenses.make(spec)
    figure = Figure(figsize=(8.2, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    highest = 0.0
    for (params, size), colour in zip(lens.examples(), COLOURS, strict=False):
        highest = max(highest, curve(left, lens, params, size, colour))
    theta = np.linspace(0, np.pi, 400)
    with np.errstate(invalid="ignore"):
        straight = np.where(theta < np.pi / 2 - 0.02, np.tan(theta), np.nan)
    left.plot(np.rad2deg(theta), straight, "--", color=GREY, lw=1, label="perspective")
    left.plot(np.rad2deg(theta), theta, ":", color=GREY, lw=1, label="equidistant")
    left.set_ylim(0, 1.15 * highest)
    left.set_xlabel("angle from the axis, degrees")
    left.set_ylabel("image radius / focal length")
    left.legend(fontsize=7, loc="upper left")
    field(right, lens, *lens.examples()[0])
    return figure


def curve(axes: Axes, lens: Lens, params: Array, size: tuple[int, int], colour: str) -> float:
    """Draw a camera's curve; the largest radius of the picture, in focal lengths."""
    focal, centre = params[:2] * magnification(lens, params), params[2:4]
    corners = np.array([(0, 0), (size[0] - 1, 0), (0, size[1] - 1), (size[0] - 1, size[1] - 1)], float)
    rays, _ = lens.unproject(params, corners)
    widest = float(np.nanmax(np.arccos(rays[:, 2])))
    limit = lens.limit_angle(params)
    for low, high, width in ((0.0, widest, 1.6), (widest, min(limit, 1.3 * widest + 0.2), 0.6)):
        theta = np.linspace(low, high, 60)[:, None]
        xyz = [
            np.sin(theta) * np.cos(TURN),
            np.sin(theta) * np.sin(TURN),
            np.repeat(np.cos(theta), len(TURN), 1),
        ]
        uv, _ = lens.project(params, np.stack(xyz, -1))
        off = (uv - centre) / focal
        radius = np.hypot(off[..., 0], off[..., 1])
        known = radius[np.isfinite(radius).all(1)]
        some = radius if len(known) and np.ptp(known, axis=1).max() > 2e-3 else radius[:, :1]
        label = f"{size[0]}x{size[1]}, f = {focal[0]:.0f}" if width > 1 else None
        thick = width if some.shape[1] == 1 else width / 2
        for line in some.T:
            axes.plot(np.rad2deg(theta), line, color=colour, lw=thick, label=label)
            label = None
    axes.set_xlim(0, max(axes.get_xlim()[1] if axes.lines else 0, np.rad2deg(min(limit, 1.3 * widest + 0.2))))
    return float(np.hypot(*((corners - centre) / focal).T).max())


def magnification(lens: Lens, params: Array) -> float:
    """dR/dθ on the axis, in units of fx and fy: 1, but for models whose parameters scale it as well."""
    small = 1e-4
    xyz = np.stack([small * np.cos(TURN), small * np.sin(TURN), np.ones_like(TURN)], -1)
    uv, _ = lens.project(params, xyz)
    return float(np.hypot(*((uv - uv.mean(0)) / params[:2]).T).mean() / small)


def field(axes: Axes, lens: Lens, params: Array, size: tuple[int, int]) -> None:
    """Draw the differences from the undistorted lens over the picture."""
    u, v = np.linspace(0, size[0] - 1, 13), np.linspace(0, size[1] - 1, 10)
    uv = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    rays, valid = lens.unproject(params, uv)
    uv, rays = uv[valid], rays[valid]
    angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    wide = bool(angle.max() > WIDE)
    radius = magnification(lens, params) * (angle if wide else np.tan(angle))
    plain = rays[:, :2] / np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-12)[:, None] * radius[:, None]
    straight = np.c_[plain, np.ones(len(plain))] @ lens.matrix(params)[:2].T
    by = uv - straight
    longest = float(np.hypot(*by.T).max())
    scale = 1.0 if longest > size[0] / 40 else 10.0 ** np.ceil(np.log10(size[0] / 40 / max(longest, 1e-9)))
    start = uv - scale * by
    arrows = axes.quiver(
        *start.T,
        *(scale * by).T,
        np.hypot(*by.T),
        angles="xy",
        scale_units="xy",
        scale=1,
        cmap="viridis",
        width=0.004,
    )
    axes.figure.colorbar(arrows, ax=axes, label="px")
    axes.add_patch(Rectangle((0, 0), size[0] - 1, size[1] - 1, fill=False, color=GREY, lw=0.8))
    (left, top), (right, bottom) = np.minimum(start.min(0), 0), np.maximum(start.max(0), np.array(size))
    axes.set_xlim(left - 0.02 * size[0], right + 0.02 * size[0])
    axes.set_ylim(bottom + 0.02 * size[1], top - 0.02 * size[1])
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    against = "equidistant" if wide else "perspective"
    enlarged = "" if scale == 1 else f", enlarged {scale:.0f} times"
    axes.set_title(f"from {against} to this lens{enlarged}", fontsize=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    parser.add_argument("--models", default=";".join(MODELS), help="separated by ;")
    told = parser.parse_args()
    told.folder.mkdir(parents=True, exist_ok=True)
    # the same file for the same curves: ids by a fixed salt, no date, text as text
    matplotlib.rcParams.update({"svg.hashsalt": "camcal", "svg.fonttype": "none", "font.size": 9})
    for spec in told.models.split(";"):
        drawing = io.StringIO()
        figure_of(spec).savefig(drawing, format="svg", metadata={"Date": None})
        # hundredths of a point are enough, and a third of the size
        text = re.sub(r"-?\d+\.\d{3,}(?!\d*[e%])", lambda m: f"{float(m[0]):.2f}", drawing.getvalue())
        (told.folder / name_of(spec)).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
