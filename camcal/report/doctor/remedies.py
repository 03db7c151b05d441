"""Possible improvements of a calibration, and their predicted gain."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from camcal.assess import figures, warning
from camcal.assess.checks.board import GAIN as BOARD_GAIN
from camcal.assess.free_board import promise
from camcal.assess.holdout import CHEAP_PARAMETERS, CHEAP_POINTS
from camcal.detect.films import REPEATED, SURPLUS
from camcal.errors import CamcalError
from camcal.plan.solution import Solution
from camcal.report.doctor.findings import Finding, Gain
from camcal.report.next_view import MORE, next_ones
from camcal.system.text import listed

#: Ratios of before to after; smaller gains are not reported. Of pictures, each of which costs a minute: the number of
#: three more than thirteen alone gives sqrt(16 / 13) = 1.1. Of anything else: sigma_hat of 13 views of 54 points is
#: itself known to 2 %.
WORTH_PICTURES, WORTH = 1.3, 1.05
#: A view is worse than the others above this multiple of their median rms. The rms of 54 points is known to 7 %:
#: by chance none of a hundred views exceeds 1.3.
WORSE_VIEW = 1.8
#: share of the mean square that is not noise above which the bias ratio is a separate finding: sigma_hat is then 20 %
#: (1 / sqrt(1 - .3) = 1.2) above the noise
BIASED = 0.3
#: share of the variance explained by a test of the residuals above which its remedy is worth trying: without it
#: sigma_hat would be 5 % smaller, as with `WORTH`
LARGE_EFFECT = 0.1
#: probability with which noise alone gives such a result: one calibration in a thousand gets a needless finding
BY_CHANCE = 1e-3
#: least number of remaining views for comparison: three determine a camera, and a fourth can contradict them
FEWEST_VIEWS = 4
#: a remedy that brings sigma_hat within this factor of the corners' noise leaves nothing to explain: another lens
#: model could gain no more than that
EXPLAINS = 1.1

#: what to do if a test of the residuals finds a large effect
_REMEDY = {
    "radius": "Try models with more radial terms: camcal select.",
    "angle": "Try models with decentering or thin-prism terms: camcal select.",
    "board-position": "Estimate the board's shape: --board-shape auto.",
    "view": "Check the noisiest pictures for blur and exposure.",
    "noise-by-radius": "Give sigmas with the points, or sharpen the borders of the picture (a smaller aperture).",
    "neighbours": "Try --board-shape auto, and other models: camcal select.",
    "gaussian": "Outliers cause such tails; try --robust huber.",
}

Document = Mapping[str, Any]


def next_views(solution: Solution, source: str) -> Finding | None:
    """Additional pictures at the most informative poses."""
    if (
        not solution.free.any()
        or solution.camera.image_size is None
        or solution.camera.lens.size > CHEAP_PARAMETERS
    ):
        return None
    try:
        answer, _ = next_ones(solution)
    except CamcalError:
        return None
    now, last = answer["now"]["worst_px"], answer["suggestions"][-1]["worst_px"]
    gain = Gain("worst uncertainty of far points, px", now, last, f"predicted for {MORE} more pictures")
    if not gain.times >= WORTH_PICTURES:
        return None
    first = "" if source else "calibrate with -o report.yaml, then "
    return Finding(
        "next-pictures",
        "better",
        "the projection is much less certain in some parts of the picture than in others; more pictures "
        "would improve them."
        if now > 2 * answer["now"]["median_px"]
        else "more pictures would improve the camera.",
        f"Take {MORE} more pictures. The first: the target at the {answer['suggestions'][0]['words']}. "
        f"All, drawn: {first}camcal next {source or 'report.yaml'} --count {MORE} -o next.png",
        gain,
    )


def board_shape(solution: Solution) -> Finding | None:
    """A board whose shape differs from the assumed one."""
    found = promise(solution)
    if found is None or found.p_value > warning.BY_CHANCE or found.after > BOARD_GAIN * found.before:
        return None
    return Finding(
        "board-not-flat",
        "better",
        "the residuals repeat at the same points of the board: it is bent, or was printed inaccurately.",
        "Let camcal find its shape: calibrate again with --board-shape auto. Or mount it on glass.",
        Gain("sigma_hat, px", found.before, found.after, "predicted for a board of free shape"),
    )


def lens_model(solution: Solution, report: Document, board: Finding | None) -> Finding | None:
    """Another lens model, tested by hold-out if the residuals indicate one.

    If only the corners' noise remains with the board's shape, there is nothing for a lens model to explain.
    """
    if not _calls_for_a_model(report) or solution.observations.point_count > CHEAP_POINTS:
        return None
    if board and board.gain and board.gain.after <= EXPLAINS * _detector_sigma(report):
        return None
    if len(solution.poses) <= FEWEST_VIEWS or not solution.free.any():
        return None
    from camcal.plan.selection import described, select

    try:
        found = described(select(solution.observations))
    except CamcalError:
        return None
    held = {m["model"]: (m.get("holdout") or {}).get("rms_point") for m in found["models"]}
    now, best = held.get(report["camera"]["model"]), held.get(found["chosen"])
    if now is None or best is None or not now > WORTH * best:
        return None
    return Finding(
        "lens-model",
        "better",
        f"{report['camera']['model']} does not fit this lens; {found['chosen']} has a lower hold-out error.",
        f"Calibrate with --model {found['chosen']}.",
        Gain("rms on held-out views, px", now, best, "tried out"),
    )


def _detector_sigma(report: Document) -> float:
    """The sigma_hat if everything except the corners' noise were explained, px."""
    ratio = (report.get("bias") or {}).get("ratio")
    return float(report["fit"]["sigma_hat"] * math.sqrt(max(1 - ratio["ratio"], 0.0))) if ratio else 0.0


