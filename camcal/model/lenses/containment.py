"""Which lens model contains which: exact embeddings of the cameras of one model into another.

Models describe their cameras in shared terms (`Lens.readings`): `n1` is the coefficient of r² in the numerator of
a radial series for `opencv5`, `brown` and `mei` alike. A model holds a camera where it has all the terms that the
camera uses. So no pair is listed anywhere: a new model takes part as soon as it states its terms.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from camcal.model.lenses.base import Lens
from camcal.model.lenses.parameters import MATRIX

Array = np.ndarray


def embed(outer: Lens, inner: Lens, params: Array) -> Array | None:
    """The parameters of `outer` that represent a camera of `inner` exactly; None if there are none.

    Both cameras project to the same pixels, up to rounding: every point of the inner one's domain, but for the models
    of `inverse`, which describe directions up to a stated angle only (`InverseLens.farthest`).

    Parameters
    ----------
    params : (P,) array, of `inner`
    """
    if outer == inner:
        return np.array(params, float)
    if outer.shaped_by_data:
        return outer.from_coarser(inner, params)
    terms = outer.terms()
    for reading in inner.readings(dict(zip(inner.names, params.tolist(), strict=True))):
        if reading.curve != outer.neutral_curve:
            continue
        names = {t: t if t in MATRIX else terms.get(t, "") for t in reading.terms}
        if set(names.values()) <= set(outer.names):
            found = outer.from_values({names[t]: v for t, v in reading.terms.items()})
            if outer.within_bounds(found):
                return found
    return None


def contains(outer: Lens, inner: Lens) -> bool:
    """Return whether `outer` holds every camera of `inner`, tested on its examples, also with opposite distortion.

    Models that are the same by another name, such as `bicubic` and `polynomial:3`, contain each other.
    """
    cameras = []
    for params, _ in inner.examples():
        opposite = params.copy()
        opposite[4:] *= -1
        cameras += [params, opposite] if inner.within_bounds(opposite) else [params]
    return all(embed(outer, inner, params) is not None for params in cameras)


@lru_cache(maxsize=64)
def contained(lens: Lens, every: bool = False) -> tuple[str, ...]:
    """Specs of models with fewer parameters whose cameras `lens` contains, the largest first.

    Of its own family (`Lens.smaller`), then of the table by size. Of models that are the same by another name one is
    enough, unless `every`: a search that is stopped by the edge of the lens's domain ends where its path met that, and
    the order of the parameters alone turns the path.
    """
    from camcal.model.lenses import LENSES, make

    table = {m.name: m for m in (make(spec, lens.has_skew) for spec in LENSES)}
    others = sorted(table.values(), key=lambda m: -m.size)
    family = [make(spec, lens.has_skew) for spec in lens.smaller()]
    found: list[Lens] = []
    for m in (*family, *others):
        known = any(f.size == m.size and contains(f, m) for f in found)  # the same by another name
        if m.size < lens.size and (every or not known) and contains(lens, m):
            found.append(m)
    ordered = sorted(found, key=lambda m: -m.size) if every else found
    return tuple(dict.fromkeys(m.name for m in ordered))
