"""Residuals too large for the noise of image points: points and cameras that do not belong together."""

from __future__ import annotations

import numpy as np

from camcal.model.pose import Array

#: rms residual relative to the spread of the images, above which they do not fit. Image points of a target of 100 px
#: are measured to 1 px or better, 0.03 of their spread; v counted upwards, exchanged cameras or points, and images in
#: another unit leave 0.1 to 1 of it, because a fit absorbs the rest.
LARGE = 0.05


def misfit(residuals: Array, uv: Array, group: Array | None = None) -> float:
    """The rms of residuals (N, 2), px, relative to the rms distance of the images (N, 2) from the mean of their group.

    `group` (N,) numbers the images' cameras; one camera by default. 0 if no group has two different images.
    """
    group = np.zeros(len(uv), int) if group is None else group
    count = np.maximum(np.bincount(group), 1)
    mean = np.stack([np.bincount(group, uv[:, i]) / count for i in range(2)], 1)
    spread = np.square(uv - mean[group]).sum(1).mean()
    return float(np.sqrt(np.square(residuals).sum(1).mean() / spread)) if spread > 0 else 0.0
