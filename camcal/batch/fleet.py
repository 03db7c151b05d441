"""Comparison of the cameras of a batch: control charts of each type, outlier cameras, ranking.

The scatter of a quantity over a fleet has two parts: how cameras differ (τ) and how well each is known (its own σ).
A camera is compared with the median of its type by

    z = (x - median) / sqrt(τ² + σ²)                                                                       (1)

with τ² = max(0, S² - median σ²) and S the scaled median absolute deviation (1.4826 MAD, Rousseeuw & Croux 1993), so
that outliers do not hide themselves. The limit is the quantile at which a fleet without outliers raises FALSE_ALARMS
false alarms in all on average (Bonferroni), and never below Shewhart's three standard deviations. It is one of
Student's t, for the median and the MAD of few cameras are themselves uncertain: their variances are 1.57 and 1.36
times S² / n of the mean and S² / (2 n) of the standard deviation (Huber & Ronchetti, Robust Statistics 2009).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from camcal.assess.figures import ranked
from camcal.batch.rows import Row, Rows
from camcal.batch.summary import DONE
from camcal.least_squares.distributions import t_bound
from camcal.least_squares.scales import MAD
from camcal.records import dataclass
from camcal.system.text import cell

Array = np.ndarray

#: quantity -> (column of its own standard deviation or None, title with unit, whether only large values are bad)
QUANTITIES: dict[str, tuple[str | None, str, bool]] = {
    "focal": ("sigma_focal", "focal length, px", False),
    "cx": ("sigma_cx", "principal point cx, px", False),
    "cy": ("sigma_cy", "principal point cy, px", False),
    "distortion": (None, "distortion, px", False),
    "rms_point": (None, "rms of the residuals, px", True),
    "holdout": (None, "rms on held-out views, px", True),
}
#: least number of cameras of a type whose spread is estimated: the MAD of eight has a relative standard
#: deviation of 40 %
LEAST = 8
#: Models of an ordinary lens: focal length, principal point and distortion mean the same in all of them, and of equal
#: cameras `--model auto` takes one or the other as their noise has it.
ORDINARY = ("pinhole", "opencv", "brown", "tilted")
#: quantities of the residuals, which a rig has as a whole; of the others it has one for each camera
_OF_THE_WHOLE = ("rms_point", "holdout")
#: expected number of false alarms in a fleet without outliers
FALSE_ALARMS = 0.05
SHEWHART = 3.0  #: standard deviations; the limits of Shewhart's control charts (1931), the least that is used
MAD_EFFICIENCY = 0.37  #: 1 / (2 x 1.36): of the MAD against the standard deviation
MEDIAN_VARIANCE = 1.57  #: π / 2: of the median against the mean
#: the scatter is not taken to be less than this part of the quantity itself, so that equal values are no outliers
ROUNDING = 1e-9


@dataclass(frozen=True)
class Control:
    """The control chart of one quantity of one type.

    Attributes
    ----------
    type, quantity : str
    names : tuple of str
        In the order of the jobs.
    values, z : (N,) arrays
    centre, spread, limit : float
        Median, scatter between cameras (τ), and the largest |z| that is no outlier.
    """

    type: str
    quantity: str
    names: tuple[str, ...]
    values: Array
    z: Array
    centre: float
    spread: float
    limit: float

    @property
    def title(self) -> str:
        """The quantity with its unit, and the camera's name for a rig."""
        part, _, quantity = self.quantity.rpartition(" ")
        if quantity in QUANTITIES:
            return f"{part} {QUANTITIES[quantity][1]}".strip()
        return f"distance {quantity}, unit of the board"

    @property
    def _one_sided(self) -> bool:
        return self.quantity in QUANTITIES and QUANTITIES[self.quantity][2]

    @property
    def outliers(self) -> dict[str, float]:
        """z of the cameras beyond the limit, by name."""
        bad = self.z > self.limit if self._one_sided else np.abs(self.z) > self.limit
        return {self.names[i]: float(self.z[i]) for i in np.flatnonzero(bad)}


def type_of(row: Row) -> str:
    """The type of a camera, or of a rig: as given by its job, otherwise the kind of its lens and its picture size."""
    ordinary = all(model.startswith(ORDINARY) for model in row["model"].split("+"))
    return row["type"] or f"{'ordinary lens' if ordinary else row['model']} {row['image_size']}".strip()