def _calls_for_a_model(report: Document) -> bool:
    large = {t["name"] for t in large_effects(report)}
    return bool(large & {"radius", "angle"}) or any(
        w["code"] in ("systematic-residuals", "large-residuals") for w in report["warnings"]
    )


def large_effects(report: Document) -> list[Mapping[str, Any]]:
    """The residual tests with a relevant effect, the largest first."""
    tests = (report.get("bias") or {}).get("tests") or []
    found = [t for t in tests if t["p_corrected"] < BY_CHANCE and t["effect"] > LARGE_EFFECT]
    return sorted(found, key=lambda t: -t["effect"])


def bias(report: Document) -> Finding | None:
    """Residuals of which a large part is not noise."""
    ratio = (report.get("bias") or {}).get("ratio")
    if not ratio or not ratio["ratio"] >= BIASED or ratio["p_value"] > BY_CHANCE:
        return None
    share, sigma = ratio["ratio"], report["fit"]["sigma_hat"]
    large = large_effects(report)
    names = f" Tests with a relevant effect: {', '.join(t['name'] for t in large)}." if large else ""
    return Finding(
        "not-only-noise",
        "better",
        f"{share:.0%} of the residuals' mean square is caused by the lens or the board, not by corner noise.{names}",
        _REMEDY[large[0]["name"]] if large else "Try --board-shape auto, and other models: camcal select.",
        Gain("sigma_hat, px", sigma, _detector_sigma(report), "if lens and board were exact", True),
    )


def worse_views(solution: Solution, report: Document) -> Finding | None:
    """Views that are worse than the others, by their rms or by their picture quality."""
    seen = {v["id"]: v for v in report["views"]}
    own = figures.per_view(solution)
    rms = np.array([f.rms_point for f in own])
    median = float(np.nanmedian(rms)) if len(rms) else 0.0
    said, worse = [], []
    for i, view in enumerate(solution.observations.views):
        looks = ((seen.get(view.id) or {}).get("quality") or {}).get("warnings") or []
        if rms[i] > WORSE_VIEW * median or looks:
            worse.append(i)
            said.append(f"{view.id} (rms {rms[i]:.2g} px{''.join('; ' + w for w in looks)})")
    if not worse or len(rms) - len(worse) < FEWEST_VIEWS:
        return None
    gain = _without(solution, worse)
    enough = gain is not None and gain.times >= WORTH
    return Finding(
        "worse-pictures",
        "better" if enough else "note",
        f"some pictures are worse than the others: {listed(said)}.",
        "Retake them (target still, sharp, evenly lit), or remove them.",
        gain if enough else None,
    )


def _without(solution: Solution, views: list[int]) -> Gain | None:
    """sigma_hat from the current residuals, without some views."""
    of_those = np.isin(solution.observations.view, list(views)) & solution.used
    squares, points = float(np.square(solution.residuals[of_those]).sum()), int(of_those.sum())
    freedom = figures.redundancy(solution)
    left, rest = freedom - 2 * points + 6 * len(views), figures.sigma_hat(solution) ** 2 * freedom - squares
    if left <= 0 or rest <= 0:
        return None
    after = math.sqrt(rest / left)
    return Gain("sigma_hat, px", figures.sigma_hat(solution), after, "of the other pictures")


def lost_pictures(used: int, lost: Sequence[Document]) -> Iterator[Finding]:
    """Pictures that were not usable: entries of a report's `views`. Repeated frames of a film are not among them."""
    lost = [v for v in lost if not str(v["reason"]).startswith((REPEATED, SURPLUS))]
    if not lost:
        return
    every = used + len(lost)
    gain = Gain(
        "error, relative to the current one",
        1.0,
        math.sqrt(max(used, 1) / every),
        "if these were as good as the others",
        True,
    )
    enough = gain.times >= WORTH
    yield Finding(
        "lost-pictures",
        "better" if enough else "note",
        f"{len(lost)} of {every} pictures were unusable: "
        + listed([f"{v['id']} ({v['reason'] or v['status'].replace('_', ' ')})" for v in lost])
        + ".",
        "Retake them: the whole target in the picture, still, sharp, evenly lit, all of the same size.",
        gain if enough else None,
    )
