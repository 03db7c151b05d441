"""Bias and coverage of hand-eye calibrations over simulated robots, beside closed forms of camcal and of cv2.

    python benchmarks/hand_eye.py [--runs 500] [--poses 15]

Robots with 0 to 5 mm and 0 to 0.5 deg of noise (a tenth of a degree for each mm), pictures with 0.2 px, cameras in the hand and
beside the robot. Printed: how often the 95 % intervals hold the truth (all six figures of the transformation), the bias in
standard errors (beyond 3 in one of six figures is one in 60 by chance), the root mean square errors of the translation
of the joint estimate and of the closed forms, and the robot's noise as estimated. cv2's are run where its wheel has
them (4.14; not 5.0): `PYTHONPATH` may lead to another wheel.
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np

from camcal.routes.hand_eye.estimate import alone, estimate
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


def study(setup, mm, runs, poses):
    """One row of the table."""
    errors, sigmas, inside, normal, noises = [], [], [], [], []
    forms = {name: [] for name in FORMS}
    theirs = []
    for seed in range(runs):
        h = hand(setup, 10_000 + seed, poses, mm=mm, deg=mm / 10)
        found = estimate(setup, h.pictures, h.robot)
        d = off(found.x, h.x)
        errors.append(d)
        sigmas.append(found.sigma[:6])
        inside.append(np.abs(d) <= found.half_width[:6])
        normal.append(np.abs(d) <= 1.96 * found.sigma[:6])
        noises.append([found.noise.translation, np.degrees(found.noise.rotation)])
        for m in found.methods:
            wrong = np.inf if m.x is None else np.linalg.norm(m.x.translation - h.x.translation)
            forms[m.name].append(wrong)
        theirs.append(cv2_error(h, alone(found.pictures).poses, "park"))
    d = np.array(errors)
    bias = np.abs(d.mean(0) / (d.std(0) / np.sqrt(runs))).max()
    rms = np.sqrt(np.square(d[:, 3:]).sum(1).mean())
    honest = np.sqrt(np.square(d / np.array(sigmas)).mean())
    cells = [
        setup,
        f"{mm:g}",
        f"{100 * np.mean(inside):.1f} ({100 * np.mean(inside, 0).min():.1f} to {100 * np.mean(inside, 0).max():.1f})",
        f"{100 * np.mean(normal):.1f}",
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
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--poses", type=int, default=15)
    given = parser.parse_args()
    header = [
        "set-up",
        "noise, mm",
        "inside 95 %",
        "±1.96 sigma",
        "bias",
        "error/sigma",
        "noise found, mm / deg",
        "joint",
        *FORMS,
    ]
    if hasattr(cv2, "calibrateHandEye"):
        header.append(f"cv2 {cv2.__version__} park")
    print("| " + " | ".join(header) + " |\n" + "|---" * len(header) + "|", flush=True)
    for setup in ("in-hand", "to-hand"):
        for mm in NOISES:
            print("| " + " | ".join(study(setup, mm, given.runs, given.poses)) + " |", flush=True)


if __name__ == "__main__":
    main()
