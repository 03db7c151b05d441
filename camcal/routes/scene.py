"""A camera and its attitude from one picture of lines in three orthogonal directions (a room, a street).

The rays of a line lie in a plane through the camera's centre, whose normal is at right angles to the line's
direction R e_i. With n = R m(α), m(α) ⟂ e_i, every line has one unknown α, and all share the camera and R. Minimised
are the distances of the points from the images of their lines, as in `lines`; no vanishing point is formed, so that
none has to be finite.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array
from camcal.routes import assumed_centre
from camcal.routes.line_geometry import Lines
from camcal.routes.scene_fit import Scene, fit_scene
from camcal.routes.scene_start import frames
from camcal.routes.scene_vote import LEAST_LINES, Seen, families, seen_lines
from camcal.solve.parameters import nominal

#: The focal length is undetermined if its relative sigma exceeds this: 95 % intervals from half to double
FOCAL = 0.25
#: rad; directions of buildings and rooms are out of square by about this, standard deviation (0.9 degrees: what twelve
#: pictures of streets and rooms are off by)
OUT_OF_SQUARE = 0.015
#: factor on σ while lines are alternately selected and fitted: initial directions come from two lines each
WIDER = (2.0, 1.5, 1.0, 1.0, 1.0, 1.0)
#: a direction is at infinity if its vanishing point is farther away than this many picture widths
INFINITY = 20.0


def estimate(
    lines: Lines, lens: Lens, fix: Mapping[str, float | None], seed: int = 0, picture: bool = False
) -> Scene:
    """Estimate the camera and the three directions that most lines agree with.

    In a `picture`, edges deviate from their directions, and these from right angles; lines of tables are exact up to
    noise.

    Raises
    ------
    DataError
        Too few lines.
    EstimationError
        If the focal length is undetermined: lines of one direction, or directions parallel to the picture.
    """
    if len(lines) < 2 * LEAST_LINES:
        raise DataError(
            f"{len(lines)} lines found; {2 * LEAST_LINES} in two directions are needed.",
            "Give a picture with more lines.",
        )
    assert lines.image_size is not None
    fix = {"aspect": None, **fix} if "fy" not in fix else dict(fix)
    fix = {**dict.fromkeys(lens.default_fixed), **fix}
    start = nominal(lens, lines.image_size, fix)
    seen = seen_lines(lines, picture)
    order = np.argsort(-seen.length, kind="stable")
    focal = float(start.params[0]) if "fx" in fix else None
    begins = frames(seen.ends[order], start.params[2:4], float(max(lines.image_size)), seed, focal)
    held = {**fix, **_centre(start)}
    found = [s for s in (_followed(lines, start, held, f, r, seen) for f, r in begins) if s is not None]
    if not found:
        raise _one_direction(lines)
    best = _judged(lines, max(found, key=lambda s: s.likelihood), fix, seen)
    return _out_of_square(lines, best, fix, seen) if picture else best


def _centre(camera: Camera) -> dict[str, float | None]:
    return {"cx": camera.values["cx"], "cy": camera.values["cy"]}


def _followed(
    lines: Lines, start: Camera, fix: Mapping[str, float | None], f: float, rotation: Array, seen: Seen
) -> Scene | None:
    """Alternate between fitting and choosing lines until the choice is stable; None if too few lines agree."""
    params = start.params.copy()
    if "fx" not in fix:
        params[:2] = f * params[:2] / params[0]
    camera = replace(start, params=params)
    vote = families(seen, camera, rotation, WIDER[0])
    scene: Scene | None = None
    for wider in WIDER[1:]:
        if (np.bincount(vote.family[vote.family >= 0], minlength=3) >= LEAST_LINES).sum() < 2:
            return None
        scene = fit_scene(lines, camera, rotation, vote, fix, start)
        if scene is None:
            return None
        camera, rotation = scene.camera, scene.rotation
        again = families(seen, camera, rotation, wider)
        settled = bool((again.family == vote.family).all())
        vote = again
        if settled and wider == WIDER[-1]:
            break
    return scene


def _judged(lines: Lines, scene: Scene, fix: Mapping[str, float | None], seen: Seen) -> Scene:
    """Free what the lines determine, hold the rest, and raise an error if the focal length is undetermined."""
    assert lines.image_size is not None
    width = max(lines.image_size)
    unknown = [n for n in ("cx", "cy") if n not in fix]
    if unknown and len(scene.directions) == 3:
        wider = _followed(lines, scene.start, fix, float(scene.camera.params[0]), scene.rotation, seen)
        if wider is not None and not _undetermined_centre(wider, unknown):
            scene, unknown = wider, []
    scene = replace(scene, assumed=tuple(unknown))
    if "fx" in fix:
        return scene
    sigma = float(np.sqrt(scene.covariance[0, 0]))
    far = all(
        at_infinity(scene, i, width) for i in scene.directions
    )  # then only the distortion would determine f
    if len(scene.directions) < 2 or far or not sigma <= FOCAL * scene.camera.params[0]:
        raise _undetermined(scene, sigma, width)
    return _with_centre(lines, scene, fix, seen)


def _undetermined_centre(scene: Scene, names: Sequence[str]) -> tuple[str, ...]:
    return assumed_centre.undetermined(scene.camera, np.sqrt(np.diagonal(scene.covariance)), names)


def _with_centre(lines: Lines, scene: Scene, fix: Mapping[str, float | None], seen: Seen) -> Scene:
    """The covariance including the uncertainty of an assumed principal point."""
    vote = families(seen, scene.camera, scene.rotation)

    def refitted(moved: Camera, _: str) -> Array | None:
        found = fit_scene(lines, moved, scene.rotation, vote, {**fix, **_centre(moved)}, scene.start)
        return None if found is None else found.camera.params

    more = assumed_centre.doubt(scene.camera, scene.assumed, refitted)
    return replace(scene, covariance=scene.covariance + more)


def _out_of_square(lines: Lines, scene: Scene, fix: Mapping[str, float | None], seen: Seen) -> Scene:
    """The covariance including the uncertainty of the angles between the scene's directions."""
    held = {**fix, **{n: scene.camera.values[n] for n in scene.assumed}}
    vote = families(seen, scene.camera, scene.rotation)
    covariance = scene.covariance.copy()
    for first, second in ((0, 1), (1, 2), (2, 0)):
        if not {first, second} <= set(scene.directions):
            continue
        square = np.eye(3)
        square[second, first] = OUT_OF_SQUARE
        square[:, first] /= np.linalg.norm(square[:, first])
        moved = fit_scene(lines, scene.camera, scene.rotation, vote, held, scene.start, square)
        if moved is not None:
            change = moved.camera.params - scene.camera.params
            covariance += np.outer(change, change)
    return replace(scene, covariance=covariance)


