"""Warnings about conditions that degrade a hand-eye transformation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from camcal.assess.warning import CalibrationWarning
from camcal.model.pose import Poses
from camcal.routes.hand_eye import NAMES
from camcal.routes.hand_eye.estimate import LEAST_TO_TEST, Estimate
from camcal.routes.hand_eye.recognise import Reading
from camcal.routes.hand_eye.scale import DIFFERENT
from camcal.system.text import listed

#: Largest share of outliers among the poses: with a third wrong in the same way, the others might be the wrong ones.
MOST_OUTLIERS = 1 / 3
#: Ratio of the standard deviations of the translation along its principal directions: at 3, the worst direction has a
#: ninth of the information of the best.
UNEVEN = 3.0
#: A scale error displaces the board, and with it the camera, by that fraction of their distance. It is reported above
#: this many standard deviations of the translation, which its interval does not cover.
OFF = 3.0
#: Largest error of the robot's positions relative to the extent of the motions. Robots have 1 to 3 % (5 mm of 200 mm);
#: positions unrelated to the pictures have about 1.
UNRELATED = 0.5


def remarks(
    made: Estimate,
    reading: Reading,
    other: Reading | None,
    names: Sequence[str],
    size: tuple[float, float],
    lost: tuple[int, int],
    square: str | None = None,
) -> Iterator[CalibrationWarning]:
    """The warnings of a hand-eye calibration.

    Parameters
    ----------
    other : Reading or None
        A reading that fits far better than the requested one.
    names : sequence of str
        Names of all views with a pose.
    size : (float, float)
        Ratio of the robot's lengths to the board's, and its standard deviation.
    lost : (int, int)
        Views without a pose and poses without a view.
    square : str, optional
        The side of the board's squares that would agree with the robot's lengths.
    """
    if other is not None:
        yield CalibrationWarning(
            "hand-eye-convention",
            f"the poses were interpreted as {reading.words}, which leaves {np.degrees(reading.misfit):.2g} deg "
            f"and {100 * reading.shift:.2g} % of the translations; as {other.words} they leave "
            f"{np.degrees(other.misfit):.2g} deg and {100 * other.shift:.2g} %.",
            "Check --rotation and --setup, and whether the poses are base_from_hand (else --inverse).",
            "wrong",
        )
    else:
        yield from _unrelated(made)
    yield from _poses(made, names, lost)
    yield from _directions(made)
    yield from _no_noise(made)
    yield from _scale(made, *size, square)


def _unrelated(made: Estimate) -> Iterator[CalibrationWarning]:
    """Positions that do not fit although the rotations do: misread rotations may still be consistent."""
    places = made.measured.translation, Poses.of(made.poses.inverse()).translation
    extent = max(float(np.sqrt(np.square(p - p.mean(0)).sum(1).mean())) for p in places)
    if made.translation_rms > UNRELATED * extent:
        yield CalibrationWarning(
            "hand-eye-convention",
            f"the robot's positions are off by {made.translation_rms:.3g}, with motions of {extent:.3g}: "
            f"they do not belong to the pictures, or the rotations have another convention than their columns state.",
            "Check the order of the rotation's numbers (--rotation), and which pose belongs to which view.",
            "wrong",
        )


def _scale(made: Estimate, factor: float, sigma: float, square: str | None) -> Iterator[CalibrationWarning]:
    if not np.isfinite(sigma) or abs(factor - 1) <= DIFFERENT * sigma:
        return
    view = made.pictures.views[0]
    far = np.linalg.norm(made.poses.rotation @ view.xyz.mean(0) + made.poses.translation, axis=1)
    off = abs(factor - 1) * float(np.median(far))
    yield CalibrationWarning(
        "hand-eye-scale",
        f"the robot moves {factor:.4g} ± {sigma:.1g} times as far as the board's lengths imply"
        + (f"; a square of {square} would make them agree." if square else "."),
        "Measure the side of a square, and check the unit and the focal length; the distance of the "
        "board has the same relative error as the scale.",
        "wrong" if off > OFF * float(made.sigma[3:6].max()) else "doubtful",
    )


def _poses(made: Estimate, names: Sequence[str], lost: tuple[int, int]) -> Iterator[CalibrationWarning]:
    out = sorted(set(range(len(names))) - set(made.used.tolist()))
    if out:
        many = len(out) > MOST_OUTLIERS * len(names)
        left_out = listed([f"'{names[i]}'" for i in out])
        yield CalibrationWarning(
            "hand-eye-outliers",
            f"{len(out)} of {len(names)} poses do not agree with the others and are not used: {left_out}.",
            "Check that each pose belongs to its picture, and that the robot was stationary.",
            "wrong" if many else "doubtful",
        )
    if len(names) < LEAST_TO_TEST:
        yield CalibrationWarning(
            "hand-eye-few-poses",
            f"{len(names)} poses: a wrong one cannot be detected; {LEAST_TO_TEST} are needed for that.",
            "Take ten or more.",
        )
    if any(lost):
        yield CalibrationWarning(
            "hand-eye-unmatched",
            f"{lost[0]} views have no pose, {lost[1]} poses have no view.",
            "They are not used; check the names if this is not intended.",
            "note",
        )


def _no_noise(made: Estimate) -> Iterator[CalibrationWarning]:
    """A variance of the robot at its bound of 0: missed by chance, or below the noise of the pictures."""
    parts = ("rotations", "translations")
    zero = [p for p, known in zip(parts, np.isfinite(made.relative[1:]), strict=True) if not known]
    if zero:
        yield CalibrationWarning(
            "hand-eye-noise-at-zero",
            f"the robot's {listed(zero)} show no noise beyond that of the pictures. In such calibrations "
            f"91 to 95 % of "
            "the 95 % intervals contain the true value, because small robot noise can go undetected by chance.",
            "Add poses: with more of them, smaller noise can be detected.",
            "note",
        )


def _directions(made: Estimate) -> Iterator[CalibrationWarning]:
    values, vectors = np.linalg.eigh(made.covariance[3:6, 3:6])
    ratio = float(np.sqrt(values[2] / values[0]))
    if ratio <= UNEVEN:
        return
    direction = " ".join(
        f"{c:.2f}" for c in vectors[:, 2] * np.sign(vectors[np.abs(vectors[:, 2]).argmax(), 2]) + 0.0
    )
    yield CalibrationWarning(
        "hand-eye-weak-direction",
        f"the translation of {NAMES[made.setup][0]} along ({direction}) is known {ratio:.2g} times less "
        f"accurately than in the best direction: the motions rotate by {made.motions.turns_deg[1]:.2g} "
        f"deg about a second axis.",
        "Add the poses listed under hand_eye.next in the report.",
    )
