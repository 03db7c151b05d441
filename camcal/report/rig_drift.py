"""A rig monitored over time, as a table and as a document."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from typing import Any

import numpy as np

from camcal.plan.rig_drift import Followed, moved
from camcal.plan.solution import RigSolution
from camcal.track.rig_changes import Knock

COLUMNS = (
    *("view", "camera", "status", "changed", "chi2"),
    *("rx_deg", "ry_deg", "rz_deg", "tx", "ty", "tz"),
    *("sigma_rx_deg", "sigma_ry_deg", "sigma_rz_deg", "sigma_tx", "sigma_ty", "sigma_tz"),
)


def csv_text(found: Followed) -> str:
    """A row for each camera and instant: the displacement of the camera, by this instant alone."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n")
    write.writerow(COLUMNS)
    for row in found.follower.rows:
        figures = [
            *np.degrees(row.deviation[:3]),
            *row.deviation[3:],
            *np.degrees(row.sigma[:3]),
            *row.sigma[3:],
        ]
        shown = ["" if math.isnan(f) else f"{f:.9g}" for f in figures]
        name = found.names[row.camera]
        write.writerow([row.instant, name, row.status, int(row.changed), f"{row.chi2:.6g}", *shown])
    return out.getvalue()


def sections(rig: RigSolution, found: Followed) -> dict[str, Any]:
    """`rig`, with the cameras after the last change, and `track`."""
    follower = found.follower
    statuses = Counter({r.instant: r.status for r in follower.rows}.values())
    after = moved(rig, found).rig
    return {
        "rig": {
            "reference": after.reference,
            "cam_from_rig": {n: p.entry() for n, p in after.cam_from_rig.items() if n != after.reference},
        },
        "track": {
            "method": "rig",
            "frames": sum(statuses.values()) + len(found.alone),
            "statuses": {**statuses, **({"alone": len(found.alone)} if found.alone else {})},
            "points_used": found.points,
            "variance_factor": follower.factor,
            "least_px": follower.least,
            "change_count": len(follower.changes),
            "changes": [_change(k) for k in follower.changes],
        },
    }


def _change(knock: Knock) -> dict[str, Any]:
    step, sigma = knock.test.step, knock.test.sigma
    return {
        "frame": knock.instant,
        "since": knock.since,
        "camera": knock.camera if knock.others else None,
        "message": knock.message,
        "rotation_deg": np.degrees(step[:3]),
        "sigma_rotation_deg": np.degrees(sigma[:3]),
        "translation": step[3:],
        "sigma_translation": sigma[3:],
        "shift_px": knock.test.pixels,
    }
