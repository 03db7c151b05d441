"""The errors of camcal: each states what was found and what was needed, and has a hint and an exit code."""

from __future__ import annotations


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
    """The input is unreadable, or too little, or not what it says it is."""

    exit_code = 3


class EstimationError(CamcalError):
    """The data were read, but no camera can be estimated from them."""

    exit_code = 4
