"""Bias and spread of each route against the Cramér-Rao bound, and where it breaks.

Made scenes (benchmarks/routes_cases.py) with Gaussian noise in the image coordinates. Of every scene and noise:
how many runs are refused; the bias and the standard deviation of the figure, both in bounds (the bias of n runs
is beyond 2 / sqrt(n) by chance in one of twenty); and how often the 95 % interval of the route holds the truth.
Spreads are 1.4826 times the median absolute deviation, which one wrong minimum does not change; `astray` are runs
that are off by more than ten bounds and their own intervals.

Usage: python benchmarks/routes.py --kept rows.json [more.json ...] [--runs 200] [--only pose,lines] [--noise 0.3,3]
[--minutes 10] [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from routes_cases import CASES
from scipy.stats import t as student
from tables import markdown, show

from camcal.errors import CamcalError

HEADER = (
    "route",
    "scene",
    "figure",
    "noise, px",
    "runs",
    "bound",
    "refused",
    "bias",
    "spread",
    "inside 95 %",
    "astray",
)


def study(case, noise, runs):
    """One row of the table."""
    values, sigmas, intervals, refused = [], [], [], 0
    for run in range(runs):
        try:
            value, sigma, *interval = case.run(np.random.default_rng(10_000 + run), noise)
        except CamcalError:
            refused += 1
            continue
        values.append(value)
        sigmas.append(np.nan if sigma is None else sigma)
        intervals += interval
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
    if intervals:  # the route's own
        held = np.array([low <= case.truth <= high for low, high in intervals])
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


def key(case, noise):
    """What a row of the table is known by."""
    return f"{case.route} | {case.scene} | {noise:g}"


def complete(kept, names, noises, runs, ends):
    """The rows that are missing, each written as soon as it is there, until the time is up."""
    for name in names:
        for case in CASES[name]():
            for noise in noises:
                if time.monotonic() > ends:
                    return
                rows = json.loads(kept.read_text()) if kept.exists() else {}
                row = rows.get(key(case, noise))
                if row is None or int(row[HEADER.index("runs")]) < runs:
                    row = study(case, noise, runs)
                    print(row, flush=True)
                    kept.write_text(json.dumps({**rows, key(case, noise): row}))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--noise", default="0.3,3")
    parser.add_argument(
        "--kept", type=Path, nargs="+", required=True, help="rows (JSON): completed, and read"
    )
    parser.add_argument("--minutes", type=float, default=np.inf, help="no row is begun after so many")
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    noises = list(map(float, given.noise.split(",")))
    complete(given.kept[0], given.only.split(","), noises, given.runs, time.monotonic() + 60 * given.minutes)
    rows = {k: row for path in given.kept for k, row in json.loads(path.read_text()).items()}
    order = [key(c, noise) for name in CASES for c in CASES[name]() for noise in noises]
    table = markdown(HEADER, [rows[k] for k in order if k in rows])
    show(given.update, "study", table)


if __name__ == "__main__":
    main()
