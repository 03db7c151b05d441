"""The next board pose suggested for a rig, in words and as a document."""

from __future__ import annotations

from typing import Any

from camcal.assess.candidate_views import target_points
from camcal.assess.next_instant import Suggestion
from camcal.assess.next_instant import suggest as search
from camcal.plan.rig_cameras import solution_within
from camcal.plan.solution import RigSolution
from camcal.report.next_view import words


def suggest(solution: RigSolution, count: int = 1, seed: int = 0) -> dict[str, Any]:
    """The answer of `camcal next` for a rig; raises as `camcal.assess.next_instant.suggest`."""
    now, found = search(solution, count, seed)
    return {
        "schema": "camcal-next/1",
        "now": _by_pair(now),
        "suggestions": [_entry(solution, one) for one in found],
    }


def _entry(solution: RigSolution, found: Suggestion) -> dict[str, Any]:
    name = found.cameras[0]
    alone = solution_within(solution, name)
    said = words(alone, target_points(alone), solution.rig.cam_from_rig[name] @ found.pose)
    return {
        "words": f"{name}: {said}; seen by {', '.join(found.cameras)}",
        "cameras": list(found.cameras),
        "relative_sigmas": _by_pair(found.relative),
        "rig_from_board": found.pose.entry(),
    }


def _by_pair(relative: Any) -> dict[str, float]:
    return {f"{a}-{b}": value for (a, b), value in relative.items()}
