"""Straightness of strings that took no part in the fit, and what is left in them.

Each picture of a calibration harp is held out in turn, the lens fitted to the strings of the others. Of the strings
held out (those within five medians):

- `held out`: rms of the distances of their points from straight, px; `alone`: of a fit to these strings themselves,
  which no fit to others can undercut by much;
- `points`: the part that changes from one point to the next (the root of half the mean square of differences of
  neighbours): noise of the detection;
- `neighbours`: the correlation of the rest between strings side by side. A lens that the fit does not describe bends
  strings side by side alike (near 1); strings that are not straight, and their uneven edges, do not share it (near 0).

Usage: python benchmarks/harp.py PICTURE... [--models opencv8 ...] [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from tables import markdown, show

from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.routes import line_start
from camcal.routes.line_geometry import Lines, distances
from camcal.routes.read_lines import read_lines
from camcal.routes.straightness import undistorted

MODELS = ("brown:radial=3,decentering=0,centre=free", "brown:radial=3", "opencv8", "opencv14")
HEADER = ("model", "held out", "strings", "held out, px", "alone, px", "points, px", "neighbours")
FAR = 5.0  #: medians of the rms of strings; others are no single string
WINDOW = 9  #: points of a running mean, 72 px: what a lens does is smoother than that


def joined(parts):
    """The lines of several pictures together."""
    uv = [part.uv[part.line == i] for part in parts for i in range(len(part))]
    return Lines.of(uv, [f"{k}:{n}" for k, part in enumerate(parts) for n in part.names], parts[0].image_size)


def straight(camera, lines):
    """The lines that are single strings."""
    rms = line_start.line_rms(camera, lines)
    return lines.take(rms < FAR * np.median(rms))


def rms(off):
    return float(np.sqrt(np.mean(np.square(off))))


def point_noise(off, lines):
    """From the differences of neighbours along a line."""
    same = lines.line[1:] == lines.line[:-1]
    return float(np.sqrt(0.5 * np.square(np.diff(off))[same].mean()))


def shared(camera, lines):
    """The correlation between smoothed deviations of neighbouring strings, at points side by side."""
    flat = undistorted(camera, lines.uv)
    chords = np.stack([np.diff(flat[lines.line == i][[0, -1]], axis=0)[0] for i in range(len(lines))])
    chords *= np.sign(chords @ chords[0])[:, None]
    main = chords.sum(0) / np.linalg.norm(chords.sum(0))
    along, across = flat @ main, flat @ [-main[1], main[0]]
    kernel, curves = np.ones(WINDOW) / WINDOW, []
    for i in range(len(lines)):
        rows = np.flatnonzero(lines.line == i)
        rows = rows[np.argsort(along[rows])]
        if len(rows) >= 2 * WINDOW:
            line = np.polynomial.Polynomial.fit(along[rows], across[rows], 1)
            off = across[rows] - line(along[rows])
            smooth = [np.convolve(x, kernel, "valid") for x in (along[rows], off)]
            curves.append((float(across[rows].mean()), *smooth))
    first, second = [], []
    curves.sort(key=lambda c: c[0])
    for (_, a, x), (_, b, y) in pairwise(curves):
        both = a[(a > b[0]) & (a < b[-1])]
        first.append(np.interp(both, a, x))
        second.append(np.interp(both, b, y))
    return float(np.corrcoef(np.concatenate(first), np.concatenate(second))[0, 1])


def row(model, name, own, others):
    """One row of the table."""
    try:
        camera = line_start.estimate(joined(others), lenses.make(model), {}, True).camera
        alone = line_start.estimate(own, lenses.make(model), {}, True).camera
    except CamcalError as error:
        return [model, name, str(len(own)), f"({error})", "", "", ""]
    lines = straight(camera, own)
    off = distances(camera, lines)
    figures = [rms(off), rms(distances(alone, straight(alone, own))), point_noise(off, lines)]
    return [model, name, str(len(lines)), *(f"{x:.3f}" for x in figures), f"{shared(camera, lines):+.2f}"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("pictures", nargs="+")
    parser.add_argument("--models", nargs="+", default=MODELS)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    parts = [read_lines([p])[0] for p in given.pictures]
    rows = []
    for model in given.models:
        for k, own in enumerate(parts):
            rows.append(row(model, str(k + 1), own, parts[:k] + parts[k + 1 :]))
            print(*rows[-1], flush=True)
    table = markdown(HEADER, rows)
    show(given.update, "harp", table)


if __name__ == "__main__":
    main()
