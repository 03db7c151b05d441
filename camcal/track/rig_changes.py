"""Whether and when a camera of a rig was knocked out of place: a test over windows of instants.

For a window of instants with normal equations N δ = g (added up) and one camera k that may have moved, the score g_k
has the covariance

    S_k = N_kk + K_k P K_kᵀ + N_k. Q N_.k                                                                  (1)

without a change: noise, the calibration's errors (covariance P), and those of places that were estimated after earlier
changes (Q). g_kᵀ S_k⁻¹ g_k is χ² with 6 degrees of freedom (5 where matches of one pair do not show the length of its
baseline), tested as F with those of the noise. Windows of 2, 4, ... instants find small steps and slow
drift: a generalised likelihood ratio test (Basseville & Nikiforov 1993, sec. 2.4.3) on a grid of change times.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.special import chdtri, fdtrc

from camcal.model.pose import Pose
from camcal.records import dataclass
from camcal.track.events import axis
from camcal.track.rig_equations import Instant, inverse

Array = np.ndarray

#: instants; beyond the longest a drift is found by the calibration's own uncertainty or not at all
WINDOWS = (2, 4, 8, 16, 32, 64)
#: instants after an alarm from which the camera's new place is estimated before tests go on
SETTLING = 8
#: two instants in a row that are both off tell the same change with this probability at least, else the first is an
#: outlier: a board found wrongly
SAME = 1e-3
POSE = 6  #: degrees of freedom at least: those of the change that is tested


@dataclass(frozen=True)
class Test:
    """The result for one camera over a window.

    `chi2` has `rank` degrees of freedom; `step` is δ (6,) of cam_from_rig, rotation (rad) and translation, `sigma` its
    standard deviations, `pixels` the root mean square shift of the image points, the board's pose refitted (of
    matches: across their epipolar lines), `freedom` the degrees of freedom of the noise.
    """

    camera: int
    chi2: float
    rank: int
    freedom: float
    step: Array
    sigma: Array
    pixels: float

    @property
    def probability(self) -> float:
        """The probability of a figure at least this large without a change."""
        return float(fdtrc(self.rank, self.freedom, self.chi2 / self.rank)) if self.rank else 1.0


@dataclass(frozen=True)
class Knock:
    """A camera that has moved.

    Attributes
    ----------
    camera : str
    others : bool
        Whether a third camera tells which one it was; of two it is either.
    instant, since : str
        At which the alarm went, and where the change began as far as the instants tell.
    test : Test
    message : str
    """

    camera: str
    others: bool
    instant: str
    since: str
    test: Test
    message: str


@dataclass(frozen=True)
class Row:
    """One camera at one instant.

    `status` is `used`, `rejected` (an outlier) or `settling` (after an alarm); `deviation` is δ (6,) from this instant
    alone, rotation (rad) and translation, with `sigma`; NaN where the camera saw nothing.
    """

    instant: str
    camera: int
    status: str
    deviation: Array
    sigma: Array
    chi2: float
    changed: bool


class RigFollower:
    """Processes the instants of a rig in order.

    Parameters
    ----------
    names : sequence of C str
    calibration : (F, F) array
        Covariance of the calibration's variables.
    factor, freedom : float
        By which the variance of an instant exceeds what its noise says, and how well that is known; see `excess`.
    least_px : float
        Smaller shifts of the image points are no change: the calibration itself does not fit better.
    false_alarm : float
        Per instant.
    """

    def __init__(
        self,
        names: Sequence[str],
        calibration: Array,
        factor: float,
        freedom: float,
        least_px: float,
        false_alarm: float,
    ):
        self.names, self.factor, self.freedom, self.least = tuple(names), factor, freedom, least_px
        self.calibration, self.level = calibration, false_alarm / len(names)
        size = 6 * len(names)
        self.baseline, self.baseline_covariance = np.zeros(size), np.zeros((size, size))
        self.kept: list[Instant] = []
        self.pending: Instant | None = None
        self.settling: tuple[Knock, int] | None = None
        self.changes: list[Knock] = []
        self.rows: list[Row] = []

    def take(self, instant: Instant) -> Knock | None:
        """Test an instant; return the change if there is an alarm."""
        if self.settling is not None:
            self._settle(instant)
            return None
        suspect = min(self.test([instant], k).probability for k in instant.cameras) < self.level
        held, self.pending = self.pending, None
        if suspect:
            if held is None or not self._alike(held, instant):
                if held is not None:
                    self._note(held, "rejected")
                self.pending = instant
                return None
            return self._add([held, instant])
        if held is not None:
            self._note(held, "rejected")
        return self._add([instant])

    def finish(self) -> None:
        """Finish after the last instant: an unconfirmed change is an outlier."""
        if self.pending is not None:
            self._note(self.pending, "rejected")
            self.pending = None
        if self.settling is not None:
            self._renew()

    def place(self, camera: int, pose: Pose) -> Pose:
        """cam_from_rig with the changes found so far."""
        return pose.moved(self.baseline[6 * camera : 6 * camera + 6])

    # -------------------------------------------------------------------------------------------------- tests
    def test(self, window: Sequence[Instant], camera: int) -> Test:
        """Equation (1) for one camera."""
        normal = _sum([i.normal for i in window]) / self.factor
        right = _sum([i.right for i in window]) / self.factor - normal @ self.baseline
        by = _sum([i.by_calibration for i in window]) / self.factor
        own = slice(6 * camera, 6 * camera + 6)
        n, g, k, every = normal[own, own], right[own], by[own], normal[own]
        s = n + k @ self.calibration @ k.T + every @ self.baseline_covariance @ every.T
        inverted, rank = inverse(n)
        step = inverted @ g
        sigma = np.sqrt(np.maximum(np.diagonal(inverted @ s @ inverted), 0.0))
        squares = [i.pixels * (step @ i.normal[own, own] @ step) for i in window]
        shift = float(np.sqrt(max(np.mean(squares), 0.0)))
        chi2 = float(g @ inverse(s)[0] @ g)
        return Test(camera, chi2, rank, self.freedom, step, sigma, shift)

    def _alike(self, a: Instant, b: Instant) -> bool:
        """Return whether two instants show the same change of the camera for which both have the strongest
        evidence.
        """
        common = [k for k in a.cameras if k in b.cameras]
        if not common:
            return False
        k = max(common, key=lambda c: self.test([a, b], c).chi2)
        chi2, rank = disagreement(a, b, k, self.calibration)
        return chi2 / self.factor < chdtri(rank, SAME)

    def _add(self, instants: list[Instant]) -> Knock | None:
        self.kept += instants
        del self.kept[: -WINDOWS[-1]]
        found = self._alarm()
        for i in instants:
            self._note(i, "used", changed=found is not None and i is instants[-1])
        if found is not None:
            self.changes.append(found)
            after = [i.name for i in self.kept].index(found.since)
            self.kept = self.kept[after:]
            self.settling = found, SETTLING
        return found

    def _alarm(self) -> Knock | None:
        best: Test | None = None
        level = self.level / len(WINDOWS)
        for length in WINDOWS:
            if length > len(self.kept):
                break
            window = self.kept[-length:]
            for camera in sorted({k for i in window for k in i.cameras}):
                test = self.test(window, camera)
                if (
                    test.probability < level
                    and test.pixels > self.least
                    and (best is None or test.chi2 > best.chi2)
                ):
                    best = test
        return None if best is None else self._knock(best.camera)

    def _knock(self, camera: int) -> Knock:
        """The change of a camera, starting at the instant that explains most."""
        tests = [self.test(self.kept[-n:], camera) for n in range(1, len(self.kept) + 1)]
        length = 1 + int(np.argmax([t.chi2 for t in tests]))
        window = self.kept[-length:]
        test = tests[length - 1]
        seen = sorted({k for i in window for k in i.cameras})
        others = len(seen) > 2
        who = (
            f"camera {self.names[camera]} moved"
            if others
            else f"{' and '.join(self.names[k] for k in seen)} moved relative to each other"
        )
        where = (
            window[-1].name
            if window[-1].name == window[0].name
            else f"{window[-1].name} (since {window[0].name})"
        )
        said = f"{who} at {where}: {in_words(test)}"
        return Knock(self.names[camera], others, window[-1].name, window[0].name, test, said)

    # -------------------------------------------------------------------------------------- after an alarm
    def _settle(self, instant: Instant) -> None:
        assert self.settling is not None
        knock, left = self.settling
        self.kept.append(instant)
        self._note(instant, "settling")
        self.settling = knock, left - 1
        if left == 1:
            self._renew()

    def _renew(self) -> None:
        """Continue from the camera's new position."""
        assert self.settling is not None
        camera = self.names.index(self.settling[0].camera)
        own = slice(6 * camera, 6 * camera + 6)
        normal = _sum([i.normal for i in self.kept]) / self.factor
        self.baseline[own] += self.test(self.kept, camera).step
        self.baseline_covariance[own, own] = inverse(normal[own, own])[0]
        self.kept, self.settling = [], None

    def _note(self, instant: Instant, status: str, changed: bool = False) -> None:
        for camera in range(len(self.names)):
            if camera not in instant.cameras:
                continue
            test = self.test([instant], camera)
            self.rows.append(Row(instant.name, camera, status, test.step, test.sigma, test.chi2, changed))


