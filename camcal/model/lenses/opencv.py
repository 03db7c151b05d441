"""OpenCV's polynomial and rational model with 0 to 14 coefficients (docs.opencv.org, camera calibration).

With a = x/z, b = y/z, s = a² + b²:

    f  = (1 + k1 s + k2 s² + k3 s³) / (1 + k4 s + k5 s² + k6 s³)                       (1) radial
    xd = a f + 2 p1 a b + p2 (s + 2 a²) + s1 s + s2 s²                                 (2) decentering, prism
    yd = b f + p1 (s + 2 b²) + 2 p2 a b + s3 s + s4 s²
    (xd, yd, 1) ~ tilt(tauX, tauY) (xd, yd, 1)                                         (3) Scheimpflug
    u  = fx xd + skew yd + cx,  v = fy yd + cy                                         (4)
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from camcal.model.lenses import newton
from camcal.model.lenses.base import Lens, OpenCVForm, Parameter, example_list, no_options
from camcal.model.lenses.curve import first_root, memo
from camcal.model.lenses.rational import fit_rational
from camcal.model.lenses.start import image_radii

Array = np.ndarray

#: rad; beyond it tan θ is too large to begin from
WIDEST = np.deg2rad(87)
#: cv2's order of the coefficients
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")

_COUNTS = {"pinhole": 0, "opencv4": 4, "opencv5": 5, "opencv8": 8, "opencv12": 12, "opencv14": 14}
ALIASES = {"tilted": "opencv14"}
_FLAGS = {8: ("RATIONAL_MODEL",), 12: ("THIN_PRISM_MODEL",), 14: ("TILTED_MODEL",)}


class OpenCV(Lens):
    """`pinhole`, `opencv4`, `opencv5`, `opencv8`, `opencv12`, `opencv14`."""

    def __init__(self, name: str, skew: bool = False):
        self.count = _COUNTS[name]
        names = COEFFICIENTS[: self.count]
        super().__init__(name, [Parameter(n, "distortion") for n in names], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> OpenCV:
        """Make the model; it has no options."""
        no_options(name, plain, named)
        return cls(ALIASES.get(name, name), skew)

    def nests(self) -> tuple[str, ...]:
        """The models with fewer coefficients."""
        return tuple(n for n, c in reversed(_COUNTS.items()) if c < self.count)

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[dict[str, float]]:
        """Without distortion, and with radial terms found linearly from the angles that the radii have."""
        found: list[dict[str, float]] = [{}]
        if not self.count:
            return found
        radius, theta = image_radii(rays, uv, None)
        used = theta < WIDEST
        terms = min(self.count // 2, 3) if self.count != 4 else 2
        fit = fit_rational(np.tan(theta[used]), radius[used], terms, 3 if self.count >= 8 else 0)
        if fit is not None:
            names = ("k1", "k2", "k3")[:terms], ("k4", "k5", "k6")
            found.append(
                {n: float(v) for c, v in zip(names, fit, strict=True) for n, v in zip(c, v, strict=False)}
            )
        return found

    def opencv(self, params: Array) -> OpenCVForm:
        """The coefficients in cv2's order, and its flags for the same free ones."""
        flags = [f for n in (8, 12, 14) if self.count >= n for f in _FLAGS[n]]
        return OpenCVForm(
            "calibrateCamera", params[self._bend :].copy(), tuple(flags), self.names[self._bend :]
        )

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A usual webcam lens, a longer one, and for the larger models their own terms."""
        bend = [-0.28, 0.1, 1e-3, -5e-4, -0.02, 0.02, 0.01, 1e-3, 2e-3, -1e-3, -1.5e-3, 1e-3, 0.01, -0.015]
        mild = [0.05, -0.08, -4e-4, 6e-4, 0.02, 0.01, -0.02, 5e-3, -1e-3, 5e-4, 1e-3, -5e-4, -0.02, 0.01]
        skew = [0.7] if self.has_skew else []
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *bend[: self.count]], (640, 480)),
            ([2336.0, 2340.0, 1132.0, 819.0, *skew, *mild[: self.count]], (2272, 1704)),
        )

    # ------------------------------------------------------------------ projection
    def _coefficients(self, params: Array) -> list[float]:
        k = params[self._bend :].tolist()
        return k + [0.0] * (14 - len(k))

    def _tilt(self, params: Array) -> Array | None:
        return tilt_matrix(*params[-2:]) if self.count == 14 and params[-2:].any() else None

    def _radial(self, k: list[float], s: Array) -> tuple[Array, Array, Array | None]:
        """f of (1), df/ds, and 1 / denominator where there is one."""
        num, slope = cubic(s, k[0], k[1], k[4])
        if self.count < 8:
            return num, slope, None
        inverse, below = cubic(s, *k[5:8])
        np.divide(1.0, inverse, out=inverse)
        num *= inverse
        below *= num
        slope -= below
        slope *= inverse
        return num, slope, inverse

    def _distort(self, k: list[float], a: Array, b: Array) -> tuple[Array, Array]:
        s = a * a + b * b
        if self.count < 8:
            f = s * (s * (s * k[4] + k[1]) + k[0]) + 1.0
        else:
            f = (s * (s * (s * k[4] + k[1]) + k[0]) + 1.0) / (s * (s * (s * k[7] + k[6]) + k[5]) + 1.0)
        common = f + (2 * k[2]) * b + (2 * k[3]) * a
        xd, yd = a * common + k[3] * s, b * common + k[2] * s
        if self.count >= 12:
            xd += s * (k[9] * s + k[8])
            yd += s * (k[11] * s + k[10])
        return xd, yd

    def forward(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equations (1) to (4)."""
        iz = 1.0 / z
        xd, yd = x * iz, y * iz
        if self.count:
            xd, yd = self._distort(self._coefficients(params), xd, yd)
            tilt = self._tilt(params)
            if tilt is not None:
                w = 1.0 / (tilt[2, 0] * xd + tilt[2, 1] * yd + tilt[2, 2])
                xd, yd = (
                    (tilt[0, 0] * xd + tilt[0, 1] * yd + tilt[0, 2]) * w,
                    (tilt[1, 0] * xd + tilt[1, 1] * yd + tilt[1, 2]) * w,
                )
        u = params[0] * xd + params[2]
        if self.has_skew:
            u += params[4] * yd
        return u, params[1] * yd + params[3]

    def radius(self, params: Array) -> float:
        """Radius sqrt(a² + b²) at which r f(r²) folds back or has a pole; inf where it does neither."""
        k = self._coefficients(params)
        return _first_fold((1.0, k[0], k[1], k[4]), (1.0, k[5], k[6], k[7]))

    def limit_angle(self, params: Array) -> float:
        """The angle of `radius`; π/2 where there is none."""
        return float(np.arctan(self.radius(params)))

    def inside(self, params: Array, x: Array, y: Array, z: Array) -> Array:
        """In front of the camera and within `radius`."""
        front = z > 0
        limit = self.radius(params)
        return front if np.isinf(limit) else front & (x * x + y * y < (limit * z) ** 2)

    # ------------------------------------------------------------------ derivatives
    def linearise(
        self, params: Array, x: Array, y: Array, z: Array, uv: Array, d_xyz: Array, d_params: Array
    ) -> bool:
        """See `Lens.linearise`; the derivatives of (1) to (4) written out."""
        k = self._coefficients(params)
        tilt = self._tilt_or_identity(params)
        # skew and tilt mix the two coordinates, so the rows are then scaled at the end
        mixed = self.has_skew or tilt is not None
        fx, fy = (1.0, 1.0) if mixed else (params[0], params[1])
        iz = 1.0 / z
        a, b = x * iz, y * iz
        s = a * a + b * b
        rows = d_params[:, self._bend :]
        if self.count:
            f, slope, inverse = self._radial(k, s)
            inside = self._grows(params, k, float(s.max()))
            partials = self._plane_derivatives(k, a, b, s, f, slope)
            self._coefficient_rows(rows, a, b, s, f, inverse, fx, fy)
        else:
            one = np.ones_like(a)
            inside, partials = True, (a, b, one, np.zeros_like(a), one)
        xd, yd, xa, cross, yb = partials[:5]
        ya = partials[5] if len(partials) > 5 else cross
        ix, iy = fx * iz, fy * iz
        np.multiply(ix, xa, out=d_xyz[:, 0, 0])
        np.multiply(iy, ya, out=d_xyz[:, 0, 1])
        np.multiply(ix, cross, out=d_xyz[:, 1, 0])
        np.multiply(iy, yb, out=d_xyz[:, 1, 1])
        a_, b_ = a[:, None], b[:, None]
        np.negative(a_ * d_xyz[:, 0] + b_ * d_xyz[:, 1], out=d_xyz[:, 2])
        if mixed:
            xd, yd = self._mix(params, tilt, xd, yd, rows, d_xyz)
        self._matrix_rows(params, xd, yd, uv, d_params)
        return inside and bool(z.min() > 0)

    def _grows(self, params: Array, k: list[float], s: float) -> bool:
        """Whether r f(r²) grows without a pole all the way to r² = s; False for NaN.

        Where the negative coefficients together cannot stop it, the roots need not be found.
        """
        if self.count < 8:
            falling = [3 * k[0], 5 * k[1], 7 * k[4]]
            if 1.0 + s * sum(min(c, 0.0) * s**i for i, c in enumerate(falling)) > 0:
                return True
        return s < self.radius(params) ** 2

    def _tilt_or_identity(self, params: Array) -> Array | None:
        """The tilt, also at zero angles: its derivatives are wanted there too."""
        return tilt_matrix(*params[-2:]) if self.count == 14 else None

    def _plane_derivatives(
        self, k: list[float], a: Array, b: Array, s: Array, f: Array, slope: Array
    ) -> tuple[Array, ...]:
        """xd, yd and d(xd)/da, d(xd)/db, d(yd)/db, and d(yd)/da where it differs from d(xd)/db."""
        p1, p2 = k[2], k[3]
        pa, pb = (2 * p2) * a, (2 * p1) * b
        common = f + pa
        common += pb
        xd, yd = a * common, b * common
        xd += p2 * s
        yd += p1 * s
        twice = 2.0 * slope
        xa, cross = twice * a, twice * b
        xa += 4 * p2
        xa *= a
        xa += common
        yb = cross + 4 * p1
        yb *= b
        yb += common
        cross += 2 * p1
        cross *= a
        cross += (2 * p2) * b
        if self.count < 12:
            return xd, yd, xa, cross, yb
        xd += s * (k[9] * s + k[8])
        yd += s * (k[11] * s + k[10])
        gx, gy = (4 * k[9]) * s + 2 * k[8], (4 * k[11]) * s + 2 * k[10]
        return xd, yd, xa + a * gx, cross + b * gx, yb + b * gy, cross + a * gy

    def _coefficient_rows(
        self, rows: Array, a: Array, b: Array, s: Array, f: Array, inverse: Array | None, fx: float, fy: float
    ) -> None:
        """d(fx xd, fy yd) / d coefficients in cv2's order."""
        s_ = s[:, None]
        np.multiply(a, fx * s, out=rows[:, 0, 0])
        np.multiply(b, fy * s, out=rows[:, 0, 1])
        if inverse is not None:
            rows[:, 0] *= inverse[:, None]
        np.multiply(rows[:, 0], s_, out=rows[:, 1])
        ab2 = (2.0 * a) * b
        np.multiply(ab2, fx, out=rows[:, 2, 0])
        np.multiply(2.0 * (b * b) + s, fy, out=rows[:, 2, 1])
        np.multiply(2.0 * (a * a) + s, fx, out=rows[:, 3, 0])
        np.multiply(ab2, fy, out=rows[:, 3, 1])
        if self.count >= 5:
            np.multiply(rows[:, 1], s_, out=rows[:, 4])
        if self.count >= 8:
            minus_f = -f[:, None]
            np.multiply(rows[:, 0], minus_f, out=rows[:, 5])
            np.multiply(rows[:, 5], s_, out=rows[:, 6])
            np.multiply(rows[:, 6], s_, out=rows[:, 7])
        if self.count >= 12:
            rows[:, 8:12] = 0.0
            np.multiply(s, fx, out=rows[:, 8, 0])
            np.multiply(rows[:, 8, 0], s, out=rows[:, 9, 0])
            np.multiply(s, fy, out=rows[:, 10, 1])
            np.multiply(rows[:, 10, 1], s, out=rows[:, 11, 1])

    def _mix(
        self, params: Array, tilt: Array | None, xd: Array, yd: Array, rows: Array, d_xyz: Array
    ) -> tuple[Array, Array]:
        """Carry derivatives of (xd, yd) through the tilt and the camera matrix; the tilted (xd, yd)."""
        fx, fy = params[0], params[1]
        skew = params[4] if self.has_skew else 0.0
        if tilt is None:
            m00, m01, m10, m11 = fx, skew, 0.0, fy
        else:
            w = 1.0 / (tilt[2, 0] * xd + tilt[2, 1] * yd + tilt[2, 2])
            xt = (tilt[0, 0] * xd + tilt[0, 1] * yd + tilt[0, 2]) * w
            yt = (tilt[1, 0] * xd + tilt[1, 1] * yd + tilt[1, 2]) * w
            t00, t01 = (tilt[0, 0] - tilt[2, 0] * xt) * w, (tilt[0, 1] - tilt[2, 1] * xt) * w
            t10, t11 = (tilt[1, 0] - tilt[2, 0] * yt) * w, (tilt[1, 1] - tilt[2, 1] * yt) * w
            m00, m01 = (fx * t00 + skew * t10)[:, None], (fx * t01 + skew * t11)[:, None]
            m10, m11 = (fy * t10)[:, None], (fy * t11)[:, None]
        for block in (rows[:, :12], d_xyz):
            top = m00 * block[:, :, 0] + m01 * block[:, :, 1]
            block[:, :, 1] = m10 * block[:, :, 0] + m11 * block[:, :, 1]
            block[:, :, 0] = top
        if tilt is None:
            return xd, yd
        for row, d in zip((12, 13), tilt_derivatives(*params[-2:]), strict=True):
            dw = d[2, 0] * xd + d[2, 1] * yd + d[2, 2]
            dx = (d[0, 0] * xd + d[0, 1] * yd + d[0, 2] - xt * dw) * w
            dy = (d[1, 0] * xd + d[1, 1] * yd + d[1, 2] - yt * dw) * w
            rows[:, row, 0] = fx * dx + skew * dy
            rows[:, row, 1] = fy * dy
        return xt, yt

    def _matrix_rows(self, params: Array, xd: Array, yd: Array, uv: Array, d_params: Array) -> None:
        """Equation (4) and its derivatives."""
        np.multiply(xd, params[0], out=uv[:, 0])
        uv[:, 0] += params[2]
        np.multiply(yd, params[1], out=uv[:, 1])
        uv[:, 1] += params[3]
        d_params[:, : self._bend] = 0.0
        d_params[:, 0, 0], d_params[:, 1, 1] = xd, yd
        d_params[:, 2, 0] = d_params[:, 3, 1] = 1.0
        if self.has_skew:
            uv[:, 0] += params[4] * yd
            d_params[:, 4, 0] = yd

    # ------------------------------------------------------------------ inverse
    def backward(self, params: Array, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Inverse of (4) and (3), then Newton on (2) from the inverse of (1) alone."""
        yd = (v - params[3]) / params[1]
        xd = (u - params[2] - (params[4] * yd if self.has_skew else 0.0)) / params[0]
        one = np.ones_like(xd)
        if not self.count:
            return xd, yd, one, np.isfinite(xd)
        tilt = self._tilt(params)
        if tilt is not None:
            t = np.linalg.inv(tilt)
            w = t[2, 0] * xd + t[2, 1] * yd + t[2, 2]
            xd, yd = (
                (t[0, 0] * xd + t[0, 1] * yd + t[0, 2]) / w,
                (t[1, 0] * xd + t[1, 1] * yd + t[1, 2]) / w,
            )
        k, limit = self._coefficients(params), self.radius(params)

        def distort(a: Array, b: Array) -> tuple[Array, ...]:
            s = a * a + b * b
            f, slope, _ = self._radial(k, s)
            x, y, xa, cross, yb, *ya = self._plane_derivatives(k, a, b, s, f, slope)
            return x, y, xa, cross, ya[0] if ya else cross, yb

        a, b = memo(self, params[self._bend :], self._start, "start")(xd, yd)
        a, b, solved = newton.solve(distort, xd, yd, a, b)
        return a, b, one, solved & (a * a + b * b < limit**2)

    def _start(self, distortion: Array) -> newton.RadialStart:
        k = [*distortion.tolist(), *[0.0] * (14 - self.count)]
        limit = _first_fold((1.0, k[0], k[1], k[4]), (1.0, k[5], k[6], k[7]))
        return newton.RadialStart(lambda s: self._radial(k, s)[:2], limit)


def cubic(s: Array, c1: float, c2: float, c3: float) -> tuple[Array, Array]:
    """1 + c1 s + c2 s² + c3 s³ and its derivative."""
    value = s * c3
    slope = 3 * value
    value += c2
    value *= s
    value += c1
    value *= s
    value += 1.0
    slope += 2 * c2
    slope *= s
    slope += c1
    return value, slope


@lru_cache(maxsize=64)
def _first_fold(num: tuple[float, ...], den: tuple[float, ...]) -> float:
    """The first positive root, as a radius, of the numerator of d(r f)/dr or of the denominator of f.

    num, den : coefficients of f = num / den in ascending powers of s = r².
    """
    n, d = np.array(num), np.array(den)
    i = np.arange(len(n))
    # n d + 2 s (n' d - n d'), with s n' = (0, n1, 2 n2, 3 n3)
    fold = np.convolve(n, d) + 2 * (np.convolve(i * n, d) - np.convolve(n, i * d))
    return float(np.sqrt(min(first_root(fold.tolist()), first_root(den))))


def tilt_matrix(tau_x: float, tau_y: float) -> Array:
    """OpenCV's matTilt (3, 3): the image plane turned by tau_x about x, then tau_y about y, rad."""
    rotation = _turn(tau_x, tau_y)
    return _projection_z(rotation) @ rotation


def _turn(tau_x: float, tau_y: float) -> Array:
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    return y @ x


def _projection_z(r: Array) -> Array:
    return np.array([[r[2, 2], 0, -r[0, 2]], [0, r[2, 2], -r[1, 2]], [0, 0, 1.0]])


def tilt_derivatives(tau_x: float, tau_y: float) -> tuple[Array, Array]:
    """Derivatives (3, 3) of `tilt_matrix` with respect to tau_x and tau_y."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    dx = np.array([[0, 0, 0], [0, -sx, cx], [0, -cx, -sx]])
    dy = np.array([[-sy, 0, -cy], [0, 0, 0], [cy, 0, -sy]])
    rotation = y @ x
    out = []
    for d in (y @ dx, dy @ x):
        dp = _projection_z(d)
        dp[2, 2] = 0.0
        out.append(dp @ rotation + _projection_z(rotation) @ d)
    return out[0], out[1]
