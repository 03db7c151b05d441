"""Parameters held at the estimate of a closed form: `--fix fx` without a value, and without a camera to start from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from camcal.assess.warning import CalibrationWarning
from camcal.model.camera import Camera

#: The parameters that a closed form estimates from the points; all others start at 0 or at what their model defines.
ESTIMATED = ("fx", "fy", "cx", "cy")


def held_at_start(
    fix: Mapping[str, float | None], camera: Camera, name: str = ""
) -> Iterator[CalibrationWarning]:
    """A note on parameters that are held at an estimate; `name` is that of the camera in a rig."""
    held = [p for p in ESTIMATED if p in fix and fix[p] is None and p in camera.lens.names]
    if not held:
        return
    values, size = camera.values, camera.image_size
    said = ", ".join(f"{p} = {values[p]:.6g}" for p in held)
    known = dict.fromkeys(held, "VALUE")
    if size is not None:
        known |= {p: f"{(n - 1) / 2:g}" for p, n in zip(("cx", "cy"), size, strict=True) if p in known}
    typed = ",".join(f"{name}.{p}={v}" if name else f"{p}={v}" for p, v in known.items())
    middle = " (the middle of the picture)" * (size is not None and {"cx", "cy"} & set(held) != set())
    yield CalibrationWarning(
        "held-at-start",
        f"{f'camera {name}: ' if name else ''}{said} is held at the closed form's estimate, whose error "
        f"is not included in any standard deviation.",
        f"Give the known value: --fix {typed}{middle}, or a camera: "
        + (f"--cameras {name}=FILE." if name else "--start-camera FILE."),
        "note",
    )
