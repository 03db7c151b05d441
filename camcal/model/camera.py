"""A lens model with the values of its parameters."""

from __future__ import annotations

import numpy as np

from camcal.errors import UsageError
from camcal.model.lenses.base import Lens
from camcal.records import dataclass

Array = np.ndarray

#: parameters that a printed camera names, enough for opencv8; a spline has hundreds
SHOWN = 12
#: k1, k2, p1, p2: cv2 takes no vector of fewer coefficients
LEAST_COEFFICIENTS = 4


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """A lens model with the values of its parameters.

    Attributes
    ----------
    lens : Lens
        The model, with its options.
    params : (P,) array
        In the order of `lens.names`: fx, fy, cx, cy, skew where the model has it, then the distortion.
    image_size : (width, height) or None
    """

    lens: Lens
    params: Array
    image_size: tuple[int, int] | None = None

    @property
    def matrix(self) -> Array:
        """The camera matrix K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], px."""
        return self.lens.matrix(self.params)

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.lens.names, self.params.tolist(), strict=True))

    def project(self, xyz_cam: Array) -> Array:
        """Project points of the camera's frame (x right, y down, z forward).

        Parameters
        ----------
        xyz_cam : (..., 3) array, any unit

        Returns
        -------
        (..., 2) array, px; the centre of the top left pixel is (0, 0). NaN outside the domain of the lens.
        """
        return self.lens.project(self.params, xyz_cam)[0]

    def unproject(self, uv: Array) -> Array:
        """The directions of the rays that project to pixels.

        Parameters
        ----------
        uv : (..., 2) array, px

        Returns
        -------
        (..., 3) array of unit length, in the camera's frame; NaN outside the domain of the lens.
        """
        return self.lens.unproject(self.params, uv)[0]

    def opencv(self) -> tuple[Array, Array]:
        """Return K (3, 3) and distCoeffs for OpenCV's functions.

        Of `pinhole` to `opencv14` and `brown` with terms that OpenCV has, for `cv2.projectPoints`,
        `cv2.undistort` and the like; of `kb4` (and `kb:n` up to n = 4), for those of `cv2.fisheye`.

        Raises
        ------
        UsageError
            If K and distCoeffs cannot describe the camera: OpenCV has no such model, or its functions ignore
            the camera's skew, or the model is `mei`, for which `cv2.omnidir` also takes xi
            (`lens.opencv(params)` has all three).
        """
        form, name = self.lens.opencv(self.params), self.lens.name
        if form is None:
            raise UsageError(
                f"OpenCV has no counterpart of the model '{name}'.",
                "Convert the camera first: camcal convert CAMERA --to-model opencv8 (or kb4 for wide lenses)",
            )
        if form.xi is not None:
            raise UsageError(
                f"K and distCoeffs cannot represent the model '{name}': cv2.omnidir also takes xi.",
                "Use xi and distortion of camera.lens.opencv(camera.params), with camera.matrix.",
            )
        if self.matrix[0, 1] != 0.0:
            raise UsageError(
                f"the camera has a skew of {self.matrix[0, 1]:.4g} px, which OpenCV's functions ignore.",
                "Calibrate without --skew.",
            )
        missing = max(0, LEAST_COEFFICIENTS - len(form.distortion))
        return self.matrix, np.r_[form.distortion, np.zeros(missing)]

    def __repr__(self) -> str:
        """Return one line: the model, the image size and the first parameters."""
        size = "" if self.image_size is None else f" {self.image_size[0]}x{self.image_size[1]}"
        shown = ", ".join(f"{n}={v:.5g}" for n, v in list(self.values.items())[:SHOWN])
        more = f", ... {self.lens.size - SHOWN} more" if self.lens.size > SHOWN else ""
        return f"<Camera {self.lens.name}{size}: {shown}{more}>"

    def _repr_html_(self) -> str:
        """Return the parameters as an HTML table, for notebooks."""
        size = "" if self.image_size is None else f", {self.image_size[0]} x {self.image_size[1]} px"
        from html import escape  # its table of entities is for notebooks alone

        rows = "".join(f"<tr><td>{escape(n)}</td><td>{v:.6g}</td></tr>" for n, v in self.values.items())
        return f"<table><caption>{escape(self.lens.name)}{size}</caption>{rows}</table>"
