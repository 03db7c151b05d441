"""The camera and the boards in space, as polygons that the page can rotate.

The initial view is drawn here, so that it is available without scripts and in print; `scene.js` projects the
same polygons by the same rule when the reader rotates them.
"""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.data.boards import board_of_ids, labels, names_of, view_name
from camcal.data.observations import View
from camcal.model.pose import Pose
from camcal.plan.rig_cameras import solution_within
from camcal.plan.solution import RigSolution, Solution
from camcal.records import dataclass
from camcal.report.charts.base import round_down
from camcal.solve.calibration import Estimate

Array = np.ndarray

#: the first direction of view, degrees: from above, behind and to the left of the camera
YAW, PITCH = 35.0, -22.0
WIDTH, HEIGHT = 640, 440
#: distance of the eye in radii of the scene: a little perspective, no distortion
EYE = 4.0
#: part of the drawing that the scene takes up at first, and how much larger than itself the ball around it is
#: drawn for that at most: a flat scene must not run out of the drawing as soon as it is turned
FILL, LARGEST = 0.94, 1.8
#: with more boards than this, some are omitted
MOST = 60
#: size of the drawn camera in parts of the median distance of the boards
CAMERA = 0.3
#: length of the drawn axes in parts of the drawn camera, and the longest bar in parts of the scene
AXIS, BAR = 1.1, 0.4


@dataclass(frozen=True)
class Shape:
    """A polygon (N, 3) in the camera's frame: `kind` is a class of the style sheet, the label is drawn at its end."""

    points: Array
    kind: str
    title: str = ""
    label: str = ""


def shapes(solution: Solution) -> list[Shape]:
    """The camera as a pyramid over its picture, and each board as the outline of its points."""
    facts = Facts(solution)
    chosen = np.unique(np.linspace(0, len(facts.views) - 1, min(len(facts.views), MOST)).astype(int))
    made = []
    for i in chosen:
        view, pose = facts.views[i], solution.poses[int(i)]
        several = _boards(solution, view)
        for title, xyz, axes in several:
            made += [Shape(outline, "board", title) for outline in _outlines(xyz, pose, True, axes)]
        if not several:
            outlines = _outlines(view.xyz, pose, bool(facts.shapes.planar[i]), facts.shapes.axes[i])
            made += [Shape(outline, "board", view.id) for outline in outlines]
    far = [float(np.linalg.norm(s.points.mean(0))) for s in made]
    return [*_camera(facts, CAMERA * float(np.median(far or [1.0]))), *made]


def _boards(solution: Solution, view: View) -> list[tuple[str, Array, Array]]:
    """The rigidly connected boards of a rig's view: title, points (N, 3), axes; empty for a single board."""
    target = solution.observations.target or {}
    if "board_poses" not in target or view.point_ids is None:
        return []
    which, names = board_of_ids(target, view.point_ids), names_of(target)
    return [
        (
            view_name(view.id, names[k]),
            view.xyz[which == k],
            Pose.from_entry(target["board_poses"][k]).rotation,
        )
        for k in np.unique(which)
    ]


def _outlines(xyz: Array, pose: Pose, planar: bool, axes: Array) -> list[Array]:
    """The bounding box of the points in their own axes: one rectangle for a board, six for a 3D rig; camera's
    frame.
    """
    if planar and np.ptp(xyz[:, 2]) == 0:
        axes = np.eye(3)  # a grid lies along its own axes, which those of its scatter need not follow
    local = xyz @ axes
    low, high = local.min(0), local.max(0)
    if planar:
        middle = (low[2] + high[2]) / 2
        low, high = np.r_[low[:2], middle], np.r_[high[:2], middle]
    corner = [np.where([i & 1, i & 2, i & 4], high, low) for i in range(8)]
    faces = [(0, 1, 3, 2)] if planar else [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)]
    return [pose.apply(np.array([corner[i] for i in face]) @ axes.T) for face in faces]


