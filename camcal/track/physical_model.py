"""The model in physical parameters: a lens, R on SO(3), t; the residual is the exact projective one.

Local coordinates: the free parameters of the lens, then δ (3) and τ (3) of x_cam -> exp(δ) x_cam + τ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from camcal.data.observations import View
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective, rotations
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Pose
from camcal.solve import ransac
from camcal.solve.parameters import apply_fixed, free_matrix
from camcal.start.pose import initial_poses
from camcal.track import decompose, first
from camcal.track.decompose import Cameras
from camcal.track.frames import Frame
from camcal.track.keep import stored
from camcal.track.model import MOVED, Model
from camcal.track.motion import scaled

Array = np.ndarray

#: cosine of a ray to the axis: poses are found on a plane of normalised coordinates, where rays farther out (89.4
#: degrees) would outweigh all others
SHALLOW = 0.01
#: rad²; below it two terms of the series are exact: the third is t⁴ / 120, 1e-18
SERIES = 1e-8
#: sine of an angle up to which its arcsine has all digits: 30 degrees; larger turns are for `rotations.log`
SHORT = 0.5
#: what is believed of the lens before the first frame, where no camera is given: standard deviations in units
#: of the focal length (aspect: of 1). Only distortion is a statement; the rest keeps numbers finite.
UNKNOWN = {"focal": 3.0, "principal": 3.0, "skew": 0.3, "distortion": 0.3}
#: of the pose, rad and in distances to the points: beyond any pose from which a frame shows the points
ANY_POSE = 10.0
#: of the lens where a camera is given and not held
GIVEN = {"focal": 0.02, "principal": 0.02, "skew": 0.002, "distortion": 0.03}


@stored
class Physical(NamedTuple):
    """An estimate: parameters of the lens (P,), R (3, 3), t (3,)."""

    params: Array
    rotation: Array
    translation: Array


class PhysicalModel(Model):
    """A lens and a pose.

    Parameters
    ----------
    lens : Lens
    params : (P,) array or None
        A known camera to start from.
    fixed : mapping of name -> value or None
        Parameters of the lens that are held, at a value or where they start; `intrinsics` holds all, `aspect`
        ties fy to fx.
    """

    kept: ClassVar[tuple[str, ...]] = ("centroid", "free")

    def __init__(
        self, lens: Lens, params: Array | None = None, fixed: Mapping[str, float | None] | None = None
    ):
        self.fix = dict(fixed or {})
        if "intrinsics" in self.fix:
            del self.fix["intrinsics"]
            self.fix = {**dict.fromkeys(lens.names), **self.fix}
        self.lens = lens
        self.lens_name, self.has_skew = lens.name, lens.has_skew
        self.params = None if params is None else apply_fixed(lens, params, self.fix)
        self.bend = 5 if lens.has_skew else 4
        self.extra_names = lens.names[self.bend :]
        self._set_free(lens.neutral if self.params is None else self.params)
        self.size = self.count + 6
        self.min_points = max(3, -(-self.size // 2))
        self.start_points = 6 if params is None else 4
        self.centroid = np.zeros(3)

    def _set_free(self, params: Array) -> None:
        self._take(free_matrix(self.lens, params, self.fix))

    def _take(self, free: Array) -> None:
        self.free, self.inverse = free, np.linalg.pinv(free)
        self.count = self.free.shape[1]
        #: indices of the free parameters where each is one parameter, so that a product is a selection
        single = self.count == 0 or bool((np.count_nonzero(self.free, axis=0) == 1).all())
        self.index = self.free.argmax(0) if single and self.count else None

    # ------------------------------------------------------------------ what a model has to say
    def linearise(self, x: Physical, frame: Frame) -> tuple[Array, Array]:
        """See `Model.linearise`."""
        n, lens, f = len(frame.xyz), self.lens, self.count
        points = x.rotation @ frame.xyz.T + x.translation[:, None]
        uv, d_xyz = np.empty((1, 2, n)), np.empty((1, 3, 2, n))
        d_params = np.empty((1, lens.size, 2, n))
        px, py, pz = points
        columns = points[:, None]
        valid = pz > 0
        with np.errstate(all="ignore"):
            if not lens.linearise(x.params, columns[0], columns[1], columns[2], uv, d_xyz, d_params):
                valid = lens.inside(x.params, px, py, pz)
        design = np.empty((self.size + 1, 2, n))
        if self.index is not None:
            design[:f] = d_params[0, self.index]
        elif f:
            design[:f] = np.tensordot(self.free.T, d_params[0], 1)
        dx, dy, dz = d_xyz[0]
        design[f] = py * dz - pz * dy
        design[f + 1] = pz * dx - px * dz
        design[f + 2] = px * dy - py * dx
        design[f + 3 : f + 6] = d_xyz[0]
        np.subtract(frame.uv.T, uv[0], out=design[-1])
        return design, valid

    def retract(self, x: Physical, delta: Array) -> Physical:
        """Add to the lens, rotate and move the pose; one Newton step keeps R orthonormal."""
        f = self.count
        turn = _exp(delta[f : f + 3])
        rotation = turn @ x.rotation
        rotation = rotation @ (1.5 * np.eye(3) - 0.5 * (rotation.T @ rotation))
        return Physical(x.params + self.free @ delta[:f], rotation, turn @ x.translation + delta[f + 3 :])

    def local(self, origin: Physical, x: Physical) -> Array:
        """The inverse of `retract`."""
        turn = x.rotation @ origin.rotation.T
        lens = self.inverse @ (x.params - origin.params)
        return np.concatenate([lens, _log(turn), x.translation - turn @ origin.translation])

    def motion(self, x: Physical, figures: Mapping[str, float]) -> Array:
        """Each group in its own coordinates; held parameters do not move."""
        fx, fy = x.params[:2]
        distance = float(np.linalg.norm(x.rotation @ self.centroid + x.translation))
        columns = decompose.noise_columns(scaled(figures, fx, distance), fy / fx, len(self.extra_names))
        rows = self._from_physical(columns)
        return rows[:, rows.any(0)]

    def moved(self, origin: Physical, x: Physical) -> bool:
        """Return whether the estimate moved by a hundredth of the focal length or the distance, the scales of a
        motion's noise.
        """
        change = x.translation - origin.translation
        return bool(
            abs(x.params[0] - origin.params[0]) > MOVED * abs(x.params[0])
            or change @ change > MOVED**2 * (origin.translation @ origin.translation)
        )

    def _from_physical(self, columns: Array) -> Array:
        """Rows (11 + E) in physical order to rows (p) of local coordinates."""
        params = np.zeros((self.lens.size, columns.shape[1]))
        params[:4] = columns[[0, 1, 3, 4]]
        if self.lens.has_skew:
            params[4] = columns[2]
        params[self.bend :] = columns[11:]
        return np.concatenate([self.inverse @ params, columns[5:11]])

    def settle(self, frame: Frame) -> None:
        """Record the position and size of the points."""
        self.centroid = frame.xyz.mean(0)

    def start(self, frame: Frame) -> Physical:
        """The start from a projection matrix, or for a given camera from poses of samples of the points."""
        if self.params is None:
            matrix = first.projection_matrix(frame.xyz, frame.uv)
            k, rotation, translation = decompose.split(matrix)
            params = apply_fixed(self.lens, self.lens.from_matrix(k), self.fix)
            self._set_free(params)
            return Physical(params, rotation, translation)
        pose = self._pose(frame)
        return Physical(np.array(self.params, float), pose.rotation, pose.translation)

    def _pose(self, frame: Frame) -> Pose:
        """The pose with which most points agree; with fewer than six points, the pose of all."""
        assert self.params is not None
        ray, valid = self.lens.unproject(self.params, frame.uv)
        valid &= ray[:, 2] > SHALLOW
        if valid.sum() < 4:
            raise EstimationError(
                f"{int(valid.sum())} points have a ray; 4 are needed to start.",
                "Check the camera that is given.",
            )
        xyz, ab = frame.xyz[valid], ray[valid, :2] / ray[valid, 2:]
        _check_spread(xyz)
        sigma = None if frame.sigma is None else frame.sigma[valid]
        view = View("", xyz, frame.uv[valid], sigma=sigma)
        found = ransac.of_poses([view], Camera(self.lens, self.params))[0]
        if found.matrix is not None:
            return Pose(found.matrix[:, :3], found.matrix[:, 3])
        try:
            with np.errstate(all="ignore"):
                return initial_poses([xyz], [ab])[0]
        except DataError:
            raise EstimationError(
                "the points of the first frame leave the pose undetermined.", "Check the points."
            ) from None

    def prior(self, x: Physical) -> Array:
        """The prior of the lens; that of the pose is negligibly weak."""
        beliefs = UNKNOWN if self.params is None else GIVEN
        focal = x.params[0]
        groups = [p.group for p in self.lens.parameters]
        unit = np.array([beliefs[g] * (1.0 if g == "distortion" else focal) for g in groups])
        lens = np.abs(self.inverse) @ unit
        distance = float(np.linalg.norm(x.rotation @ self.centroid + x.translation))
        return np.diag(np.concatenate([lens, np.full(3, ANY_POSE), np.full(3, ANY_POSE * distance)]))

    def describe(self, estimates: Sequence[Physical], factors: Sequence[Array]) -> Cameras:
        """Reorder the rows, which are physical already."""
        params = np.stack([x.params for x in estimates])
        k = np.stack([self.lens.matrix(p) for p in params])
        factor = np.stack(factors)[:, : self.size]
        lens = self.free @ factor[:, : self.count]
        rows = np.zeros((len(k), 11 + len(self.extra_names), factor.shape[2]))
        rows[:, [0, 1, 3, 4]] = lens[:, :4]
        if self.lens.has_skew:
            rows[:, 2] = lens[:, 4]
        rows[:, 5:11] = factor[:, self.count :]
        rows[:, 11:] = lens[:, self.bend :]
        rotation = np.stack([x.rotation for x in estimates])
        translation = np.stack([x.translation for x in estimates])
        return Cameras(k, rotation, translation, rows, params[:, self.bend :])

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore the position of the points and the ratio of fy to fx."""
        self.centroid = state["centroid"]
        self._take(state["free"])


def _check_spread(xyz: Array) -> None:
    spread = projective.fit_plane(xyz)[2]
    if spread[1] <= first.FLAT * spread[0]:
        raise EstimationError(
            "the points lie on a line: the pose is undetermined.", "Points off the line are needed."
        )


def _exp(v: Array) -> Array:
    """exp of a single rotation vector; `rotations.exp` takes several times as long for one."""
    x, y, z = v.tolist()
    t2 = x * x + y * y + z * z
    t = math.sqrt(t2)
    a = math.sin(t) / t if t2 > SERIES else 1 - t2 / 6
    b = 2 * (math.sin(t / 2) / t) ** 2 if t2 > SERIES else 0.5 - t2 / 24
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


def _log(turn: Array) -> Array:
    """The rotation vector of a single rotation, as `_exp`; `rotations.log` where the angle is not small."""
    (_, a, b), (c, _, d), (e, f, _) = turn.tolist()
    x, y, z = 0.5 * (f - d), 0.5 * (b - e), 0.5 * (c - a)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine > SHORT or float(turn.trace()) < 1.0:
        return rotations.log(turn)
    factor = math.asin(sine) / sine if sine**2 > SERIES else 1 + sine * sine / 6
    return factor * np.array([x, y, z])
