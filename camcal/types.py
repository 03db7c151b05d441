"""The frozen dataclasses that travel between the rooms.

Conventions (docs/conventions.md): x_cam = R x_world + t; pixel (0, 0) is the centre of the top-left pixel;
image sizes are (width, height); residual = predicted - observed, in px.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from camcal.errors import DataError

if TYPE_CHECKING:  # the lens room lies below the types only for the type checker
    from camcal.lenses.base import Lens

Array = np.ndarray


@dataclass(frozen=True)
class View:
    """The correspondences of one picture.

    Attributes
    ----------
    id : str
        What the user calls it: the file's name, or the value of the `view` column.
    xyz : (N, 3) array
        Points in the board's or the world's frame, in the unit of the data.
    uv : (N, 2) array
        Their images, px.
    sigma : (N,) array or None
        Standard deviation of each image point in each coordinate, px.
    point_ids : (N,) int array or None
        Which point of the target each row is; the same number is the same physical point in every view.
    """

    id: str
    xyz: Array
    uv: Array
    sigma: Array | None = None
    point_ids: Array | None = None

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, rows: Array) -> View:
        """Return the view with only `rows` (a mask or indices) of its points."""

        def pick(a: Array | None) -> Array | None:
            return None if a is None else a[rows]

        return View(self.id, self.xyz[rows], self.uv[rows], pick(self.sigma), pick(self.point_ids))


@dataclass(frozen=True)
class SkippedView:
    """A picture or a view that gave no usable points, and why.

    `status` is one of the report's: `not_found`, `unreadable` or `rejected`. `rms_point`, px, is that of its
    points at the pose with which most of them agree, where there are points and a camera.
    """

    id: str
    status: str
    reason: str
    points: int = 0
    rms_point: float | None = None


@dataclass(frozen=True)
class Correspondences:
    """All views of one camera.

    Attributes
    ----------
    views : tuple of View
    image_size : (width, height) or None
    target : mapping or None
        What the report says under `target`: kind, columns, rows, square, unit, detected.
    skipped : tuple of SkippedView
        Pictures without points, in the order they were met.
    files : tuple of mappings
        `{path, sha256}` of each input file.
    picture_quality : mapping of view id -> mapping
        Figures on each picture (sharpness, exposure, ...), where pictures were read.
    """

    views: tuple[View, ...]
    image_size: tuple[int, int] | None = None
    target: Mapping[str, Any] | None = None
    skipped: tuple[SkippedView, ...] = ()
    files: tuple[Mapping[str, str], ...] = ()
    picture_quality: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def from_views(
        cls, views: Sequence[Any], image_size: tuple[int, int] | None = None, **more: Any
    ) -> Correspondences:
        """Make correspondences from `[(xyz (N, 3) or (N, 2), uv (N, 2)), ...]` or from `View` objects.

        Two-column points lie on the plane z = 0.

        Raises
        ------
        DataError
            Where shapes do not match or a value is not finite.
        """
        made = []
        for index, item in enumerate(views):
            if isinstance(item, View):
                made.append(item)
                continue
            xyz, uv = (np.array(a, dtype=float, ndmin=2) for a in item[:2])
            if xyz.shape[1] == 2:
                xyz = np.c_[xyz, np.zeros(len(xyz))]
            sigma = np.asarray(item[2], float) if len(item) > 2 else None
            made.append(View(f"view{index + 1}", xyz, uv, sigma))
        for view in made:
            _check_view(view)
        size = (int(image_size[0]), int(image_size[1])) if image_size is not None else None
        return cls(tuple(made), size, **more)

    def __len__(self) -> int:
        return len(self.views)

    @property
    def point_count(self) -> int:
        """Number of points over all views."""
        return sum(len(v) for v in self.views)


def _check_view(view: View) -> None:
    if view.xyz.ndim != 2 or view.xyz.shape[1] != 3 or view.uv.shape != (len(view.xyz), 2):
        raise DataError(
            f"view '{view.id}' holds points of shape {view.xyz.shape} and {view.uv.shape}; "
            "(N, 3) and (N, 2) are needed."
        )
    if not (np.isfinite(view.xyz).all() and np.isfinite(view.uv).all()):
        raise DataError(f"view '{view.id}' holds a NaN or infinite coordinate.", "Remove that row.")
    if view.sigma is not None and not (np.isfinite(view.sigma) & (view.sigma > 0)).all():
        raise DataError(f"view '{view.id}' holds a sigma that is not positive.", "Sigmas are px, > 0.")


@dataclass(frozen=True)
class Pose:
    """A rigid transformation, x_to = R x_from + t.

    Attributes
    ----------
    rotation : (3, 3) array
    translation : (3,) array, in the unit of the points
    """

    rotation: Array
    translation: Array

    def apply(self, xyz: Array) -> Array:
        """Transform points (..., 3)."""
        return xyz @ self.rotation.T + self.translation

    def inverse(self) -> Pose:
        """Return the transformation the other way round."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def after(self, first: Pose) -> Pose:
        """Return self o first: a_from_b.after(b_from_c) is a_from_c."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.translation + self.translation)


@dataclass(frozen=True)
class Poses(Sequence):
    """A pose per view, as arrays: `rotations` (V, 3, 3) and `translations` (V, 3)."""

    rotations: Array
    translations: Array

    @classmethod
    def stack(cls, poses: Sequence[Pose]) -> Poses:
        """Collect single poses."""
        if not poses:
            return cls(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return cls(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, (int, np.integer)):
            return Pose(self.rotations[index], self.translations[index])
        return Poses(self.rotations[index], self.translations[index])

    def __iter__(self) -> Iterator[Pose]:
        return (Pose(r, t) for r, t in zip(self.rotations, self.translations, strict=True))


@dataclass(frozen=True)
class Camera:
    """A lens model with the values of its parameters.

    Attributes
    ----------
    lens : Lens
        The model, with its options.
    params : (P,) array
        In the order of `lens.names`.
    image_size : (width, height) or None
    """

    lens: Lens
    params: Array
    image_size: tuple[int, int] | None = None

    @property
    def matrix(self) -> Array:
        """The 3x3 matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], px."""
        return self.lens.matrix(self.params)

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.lens.names, self.params.tolist(), strict=True))

    def project(self, xyz_cam: Array) -> Array:
        """Project points (..., 3) of the camera's frame to pixels (..., 2); NaN outside the lens's domain."""
        return self.lens.project(self.params, xyz_cam)[0]

    def unproject(self, uv: Array) -> Array:
        """Rays of unit length (..., 3) of the pixels (..., 2); NaN outside the lens's domain."""
        return self.lens.unproject(self.params, uv)[0]


