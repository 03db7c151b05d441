"""Brown and Conrady's model of any order, about the principal point or a centre of its own.

See `plane.PlaneDistortion` for the equations and `mapped` for the distortion centre; a = x/z, b = y/z.
"""

from __future__ import annotations

import numpy as np

from camcal.errors import UsageError
from camcal.model.lenses.base import OpenCVForm, Parameter, example_list, no_options
from camcal.model.lenses.mapped import MappedLens
from camcal.model.lenses.plane import PlaneDistortion

Array = np.ndarray

OPTIONS = ("radial", "decentering", "prism", "centre")
MOST_RADIAL, MOST_DECENTERING = 10, 6


class Brown(MappedLens):
    """`brown:radial=n,decentering=m,prism=0|1,centre=free|principal`.

    `decentering` counts the factors of Brown's product: 1 is p1 and p2, 2 adds p3, and so on.
    """

    def __init__(self, radial: int, decentering: int, prism: bool, free_centre: bool, skew: bool = False):
        self.plane = PlaneDistortion(radial, decentering, prism)
        name = brown_spec(radial, decentering, prism, free_centre)
        distortion = [Parameter(n, "distortion") for n in self.plane.names]
        super().__init__(name, distortion, skew, free_centre)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Brown:
        """Without options: radial=3, decentering=1, prism=0, centre=principal."""
        no_options(name, plain, named, OPTIONS)
        centre = named.get("centre", "principal")
        if centre not in ("free", "principal"):
            raise UsageError(f"model 'brown': centre={centre} is neither 'free' nor 'principal'.")
        return cls(
            whole_number(name, named, "radial", 3, MOST_RADIAL),
            whole_number(name, named, "decentering", 1, MOST_DECENTERING),
            bool(whole_number(name, named, "prism", 0, 1)),
            centre == "free",
            skew,
        )

    @classmethod
    def variants(cls, name: str) -> tuple[str, ...]:
        """Every kind of term, alone and together."""
        return (
            brown_spec(3, 1),
            brown_spec(2, 0),
            brown_spec(0, 0),
            brown_spec(4, 3, True),
            brown_spec(3, 2, True, True),
            brown_spec(2, 0, False, True),
        )

    def nests(self) -> tuple[str, ...]:
        """One term less of each kind, and OpenCV's models that hold nothing else."""
        p, found = self.plane, []
        if self.free_centre:
            found.append(brown_spec(p.radial, p.decentering, p.prism))
        if p.prism:
            found.append(brown_spec(p.radial, p.decentering, False, self.free_centre))
        if p.decentering:
            found.append(brown_spec(p.radial, p.decentering - 1, p.prism, self.free_centre))
            found += [f"opencv{n}" for n, k in ((5, 3), (4, 2)) if k <= p.radial]
        if p.radial:
            found.append(brown_spec(p.radial - 1, p.decentering, p.prism, self.free_centre))
        return (*found, "pinhole") if len(p.names) else tuple(found) or ("pinhole",)

    def opencv(self, params: Array) -> OpenCVForm | None:
        """OpenCV's coefficients up to three radial ones and p1, p2, with its prism where there is one."""
        p = self.plane
        if p.radial > 3 or p.decentering > 1 or self.free_centre:
            return None
        value = dict(zip(self.names, params.tolist(), strict=True))
        order = ("k1", "k2", "p1", "p2", "k3", "", "", "", "s1", "", "s2", "")
        out = np.array([value.get(n, 0.0) for n in order[: 12 if p.prism else 5]])
        flags = [f"FIX_K{i}" for i in range(p.radial + 1, 7 if p.prism else 4)]
        if not p.decentering:
            flags.append("ZERO_TANGENT_DIST")
        if p.prism:
            flags.append("THIN_PRISM_MODEL")
        # cv2's prism has two more terms, which its flags cannot hold back
        free = (*self.names[self._own :], *(("s2_r4", "s4_r4") if p.prism else ()))
        return OpenCVForm("calibrateCamera", out, tuple(flags), free)

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A usual webcam lens and a long one."""
        skew = [0.7] if self.has_skew else []
        webcam = [-0.28, 0.1, -0.02, 0.001], [1e-3, -5e-4, 0.2, -0.1], [1e-3, -8e-4]
        long = [0.05, -0.08, 0.02, -0.01], [-4e-4, 6e-4, -0.3, 0.2], [-5e-4, 1e-3]
        centre = [(0.02, -0.015), (-0.01, 0.03)] if self.free_centre else [(), ()]
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *centre[0], *self._pick(*webcam)], (640, 480)),
            ([2336.0, 2340.0, 1132.0, 819.0, *skew, *centre[1], *self._pick(*long)], (2272, 1704)),
        )

    def _pick(self, k: list[float], p: list[float], s: list[float]) -> list[float]:
        """Values of the coefficients that this model has."""
        table = {
            f"{letter}{i + 1}": v for letter, c in zip("kps", (k, p, s), strict=True) for i, v in enumerate(c)
        }
        return [table.get(n, 0.0) for n in self.plane.names]

    # ------------------------------------------------------------------ MappedLens
    def bend(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equation (1) of `plane` at (x/z, y/z)."""
        iz = 1.0 / z
        return self.plane.apply(k, x * iz, y * iz)

    def bend_derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array
    ) -> tuple[Array, Array, bool]:
        """The chain rule through (x/z, y/z)."""
        iz = 1.0 / z
        a, b = x * iz, y * iz
        xd, yd, xa, xb, ya, yb = self.plane.derivatives(k, a, b)
        self.plane.coefficient_rows(k, a, b, d_k)
        d_xyz[:, 0, 0], d_xyz[:, 0, 1] = xa * iz, ya * iz
        d_xyz[:, 1, 0], d_xyz[:, 1, 1] = xb * iz, yb * iz
        np.negative(a[:, None] * d_xyz[:, 0] + b[:, None] * d_xyz[:, 1], out=d_xyz[:, 2])
        inside = bool(((z > 0) & (a * a + b * b < self.plane.fold(k) ** 2)).all())
        return xd, yd, inside

    def bend_inside(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """In front of the camera, before the radial part folds back."""
        return (z > 0) & (x * x + y * y < (self.plane.fold(k) * z) ** 2)

    def unbend(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """Newton."""
        a, b, solved = self.plane.invert(k, mx, my)
        return a, b, np.ones_like(a), solved


def brown_spec(radial: int, decentering: int, prism: bool = False, free_centre: bool = False) -> str:
    """The spec of a model, with what differs from none left out."""
    spec = f"brown:radial={radial},decentering={decentering}"
    return spec + ",prism=1" * prism + ",centre=free" * free_centre


def whole_number(name: str, named: dict[str, str], key: str, default: int, most: int) -> int:
    """A whole number from 0 to `most` among the options of a spec; UsageError for anything else."""
    text = named.get(key, str(default))
    if not text.isdigit() or int(text) > most:
        raise UsageError(
            f"model '{name}': {key}={text} is not a number from 0 to {most}.", f"Try: {key}={default}"
        )
    return int(text)
