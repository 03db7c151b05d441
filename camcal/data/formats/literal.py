"""Python literals in files, parsed as data; nothing is executed."""

from __future__ import annotations

import ast
import warnings
from typing import Any

LONGEST = 120  #: characters of Python's own message that are shown


def literal(text: str) -> Any:
    """The value of a Python literal; ValueError if the text is not one."""
    try:
        with warnings.catch_warnings():  # of Python's own parser on damaged numbers
            warnings.simplefilter("ignore")
            return ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError) as error:
        raise ValueError(f"not a Python literal: {str(error).partition(chr(10))[0][:LONGEST]}") from None
