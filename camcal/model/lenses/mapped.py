"""Lenses that are a camera matrix applied to a map (x, y, z) -> (mx, my) of their own.

    u = fx mx + skew my + cx,  v = fy my + cy                                                            (1)

With a free distortion centre (xc, yc), in units of the focal length, the map acts about that centre:

    (mx, my) = (xc, yc) + map(x - xc z, y - yc z, z)                                                     (2)

so that the principal point (cx, cy) and the distortion centre (cx + fx xc + skew yc, cy + fy yc) are apart,
as in Brown (1966) and in Hartley & Kang (2005).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from camcal.model.lenses.base import Lens, Parameter

Array = np.ndarray

CENTRE = (Parameter("xc", "distortion"), Parameter("yc", "distortion"))


class MappedLens(Lens):
    """A lens that states `bend`, its derivatives and its inverse; the camera matrix is dealt with here."""

    def __init__(
        self, name: str, distortion: Sequence[Parameter], skew: bool = False, free_centre: bool = False
    ):
        self.free_centre = free_centre
        super().__init__(name, (*CENTRE, *distortion) if free_centre else distortion, skew)
        self._own = self._bend + (2 if free_centre else 0)  # where the parameters of the map begin
        self._lower = np.array([p.lower for p in self.parameters])
        self._upper = np.array([p.upper for p in self.parameters])

    # ------------------------------------------------------------------ what a map has to say
    @abstractmethod
    def bend(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """The map without a look at its domain: (mx, my)."""

    @abstractmethod
    def bend_derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array
    ) -> tuple[Array, Array, bool]:
        """The map and its derivatives into d_xyz (V, 3, 2, N) and d_k (V, Q, 2, N).

        Returns
        -------
        mx, my : (V, N) arrays
        inside : bool, False where a point is outside the domain
        """

    @abstractmethod
    def unbend(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """The inverse: a ray (x, y, z) of any length, and which points have one."""

    @abstractmethod
    def bend_inside(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Which points the map holds for."""

    # ------------------------------------------------------------------ Lens
    def _centred(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        if not self.free_centre:
            return x, y
        xc, yc = params[self._bend : self._own].tolist()
        return x - xc * z, y - yc * z

    def within_bounds(self, params: Array) -> bool:
        """Whether every parameter lies within its bounds."""
        return bool(((params >= self._lower) & (params <= self._upper)).all())

    def inside(self, params: Array, x: Array, y: Array, z: Array) -> Array:
        """Where the map holds."""
        x, y = self._centred(params, x, y, z)
        return self.bend_inside(params[self._own :], x, y, z)

    def forward(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equations (1) and (2)."""
        x, y = self._centred(params, x, y, z)
        mx, my = self.bend(params[self._own :], x, y, z)
        if self.free_centre:
            mx, my = mx + params[self._bend], my + params[self._bend + 1]
        u = params[0] * mx + params[2]
        if self.has_skew:
            u += params[4] * my
        return u, params[1] * my + params[3]

    def linearise(
        self, params: Array, x: Array, y: Array, z: Array, uv: Array, d_xyz: Array, d_params: Array
    ) -> bool:
        """See `Lens.linearise`; a step out of the parameters' bounds counts as outside, too."""
        x, y = self._centred(params, x, y, z)
        rows = d_params[:, self._bend :]
        mx, my, inside = self.bend_derivatives(params[self._own :], x, y, z, d_xyz, d_params[:, self._own :])
        if self.free_centre:
            xc, yc = params[self._bend : self._own].tolist()
            z_ = z[:, None]
            for i in range(2):  # d/dxc: the centre moves, the map is read elsewhere
                np.multiply(d_xyz[:, i], -z_, out=rows[:, i])
                rows[:, i, i] += 1.0
            d_xyz[:, 2] -= xc * d_xyz[:, 0] + yc * d_xyz[:, 1]
            mx, my = mx + xc, my + yc
        for block in (rows, d_xyz):
            block[:, :, 0] *= params[0]
            if self.has_skew:
                block[:, :, 0] += params[4] * block[:, :, 1]
            block[:, :, 1] *= params[1]
        self._matrix_rows(params, mx, my, uv, d_params)
        return inside and self.within_bounds(params)

    def _matrix_rows(self, params: Array, mx: Array, my: Array, uv: Array, d_params: Array) -> None:
        """Equation (1) and its derivatives with respect to fx, fy, cx, cy, skew."""
        np.multiply(mx, params[0], out=uv[:, 0])
        uv[:, 0] += params[2]
        np.multiply(my, params[1], out=uv[:, 1])
        uv[:, 1] += params[3]
        d_params[:, : self._bend] = 0.0
        d_params[:, 0, 0], d_params[:, 1, 1] = mx, my
        d_params[:, 2, 0] = d_params[:, 3, 1] = 1.0
        if self.has_skew:
            uv[:, 0] += params[4] * my
            d_params[:, 4, 0] = my

    def backward(self, params: Array, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """The inverse of (1) and (2)."""
        my = (v - params[3]) / params[1]
        mx = (u - params[2] - (params[4] * my if self.has_skew else 0.0)) / params[0]
        if not self.free_centre:
            return self.unbend(params[self._own :], mx, my)
        xc, yc = params[self._bend : self._own].tolist()
        x, y, z, valid = self.unbend(params[self._own :], mx - xc, my - yc)
        return x + xc * z, y + yc * z, z, valid