def _sum(arrays: Sequence[Array]) -> Array:
    return np.asarray(np.sum(arrays, axis=0))


def disagreement(a: Instant, b: Instant, camera: int, calibration: Array) -> tuple[float, int]:
    """χ² of the difference between two instants' estimates of a camera's pose, and its degrees of freedom.

    An error of the calibration (covariance (F, F)) moves both, and each in its own way where they see other places.
    """
    own = slice(6 * camera, 6 * camera + 6)
    found = [inverse(i.normal[own, own]) for i in (a, b)]
    off = found[1][0] @ b.right[own] - found[0][0] @ a.right[own]
    moved = found[1][0] @ b.by_calibration[own] - found[0][0] @ a.by_calibration[own]
    weights, rank = inverse(found[0][0] + found[1][0] + moved @ calibration @ moved.T)
    return float(off @ weights @ off), rank


def excess(instants: Sequence[Instant], known: Sequence[Instant], calibration: Array) -> tuple[float, float]:
    """The scatter of instants relative to their noise, as a factor of the variance, and its degrees of freedom.

    Lenses and boards that are not quite as modelled put a board a little elsewhere at each place. Seen from neighbours,
    of which a change of the rig moves one pair only (the median), and from `known` instants, those of the calibration
    with its covariance (the mean); the larger counts, 1 at least.
    """
    pairs = [
        chi2 / chdtri(rank, 0.5)
        for a, b in pairwise(instants)
        for k in a.cameras
        if k in b.cameras
        for chi2, rank in [disagreement(a, b, k, calibration)]
        if rank
    ]  # each instant is in two of them
    inverses = [inverse(i.normal) for i in known]
    own = [float(i.right @ n @ i.right) for i, (n, _) in zip(known, inverses, strict=True)]
    ranks = [rank for _, rank in inverses]
    found = [1.0]
    if pairs:
        found.append(float(np.median(pairs)))
    if own:
        found.append(sum(own) / sum(ranks))
    steps = sum(inverse(i.normal)[1] for i in instants[1:])
    return max(found), float(max(steps / 2 + sum(ranks), POSE))


def in_words(test: Test) -> str:
    """Describe how far a camera moved."""
    angle, shift = np.degrees(test.step[:3]), test.step[3:]
    return (
        f"{np.linalg.norm(angle):.2g} deg about {axis(angle)} (± {np.degrees(test.sigma[:3]).max():.1g}), "
        f"{np.linalg.norm(shift):.2g} along {axis(shift)} (± {test.sigma[3:].max():.1g}), {test.pixels:.2g} px"
    )
