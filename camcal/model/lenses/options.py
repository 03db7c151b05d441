"""The options in the spec of a lens model, such as `brown:radial=2,centre=free` or `division:3`."""

from __future__ import annotations

from collections.abc import Sequence

from camcal.errors import UsageError


def no_options(name: str, plain: Sequence[str], named: dict[str, str], known: Sequence[str] = ()) -> None:
    """Reject options that a model does not know."""
    unknown = [*plain, *(k for k in named if k not in known)]
    if unknown:
        raise UsageError(
            f"model '{name}' has no option '{unknown[0]}'.",
            f"Known: {', '.join(known)}." if known else f"Try: --model {name}",
        )


def count_option(name: str, plain: list[str], default: int, least: int, most: int) -> int:
    """The number in `name:number`; UsageError for anything else."""
    if not plain:
        return default
    if not plain[0].isdigit() or not least <= int(plain[0]) <= most:
        raise UsageError(
            f"model '{name}' has no option '{plain[0]}'; a number from {least} to {most} is needed.",
            f"Try: --model {name}:{default}",
        )
    return int(plain[0])


def whole_number(name: str, named: dict[str, str], key: str, default: int, most: int) -> int:
    """The number from 0 to `most` in `key=number`; UsageError for anything else."""
    text = named.get(key, str(default))
    if not text.isdigit() or int(text) > most:
        raise UsageError(
            f"model '{name}': {key}={text} is not a number from 0 to {most}.", f"Try: {key}={default}"
        )
    return int(text)


def choice(name: str, named: dict[str, str], key: str, words: Sequence[str]) -> str:
    """The word in `key=word`, by default the first; UsageError for any other."""
    text = named.get(key, words[0])
    if text not in words:
        raise UsageError(f"model '{name}': {key}={text} is neither {' nor '.join(repr(w) for w in words)}.")
    return text
