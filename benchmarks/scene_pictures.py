"""The focal length of single pictures of known cameras, and whether it hangs on constants set on the same pictures.

Three constants of `camcal scene` were set on the York Urban pictures: the noise of segments and how far edges are out
of their direction (both by the likelihood of the segments, without the known focal length), and how far directions are
out of square (by the errors of the focal length). Each picture is held out in turn: the three are chosen again by the
others (of the values below) and the picture is estimated with these.

Usage: python benchmarks/scene_pictures.py --focal 674.918 --centre 306.551,250.454 PICTURE... [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from tables import markdown, show

from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.report.scene import _segments
from camcal.routes import scene, scene_vote

#: (noise of segments, px; edges out of their direction, rad), the first as it is
SEGMENTS = ((0.2, 0.003), (0.1, 0.003), (0.3, 0.003), (0.2, 0.006))
SQUARE = np.radians((0.0, 0.3, 0.6, 0.86, 1.2, 1.8))  #: directions out of square


def measure(picture, fix, truth):
    """The likelihood, relative error, and the two parts of the relative variance, for each choice; NaN if refused."""
    lines = _segments(picture, None)
    out = np.full((len(SEGMENTS), 4), np.nan)
    plain = {}
    complete = scene._out_of_square

    def noted(lines, found, fix, seen):
        plain["found"] = found
        return complete(lines, found, fix, seen)

    for i, (noise, loose) in enumerate(SEGMENTS):
        scene_vote.PICTURE_NOISE, scene_vote.LOOSE, scene._out_of_square = noise, loose, noted
        try:
            found = scene.estimate(lines, lenses.make("pinhole"), fix, 0, True)
        except CamcalError:
            continue
        finally:
            scene_vote.PICTURE_NOISE, scene_vote.LOOSE = SEGMENTS[0]
            scene._out_of_square = complete
        own = plain["found"].covariance[0, 0]
        error = found.camera.params[0] / truth - 1
        out[i] = found.likelihood, error, own / truth**2, (found.covariance[0, 0] - own) / truth**2
    return out


def chosen(measured):
    """The choice of both by some pictures (N, choices, 4)."""
    usable = np.isfinite(measured[:, :, 0]).all(1)
    segments = int(measured[usable, :, 0].sum(0).argmax())
    own = measured[np.isfinite(measured[:, segments, 0]), segments]
    growth = (SQUARE / scene.OUT_OF_SQUARE) ** 2
    variance = own[:, 2] + growth[:, None] * own[:, 3]
    score = -0.5 * (np.log(variance) + own[:, 1] ** 2 / variance).sum(1)
    return segments, int(score.argmax())


def summary(name, error, sigma):
    ok = np.isfinite(error)
    error, sigma = error[ok], sigma[ok]
    held = np.abs(error) <= 1.96 * sigma
    return [
        name,
        f"{ok.sum()} of {len(ok)}",
        f"{100 * np.median(np.abs(error)):.2f} %",
        f"{np.mean(np.abs(error) <= 0.05):.0%}",
        f"{held.sum()} of {len(held)}",
        f"{100 * np.median(sigma):.1f} %",
    ]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("pictures", nargs="+", type=Path)
    parser.add_argument("--focal", type=float, required=True)
    parser.add_argument("--centre", required=True)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    cx, cy = map(float, given.centre.split(","))
    measured = np.stack([measure(p, {"cx": cx, "cy": cy}, given.focal) for p in given.pictures])
    rows, choices = np.arange(len(measured)), []
    for i in rows:
        choices.append(chosen(measured[rows != i]))
        print(
            given.pictures[i].stem,
            SEGMENTS[choices[-1][0]],
            np.degrees(SQUARE[choices[-1][1]]),
            measured[i, 0],
        )
    now = measured[:, 0]
    segments, square = np.array(choices).T
    held = measured[rows, segments]
    growth = (SQUARE[square] / scene.OUT_OF_SQUARE) ** 2
    table = markdown(
        ("constants", "estimated", "median error", "within 5 %", "95 % intervals hold", "median sigma"),
        [
            summary("as they are", now[:, 1], np.sqrt(now[:, 2] + now[:, 3])),
            summary("chosen by the other pictures", held[:, 1], np.sqrt(held[:, 2] + growth * held[:, 3])),
        ],
    )
    show(given.update, "scene", table)


if __name__ == "__main__":
    main()