def controls(rows: Sequence[Row]) -> list[Control]:
    """The control charts of all types with enough cameras."""
    groups: dict[str, _Group] = {}
    for row in rows:
        if row["status"] == DONE:
            groups.setdefault(type_of(row), _Group()).add(row)
    groups = {name: group for name, group in groups.items() if len(group.names) >= LEAST}
    tests = sum(len(group.columns) * len(group.names) for group in groups.values())
    made = [_control(name, q, group, tests) for name, group in groups.items() for q in group.columns]
    return [chart for chart in made if chart is not None]


class _Group:
    """The cameras of a type: their names, and for each quantity the cameras that have it, its values and sigmas."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.columns: dict[str, tuple[array[int], array[float], array[float]]] = {}

    def add(self, row: Row) -> None:
        """Take a camera."""
        for name, (value, sigma) in quantities(row).items():
            which, values, sigmas = self.columns.setdefault(name, (array("q"), array("d"), array("d")))
            which.append(len(self.names))
            values.append(value)
            sigmas.append(sigma)
        self.names.append(row["name"])


def quantities(row: Row) -> dict[str, tuple[float, float]]:
    """The compared quantities of a job, with their standard deviations (0 if unknown), by name.

    Of a camera those of QUANTITIES; of a rig those of each camera, after its name and a blank, and the distances.
    """
    parts = row.get("parts")
    sources = [("", row)] if parts is None else [("", row), *((f"{n} ", part) for n, part in parts.items())]
    found: dict[str, tuple[float, float]] = {}
    for prefix, values in sources:
        for name, (sigma, _, _) in QUANTITIES.items():
            if values.get(name) is not None and (not prefix or name not in _OF_THE_WHOLE):
                found[prefix + name] = (values[name], (values[sigma] or 0.0) if sigma else 0.0)
    for pair, distance in row.get("baselines", {}).items():
        found[pair] = (distance["value"], distance["sigma"] or 0.0)
    return found


@lru_cache(maxsize=64)  # the quantities of a type mostly have the same cameras
def limit_for(tests: int, cameras: int) -> float:
    """The largest |z| that is not an outlier, for a type with `cameras` cameras and this number of tested values."""
    freedom = MAD_EFFICIENCY * (cameras - 1)
    quantile = t_bound(0.5 * FALSE_ALARMS / tests, freedom)
    return max(SHEWHART, quantile * math.sqrt(1 + MEDIAN_VARIANCE / cameras))


def _control(name: str, quantity: str, group: _Group, tests: int) -> Control | None:
    there, values, sigma = map(np.array, group.columns[quantity])
    if len(there) < LEAST:
        return None
    centre = float(np.median(values))
    scatter = MAD * float(np.median(np.abs(values - centre)))
    floor = ROUNDING * max(abs(centre), 1.0)
    between = math.sqrt(max(scatter**2 - float(np.median(sigma**2)), floor**2))
    z = (values - centre) / np.hypot(between, sigma)
    names = tuple(group.names[i] for i in there.tolist())
    return Control(name, quantity, names, values, z, centre, between, limit_for(tests, len(there)))


def with_fleet(rows: Sequence[Row], charts: Sequence[Control]) -> Rows:
    """The rows with `outlier` (what is unusual, with its z) and `rank` (1 is the camera with the smallest error).

    Ranked by the error on held-out views where that is known, else by the residuals; cameras that failed have none.
    """
    found: dict[str, list[str]] = {}
    for chart in charts:
        for name, z in chart.outliers.items():
            found.setdefault(name, []).append(f"{chart.quantity} {z:+.1f}")
    order = sorted((ranked(r["holdout"] or r["rms_point"]), r["name"]) for r in rows if r["status"] == DONE)
    ranks = {name: rank for rank, (_, name) in enumerate(order, 1)}
    return Rows.of(
        row | {"outlier": "; ".join(found.get(row["name"], ())), "rank": ranks.get(row["name"])}
        for row in rows
    )


#: the columns of summary.csv
COLUMNS = (
    "name", "status", "reason", "rms_point", "verdict", "grade", "warnings", "outlier", "rank", "type", "model",
    "image_size", "views", "points", "focal", "sigma_focal", "cx", "sigma_cx", "cy", "sigma_cy", "distortion",
    "holdout", "seconds",
)  # fmt: skip


def csv_text(rows: Sequence[Row]) -> bytes:
    """summary.csv in UTF-8: a line per job, in the order of the jobs."""
    import csv
    import io

    out = io.BytesIO()  # StringIO would hold four bytes for each character
    with io.TextIOWrapper(out, encoding="utf-8", newline="", write_through=True) as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([_cell(row.get(column)) for column in COLUMNS] for row in rows)
        return out.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return cell(" ".join(value.split()))
    return "" if value is None else value
