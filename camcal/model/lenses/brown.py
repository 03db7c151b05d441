"""The Brown-Conrady model of any order, about the principal point or a separate centre.

Equations (1) and (2) of `plane` at (a, b) = (x/z, y/z), and (2) of `base` for the distortion centre.
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses.base import example_list
from camcal.model.lenses.forms import OpenCVForm
from camcal.model.lenses.opencv import PlaneLens
from camcal.model.lenses.options import choice, no_options, whole_number

Array = np.ndarray

OPTIONS = ("radial", "decentering", "prism", "centre")
#: more than published calibrations use; the columns of higher powers are nearly collinear
MOST_RADIAL, MOST_DECENTERING = 10, 6


class Brown(PlaneLens):
    """`brown:radial=n,decentering=m,prism=0|1,centre=free|principal`.

    `decentering` counts the factors of Brown's product: 1 is p1 and p2, 2 adds p3, and so on.
    """

    def __init__(self, radial: int, decentering: int, prism: bool, free_centre: bool, skew: bool = False):
        self.radial, self.decentering, self.prism = radial, decentering, prism
        k = [f"k{i + 1}" for i in range(radial)]
        p = [f"p{i + 1}" for i in range(decentering + 1 if decentering else 0)]
        names = [*k, *p, *(("s1", "s2") if prism else ())]
        terms = [*(n.replace("k", "n") for n in k), *p, *(("x1", "y1") if prism else ())]
        super().__init__(brown_spec(radial, decentering, prism, free_centre), names, terms, skew, free_centre)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Brown:
        """Parse the options; defaults: radial=3, decentering=1, prism=0, centre=principal."""
        no_options(name, plain, named, OPTIONS)
        centre = choice(name, named, "centre", ("principal", "free"))
        return cls(
            whole_number(name, named, "radial", 3, MOST_RADIAL),
            whole_number(name, named, "decentering", 1, MOST_DECENTERING),
            bool(whole_number(name, named, "prism", 0, 1)),
            centre == "free",
            skew,
        )

    def smaller(self) -> tuple[str, ...]:
        """The models with one term less of each kind."""
        counts, found = [self.free_centre, self.prism, self.decentering, self.radial], []
        for i, count in enumerate(counts):
            if count:
                free, prism, decentering, radial = [c - (i == j) for j, c in enumerate(counts)]
                found.append(brown_spec(radial, decentering, bool(prism), bool(free)))
        return tuple(found)

    def opencv(self, params: Array) -> OpenCVForm | None:
        """OpenCV's coefficients: up to three radial ones, p1 and p2, and the prism where there is one."""
        if self.radial > 3 or self.decentering > 1 or self.free_centre:  # cv2 has k1 to k3, p1 and p2
            return None
        value = dict(zip(self.names, params.tolist(), strict=True))
        order = ("k1", "k2", "p1", "p2", "k3", "", "", "", "s1", "", "s2", "")
        out = np.array([value.get(n, 0.0) for n in order[: 12 if self.prism else 5]])
        flags = [f"FIX_K{i}" for i in range(self.radial + 1, 7 if self.prism else 4)]
        if not self.decentering:
            flags.append("ZERO_TANGENT_DIST")
        if self.prism:
            flags.append("THIN_PRISM_MODEL")
        return OpenCVForm("calibrateCamera", out, tuple(flags))

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A typical webcam lens and a long one."""
        skew = [0.7] if self.has_skew else []
        webcam = [-0.28, 0.1, -0.02, 0.001], [1e-3, -5e-4, 0.2, -0.1], [1e-3, -8e-4]
        long = [0.05, -0.08, 0.02, -0.01], [-4e-4, 6e-4, -0.3, 0.2], [-5e-4, 1e-3]
        centre = [(0.02, -0.015), (-0.01, 0.03)] if self.free_centre else [(), ()]
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *centre[0], *self._pick(*webcam)], (640, 480)),
            ([2336.0, 2340.0, 1132.0, 819.0, *skew, *centre[1], *self._pick(*long)], (2272, 1704)),
        )

    def _pick(self, k: list[float], p: list[float], s: list[float]) -> list[float]:
        """Select the values of the coefficients that this model has."""
        table = {
            f"{letter}{i + 1}": v for letter, c in zip("kps", (k, p, s), strict=True) for i, v in enumerate(c)
        }
        return [table.get(n, 0.0) for n in self.names[self._own :]]


def brown_spec(radial: int, decentering: int, prism: bool = False, free_centre: bool = False) -> str:
    """The spec of a model, omitting options at their neutral values."""
    spec = f"brown:radial={radial},decentering={decentering}"
    return spec + ",prism=1" * prism + ",centre=free" * free_centre
