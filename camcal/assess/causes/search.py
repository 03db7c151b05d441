"""The search for a small model that explains why the views do not agree on one camera.

Each candidate is the calibration with a few additional parameters (`kinds.py`). The gain predicted by one step
(`linear.py`) decides which are fitted; the fits are compared by the Bayesian information criterion (Schwarz 1978),

    BIC = n ln(cost / n) + m ln n + 2 ln(choices)                                                         (1)

with n coordinates minus unknowns, m parameters, and the number of candidates of the kind (split points, assignments of
views to two groups) that were considered. Outlying views and a non-ideal board are also candidates: what they explain
better is left to the checks that name them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace
from math import comb, exp, lgamma, log

import numpy as np

from camcal.assess import figures, free_board
from camcal.assess.causes.circles import circles
from camcal.assess.causes.kinds import KINDS, OF_EACH, OF_ONE, OF_PARTS, contrasts, shared
from camcal.assess.causes.linear import Linear, all_fields, problem_of
from camcal.assess.covariance import eliminate_poses, invert_determined, reduce
from camcal.data.shape import sides
from camcal.errors import CamcalError
from camcal.geometry.numbers import TINY
from camcal.least_squares.distributions import f_exceeded
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve import optimizers
from camcal.solve.board import make_board
from camcal.solve.calibration import Calibration, NormalBlocks
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import How, refine
from camcal.solve.several_boards import Several
from camcal.solve.warp import Warp

#: least decrease of (1): very strong evidence in the table of Kass & Raftery (Bayes factors, 1995). On 30 clean sets it
#: does not decrease (the best candidate is 2 to 12 above), on 12 with half a per cent of zoom by 15 to 99
EVIDENCE = 10.0
#: least number of views in a part: a single one is an outlier
LEAST_PART = 2
#: kinds in which two groups may differ, by the parameter of each view that separates them
_GROUPED = {"focal": ("focal", "focus", "camera"), "resized": ("resized",), "cropped": ("cropped",)}
#: groups of more views than this are not improved view by view: that takes count² products
MOST_SWAPPED = 40
#: at most one view in so many is an outlier; more are parts of the set, which are separate candidates
MOST_OUTLYING = 5
#: least fraction of the cost that a predicted step may leave: exact data have only rounding errors
LEAST_LEFT = 1e-6
#: steps of a fit; near its minimum after 5 to 8, from a factor of two in scale after 20
STEPS = 25
#: ... which ends if the predicted decrease is below this fraction of the cost: (1) changes by .04 with 20,000 points
NEAR = 1e-6

_SHORT = Options(max_iterations=STEPS, tolerance=NEAR)


@dataclass(frozen=True)
class Trial:
    """A fitted candidate.

    Attributes
    ----------
    kind : str
        A key of `KINDS`, `board`, `circles`, or `views` (some do not belong).
    how : str
        `split` (all views from `parts`' first on), `groups`, `sides` (those seen from behind), `each`, or empty.
    camera : Camera
        Of the first part; without any map.
    theta : (V, K) array
        The field parameters of each view.
    parts : (V,) bool array
        Which views form the second part.
    cost, numbers, bic : float, int, float
    warp : Warp
    covariance : (F, F) array
        Of the camera's free parameters in this trial; empty for a board.
    """

    kind: str
    how: str
    camera: Camera
    theta: Array
    parts: Array
    cost: float
    numbers: int
    bic: float
    warp: Warp
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))


class Search:
    """The candidates of one solution."""

    def __init__(self, base: Calibration):
        self.base, self.count = base, len(base.poses)
        self.warp = all_fields(base)
        self.freedom = figures.redundancy(base)
        self.columns = {k: make(self.warp) for k, make in KINDS.items()}
        linear = Linear.of(base, self.warp) if self.freedom > 0 else None
        self.linear = linear if linear is not None and linear.cost > 0 else None

    def bic(self, cost: float, numbers: int, choices: float) -> float:
        """(1) with the logarithm of the number of choices."""
        n = self.freedom
        return n * log(max(cost, TINY) / n) + numbers * log(n) + 2 * choices

    def by_chance(self, trial: Trial) -> float:
        """The probability that any of the choices gains as much without a cause, by the F test.

        The criterion (1) is asymptotic; with 8 coordinates more than unknowns it accepts noise as a cause.
        """
        assert self.linear is not None
        freedom = self.freedom - trial.numbers
        choices = 0.5 * (trial.bic - self.bic(trial.cost, trial.numbers, 0.0))
        if freedom <= 0 or not trial.cost > 0:
            return 1.0 if freedom <= 0 else 0.0
        ratio = (self.linear.cost - trial.cost) / trial.numbers / (trial.cost / freedom)
        found = f_exceeded(max(ratio, 0.0), trial.numbers, freedom)
        return float(min(1.0, found * exp(choices)))

    @property
    def none(self) -> float:
        """(1) of the solution itself."""
        return self.bic(self.base.fit.cost if self.linear is None else self.linear.cost, 0, 0.0)

    def promised(self, gain: float, numbers: int, choices: float) -> float:
        """(1) as predicted by one step with this gain."""
        return self.bic(self._left(gain), numbers, choices)

    def _left(self, gain: float) -> float:
        """The cost predicted by one step with this gain."""
        assert self.linear is not None
        return max(self.linear.cost - gain, LEAST_LEFT * self.linear.cost)

    def fit(self, kind: str, how: str, design: Array, parts: Array, choices: float) -> Trial | None:
        """Fit a candidate; None if it has as many unknowns as there are coordinates, or diverges."""
        if self.freedom <= 2 * design.shape[2]:
            return None
        moved: Array = np.asarray(design.any(axis=(0, 2)))  # fields without parameters need not be evaluated
        names = tuple(n for n, some in zip(self.warp.fields, moved, strict=True) if some)
        problem = problem_of(self.base, replace(self.warp, fields=names, design=design[:, moved]))
        start = problem.state(self.base.camera.params, self.base.poses)
        try:
            found = optimizers.make("lm")(problem, start, _SHORT, None)
        except (CamcalError, np.linalg.LinAlgError):
            return None
        cost, numbers = found.blocks.cost, design.shape[2]
        camera = Camera(self.base.camera.lens, found.state.params, self.base.camera.image_size)
        warp = replace(self.warp, design=design)
        theta = warp.values(found.state.shape)
        noise = np.sqrt(2 * cost / (self.freedom - numbers))
        return Trial(
            kind,
            how,
            camera,
            theta,
            parts,
            cost,
            numbers,
            self.bic(cost, numbers, choices),
            warp,
            covariance=_of_camera(found.blocks.normal(), problem.rigid, float(noise)),
        )

    # ------------------------------------------------------------------ candidates
    def splits(self) -> Iterator[Trial]:
        """A change from some view on: the best position of each kind, if one step predicts a gain."""
        places = np.arange(LEAST_PART, self.count - LEAST_PART + 1)
        if len(places) < 2:
            return
        assert self.linear is not None
        after, choices = np.arange(self.count) >= places[:, None], log(len(places))
        for kind in OF_PARTS:
            columns = self.columns[kind]
            gains = self.linear.gains_of_parts(columns, after)
            best = int(np.argmax(gains))
            if self.promised(gains[best], columns.shape[1], choices) < self.none - EVIDENCE:
                design = self._parts(kind, after[best])
                yield from self._some(self.fit(kind, "split", design, after[best], choices))

    def shifted(self, split: Trial) -> Trial:
        """A split with its position moved view by view as long as the fit improves.

        One step finds the position if effects are small; for pictures at half the size it may be off by one view.
        """
        best, place = split, int(np.argmax(split.parts))
        choices = log(self.count - 2 * LEAST_PART + 1)
        for way in (-1, 1):
            at = place + way
            while LEAST_PART <= at <= self.count - LEAST_PART:
                after = np.arange(self.count) >= at
                found = self.fit(split.kind, "split", self._parts(split.kind, after), after, choices)
                if found is None or not found.bic < best.bic:
                    break
                best, at = found, at + way
        return best

    def each(self) -> Iterator[Trial]:
        """One parameter for each view."""
        none = np.zeros(self.count, bool)
        assert self.linear is not None
        for kind in OF_EACH:
            design = shared(contrasts(self.count), self.columns[kind])
            numbers = design.shape[2]
            if self.freedom <= 2 * numbers:
                continue
            if self.promised(self.linear.gain(design), numbers, 0.0) < self.none - EVIDENCE:
                yield from self._some(self.fit(kind, "each", design, none, 0.0))

    def groups(self, each: Trial) -> Iterator[Trial]:
        """Two groups of views, by the values of the parameter fitted to each view."""
        kinds = _GROUPED.get(each.kind, ())
        if not kinds or self.count < 2 * LEAST_PART:
            return
        assert self.linear is not None
        column = self.columns[each.kind]
        values = each.theta @ np.linalg.pinv(column).T
        along = np.linalg.svd(values - values.mean(0), full_matrices=False)[2][0]
        parts = two_groups(values @ along, self.linear.information(column @ along))
        if parts is None:
            return
        for kind in kinds:
            for some in {p.tobytes(): p for p in (parts, self._swapped(kind, parts))}.values():
                choices = log(comb(self.count, int(some.sum())))
                yield from self._some(self.fit(kind, "groups", self._parts(kind, some), some, choices))

    def sides(self) -> Iterator[Trial]:
        """The views that show a plane from its other side, about another principal point: mirrored pictures."""
        shapes = self.base.observations.shapes
        if not shapes.planar.all():
            return
        parts = sides(shapes, self.base.poses)
        design = self._parts("cropped", parts)
        assert self.linear is not None
        promise = self.promised(self.linear.gain(design), design.shape[2], 0.0)
        if parts.sum() >= LEAST_PART and promise < self.none - EVIDENCE:
            yield from self._some(self.fit("cropped", "sides", design, parts, 0.0))

    def _swapped(self, kind: str, parts: Array) -> Array:
        """Move views between two groups one at a time while one step predicts an improvement."""
        best, promise = parts, self._of_groups(kind, parts[None])[0]
        for _ in range(self.count if self.count <= MOST_SWAPPED else 0):
            others = best ^ np.eye(self.count, dtype=bool)
            promises = self._of_groups(kind, others)
            place = int(np.argmin(promises))
            if not promises[place] < promise:
                break
            best, promise = others[place], promises[place]
        return best

    def _of_groups(self, kind: str, parts: Array) -> list[float]:
        """The prediction for each of several groups (P, V); infinite if one is too small."""
        assert self.linear is not None
        columns = self.columns[kind]
        return [
            self.promised(gain, columns.shape[1], log(comb(self.count, size)))
            if LEAST_PART <= size <= self.count - LEAST_PART
            else np.inf
            for gain, size in zip(
                self.linear.gains_of_parts(columns, parts), parts.sum(1).tolist(), strict=True
            )
        ]

    def outlying(self) -> Iterator[Trial]:
        """Outlying views, added one at a time, up to a fifth of them, as many as one step finds best."""
        assert self.linear is not None
        chosen: list[int] = []
        columns, eye = self.columns[OF_ONE], np.eye(self.count)
        best, wanted = np.inf, 0
        for _ in range(max(1, self.count // MOST_OUTLYING)):
            rest = [i for i in range(self.count) if i not in chosen]
            gains = self.linear.gains_of_views(columns, np.array([[*chosen, i] for i in rest]))
            chosen.append(rest[int(np.argmax(gains))])
            numbers = len(chosen) * columns.shape[1]
            promise = self.promised(max(gains), numbers, _log_choices(self.count, len(chosen)))
            if promise < best:
                best, wanted = promise, len(chosen)
        chosen = chosen[:wanted]
        parts = np.isin(np.arange(self.count), chosen)
        choices = _log_choices(self.count, wanted)
        yield from self._some(self.fit("views", "", shared(eye[:, chosen], columns), parts, choices))

    def boards(self, kinds: tuple[str, ...] = ("print", "free")) -> Iterator[Trial]:
        """A board with its own shape."""
        base, none = self.base, np.zeros(self.count, bool)
        if base.board is not None:
            return
        for kind in kinds:
            try:
                if not self._promised_board(kind) < self.none - EVIDENCE:
                    continue
                made = refine(
                    base.camera,
                    base.poses,
                    base.observations,
                    How(base.held, board=kind, stopping=_SHORT),
                )
            except CamcalError:
                continue
            assert made.board is not None
            numbers = made.board.size
            theta = np.zeros((self.count, len(self.warp.fields)))
            bic = self.bic(made.fit.cost, numbers, 0.0)
            yield Trial("board", kind, made.camera, theta, none, made.fit.cost, numbers, bic, self.warp)

    def _promised_board(self, kind: str) -> float:
        """(1) of a board of a kind as predicted by one step; infinite if the step cannot be made.

        Raises
        ------
        UsageError
            If the views do not share a board.
        """
        kept = self.base.observations.kept()
        board = make_board(kept.views, kind, Several.of(kept))
        found = free_board.step(self.base, board)
        return np.inf if found is None else self.promised(found[1], board.size, 0.0)

    def circles(self) -> Iterator[Trial]:
        """Centroids of the images of circles; one step suffices, since these are small effects."""
        found = circles(self.base)
        if found is None or not found.radius > 0:
            return
        cost = self._left(found.gain)
        theta, none = np.zeros((self.count, len(self.warp.fields))), np.zeros(self.count, bool)
        camera = replace(self.base.camera, params=found.params)
        yield Trial("circles", "", camera, theta, none, cost, 1, self.bic(cost, 1, 0.0), self.warp)

    def _parts(self, kind: str, parts: Array) -> Array:
        return shared(parts.astype(float)[:, None], self.columns[kind])

    @staticmethod
    def _some(trial: Trial | None) -> Iterator[Trial]:
        if trial is not None:
            yield trial

    def all(self) -> list[Trial]:
        """Every candidate that one step predicts to be useful, fitted, the best first."""
        if self.linear is None or self.count < LEAST_PART + 1:
            return []
        each = list(self.each())
        splits = sorted(self.splits(), key=lambda t: t.bic)
        splits[:1] = [self.shifted(t) for t in splits[:1]]
        found = [*splits, *self.sides(), *each, *(t for e in each for t in self.groups(e))]
        found += self.boards(("print",) if not found else ("print", "free"))
        if any(t.bic < self.none - EVIDENCE for t in found):
            found += [*self.outlying(), *self.circles()]  # else nothing needs another explanation
        return sorted(found, key=lambda t: t.bic)


def _of_camera(normal: NormalBlocks, free: int, noise: float) -> Array:
    """The covariance (F, F) of the first variables, with the others and the poses unknown."""
    reduced = reduce(normal, eliminate_poses(normal))
    return invert_determined(reduced, np.diag(normal.intrinsics), noise)[0][:free, :free]


def _log_choices(n: int, k: int) -> float:
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)


def two_groups(values: Array, information: Array) -> Array | None:
    """Two groups with the smallest scatter of weighted numbers (V,): the second as a mask; None if they are too
    small.
    """
    order = np.argsort(values)
    x, w = values[order], np.maximum(information[order], TINY)
    best, place = np.inf, 0
    for k in range(LEAST_PART, len(x) - LEAST_PART + 1):
        scatter = sum(
            float((w[s] * (x[s] - np.average(x[s], weights=w[s])) ** 2).sum())
            for s in (slice(k), slice(k, None))
        )
        if scatter < best:
            best, place = scatter, k
    if not place:
        return None
    mask = np.zeros(len(x), bool)
    mask[order[place:]] = True
    return mask
