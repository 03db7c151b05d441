"""`camcal track`: a camera that changes with time, followed frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click
from click.core import ParameterSource

from camcal.cli.options import options
from camcal.cli.track_results import deliver, may_replace, reference_matrix
from camcal.cli.verbosity import note, verbosity_options
from camcal.settings.tracking import FROM_FILE, FROM_PIPE, TrackOptions

if TYPE_CHECKING:
    from camcal.track.events import Change
    from camcal.track.frames import Frame

#: changes that are shown on stderr as they are found; further ones are only counted
SHOWN = 20


@click.command("track")
@click.argument("frames", nargs=-1, required=True, metavar="FRAMES")
@options("track")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, frames: tuple[str, ...], **options: Any) -> int:
    """Follow a camera that changes with time, and report when it has changed.

    FRAMES is a table with the columns frame,X,Y,Z,u,v[,sigma][,t], or - for such a table from stdin, where each
    output row is written as soon as its frame is complete; or pictures of one fixed target (with --camera). The
    output has a row for each frame: the projection matrix, K, R, t, their sigmas, the innovation and its test.
    With --rig, the poses of a rig's cameras are followed, and the output has a row for each camera and instant.
    The cameras see a board, or with --natural arbitrary scenes.
    """
    if options["rig"] is not None or options["natural"]:
        from camcal.cli.track_rig import follow_rig

        return follow_rig(ctx, frames, options)
    from camcal.track.follow import Follower

    _check_files(options)
    estimator, track_options = _estimator(ctx, frames, options)
    live = frames == ("-",)
    output = _output(estimator.model, options, live)
    follower = Follower(
        estimator,
        output,
        on_change=_ChangeLog(),
        hold=options["reorder"],
        state_file=options["state"],
        every=options["state_every"] or (FROM_PIPE if live else FROM_FILE),
        options=_must_match(options, track_options),
    )
    try:
        follower.resume()
        summary = follower.run(_frames(frames, options, output.flush))
        output.finish()
    except BaseException:  # also on ^C: no table that looks complete
        output.discard()
        raise
    return deliver(ctx, summary, follower, options)


# ------------------------------------------------------------------ before the run
def _check_files(options: dict[str, Any]) -> None:
    """Raise an error for outputs that cannot be written, before any work is done."""
    from camcal.data.writing import check_writable
    from camcal.errors import UsageError

    force = may_replace(options)
    for name in ("output", "report"):
        if options[name] is not None:
            check_writable(options[name], force)
    if options["state"] is not None:
        check_writable(options["state"], force=True)
    if options["plots"] is not None:
        from camcal.track import plots

        if options["output"] is None:
            raise UsageError("plots need the table in a file, but it goes to stdout.", "Give -o FILE too.")
        plots.require_matplotlib()
        if options["plots"].is_dir():
            for path in plots.paths(options["plots"]):
                check_writable(path, force)
        if options["reference"] is not None:
            reference_matrix(options["reference"])


def _estimator(
    ctx: click.Context, frames: tuple[str, ...], options: dict[str, Any]
) -> tuple[Any, TrackOptions]:
    """Make the estimator; raise an error for options that it would ignore."""
    from camcal.errors import UsageError
    from camcal.registry import look_up
    from camcal.track import ESTIMATORS

    method = options["method"] or ("iekf" if options["camera"] is not None else "kalman")
    options["method"] = method
    cls = look_up(ESTIMATORS, method, "method")
    known = TrackOptions.options()
    for name in sorted(set(known) - cls.takes - _FOR_ALL):
        if _given(ctx, name):
            takers = [m for m, path in ESTIMATORS.items() if name in look_up({m: path}, m, "method").takes]
            raise UsageError(
                f"{known[name].long} has no effect with the method '{method}'.",
                f"It is for {', '.join(takers)}.",
            )
    gain = options["gain"] or next(iter(cls.gains), None)
    for name, owner in _OF_GAIN.items():
        if gain in cls.gains and gain != owner and _given(ctx, name):
            raise UsageError(f"--{name} has no effect with the gain '{gain}'.", f"Add --gain {owner}.")
    values = {name: options[name] for name in known}
    if options["camera"] is not None:
        values["camera"] = _camera(ctx, options)
    if not _is_table(frames):
        values["learn_noise"] = True
    made = TrackOptions(**values)
    return cls(made), made


def _given(ctx: click.Context, name: str) -> bool:
    """Return whether an option was given for this run, not by default or in a shared configuration."""
    found = ctx.get_parameter_source(name)
    return found not in (ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP, None)


#: options that belong to one gain
_OF_GAIN = {"alpha": "fixed", "forgetting": "forgetting"}
_FOR_ALL = frozenset(("sigma", "learn_noise", "gate", "false_alarm", "min_points", "rate"))


def _camera(ctx: click.Context, options: dict[str, Any]) -> Any:
    from camcal.errors import UsageError
    from camcal.report.loading import load_camera

    for name in ("model", "skew"):
        if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"--{name} and --camera were both given.", "The lens is that of the camera.")
    return load_camera(options["camera"])


def _must_match(options: dict[str, Any], track: TrackOptions) -> dict[str, Any]:
    """Return the values that must match for a run to continue from a checkpoint."""
    values = track.checkpoint()
    if track.camera is not None:
        values["camera"] = [track.camera.lens.name, track.camera.params]
    output = None if options["output"] is None else str(options["output"].resolve())
    own = {"method": options["method"], "reorder": options["reorder"], "covariance": options["covariance"]}
    return {**own, **values, "format": _format(options), "output": output}


# ------------------------------------------------------------------ in and out
def _is_table(frames: tuple[str, ...]) -> bool:
    return len(frames) == 1 and (
        frames[0] == "-" or Path(frames[0]).suffix.lower() in (".csv", ".txt", ".tsv", ".dat")
    )


def _frames(
    frames: tuple[str, ...], options: dict[str, Any], before_read: Callable[[], object]
) -> Iterable[Frame]:
    from camcal.errors import UsageError

    if not _is_table(frames):
        tables = [name for name in frames if _is_table((name,))]
        if tables and len(frames) > 1:
            raise UsageError(
                f"{len(frames)} inputs, '{tables[0]}' among them; a table must be the only input.",
                "Concatenate the tables, with frames in ascending order.",
            )
        return _from_pictures(frames, options)
    if frames[0] == "-":
        from camcal.system.streams import standard_input

        return _from_stream(standard_input(), "stdin", before_read)
    from camcal.data.blocks import open_binary

    return _from_stream(open_binary(frames[0]), frames[0])


def _from_stream(
    stream: BinaryIO, name: str, before_read: Callable[[], object] = lambda: None
) -> Iterator[Frame]:
    from camcal.track.stream import FrameReader

    with stream:
        yield from FrameReader(stream, name, before_read)


def _from_pictures(paths: tuple[str, ...], options: dict[str, Any]) -> Iterator[Frame]:
    from camcal.cli.job import read_pictures
    from camcal.track.frames import from_pictures

    # of a film every frame counts: none is left out for showing what another shows
    every = options["every"] or 1
    return from_pictures(
        read_pictures(paths, {**options, "keep_frames": None, "every": every}, calibrated=False)
    )


def _format(options: dict[str, Any]) -> str:
    if options["format"] is not None:
        return options["format"]
    path = options["output"]
    return "jsonl" if path is not None and path.suffix.lower() in (".jsonl", ".ndjson") else "csv"


def _output(model: Any, options: dict[str, Any], live: bool) -> Any:
    from camcal.track.output import Output
    from camcal.track.table import Table

    return Output(
        Table(model, options["covariance"]),
        _format(options),
        options["output"],
        growing=live or options["state"] is not None,
        force=options["force"],
    )


class _ChangeLog:
    """Writes each change to stderr as it is found, up to a maximum number."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, change: Change) -> None:
        self.count += 1
        if self.count <= SHOWN:
            note(f"{change.message}.")
        elif self.count == SHOWN + 1:
            note("Further changes are counted but not shown; check whether --motion is suitable.")
