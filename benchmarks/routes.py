"""Bias and spread of each route against the Cramér-Rao bound, and where it breaks.

Made scenes (benchmarks/routes_cases.py) with Gaussian noise in the image coordinates. Of every scene and noise:
how many runs are refused; the bias and the standard deviation of the figure, both in bounds (the bias of n runs
is beyond 2 / sqrt(n) by chance in one of twenty); and how often the 95 % interval of the route holds the truth.
Spreads are 1.4826 times the median absolute deviation, which one wrong minimum does not change; `astray` are runs
that are off by more than ten bounds and their own intervals.

Usage: python benchmarks/routes.py [--runs 200] [--only pose,lines] [--noise 0.3,3] [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from routes_cases import CASES
from scipy.stats import t as student
from tables import markdown, update

from camcal.errors import CamcalError

HEADER = (
    "route",
    "scene",
    "figure",
    "noise, px",
    "bound",
    "refused",
    "bias",
    "spread",
    "inside 95 %",
    "astray",
)


def study(case, noise, runs):
    """One row of the table."""
    values, sigmas, refused = [], [], 0
    for run in range(runs):
        try:
            value, sigma = case.run(np.random.default_rng(10_000 + run), noise)
        except CamcalError:
            refused += 1
            continue
        values.append(value)
        sigmas.append(np.nan if sigma is None else sigma)
    bound = case.bound * noise
    known = f"{bound:.3g}" if np.isfinite(bound) else "undetermined"
    cells = [
        case.route,
        case.scene,
        f"{case.figure} {case.truth:g}",
        f"{noise:g}",
        str(runs),
        known,
        f"{100 * refused / runs:.0f} %",
    ]
    if len(values) < 2:
        return [*cells, "", "", "", ""]
    off, sigma = np.array(values) - case.truth, np.array(sigmas)
    held = np.abs(off) <= student.ppf(0.975, case.freedom) * sigma
    unit = bound if np.isfinite(bound) else 1.0
    spread = 1.4826 * np.median(np.abs(off - np.median(off)))
    astray = (np.abs(off) > 10 * bound) & ~held
    inside = f"{100 * held.mean():.0f} %" if np.isfinite(sigma).all() else ""
    unitless = np.isfinite(bound)
    return [
        *cells,
        f"{np.median(off) / unit:+.2f}" if unitless else f"{np.median(off):+.3g} absolute",
        f"{spread / unit:.2f}" if unitless else f"{spread:.3g} absolute",
        inside,
        f"{100 * astray.mean():.0f} %",
    ]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--noise", default="0.3,3")
    parser.add_argument("--kept", type=Path, help="rows of earlier runs (JSON), completed and written again")
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    kept = json.loads(given.kept.read_text()) if given.kept and given.kept.exists() else {}
    for name in given.only.split(","):
        rows = []
        for case in CASES[name]():
            for noise in map(float, given.noise.split(",")):
                rows.append(study(case, noise, given.runs))
                print(rows[-1], flush=True)
        kept[name] = rows
        if given.kept:
            given.kept.write_text(json.dumps(kept))
    table = markdown(HEADER, [row for name in CASES if name in kept for row in kept[name]])
    print(table)
    if given.update:
        update(given.update, "study", table)


if __name__ == "__main__":
    main()
