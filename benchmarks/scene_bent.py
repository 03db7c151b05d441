"""What `camcal scene` makes of rendered pictures through a lens with distortion.

The pictures of `scene_rendered.py` (rooms and streets), resampled through a division model of one term about the
middle, the principal point given. Of each coefficient and model: errors of the focal length and of the coefficient,
whether their 95 % intervals hold, and in how many pictures the warning `lines-bent` is given. `chains` are the long
curves that `camcal lines` finds in the same pictures, with the focal length held.

Usage: python benchmarks/scene_bent.py [--runs 25] --kept FILE [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
from scene_rendered import KINDS, MIDDLE, SIZE, picture
from tables import keep, kept, markdown, show

from camcal.detect.lines import find_lines
from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.report.scene import _segments
from camcal.routes import line_start, scene
from camcal.routes.line_geometry import Lines
from camcal.routes.scene_bend import with_distortion

DIVISION = lenses.make("division:1")
SCENES, COEFFICIENTS = ("room", "street"), (0.0, -0.05, -0.15)
FIX = {"cx": float(MIDDLE[0]), "cy": float(MIDDLE[1])}
HEADER = (
    "l1",
    "model",
    "pictures",
    "refused",
    "median error of f",
    "holds f",
    "rms error of l1",
    "holds l1",
    "warned",
)


def through(grey, focal, coefficient):
    """The picture that a lens with distortion takes of the same scene."""
    camera = Camera(DIVISION, np.array([focal, focal, *MIDDLE, coefficient]), SIZE)
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    rays = camera.unproject(np.c_[u.ravel(), v.ravel()])
    ideal = (focal * rays[:, :2] / rays[:, 2:] + MIDDLE).reshape(*grey.shape, 2).astype(np.float32)
    return cv2.remap(grey, ideal[..., 0], ideal[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def result(estimated, focal, coefficient):
    """Errors of a fit in their units, and in standard deviations."""
    try:
        found = estimated()
    except CamcalError:
        return {}, None
    values, sigma = found.camera.values, np.sqrt(np.diagonal(found.covariance))
    made = {"f": values["fx"] / focal - 1}
    if sigma[0] > 0:
        made["f_sigmas"] = (values["fx"] - focal) / sigma[0]
    if "l1" in values:
        made |= {"l1": values["l1"] - coefficient, "l1_sigmas": (values["l1"] - coefficient) / sigma[-1]}
    return made, found


def measure(name, coefficient, seed):
    """One picture with all models."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.png"
        cv2.imwrite(str(path), through(picture(kind, seed), kind.focal, coefficient))
        lines, grey = _segments(path, None), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    chains = find_lines(grey)
    chains = Lines.of(chains, [str(i) for i in range(len(chains))], SIZE)
    plain, found = result(
        lambda: scene.estimate(lines, lenses.make("pinhole"), FIX, 0, True), kind.focal, coefficient
    )
    if found is not None:
        plain["warned"] = with_distortion(found, lines, FIX, 0, True) is not None
    bent, _ = result(lambda: scene.estimate(lines, DIVISION, FIX, 0, True), kind.focal, coefficient)
    held = {**FIX, "fx": kind.focal}
    long, _ = result(lambda: line_start.estimate(chains, DIVISION, held, True, True), kind.focal, coefficient)
    return {"l1": coefficient, "pinhole": plain, "division:1": bent, "chains": long}


def row(coefficient, model, runs):
    """One row of the table."""
    own = [r[model] for r in runs if r["l1"] == coefficient]
    made = [r for r in own if r]

    def cell(name, of, form):
        values = np.array([r[name] for r in made if name in r], float)
        return form.format(of(values)) if len(values) else ""

    def holds(z):
        return np.mean(np.abs(z) <= 1.96)

    return [
        f"{coefficient:g}",
        model,
        len(own),
        len(own) - len(made),
        cell("f", lambda v: 100 * np.median(np.abs(v)), "{:.2f} %") if model != "chains" else "",
        cell("f_sigmas", holds, "{:.0%}"),
        cell("l1", lambda v: np.sqrt(np.mean(v**2)), "{:.4f}"),
        cell("l1_sigmas", holds, "{:.0%}"),
        cell("warned", np.mean, "{:.0%}"),
    ]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=25)
    parser.add_argument("--kept", type=Path, required=True)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    if not given.update:
        for seed in range(given.runs):
            for name in SCENES:
                for coefficient in COEFFICIENTS:
                    keep(given.kept, measure(name, coefficient, seed))
    runs = kept(given.kept)
    rows = [row(k, m, runs) for k in COEFFICIENTS for m in ("pinhole", "division:1", "chains")]
    show(given.update, "scene-bent", markdown(HEADER, rows))


if __name__ == "__main__":
    main()
