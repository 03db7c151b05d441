"""Bias and coverage of hand-eye calibrations over simulated robots, beside closed forms of camcal and of cv2.

Robots with 0 to 5 mm of noise and a tenth of a degree for each mm, pictures with 0.2 px, cameras in the hand and
beside the robot. How often the 95 % intervals hold the truth (all six figures of the transformation; the worst and the
best in brackets), the largest bias in standard errors (above 2.6 in one of six figures is one in twenty by chance), the
root mean square of error over sigma, the robot's noise as estimated, and the root mean square errors of the
translation, mm: of the joint estimate and of the closed forms. cv2's is run where its wheel has it (4.14; not 5.0).

Usage: python benchmarks/hand_eye.py [--runs 500] [--poses 15] [--rows in-hand:0,to-hand:5] [--results FILE]
       python benchmarks/hand_eye.py --poses 15 --results FILE --update docs/hand-eye.md

With `--calibrated` the camera is calibrated from the same pictures (opencv4), and the table compares it estimated along
with the camera held.

`--results` takes the rows one by one as they are done (a line of JSON each), so that a study can be run in pieces;
`--update` writes the table of all rows that are in it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tables import keep, kept, markdown, update

import camcal
from camcal.plan.hand_eye import _pictures, camera_along
from camcal.routes.hand_eye.estimate import estimate
from camcal.routes.hand_eye.pictures import alone
from tests.routes.hand_eye.hands import hand, off

NOISES = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0)
FORMS = ("tsai", "park", "horaud", "andreff", "daniilidis", "shah", "li")


def cv2_error(h, c, name):
    """Error of the translation of cv2.calibrateHandEye, or None."""
    if not hasattr(cv2, "calibrateHandEye"):
        return None
    robot = h.robot if h.setup == "in-hand" else h.robot.inverse()
    method = getattr(cv2, f"CALIB_HAND_EYE_{name.upper()}")
    _, t = cv2.calibrateHandEye(
        list(robot.rotation), list(robot.translation), list(c.rotation), list(c.translation), method=method
    )
    return float(np.linalg.norm(np.ravel(t) - h.x.translation))


def calibrated(setup, mm, runs, poses):
    """One row of the table of cameras that are calibrated from the same pictures."""
    errors, held, sigmas, inside, noises, focal = [], [], [], [], [], []
    for seed in range(runs):
        h = hand(setup, 20_000 + seed, poses, mm=mm, deg=mm / 10)
        views = [(v.xyz, v.uv) for v in h.pictures.views]
        data = camcal.Correspondences.from_views(views, image_size=h.pictures.camera.image_size)
        solution = camcal.calibrate(data, model="opencv4", robust="none", checks=False)
        pictures, _ = _pictures(solution)
        found = estimate(setup, pictures, h.robot)
        known = replace(pictures, gain=pictures.gain[:, :, :0], camera_covariance=np.zeros((0, 0)))
        other = estimate(setup, known, h.robot)
        errors.append(off(found.x, h.x))
        held.append(off(other.x, h.x))
        sigmas.append(found.sigma[:6])
        inside.append(np.abs(errors[-1]) <= found.half_width[:6])
        noises.append([[e.noise.translation, np.degrees(e.noise.rotation)] for e in (found, other)])
        fx = camera_along(found, solution)["fx"]
        focal.append([fx[0] - 600, fx[2] - 600])
    d, e = np.array(errors), np.array(held)
    share = 100 * np.mean(inside, 0)
    found, other = (" / ".join(f"{v:.2g}" for v in np.median(np.array(noises)[:, k], 0)) for k in (0, 1))
    return [
        setup,
        f"{mm:g}",
        f"{share.mean():.1f} ({share.min():.1f} to {share.max():.1f})",
        f"{np.abs(d.mean(0) / (d.std(0) / np.sqrt(runs))).max():.1f}",
        f"{np.sqrt(np.square(d / np.array(sigmas)).mean()):.2f}",
        found,
        other,
        *(f"{np.sqrt(np.square(v[:, 3:]).sum(1).mean()):.3f}" for v in (d, e)),
        *(f"{v:.2f}" for v in np.sqrt(np.mean(np.square(focal), 0))),
    ]


def study(setup, mm, runs, poses):
    """One row of the table."""
    errors, sigmas, inside, noises = [], [], [], []
    forms = {name: [] for name in FORMS}
    theirs = []
    for seed in range(runs):
        h = hand(setup, 10_000 + seed, poses, mm=mm, deg=mm / 10)
        found = estimate(setup, h.pictures, h.robot)
        d = off(found.x, h.x)
        errors.append(d)
        sigmas.append(found.sigma[:6])
        inside.append(np.abs(d) <= found.half_width[:6])
        noises.append([found.noise.translation, np.degrees(found.noise.rotation)])
        for m in found.methods:
            wrong = np.inf if m.x is None else np.linalg.norm(m.x.translation - h.x.translation)
            forms[m.name].append(wrong)
        theirs.append(cv2_error(h, alone(h.pictures).poses, "park"))
    d = np.array(errors)
    bias = np.abs(d.mean(0) / (d.std(0) / np.sqrt(runs))).max()
    rms = np.sqrt(np.square(d[:, 3:]).sum(1).mean())
    honest = np.sqrt(np.square(d / np.array(sigmas)).mean())
    cells = [
        setup,
        f"{mm:g}",
        f"{100 * np.mean(inside):.1f} ({100 * np.mean(inside, 0).min():.1f} to {100 * np.mean(inside, 0).max():.1f})",
        f"{bias:.1f}",
        f"{honest:.2f}",
        " / ".join(f"{v:.2g}" for v in np.median(noises, 0)),
        f"{rms:.3f}",
        *(f"{np.sqrt(np.mean(np.square(forms[n]))):.3f}" for n in FORMS),
    ]
    if theirs[0] is not None:
        cells.append(f"{np.sqrt(np.mean(np.square(theirs))):.3f}")
    return cells


def main():
    parser = argparse.ArgumentParser()
    every = [f"{setup}:{mm:g}" for setup in ("in-hand", "to-hand") for mm in NOISES]
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--poses", type=int, default=15)
    parser.add_argument("--rows", default=",".join(every))
    parser.add_argument("--calibrated", action="store_true")
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    if given.update is None:
        for row in given.rows.split(","):
            setup, mm = row.split(":")
            made = {
                "poses": given.poses,
                "row": row,
                "cells": (calibrated if given.calibrated else study)(
                    setup, float(mm), given.runs, given.poses
                ),
            }
            print(made["cells"], flush=True)
            keep(given.results, made)
        return
    rows = {d["row"]: d["cells"] for d in kept(given.results) if d["poses"] == given.poses}
    shared = ["set-up", "noise", "inside 95 %", "bias", "error/sigma", "noise found, mm, deg"]
    if given.calibrated:
        header = [*shared, "camera held", "translation, mm", "camera held", "fx, px", "by the pictures"]
        update(given.update, "study-calibrated", markdown(header, [rows[r] for r in every if r in rows]))
        return
    header = [*shared, "joint", *FORMS]
    if hasattr(cv2, "calibrateHandEye"):
        header.append(f"cv2 {cv2.__version__} park")
    update(given.update, f"study-{given.poses}", markdown(header, [rows[r] for r in every if r in rows]))


if __name__ == "__main__":
    main()
