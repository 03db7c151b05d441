"""What a fit estimates, a camera or a rig: its cameras, their fixed parameters, and the same with other parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose, Poses
from camcal.model.rig import Rig
from camcal.solve.parameters import apply_fixed


def cameras_of(start: Camera | Rig) -> tuple[Camera, ...]:
    """The single camera, or those of a rig."""
    return tuple(start.cameras.values()) if isinstance(start, Rig) else (start,)


def fixes(start: Camera | Rig, fix: Mapping[str, float | None]) -> list[dict[str, float | None]]:
    """The fixed parameters of each camera."""
    if isinstance(start, Camera):
        return [dict(fix)]
    return [
        {n.removeprefix(f"{name}."): v for n, v in fix.items() if n.startswith(f"{name}.")}
        for name in start.cameras
    ]


def with_fixed(start: Camera | Rig, fix: Mapping[str, float | None]) -> Camera | Rig:
    """The start with the held values applied."""
    made = [
        replace(c, params=apply_fixed(c.lens, c.params, own))
        for c, own in zip(cameras_of(start), fixes(start, fix), strict=True)
    ]
    return (
        replace(start, cameras=dict(zip(start.cameras, made, strict=True)))
        if isinstance(start, Rig)
        else made[0]
    )


def rig_poses(start: Camera | Rig) -> Poses | None:
    """cam_from_rig of all cameras; None for a single camera."""
    return Poses.stack(list(start.cam_from_rig.values())) if isinstance(start, Rig) else None


def solved_for(start: Camera | Rig, params: Sequence[Array], rig: Poses, scale: float) -> Camera | Rig:
    """The start with other parameters and other poses of its cameras, with translations scaled."""
    made = [replace(c, params=p) for c, p in zip(cameras_of(start), params, strict=True)]
    if isinstance(start, Camera):
        return made[0]
    poses = [Pose(p.rotation, scale * p.translation) for p in rig]
    names = list(start.cameras)
    return Rig(dict(zip(names, made, strict=True)), dict(zip(names, poses, strict=True)), start.reference)
