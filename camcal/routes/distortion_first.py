"""A lens whose distortion is given as a map of the picture, converted to another focal length.

Lines determine the distortion as a map from pixels to undistorted pixels; what remains is a pinhole camera.
Coefficients refer to focal lengths, so that the same map has different coefficients at another focal length.
"""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import EstimationError
from camcal.model.camera import Camera
from camcal.model.lenses.regress import regress
from camcal.model.pose import Array
from camcal.routes.straightness import undistorted

#: px; the map at another focal length is exact for series models; others must agree within this, or are refused
EXACT = 0.01
#: columns and rows of the pixels at which the maps are compared
GRID = (31, 23)


def without_distortion(camera: Camera, data: Correspondences) -> Correspondences:
    """Correspondences with undistorted pixels; points whose rays are at 90 degrees or beyond are omitted."""
    views = []
    for view in data.views:
        flat = undistorted(camera, view.uv)
        ahead = np.isfinite(flat).all(1)
        kept = view.take(ahead)
        views.append(View(view.id, kept.xyz, flat[ahead], kept.sigma, kept.point_ids))
    return Correspondences.from_views(views, camera.image_size or data.image_size)


def at_focal_length(camera: Camera, f: float) -> Camera:
    """The camera with the same distortion map and focal length f, px; the principal point is unchanged.

    Raises
    ------
    EstimationError
        If the model cannot express the same map at another focal length within 0.01 px.
    """
    lens = camera.lens
    assert camera.image_size is not None
    uv = _grid(camera.image_size)
    rays = camera.unproject(uv)
    good = np.isfinite(rays).all(1) & (rays[:, 2] > 0)
    flat = rays[good] / rays[good][:, 2:]
    scale = np.array([camera.params[0] / f, camera.params[1] / f, 1.0])
    start = camera.params.copy()
    start[:2] = f
    found = regress(lens, flat * scale, uv[good], camera.image_size, ["fx", "fy", "cx", "cy", "skew"], start)
    worst = float(np.nanmax(found.errors, initial=0)) if found.covered.all() else np.inf
    if not worst <= EXACT:
        raise EstimationError(
            f"model '{lens.name}' cannot represent this distortion at another focal length: the error is "
            f"{worst:.2g} px.",
            "Estimate the distortion with a series model: division:n, brown, polynomial:n.",
        )
    return Camera(lens, found.params, camera.image_size)


def _grid(size: tuple[int, int]) -> Array:
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, GRID[0]), np.linspace(0, size[1] - 1, GRID[1]))
    return np.c_[u.ravel(), v.ravel()]


def held_parameters(camera: Camera) -> dict[str, float | None]:
    """The parameters that a calibration holds: the distortion, its centre, and the aspect."""
    names = [p.name for p in camera.lens.parameters if p.group == "distortion"]
    if not getattr(camera.lens, "free_centre", False):
        names += ["cx", "cy"]
    return {**{n: camera.values[n] for n in names}, "aspect": None}
