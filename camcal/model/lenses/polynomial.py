"""Two polynomials from the image to the plane z = 1: bicubic and of any order.

E. Kilpelä, Compensation of systematic errors of image and model coordinates (1980); R. Grompone von Gioi,
P. Monasse, J.-M. Morel, Z. Tang, Lens distortion correction with a calibration harp, ICIP (2011), section 2.
With (p, q) the pixel less the camera matrix:

    X = p + Σ a_ij pⁱ qʲ,  Y = b10 p + q + Σ b_ij pⁱ qʲ,  Z = 1,   2 <= i + j <= n                       (1)

`bicubic` is n = 3: ten coefficients each, of which fx, fy, cx, cy, skew and b10 stand for the constant and
the linear ones. b10 turns the picture about the axis, as the pose does, and is held at 0 unless freed.
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses import direct
from camcal.model.lenses.base import example_list
from camcal.model.lenses.forms import Values
from camcal.model.lenses.inverse import InverseLens
from camcal.model.lenses.options import count_option, no_options
from camcal.model.lenses.parameters import Parameter

Array = np.ndarray

MOST = 15  #: order: Grompone von Gioi et al. use 11; 15 has 270 coefficients


class Polynomial(InverseLens):
    """`bicubic` = `polynomial:3`, `polynomial:n`."""

    default_fixed = ("b10",)
    turns = ("b10",)

    def __init__(self, name: str, order: int, skew: bool = False):
        self.order = order
        self.powers = [(d - j, j) for d in range(2, order + 1) for j in range(d + 1)]
        names = ["b10", *(coefficient(c, i, j, order) for c in "ab" for i, j in self.powers)]
        super().__init__(name, [Parameter(n, "distortion") for n in names], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Polynomial:
        """Parse `bicubic` (no options) or `polynomial:n` of order n; 3 by default."""
        if name == "bicubic":
            no_options(name, plain, named)
            return cls(name, 3, skew)
        no_options(name, plain[1:], named)
        order = count_option(name, plain, 3, 1, MOST)
        return cls(f"polynomial:{order}", order, skew)

    def smaller(self) -> tuple[str, ...]:
        """Lower orders; every other one of the high orders."""
        orders = [n for n in (12, 10, 8, 6, 5, 4, 3, 2) if n < self.order]
        return tuple("bicubic" if n == 3 else f"polynomial:{n}" for n in orders)

    def terms(self) -> dict[str, str]:
        """The coefficients of pⁱ qʲ in X and Y."""
        powers = [("b", 1, 0), *((c, i, j) for c in "ab" for i, j in self.powers)]
        return {f"{c}{i},{j}": n for (c, i, j), n in zip(powers, self.names[self._own :], strict=True)}

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """The linear solution; no distortion if there are too few rays."""
        found = direct.polynomial(rays, uv, self.order)
        if found is None:
            return [{}]
        matrix, turn, coefficients = found
        params = self.from_matrix(matrix)
        params[self._own :] = np.r_[turn, coefficients[0], coefficients[1]]
        return [dict(zip(self.names, params.tolist(), strict=True)), {}]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A typical lens with some asymmetry, and a long one."""
        skew = [0.7] if self.has_skew else []

        def values(k1: float, a20: float, a11: float, k2: float) -> list[float]:
            radial = {(3, 0): (k1, 0), (1, 2): (k1, 0), (2, 1): (0, k1), (0, 3): (0, k1), (2, 0): (a20, -a11)}
            radial |= {(1, 1): (a11, a20), (5, 0): (k2, 0), (3, 2): (2 * k2, 0), (0, 5): (0, k2)}
            both = [radial.get(ij, (0.0, 0.0)) for ij in self.powers]
            return [0.0, *(v[0] for v in both), *(v[1] for v in both)]

        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *values(0.25, 0.004, -0.006, 0.03)], (640, 480)),
            ([2336.0, 2340.0, 1132.0, 819.0, *skew, *values(-0.05, -0.002, 0.003, 0.01)], (2272, 1704)),
        )

    # ------------------------------------------------------------------ InverseLens
    def farthest(self, k: Array) -> float:
        """79 degrees: a polynomial over the plane z = 1 is unsuitable for wider lenses."""
        return 5.0

    def _tables(self, p: Array, q: Array) -> tuple[list[Array], list[Array]]:
        ps, qs = [np.ones_like(p)], [np.ones_like(q)]
        for _ in range(self.order):
            ps.append(ps[-1] * p)
            qs.append(qs[-1] * q)
        return ps, qs

    def ray(self, k: Array, p: Array, q: Array) -> Array:
        """Equation (1)."""
        ps, qs = self._tables(p, q)
        half = len(self.powers)
        out = np.zeros((3, 3, *np.shape(p)))
        out[0, 0], out[0, 1], out[0, 2] = p, k[0] * p + q, 1.0
        out[1, 0] = out[2, 1] = 1.0
        out[1, 1] = k[0]
        for (i, j), a, b in zip(self.powers, k[1 : half + 1].tolist(), k[half + 1 :].tolist(), strict=True):
            if a == 0.0 and b == 0.0:
                continue
            terms = [ps[i] * qs[j], None, None]
            if i:
                terms[1] = i * ps[i - 1] * qs[j]
            if j:
                terms[2] = j * ps[i] * qs[j - 1]
            for row, term in enumerate(terms):
                if term is not None:
                    out[row, 0] += a * term
                    out[row, 1] += b * term
        return out

    def ray_rows(self, k: Array, p: Array, q: Array, normal: Array, rows: Array) -> None:
        """The derivatives: X and Y are linear in the coefficients."""
        ps, qs = self._tables(p, q)
        half = len(self.powers)
        np.multiply(normal[1], p, out=rows[:, 0])
        for n, (i, j) in enumerate(self.powers, 1):
            term = ps[i] * qs[j]
            np.multiply(normal[0], term, out=rows[:, n])
            np.multiply(normal[1], term, out=rows[:, n + half])


def coefficient(letter: str, i: int, j: int, order: int) -> str:
    """The name of the coefficient of pⁱ qʲ."""
    return f"{letter}{i}{j}" if order < 10 else f"{letter}{i}_{j}"
