"""The errors of camcal: each states what was found and what was needed, and has a hint and an exit code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class CamcalError(Exception):
    """An expected failure, shown to the user as one line and a hint.

    Parameters
    ----------
    message : str
        What was found and what was needed, in one sentence.
    hint : str, optional
        One thing to try.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str | None = None):
        super().__init__(message)
        self.message = message
        self.hint = hint


class UsageError(CamcalError):
    """The command line or the configuration asks for something that does not exist or contradicts itself."""

    exit_code = 2


class DataError(CamcalError):
    """The input is unreadable, insufficient, or not of the kind that it claims to be."""

    exit_code = 3


class EstimationError(CamcalError):
    """The data were read, but no camera can be estimated from them."""

    exit_code = 4


def caught(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | CamcalError:
    """The result of a function, or the expected error that it raised."""
    try:
        return function(*args, **kwargs)
    except CamcalError as error:
        return error


def only(found: Sequence[T | CamcalError]) -> T:
    """The only result of a function of many; raise it if it is an error."""
    (one,) = found
    if isinstance(one, CamcalError):
        raise one
    return one
