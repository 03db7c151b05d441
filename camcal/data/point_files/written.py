"""Correspondences written as an .npz archive and as mrcal's .vnl."""

from __future__ import annotations

import io

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import UsageError

DIGITS = 9  #: decimals to which coordinates are one: the rounding of a board's poses and units, not its shape


def archive(correspondences: Correspondences) -> bytes:
    """The bytes of an archive with xyz, uv and view; sigma and id if all views have them; image_size."""
    views = correspondences.views
    arrays = {
        "xyz": np.concatenate([v.xyz for v in views]),
        "uv": np.concatenate([v.uv for v in views]),
        "view": np.repeat([v.id for v in views], [len(v) for v in views]),
    }
    if all(v.sigma is not None for v in views):
        arrays["sigma"] = np.concatenate([v.sigma for v in views if v.sigma is not None])
    if all(v.point_ids is not None for v in views):
        arrays["id"] = np.concatenate([v.point_ids for v in views if v.point_ids is not None])
    if correspondences.image_size is not None:
        arrays["image_size"] = np.array(correspondences.image_size)
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def vnl(correspondences: Correspondences) -> str:
    """Corners row by row, `-` for those missing in a picture; mrcal expects whole rectangular boards.

    Raises
    ------
    UsageError
        If the points are no rectangular grid, or a name holds a blank.
    """
    views = correspondences.views
    places = np.unique(np.concatenate([v.xyz for v in views]).round(DIGITS)[:, [2, 1, 0]], axis=0)[:, ::-1]
    x, y = np.unique(places[:, 0]), np.unique(places[:, 1])
    if np.ptp(places[:, 2]) or len(x) * len(y) != len(places):
        raise UsageError(
            "a .vnl file holds the corners of a rectangular board; these points are not such corners.",
            "Write CSV or npz.",
        )
    lines = [f"## {len(x)}x{len(y)} corners, written by camcal", "# filename x y level"]
    for view in views:
        lines += _lines(view, x, y)
    return "\n".join(lines) + "\n"


def _lines(view: View, x: np.ndarray, y: np.ndarray) -> list[str]:
    if any(c.isspace() for c in view.id):
        raise UsageError(
            f"a .vnl file cannot hold the name '{view.id}', which contains a space.", "Rename the picture."
        )
    rounded = view.xyz.round(DIGITS)
    at = np.searchsorted(y, rounded[:, 1]) * len(x) + np.searchsorted(x, rounded[:, 0])
    seen = dict(zip(at.tolist(), view.uv.tolist(), strict=True))
    return [
        f"{view.id} {seen[i][0]!r} {seen[i][1]!r} 0" if i in seen else f"{view.id} - - -"
        for i in range(len(x) * len(y))
    ]
