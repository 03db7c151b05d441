"""The single place where exceptions become messages and exit codes.

| exit | what happened                                   |
|------|-------------------------------------------------|
| 0, 1 | done; 1 if a gate failed                        |
| 2    | usage or configuration                          |
| 3    | data                                            |
| 4    | estimation failed                               |
| 70   | a bug in camcal                                 |
| 130  | interrupted                                     |
| 141  | the reader of stdout has ended (as in a shell)  |
| 143  | terminated (129: the terminal was closed)       |

Errors of the system (a full disk, no memory, no permission) are not bugs in camcal: exit code 3.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import click

from camcal.errors import CamcalError
from camcal.system import streams, text
from camcal.system.processes import Terminated

BUG, INTERRUPTED, BROKEN_PIPE = 70, 130, 141
DATA = 3
NO_MEMORY = -4  #: cv2.Error.StsNoMem


def run(args: Sequence[str]) -> int:
    """Run one command line and return its exit code; no exception escapes this function.

    click's own `main` is not used: it turns ^C and a bare EOFError into the same `Abort`, and a broken
    pipe into exit code 1.
    """
    if "_CAMCAL_COMPLETE" in os.environ:
        return _run(args)  # for the shell's completion, which click writes as bytes
    with streams.outlets():
        return _run(args)


def _run(args: Sequence[str]) -> int:
    state: dict[str, Any] = {"verbosity": 0, "args": list(args)}
    try:
        code = _invoke(list(args), state)
        sys.stdout.flush()  # a pipe that broke is noticed here, not when the interpreter ends
        return code
    except CamcalError as error:
        return _say(error.message, error.hint, error.exit_code)
    except click.ClickException as error:
        return _say(*explain_usage(error), 2)
    except (KeyboardInterrupt, click.Abort):
        click.echo("Interrupted.", err=True)
        return INTERRUPTED
    except Terminated as error:
        click.echo("Terminated.", err=True)
        return error.exit_code
    except BrokenPipeError:
        streams.silence(sys.stdout)
        return BROKEN_PIPE
    except MemoryError:
        return _no_memory()
    except OSError as error:
        if error.strerror is None:  # not raised by the system
            return _report_bug(error, args, state["verbosity"])
        where = "the system refused" if error.filename is None else f"{error.filename}"
        return _say(f"{where}: {error.strerror}.", None, DATA)
    except Exception as error:  # noqa: BLE001 - the boundary: whatever else arrives here is a bug
        if type(error).__module__ == "cv2" and getattr(error, "code", None) == NO_MEMORY:
            return _no_memory()
        return _report_bug(error, args, state["verbosity"])


def _invoke(args: list[str], state: dict[str, Any]) -> int:
    from camcal.cli.group import camcal

    if instruction := os.environ.get("_CAMCAL_COMPLETE"):
        from click.shell_completion import shell_complete

        return shell_complete(camcal, {"obj": state}, "camcal", "_CAMCAL_COMPLETE", instruction)
    try:
        with camcal.make_context("camcal", args, obj=state) as ctx:
            return camcal.invoke(ctx) or 0
    except click.exceptions.Exit as leave:
        return leave.exit_code


def explain_usage(error: click.ClickException) -> tuple[str, str | None]:
    """Rephrase one of click's errors as (message, hint)."""
    ctx = getattr(error, "ctx", None)
    help_hint = f"{ctx.command_path} --help shows what it takes." if ctx else None
    if isinstance(error, click.NoSuchOption):
        return f"unknown option '{error.option_name}'.", _closest_option(error, ctx) or help_hint
    if isinstance(error, click.MissingParameter):
        return f"{_name_of(error) or 'an argument'} is missing.", help_hint
    if isinstance(error, click.BadParameter):
        name = _name_of(error)
        message = f"{name}: {error.message}" if name else error.message
        return message, getattr(error, "hint", None) or help_hint
    said = error.format_message().rstrip(".")
    return said[:1].lower() + said[1:] + ".", help_hint


def _name_of(error: click.BadParameter) -> str:
    """Return the target of a value: the flag, the argument, or the name in the error itself."""
    hint = error.param_hint
    if isinstance(hint, str):
        return hint
    if hint:
        return " / ".join(hint)
    param = error.param
    if isinstance(param, click.Option):
        return max(param.opts, key=len)
    return param.human_readable_name if param else ""


def _closest_option(error: click.NoSuchOption, ctx: click.Context | None) -> str | None:
    from camcal.registry import suggestion

    if ctx is None:
        return None
    names = [name for param in ctx.command.get_params(ctx) for name in (*param.opts, *param.secondary_opts)]
    return suggestion(error.option_name, [name for name in names if name.startswith("--")])


def _say(message: str, hint: str | None, code: int) -> int:
    click.echo(f"Error: {text.message(message)}", err=True)
    for line in (hint or "").splitlines():
        click.echo(f"  {text.message(line)}", err=True)
    return code


def _no_memory() -> int:
    return _say("there is not enough memory.", "Try less data at a time, or smaller pictures.", DATA)


def _report_bug(error: Exception, args: Sequence[str], verbosity: int) -> int:
    from camcal.cli.buglog import write_log

    path = write_log(error, args)
    where = f"the log is at {path}" if path else "no log could be written"
    click.echo(f"Error: a bug in camcal: {type(error).__name__}: {_first_line(error)}; {where}", err=True)
    if verbosity >= 2:
        import traceback

        click.echo("".join(traceback.format_exception(error)), err=True)
    return BUG


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or ["no message"])[0]
