"""The rational function model: the ray is a quadratic function of the pixel.

D. Claus, A. W. Fitzgibbon, A rational function lens distortion model for general cameras, CVPR (2005), eqs. 4
to 6, with three coefficient vectors over χ = [p², pq, q², p, q, 1] of the pixel (p, q):

    (X, Y, Z) ~ A χ(p, q)                                                                                (1)

A has 18 entries. The camera matrix, with which (p, q) is the pixel less fx, fy, cx, cy, skew, stands for
five, the scale for one; a turn of the ray about the axis (b4) and about the two others (c4, c5) is the
pose's and held at 0 unless freed:

        [ a1  a2  a3   1   0   0 ]
    A = [ b1  b2  b3  b4   1   0 ]                                                                       (2)
        [ c1  c2  c3  c4  c5   1 ]

so that (cx, cy) is the pixel of the axis and a division model has c1 = c3 alone.
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses import direct
from camcal.model.lenses.base import example_list
from camcal.model.lenses.forms import Values
from camcal.model.lenses.inverse import InverseLens
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter

Array = np.ndarray

NAMES = ("a1", "a2", "a3", "b1", "b2", "b3", "b4", "c1", "c2", "c3", "c4", "c5")
#: the entries of A as coefficients of pⁱ qʲ in X, Y, Z, as in `polynomial`
TERMS = ("a2,0", "a1,1", "a0,2", "b2,0", "b1,1", "b0,2", "b1,0", "c2,0", "c1,1", "c0,2", "c1,0", "c0,1")


class RationalFunction(InverseLens):
    """`rational-function`."""

    default_fixed = ("b4", "c4", "c5")
    turns = ("b4", "c4", "c5")

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> RationalFunction:
        """Reject any option."""
        no_options(name, plain, named)
        return cls(name, [Parameter(n, "distortion") for n in NAMES], skew)

    def terms(self) -> dict[str, str]:
        """Coefficients of pⁱ qʲ."""
        return dict(zip(TERMS, NAMES, strict=True))

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """The linear solution, and division models from a pinhole camera to 180 degrees and beyond."""
        found = direct.rational_function(rays, uv)
        divisions = [{"c1": v, "c3": v} for v in (0.0, -0.1, -0.25, -0.45)]
        if found is None:
            return divisions
        matrix, a = found
        params = self.from_matrix(matrix)
        params[self._own :] = np.r_[a[0, :3], a[1, :4], a[2, :5]]
        return [dict(zip(self.names, params.tolist(), strict=True)), *divisions]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A wide lens with some asymmetry, and a mild one."""
        skew = [0.8] if self.has_skew else []
        wide = [0.004, -0.003, 0.002, -0.001, 0.003, 0.002, 0.0, -0.3, 0.004, -0.29, 0.0, 0.0]
        mild = [-0.002, 0.004, 0.001, 0.003, -0.002, 0.001, 0.01, -0.12, -0.005, -0.13, 0.003, -0.004]
        return example_list(
            ([420.0, 421.0, 640.0, 395.0, *skew, *wide], (1280, 800)),
            ([533.0, 534.0, 341.0, 234.0, *skew, *mild], (640, 480)),
        )

    # ------------------------------------------------------------------ InverseLens
    def ray(self, k: Array, p: Array, q: Array) -> Array:
        """Equation (1) with (2)."""
        a, b, c = k[:3].tolist(), k[3:7].tolist(), k[7:].tolist()
        out = np.empty((3, 3, *np.shape(p)))
        for row, (m, linear) in enumerate(((a, (1.0, 0.0)), (b[:3], (b[3], 1.0)), (c[:3], (c[3], c[4])))):
            by_p, by_q = m[0] * p + m[1] * q, m[2] * q
            np.add(p * (by_p + linear[0]), q * (by_q + linear[1]), out=out[0, row])
            np.add(by_p + m[0] * p, linear[0], out=out[1, row])
            np.add(m[1] * p + 2 * by_q, linear[1], out=out[2, row])
        out[0, 2] += 1.0
        return out

    def ray_rows(self, k: Array, p: Array, q: Array, normal: Array, rows: Array) -> None:
        """The derivatives: X is linear in A."""
        monomials = (p * p, p * q, q * q, p, q)
        for n, (row, m) in enumerate(
            [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (1, 3), (2, 0), (2, 1), (2, 2), (2, 3), (2, 4)]
        ):
            np.multiply(normal[row], monomials[m], out=rows[:, n])
