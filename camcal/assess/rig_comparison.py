"""Comparison of two rigs: each camera by its projections, and the relative poses with their standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.assess.rig import baseline_sigma, relative_sigmas
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.rig import Rig
from camcal.records import dataclass
from camcal.solve.calibration import RigCalibration

Array = np.ndarray


@dataclass(frozen=True)
class RigSide:
    """A rig to compare, with its calibration if available."""

    name: str
    rig: Rig
    solution: RigCalibration | None = None


def common_cameras(a: RigSide, b: RigSide) -> list[str]:
    """The cameras that both rigs have, in the order of A's.

    Raises
    ------
    DataError
        If they share fewer than two.
    """
    shared = [n for n in a.rig.cameras if n in b.rig.cameras]
    if len(shared) < 2:
        raise DataError(
            f"the rigs have no two cameras of the same name: {', '.join(a.rig.cameras)} and "
            f"{', '.join(b.rig.cameras)}.",
            "Compare single cameras: camcal compare A.yaml#left B.yaml#left",
        )
    return shared


def places(a: RigSide, b: RigSide, names: Sequence[str]) -> dict[str, Any]:
    """The difference of each camera's pose in the frame of the first one, B minus A, and of the distances.

    Standard deviations are of the difference of two independent calibrations; null where one has none.
    """
    first, second = (s.rig.with_reference(names[0]) for s in (a, b))
    made: dict[str, Any] = {"reference": names[0], "cam_from_rig": {}, "baselines": {}}
    for name in names[1:]:
        ours, theirs = first.cam_from_rig[name], second.cam_from_rig[name]
        turn = np.degrees(np.linalg.norm(rotations.log(theirs.rotation @ ours.rotation.T)))
        shift = theirs.translation - ours.translation
        sigma = _together([_pose_sigma(s, name, names[0]) for s in (a, b)])
        made["cam_from_rig"][name] = {
            "rotation_deg": float(turn),
            "translation": shift,
            "sigma_rotation_deg": None if sigma is None else float(np.degrees(np.linalg.norm(sigma[:3]))),
            "sigma_translation": None if sigma is None else sigma[3:],
        }
    for one, other in combinations(names, 2):
        values = [s.rig.baseline(one, other) for s in (a, b)]
        known = _together([_baseline_sigma(s, one, other) for s in (a, b)])
        made["baselines"][f"{one}-{other}"] = {
            "a": values[0],
            "b": values[1],
            "change": values[1] - values[0],
            "sigma": None if known is None else float(known[0]),
        }
    return made


def _together(sigmas: Sequence[Array | None]) -> Array | None:
    known = [s for s in sigmas if s is not None]
    return None if len(known) < len(sigmas) else np.sqrt(np.square(known).sum(0))


def _pose_sigma(side: RigSide, name: str, reference: str) -> Array | None:
    """The pose uncertainty; available only in the frame of the calibration's own reference."""
    if side.solution is None or not side.solution.extrinsics or side.rig.reference != reference:
        return None
    return relative_sigmas(side.solution, covariance(side.solution), name)


def _baseline_sigma(side: RigSide, one: str, other: str) -> Array | None:
    if side.solution is None or not side.solution.extrinsics:
        return None
    return np.array([baseline_sigma(side.solution, covariance(side.solution), one, other)])


def described(
    a: RigSide, b: RigSide, cameras: Mapping[str, Mapping[str, Any]], difference: Mapping[str, Any]
) -> dict[str, Any]:
    """The comparison of two rigs as one document: that of each camera by name, and `rig`."""
    gates = [{**g, "name": f"{name}: {g['name']}"} for name, c in cameras.items() for g in c["gates"]]
    return {
        "schema": "camcal-comparison/1",
        "a": {"name": a.name, "model": ", ".join(c.lens.name for c in a.rig.cameras.values())},
        "b": {"name": b.name, "model": ", ".join(c.lens.name for c in b.rig.cameras.values())},
        "cameras": {n: {k: c[k] for k in ("projection", "parameters")} for n, c in cameras.items()},
        "rig": difference,
        "projection": [],
        "parameters": {},
        "gates": gates,
        "verdict": "pass" if all(g["passed"] for g in gates) else "fail",
    }
