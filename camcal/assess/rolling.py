"""The readout time of a film's frames: rows read one after the other while the target moved (rolling shutter).

The displacement of a point is the time at which its row is read times its velocity, which neighbouring frames give.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.design import Design
from camcal.assess.difference import difference
from camcal.assess.fold_difference import covered_grid
from camcal.data.observations import Observations, View
from camcal.geometry.plane_flow import flow_at
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Calibration

#: frames whose motion is known: of fewer, motion and poses are hardly separable
LEAST_FRAMES = 6
#: sigmas of the readout time; chance reaches 3 in one film of 400, and blur by motion is not quite symmetric
SURE = 5.0
#: of the time between two frames. Rows cannot take longer than that, but for the error of the motion; a longer
#: readout is another cause that follows the motion
LONGEST = 1.2


@dataclass(frozen=True)
class Readout:
    """The readout time that explains the residuals best.

    Attributes
    ----------
    time, sigma : float
        From the first row to the last, in frames; negative where the last row is read first.
    share : float
        Of the sum of squared residuals, what it explains.
    step : (P,) array
        By what the camera's parameters change with it.
    most : float
        px; the largest displacement within a frame.
    """

    time: float
    sigma: float
    share: float
    step: Array
    most: float


def sure(solution: Calibration) -> Readout | None:
    """The readout time of a film's frames if the residuals show significantly that there is one."""
    found = readout(solution)
    if found is None or abs(found.time) < SURE * found.sigma or abs(found.time) > LONGEST:
        return None
    return found


def effect_px(solution: Calibration, found: Readout) -> float:
    """The difference in projection from the camera with the readout time, px (rms over the covered part)."""
    grid, covered = covered_grid(solution)
    camera = solution.camera
    moved = replace(camera, params=camera.params + found.step)
    return difference(camera, moved, grid[covered]).rms_px


def readout(solution: Calibration) -> Readout | None:
    """Estimate the readout time of a film's frames by one linear step from a solution.

    With d the displacement of each point for a readout of one frame, (row / height) times its velocity, and H the
    projection on what camera and poses take up (`design.py`), residuals r = predicted - observed give

        time = -dᵀ r / dᵀ (I - H) d,    sigma = sigma_0 / sqrt(dᵀ (I - H) d)                              (1)

    Returns
    -------
    Readout, or None where the motion of fewer than `LEAST_FRAMES` frames is known or the camera is held.
    """
    flows = _flows(solution.observations)
    size = solution.camera.image_size
    if len(flows) < LEAST_FRAMES or size is None or not solution.free.any():
        return None
    design = Design(solution)
    kept = solution.observations.kept()
    weights = np.ones(kept.point_count) if kept.precision is None else np.sqrt(kept.precision)
    along = cost = own = most = 0.0
    coupling = np.zeros(design.transform.shape[1])
    for rows in design.rows():
        r = rows.residuals.ravel()
        cost += float(r @ r)
        flow = flows.get(kept.view_ids[rows.view])
        if flow is None:
            continue
        at = kept.slices[rows.view]
        uv = kept.uv[at]
        shift = _displaced(flow, uv, size)
        most = max(most, float(np.ptp(shift, axis=0).max()))
        d = (shift * weights[at, None]).ravel()
        free, pose = rows.free.reshape(len(d), -1), rows.pose.reshape(len(d), -1)
        to_pose = pose.T @ d
        along += float(d @ r)
        own += float(d @ d - to_pose @ design.poses.inverse[rows.view] @ to_pose)
        coupling += free.T @ d - design.poses.gain[rows.view].T @ to_pose
    taken = design.inverse @ coupling
    information = own - float(coupling @ taken)
    if not information > 0 or not cost > 0:
        return None
    time = -along / information
    sigma = float(design.sigma_0 / np.sqrt(information))
    return Readout(
        time, sigma, along**2 / information / cost, -time * (design.transform @ taken), abs(time) * most
    )


def known_motion(data: Observations) -> bool:
    """Return whether the motion of enough frames is known to find a readout time."""
    return len(_flows(data)) >= LEAST_FRAMES


def corrected(data: Observations, time: float) -> Observations:
    """The observations corrected as if all rows were read at once; views of unknown motion stay unchanged.

    Parameters
    ----------
    data : Observations
    time : float
        Of the readout, in frames.
    """
    flows, size = _flows(data), data.image_size
    assert size is not None

    def straight(view: View) -> View:
        flow = flows.get(view.id)
        return view if flow is None else replace(view, uv=view.uv - time * _displaced(flow, view.uv, size))

    return data.map_views(straight)


def _displaced(flow: Array, uv: Array, size: tuple[int, int]) -> Array:
    """The displacement (N, 2) of points by a readout of one frame, px."""
    return ((uv[:, 1] + 0.5) / size[1])[:, None] * flow_at(flow, uv, size)


def _flows(data: Observations) -> dict[str, Array]:
    """The motion of each view that is a frame of a film."""
    quality = data.picture_quality
    return {name: np.array(q["flow"], float) for name, q in quality.items() if q.get("flow")}
