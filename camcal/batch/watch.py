"""A calibration that is updated with each picture: the effect of the picture, and where to hold the target next."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.uncertainty import board_distance, map_over_image, projection_uncertainty
from camcal.data.observations import Observations, SkippedView, View
from camcal.detect import cache, targets
from camcal.detect.examine import Outcome, Task, examine
from camcal.detect.images import detect_images
from camcal.detect.listing import natural_order, view_ids
from camcal.detect.targets.base import Target
from camcal.errors import CamcalError, DataError
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import Solution
from camcal.records import dataclass
from camcal.report.charts.base import Chart
from camcal.report.next_view import drawing, suggest

#: pictures that must show the same target before it is taken as known
CERTAIN = 3
#: what is left out until the camera is known well enough
_QUICK = {"checks": False, "crosscheck": False, "board_shape": "flat"}
#: advice for the first pictures, before a camera is known from which a pose can be computed
FIRST_POSES = (
    "hold the target in the middle of the picture, over half of its width, turned by about 30 degrees to the left",
    "hold the target in the middle of the picture, turned by about 30 degrees to the right",
    "hold the target in the middle of the picture, turned by about 30 degrees with its top towards the camera",
    "hold the target closer, in a corner of the picture, turned by about 30 degrees",
)


@dataclass(frozen=True)
class Step:
    """The effect of a picture.

    Attributes
    ----------
    id : str
    status : str
        `found`, `not_found`, `unreadable`, or `removed`.
    reason : str
        Why no point was found.
    points : int
    rms : float or None
        Of the residuals of this view, px.
    before, after : float or None
        The worst projection uncertainty over the picture at the boards' distance, px, without and with it.
    trouble : str
        Why there is no camera yet.
    weakest : str
        The part of the picture where the projection is least certain.
    advice : str
        Where to hold the target next.
    views : int
        Pictures with the target so far.
    seconds : float
        From when the picture was taken up to this answer.
    """

    id: str
    status: str
    reason: str = ""
    points: int = 0
    rms: float | None = None
    before: float | None = None
    after: float | None = None
    trouble: str = ""
    weakest: str = ""
    advice: str = ""
    views: int = 0
    seconds: float = 0.0


class Watcher:
    """The pictures so far and the resulting camera.

    Parameters
    ----------
    search : mapping
        Options of the search for the target (camcal.settings.detection).
    options : mapping
        Options of the calibration (camcal.settings.calibration).
    """

    def __init__(self, search: Mapping[str, Any], options: Mapping[str, Any]):
        self.search = {name: value for name, value in search.items() if name != "jobs"}
        model = options["model"] if options["model"] != "auto" else "opencv5"
        self.options = {**options, "model": model, **_QUICK}
        self.target: Target | None = _given(search)
        self.certain = self.target is not None
        self.outcomes: dict[Path, Outcome] = {}
        self.solution: Solution | None = None
        self.worst: float | None = None
        self.chart: Chart | None = None

    # ------------------------------------------------------------------ pictures
    def take(self, path: Path) -> Step:
        """Search a new or changed picture, and update the camera."""
        began = time.perf_counter()
        self.outcomes[path] = self._examine(path)
        if not self.certain:
            self._recognise()
        outcome = self.outcomes[path]
        found = outcome.detection
        step = Step(self._ids()[path], outcome.status, outcome.reason, len(found) if found else 0)
        return replace(self._update(step), seconds=time.perf_counter() - began)

    def drop(self, path: Path) -> Step:
        """Remove a picture that was deleted."""
        step = Step(self._ids()[path], "removed")
        del self.outcomes[path]
        return self._update(step)

    def _examine(self, path: Path) -> Outcome:
        folder = cache.default_folder() if self.search["cache"] else None
        return examine(Task(path, self.target, self.search["seconds"], folder))

    def _recognise(self) -> None:
        """Recognise the target from all pictures so far; a known one is searched for in each."""
        said: dict[str, Any] = {}

        def listen(event: str, details: Mapping[str, Any]) -> None:
            if event == "target":
                said.update(details)

        try:
            detect_images(sorted(self.outcomes), **self.search, jobs=1, on_event=listen)
        except DataError:
            return
        target = targets.make(said["spec"])
        self.certain = said["pictures"] >= CERTAIN
        if self.target is None or self.target.spec != target.spec:
            self.target = target
            for path in self.outcomes:
                self.outcomes[path] = self._examine(path)

    def _ids(self) -> dict[Path, str]:
        files = sorted(self.outcomes, key=natural_order)
        return dict(zip(files, view_ids(files), strict=True))

    def observations(self) -> Observations:
        """All pictures so far, in the form of `detect_images`."""
        assert self.target is not None
        ids = self._ids()
        found = [o for o in self.outcomes.values() if o.detection is not None]
        size = Counter(o.size for o in found).most_common(1)[0][0]
        views, skipped = [], []
        for path, name in ids.items():
            o = self.outcomes[path]
            if o.detection is None:
                skipped.append(SkippedView(name, o.status, o.reason))
            elif o.size != size:
                skipped.append(
                    SkippedView(name, "rejected", "the size of the picture differs from most others")
                )
            else:
                d = o.detection
                views.append(View(name, self.target.points[d.point_ids], d.uv, d.sigma, d.point_ids))
        files = tuple({"path": str(path), "sha256": self.outcomes[path].sha256} for path in ids)
        quality = {ids[path]: o.quality for path, o in self.outcomes.items() if o.quality}
        described = {**self.target.describe(), "detected": _given(self.search) is None}
        return Observations.from_views(
            views, size, target=described, skipped=tuple(skipped), files=files, picture_quality=quality
        )

    # ------------------------------------------------------------------ the camera
    def _update(self, step: Step) -> Step:
        """Calibrate again, and report the changes."""
        views = sum(o.detection is not None for o in self.outcomes.values())
        before, self.chart = self.worst, None
        step = replace(step, views=views, before=before)
        if not views:
            self.solution = self.worst = None
            return replace(step, advice=FIRST_POSES[0])
        try:
            self.solution = calibrate(self.observations(), **self.options)
            self.worst, place = worst_uncertainty(self.solution)
            advice = self._advice()
        except CamcalError as error:
            self.solution = self.worst = None
            return replace(step, trouble=error.message, advice=FIRST_POSES[views % len(FIRST_POSES)])
        return replace(step, after=self.worst, rms=self._rms(step.id), weakest=place, advice=advice)

    def _advice(self) -> str:
        assert self.solution is not None
        answer, found = suggest(self.solution, 1, board_distance(self.solution))
        self.chart = drawing(self.solution, found[0])
        return "hold the target at the " + answer["suggestions"][0]["words"]

    def _rms(self, name: str) -> float | None:
        assert self.solution is not None
        data = self.solution.observations
        if name not in data.view_ids:
            return None
        rows = data.slices[data.view_ids.index(name)]
        return float(np.sqrt(np.nanmean((self.solution.residuals[rows] ** 2).sum(1))))


def worst_uncertainty(solution: Solution) -> tuple[float, str]:
    """The worst projection uncertainty over the picture at the boards' distance, px, and its pixel."""
    low, high = Facts(solution).low_high
    found = map_over_image(projection_uncertainty(solution), low, high, board_distance(solution))
    u, v, sigma = found.worst
    across = ("left", "middle", "right")[min(2, int(3 * (u - low[0]) / (high[0] - low[0])))]
    down = ("top", "middle", "bottom")[min(2, int(3 * (v - low[1]) / (high[1] - low[1])))]
    return float(sigma), "middle" if across == down else f"{down} {across}".replace("middle ", "").replace(
        " middle", ""
    )


def _given(search: Mapping[str, Any]) -> Target | None:
    """The target that the options name."""
    if search["target"] is not None and search["target"] != "checkerboard":
        return targets.make(search["target"])
    if search["board"] is None:
        return None
    columns, rows = search["board"]
    square = "" if search["square"] is None else f":{search['square']}"
    return targets.make(f"checkerboard:{columns}x{rows}{square}")