def _camera(facts: Facts, size: float) -> list[Shape]:
    (left, top), (right, bottom) = facts.low_high
    rays = facts.camera.unproject(np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    if np.isnan(rays).any():  # a corner that the lens does not see: a plain pyramid instead
        rays = np.array([[-0.6, -0.45, 0.66], [0.6, -0.45, 0.66], [0.6, 0.45, 0.66], [-0.6, 0.45, 0.66]])
    ends = size * rays
    sides = [Shape(np.array([np.zeros(3), ends[i], ends[(i + 1) % 4]]), "camera", "camera") for i in range(4)]
    up = np.array([ends[0], ends[1], (ends[0] + ends[1]) / 2 * 1.0 + [0, -0.25 * size, 0]])
    return [*sides, Shape(ends, "camera", "camera"), Shape(up, "camera up", "the camera's upper side")]


def axes_and_scale(made: list[Shape], unit: str) -> tuple[list[Shape], str]:
    """The axes of the (first) camera, and a scale bar of a round length below the boards."""
    size = float(max(np.ptp(s.points, axis=0).max() for s in made if s.kind.startswith("camera")))
    axes = [
        Shape(np.array([np.zeros(3), AXIS * size * e]), "axis", f"{n} of the camera", n)
        for n, e in zip("xyz", np.eye(3), strict=True)
    ]
    every = np.concatenate([s.points for s in made if s.kind == "board"] or [s.points for s in made])
    low, high = every.min(0), every.max(0)
    length = round_down(BAR * float((high - low).max()))
    said = f"{length:g} {unit}{'s' * (unit == 'square' and length != 1)}".strip()
    start = np.array([(low[0] + high[0] - length) / 2, high[1], (low[2] + high[2]) / 2])
    return [*axes, Shape(np.array([start, start + [length, 0, 0]]), "axis", said, said)], said


def pivot_and_scale(made: list[Shape]) -> tuple[Array, float]:
    """The point about which the scene rotates, and the radius of the sphere around it."""
    every = np.concatenate([s.points for s in made])
    pivot = (every.min(0) + every.max(0)) / 2
    return pivot, float(np.linalg.norm(every - pivot, axis=1).max()) or 1.0


def projected(
    points: Array, pivot: Array, radius: float, yaw: float, pitch: float, fill: float = 1.0
) -> tuple[Array, float]:
    """Positions (N, 2) in the drawing, and the mean depth, by which polygons are sorted.

    Turned about the vertical by `yaw` and then about the horizontal by `pitch`, radians; the ball of `radius`
    fills `fill` of the drawing's height. `scene.js` does the same.
    """
    x, y, z = ((points - pivot) / radius).T
    x, z = np.cos(yaw) * x - np.sin(yaw) * z, np.sin(yaw) * x + np.cos(yaw) * z
    y, z = np.cos(pitch) * y - np.sin(pitch) * z, np.sin(pitch) * y + np.cos(pitch) * z
    scale = 0.5 * HEIGHT * fill * EYE / (EYE + z)
    return np.stack([WIDTH / 2 + scale * x, HEIGHT / 2 + scale * y], 1), float(z.mean())


def filling(made: list[Shape], pivot: Array, radius: float, yaw: float, pitch: float) -> float:
    """The size of the sphere at which the scene fits into the drawing."""
    every = np.concatenate([projected(s.points, pivot, radius, yaw, pitch)[0] for s in made])
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    return min(LARGEST, FILL * float((middle / np.abs(every - middle).max(0)).min()))


def drawing(solution: Solution) -> dict[str, Any]:
    """The initial view as SVG polygons, and the data that `scene.js` needs to rotate it."""
    return drawing_of(shapes(solution), len(solution.poses), _unit(solution))


def _unit(solution: Estimate) -> str:
    """The unit of the target's lengths, if the data have one."""
    return str((solution.observations.target or {}).get("unit") or "")


def rig_drawing(solution: RigSolution) -> dict[str, Any]:
    """The same for a rig: all cameras, and the board of each instant in the frame of the rig."""
    made: dict[str, list[Shape]] = {}
    cameras = []
    for name in solution.rig.cameras:
        back = solution.rig.cam_from_rig[name].inverse()
        seen: dict[str, list[Shape]] = {}
        for shape in shapes(solution_within(solution, name)):
            moved = Shape(back.apply(shape.points), shape.kind, shape.title)
            if shape.kind == "board":
                seen.setdefault(shape.title, []).append(moved)
            else:
                cameras.append(Shape(moved.points, shape.kind, name))
        made = seen | made  # each board as seen by the first camera that saw it
    boards = [s for own in made.values() for s in own]
    return drawing_of([*cameras, *boards], _shown(solution), _unit(solution))


def _shown(solution: RigSolution) -> int:
    """The number of boards in the scene: one per instant, or the number of fixed boards."""
    data = solution.observations
    which = labels(data)
    several = which is not None and "board_poses" in (data.target or {})
    return len(np.unique(np.c_[data.view, which], axis=0)) if several else len(solution.poses)


def drawing_of(made: list[Shape], count: int, unit: str = "") -> dict[str, Any]:
    """Shapes as SVG polygons and as data, with `count` boards and lengths in `unit`."""
    more, said = axes_and_scale(made, unit)
    made = [*made, *more]
    pivot, radius = pivot_and_scale(made)
    yaw, pitch = np.radians(YAW), np.radians(PITCH)
    fill = filling(made, pivot, radius, yaw, pitch)
    places = [projected(s.points, pivot, radius, yaw, pitch, fill) for s in made]
    order = sorted(range(len(made)), key=lambda i: -places[i][1])
    polygons = [
        f'<polygon class="{made[i].kind}" data-shape="{i}" points="'
        + " ".join(f"{x:.1f},{y:.1f}" for x, y in places[i][0])
        + f'"{_linked(made[i])}><title>{escape(made[i].title)}</title></polygon>'
        for i in order
    ]
    polygons += [
        f'<text data-label="{i}" x="{places[i][0][-1, 0] + 4:.1f}" y="{places[i][0][-1, 1] + 4:.1f}">'
        f"{escape(made[i].label)}</text>"
        for i in order
        if made[i].label
    ]
    data = {
        "shapes": [np.round((s.points - pivot) / radius, 6).tolist() for s in made],
        "yaw": yaw,
        "pitch": pitch,
        "eye": EYE,
        "fill": fill,
        "width": WIDTH,
        "height": HEIGHT,
    }
    boards = len({s.title for s in made if s.kind == "board"})
    shown = "" if boards == count else f" ({boards} of {count} are shown)"
    return {
        "polygons": "".join(polygons),
        "data": data,
        "width": WIDTH,
        "height": HEIGHT,
        "shown": shown,
        "scale": said,
    }


def _linked(shape: Shape) -> str:
    """The attribute by which the page links a board to its view."""
    return f' data-view="{escape(shape.title)}"' if shape.kind == "board" else ""