@dataclass(frozen=True)
class CalibrationWarning:
    """Something that makes the result less than it seems; `code` names it for programs."""

    code: str
    message: str
    hint: str = ""


@dataclass(frozen=True)
class Stage:
    """One estimate on the way to the solution, with its own figures.

    `rms_point` is in px over the used points; `projection_matrix` (3, 4) only for a single view;
    `info` holds what the stage has to say besides (condition numbers, why it was chosen).
    """

    name: str
    rms_point: float
    matrix: Array | None
    seconds: float
    projection_matrix: Array | None = None
    camera: Camera | None = None
    poses: Poses | None = None
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """How the refinement went."""

    optimizer: str
    loss: str
    iterations: int
    evaluations: int
    converged: bool
    stop_reason: str
    cost: float  #: half the weighted sum of squares
    seconds: float
    trace: tuple[float, ...] = ()
    #: (iteration, cost, evaluations, seconds) of the start and of every step that was kept
    samples: tuple[tuple[int, float, int, float], ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class NormalBlocks:
    """The blocks of JᵀJ at the solution: what a covariance needs, without the matrix that is zero elsewhere.

    Attributes
    ----------
    intrinsics : (F, F) array
        Free parameters of the camera (and of the board's shape), all views added up.
    coupling : (V, F, 6) array
        Between those and the pose of each view; pose = (rotation on the left, translation).
    poses : (V, 6, 6) array
    """

    intrinsics: Array
    coupling: Array
    poses: Array


@dataclass(frozen=True)
class Solution:
    """A calibration with all that a later stage needs.

    Attributes
    ----------
    camera : Camera
    poses : Poses
        cam_from_board of each view in `correspondences.views`.
    correspondences : Correspondences
        The views that were used; those left out are in its `skipped`.
    residuals : tuple of (N, 2) arrays
        Predicted - observed of each view, px, rejected points included.
    inliers : tuple of (N,) bool arrays
        Which points the solution rests on.
    start : Camera
        Where the refinement began.
    free : (P, F) array
        d params / d free parameters; a row of zeros is a fixed parameter.
    normal : NormalBlocks
        Of the weighted problem at the solution, unit weight = 1 px.
    """

    camera: Camera
    poses: Poses
    correspondences: Correspondences
    residuals: tuple[Array, ...]
    inliers: tuple[Array, ...]
    start: Camera
    free: Array
    normal: NormalBlocks
    fit: Fit
    stages: tuple[Stage, ...] = ()
    warnings: tuple[CalibrationWarning, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    crosscheck: tuple[Mapping[str, Any], ...] = ()
    holdout: Mapping[str, Any] | None = None
    extras: Mapping[str, Any] = field(default_factory=dict)
    weights: tuple[Array, ...] | None = None  #: of a robust loss, 0 to 1, (N,) a view

    @property
    def used_residuals(self) -> Array:
        """Residuals (M, 2) of the points the solution rests on, px."""
        return np.concatenate(self.residuals)[np.concatenate(self.inliers)]

    @property
    def rms_point(self) -> float:
        """sqrt(sum |r|² / N) over the used points, px: the figure cv2 and Zhang print."""
        r = self.used_residuals
        return float(np.sqrt(np.einsum("ij,ij->", r, r) / max(len(r), 1)))

    @property
    def free_count(self) -> int:
        """Number of estimated parameters, poses and the board's shape included."""
        return self.free.shape[1] + 6 * len(self.poses)
