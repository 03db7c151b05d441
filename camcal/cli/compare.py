"""`camcal compare`: how differently two cameras project, with tolerances for CI jobs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.errors import CamcalError, UsageError

FILE = click.Path(path_type=Path)


@click.command("compare")
@click.argument("a", type=FILE, metavar="A")
@click.argument("b", type=FILE, metavar="[B]", required=False)
@options("compare")
@verbosity_options
def command(a: Path, b: Path | None, **options: Any) -> int:
    """Compare two cameras by what they project, over the image.

    A and B are camera files of any format; `camcal list formats` names them. The exit code is 1 if a gate
    fails. Gates apply to the part of the picture for which both cameras have data. The difference is taken
    after the best-fitting rotation (at a finite distance also translation), because a calibration does not
    define the camera's frame. Two rigs are compared camera by camera, with their relative poses; rig.yaml#left
    is one camera of a rig.
    """
    if (b is None) == (options["against"] is None):
        raise UsageError("two cameras are needed.", "Give a second file, or --against cv2.")
    from camcal.cli.job import output_is_free

    output_is_free(options, "junit")
    try:
        found = _comparison(a, b, options)
    except CamcalError as error:
        _not_compared(a, b, error, options)
        raise
    return _deliver(found, options)


def _not_compared(a: Path, b: Path | None, error: CamcalError, options: dict[str, Any]) -> None:
    """Report a comparison that could not be made to CI systems."""
    from camcal.cli.output import write_for_ci
    from camcal.report.ci import Check

    check = Check(
        "comparison", False, " ".join(filter(None, (error.message, error.hint))), "error", str(b or a)
    )
    write_for_ci("camcal compare", f"{a} against {b or 'cv2'}", [check], options)


def _comparison(a: Path, b: Path | None, options: dict[str, Any]) -> dict[str, Any]:
    from camcal.report.comparison import load_rig_side, load_side

    rigs = [load_rig_side(p) for p in (a, b) if p is not None]
    if len(rigs) == 2 and rigs[0] is not None and rigs[1] is not None:
        return _rigs(rigs[0], rigs[1], options)
    first = load_side(a, options["image_size"])
    second = load_side(b, options["image_size"]) if b is not None else _by_cv2(a)
    return _sides(first, second, options)


def _rigs(a: Any, b: Any, options: dict[str, Any]) -> dict[str, Any]:
    """Camera by camera, and the relative poses."""
    from camcal.assess import rig_comparison
    from camcal.report.comparison import side_within

    names = rig_comparison.common_cameras(a, b)
    cameras = {n: _sides(side_within(a, n), side_within(b, n), options) for n in names}
    return rig_comparison.described(a, b, cameras, rig_comparison.places(a, b, names))


def _sides(first: Any, second: Any, options: dict[str, Any]) -> dict[str, Any]:
    import numpy as np

    from camcal.assess import comparison

    bounds = comparison.common_bounds(first, second, options["image_size"])
    apart = [comparison.compare(first, second, bounds, d) for d in options["distance"] or (np.inf,)]
    changes = comparison.parameters(first, second)
    tolerances = _tolerances(options["tolerance"])
    asked = comparison.gates(
        apart,
        changes,
        options["max_px"],
        options["max_sigma"],
        tolerances,
        options["max_rms_px"],
        options["max_p95_px"],
    )
    return comparison.described(first, second, apart, changes, asked)


def _by_cv2(a: Path) -> Any:
    from camcal.assess.comparison import Side
    from camcal.peers.camera import camera_by_cv2
    from camcal.report.loading import load

    camera, name = camera_by_cv2(load(a))
    return Side(name, camera)


def _tolerances(given: dict[str, float]) -> dict[str, float]:
    for name, bound in given.items():
        if bound < 0:
            raise UsageError(
                f"--tolerance: the bound of '{name}' is {bound:g}; a number from 0 up is needed.",
                f"Try: --tolerance {name}=0.5",
            )
    return given


def _deliver(found: dict[str, Any], options: dict[str, Any]) -> int:
    from camcal.cli.output import write_for_ci
    from camcal.cli.results import deliver
    from camcal.report import comparison
    from camcal.report.ci import append_summary

    deliver(found, options, "Comparison", lambda: _tables(found))
    write_for_ci("camcal compare", comparison.pair(found), comparison.checks(found), options)
    if options["summary"] is not None:
        append_summary(options["summary"], comparison.markdown(found))
    for gate in found["gates"]:
        note(f"{'ok' if gate['passed'] else 'FAILED'}: {comparison.sentence(gate)}")
    return 0 if found["verdict"] == "pass" else 1


def _tables(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    names = [f"{side.upper()}: {found[side]['name']} ({found[side]['model']})\n" for side in "ab"]
    parts: list[Any] = [Text("".join(names))]
    if "rig" not in found:
        return Group(*parts, *_of_camera(found))
    for name, camera in found["cameras"].items():
        parts += [Text(f"camera {name}", style="bold"), *_of_camera(camera), Text("")]
    return Group(*parts, *_places(found["rig"]))


def _places(rig: dict[str, Any]) -> list[Any]:
    from rich.text import Text

    from camcal.cli.output import number, table

    rows = [
        [
            n,
            number(p["rotation_deg"], 3),
            number(p["sigma_rotation_deg"], 2),
            *(number(t, 3) for t in p["translation"]),
        ]
        for n, p in rig["cam_from_rig"].items()
    ]
    moved = table(
        ["camera", "turned, deg", "±", "x", "y", "z"], rows, f"places relative to {rig['reference']}, B - A"
    )
    rows = [
        [n, number(d["a"]), number(d["b"]), number(d["change"], 3), number(d["sigma"], 2)]
        for n, d in rig["baselines"].items()
    ]
    return [moved, Text(""), table(["distance", "A", "B", "B - A", "± sigma"], rows)]


def _of_camera(found: dict[str, Any]) -> list[Any]:
    from rich.text import Text

    from camcal.cli.output import number, table

    rows = []
    for p in found["projection"]:
        keys = ("max_px", "p95_px", "rms_px", "max_sigma")
        for part, of in (("both have data", p["supported"]), ("whole picture", p | {"p95_px": None})):
            where = "-" if of["worst"] is None else "{:.0f}, {:.0f}".format(*of["worst"])
            # to a billionth: two equal cameras differ by 0, not by what their arithmetic rounds
            figures = [number(of[k] if of[k] is None else round(of[k], 9), 4) for k in keys]
            rows.append([number(p["distance"]), part, *figures, where])
    columns = ["distance", "where", "max px", "p95", "rms", "max sigma", "worst at u, v"]
    parts = [table(columns, rows, "difference of projection"), Text("")]
    changes = []
    for name, p in found["parameters"].items():
        sigmas = p["change"] / p["sigma"] if p["sigma"] else None
        changes.append(
            [name, p["a"], p["b"], number(p["change"], 4), number(p["sigma"], 3), number(sigmas, 3)]
        )
    parts.append(table(["parameter", "A", "B", "B - A", "± sigma", "sigmas"], changes, "parameters"))
    return parts
