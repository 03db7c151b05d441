"""Recognition of the target if none was specified, and its detection in each picture."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from camcal.detect import several, targets
from camcal.detect.examine import Outcome
from camcal.detect.recognition.decide import Answer, answers, board_size, unread, words
from camcal.detect.recognition.look import Sight
from camcal.detect.recognition.measure import measured
from camcal.detect.search_pictures import Search
from camcal.detect.several import Searched
from camcal.detect.targets.base import Target
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.targets.circles import Circles
from camcal.errors import DataError
from camcal.settings.sizes import parse_length

MOST_REASONS = 3  #: that are named if no picture shows the target
FIRST_LOOK = 12  #: pictures, spread over all, that are first searched for every kind of target
#: pictures searched before these, the first and one in the middle: if both show one whole plain board, the others are
#: not searched for markers. That search takes a third of the time of a picture, and an additional board of markers
#: would have to be outside both pictures
AGREEING = 2
ENOUGH_VOTES = 3  #: pictures that must show a target of markers or discs for the others not to be consulted


def recognised(run: Search, square: str | tuple[float, str] | None) -> list[Searched]:
    """The target that most pictures show and its detections in each; then further boards of markers.

    A few pictures are examined first. If they agree on markers or discs, the others are searched for that
    target only; the size of a checkerboard is decided by all of them.
    """
    first = spread(run.files, AGREEING)
    outcomes = {o.path: o for o in run.examine_all(first, None)}
    board = _agreed([o.sight for o in outcomes.values()])
    first = [f for f in spread(run.files, FIRST_LOOK) if f not in outcomes]
    outcomes |= {o.path: o for o in run.examine_all(first, None, board)}
    best = best_of(list(outcomes.values()))
    plain = best is None or isinstance(best.target, Checkerboard)
    if plain or (best is not None and len(best.pictures) < ENOUGH_VOTES):
        rest = [f for f in run.files if f not in outcomes]
        outcomes |= {o.path: o for o in run.examine_all(rest, None, board)}
    looked = [outcomes[f] for f in run.files if f in outcomes]
    sights = [o.sight or Sight() for o in looked]
    best = best_of(looked)
    if best is None or unread(sights, best):
        negative = _recognised_in_negative(run, square)
        if negative is not None:
            return negative
    mirrored = sum(s.mirrored for s in sights)
    if mirrored > (0 if best is None else len(best.pictures)):
        raise DataError(
            f"{mirrored} of {len(looked)} pictures are mirror images: their markers can be read only after they are "
            "turned over.",
            "Turn off the mirror effect (a setting of front cameras and of video calls), or flip all "
            "files from left to right.",
        )
    number = unread(sights, best)
    if number:
        raise DataError(
            f"{number} of {len(looked)} pictures show a board whose squares hold markers that cannot be read.",
            "Specify the board, as in --target charuco:9x7:40mm:20mm:4X4_100, or take sharper, larger pictures.",
        )
    if best is None:
        raise nothing_found("target", looked, None, run)
    if isinstance(best.target, Checkerboard):
        return [_as_checkerboard(run, looked, sights, square)]
    boards = [best, *several.further(best, answers(sights))]
    found = [with_length(_measured(run, b, looked), square) for b in boards]
    _tell_target(run, found, best, looked, best.whole)
    return [Searched(t, run.examine_all(run.files, t)) for t in found]


def _agreed(sights: list[Sight | None]) -> tuple[int, int] | None:
    """The size of the plain board that is whole in each of some pictures, none of which shows markers."""
    boards = {s.board if s is not None and s.plain else None for s in sights}
    return boards.pop() if len(boards) == 1 and len(sights) == AGREEING else None


def _recognised_in_negative(run: Search, square: str | tuple[float, str] | None) -> list[Searched] | None:
    """The target that some pictures show with black and white exchanged, and its detections in each."""
    outcomes = run.examine_all(spread(run.files, FIRST_LOOK), None, negative=True)
    best = best_of(outcomes)
    if best is None or isinstance(best.target, Checkerboard):  # a checkerboard is its own negative
        return None
    found = with_length(_measured(run, best, outcomes, negative=True), square).as_negative()
    _tell_target(run, [found], best, outcomes, best.whole)
    return [Searched(found, run.examine_all(run.files, found))]


def best_of(outcomes: list[Outcome]) -> Answer | None:
    """The target that most pictures show."""
    found = answers([o.sight or Sight() for o in outcomes])
    return found[0] if found else None


def _measured(run: Search, best: Answer, looked: list[Outcome], negative: bool = False) -> Target:
    if isinstance(best.target, Circles):
        return best.target
    pictures = [run.read(looked[i].path, negative) for i in best.pictures]
    return measured(best.target, [p for p in pictures if p is not None])


def _as_checkerboard(
    run: Search, looked: list[Outcome], sights: list[Sight], square: str | tuple[float, str] | None
) -> Searched:
    """The size of a plain checkerboard from all pictures; pictures that showed something else are searched again."""
    found = board_size(sights)
    shown = [s.board for s in sights if s.board and not s.marked]
    if found is None:
        sizes = ", ".join(f"{c}x{r} ({n})" for (c, r), n in Counter(shown).most_common(MOST_REASONS))
        (columns, rows), _ = Counter(shown).most_common(1)[0]
        raise DataError(
            f"{len(shown)} of {len(looked)} pictures show a checkerboard, but too few show its border, "
            f"and they do not agree on its size: {sizes}.",
            f"Give its size in inner corners, as in --board {columns}x{rows}. A picture in which something (a hand) "
            "covers an outer row of corners shows a smaller board: leave it out, or hold the board by its margin.",
        )
    size, whole, votes = found
    target = Checkerboard(*size, *length_of(square))
    answer = Answer(target, tuple(range(votes)))
    _tell_target(run, [target], answer, looked, whole)
    certain = [o.sight is not None and o.sight.board == size and (o.sight.whole or not whole) for o in looked]
    again = [
        o.path for o, sure in zip(looked, certain, strict=True) if o.sight and o.sight.board and not sure
    ]
    new = {o.path: o for o in run.examine_all(again, target)} if again else {}
    return Searched(target, [new.get(o.path, o) for o in looked])


def _tell_target(run: Search, found: list[Target], best: Answer, looked: list[Outcome], whole: bool) -> None:
    """Report the recognised target, and what else the pictures show."""
    sights = [o.sight or Sight() for o in looked]
    target = found[0]
    rest = [
        a
        for a in answers(sights)
        if not any(type(a.target) is type(t) and same_size(a.target, t) for t in found)
    ]
    others = [f"{words(a.target)} ({len(a.pictures)})" for a in rest if isinstance(target, type(a.target))]
    said = " and ".join(words(t) for t in found)
    spec = targets.BOTH.join(t.spec for t in found)
    details = {"spec": spec, "words": said, "pictures": len(best.pictures), "of": len(looked)}
    run.tell("target", **details, whole=whole, others=others, noun=run.noun)


def same_size(one: Target, other: Target) -> bool:
    """Return whether two targets have the same columns and rows, and the same first marker if they have markers."""
    start = getattr(one, "start", 0) == getattr(other, "start", 0)
    return (one.columns, one.rows) == (other.columns, other.rows) and start


def spread(files: list[Path], count: int) -> list[Path]:
    """At most `count` files, evenly spread over all."""
    if len(files) <= count:
        return list(files)
    return [files[i * len(files) // count] for i in range(count)]


def with_length(target: Target, square: str | tuple[float, str] | None) -> Target:
    """The target with the length of its cell, if that is known."""
    return target if square is None else target.scaled(*length_of(square))


def length_of(square: str | tuple[float, str] | None) -> tuple[float, str]:
    """Value and unit of the length of a cell; 1 square if it is not known."""
    if square is None:
        return 1.0, "square"
    value, unit = parse_length(square) if isinstance(square, str) else square
    return float(value), unit


def nothing_found(what: str, outcomes: list[Outcome], seen: Answer | None, run: Search) -> DataError:
    """The error for a set of pictures without the target, with the most frequent reasons as its hint."""
    run.tell_pictures(outcomes)
    message = f"no {what} was found in {run.count}."
    if seen is not None:
        number = len(seen.pictures)
        shown = f"{number} of the pictures show{'s' * (number == 1)} {words(seen.target)}."
        option = f"--target {seen.target.spec}"
        if isinstance(seen.target, Checkerboard):
            option = f"--board {seen.target.columns}x{seen.target.rows}"
        return DataError(message, f"{shown} Try: {option}")
    # messages of one reason code differ in figures; those of unreadable files have no code
    example = {o.code or o.reason: o.reason for o in reversed(outcomes)}
    kinds = Counter(o.code or o.reason for o in outcomes).most_common(MOST_REASONS)
    said = "; ".join(f"{number} of {len(outcomes)}: {example[kind]}" for kind, number in kinds)
    return DataError(message, said + ".")