def _one_direction(lines: Lines) -> EstimationError:
    return EstimationError(
        f"no two orthogonal directions have {LEAST_LINES} of the {len(lines)} lines each: the lines are parallel in "
        "space, or have no common directions; one vanishing point does not give a focal length.",
        "Take a picture with lines in two or three orthogonal directions.",
    )


def _undetermined(scene: Scene, sigma: float, width: int) -> EstimationError:
    if len(scene.directions) < 2:
        return EstimationError(
            "the lines of one direction alone are parallel; one vanishing point does not give a focal length.",
            "Take a picture with lines in two or three orthogonal directions.",
        )
    far = [i for i in scene.directions if at_infinity(scene, i, width)]
    known = f"{sigma / scene.camera.params[0]:.0%}" if np.isfinite(sigma) else "nothing"
    if len(far) == len(scene.directions):
        known = "nothing"
    what = (
        f"{len(far)} of {len(scene.directions)} vanishing points are at infinity"
        if far
        else "the lines intersect too far away"
    )
    return EstimationError(
        f"the vanishing points leave the focal length undetermined (known to {known}): {what}, since "
        f"their directions are parallel to the image plane.",
        "Turn the camera so that two directions converge, or give the focal length (--fix fx=VALUE).",
    )


def at_infinity(scene: Scene, index: int, width: int) -> bool:
    """Return whether a direction is parallel to the image plane within its uncertainty."""
    direction = scene.rotation[:, index]
    reach = scene.camera.params[0] * np.hypot(direction[0], direction[1])
    return bool(abs(direction[2]) * INFINITY * width < reach)
