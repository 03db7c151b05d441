"""The report's `coverage`: how much of the picture, of the directions and of the distances the views cover."""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.checks.views import distinct_count, tilt_of_views, tilts
from camcal.geometry import hull
from camcal.geometry.numbers import median
from camcal.model.pose import Array
from camcal.plan.solution import Solution


def section(solution: Solution) -> dict[str, Any] | None:
    """The coverage of the views; None without views."""
    facts = Facts(solution)
    if not len(facts.views):
        return None
    size = facts.image_size
    centres = [v.xyz.mean(0) for v in solution.observations.kept().views]
    poses = solution.poses
    placed = poses.apply(np.array(centres))
    return {
        "image": None if size is None else hull.area(facts.image_points) / float(np.prod(size)),
        "tilt_degrees": _spread(tilt_of_views(facts)) if facts.planar else None,
        "normals_spread_degrees": tilts(facts)[1] if facts.planar else None,
        "distance": _spread(np.linalg.norm(placed, axis=1)),
        "different_views": distinct_count(facts),
    }


def _spread(values: Array) -> dict[str, float]:
    return {"least": float(values.min()), "median": median(values), "most": float(values.max())}
