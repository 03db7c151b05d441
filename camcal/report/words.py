"""The result of a report, in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

from camcal.report.table import number

Document = Mapping[str, Any]


def trust(report: Document) -> str:
    """Describe the remaining uncertainty of the camera in a sentence; empty if nothing was estimated."""
    found = report.get("uncertainty")
    if not found:
        return ""
    near, far = found["maps"][0], found["maps"][-1]
    if not math.isfinite(near["median"]):
        return "The data do not determine this camera's projections: do not use it."
    said = (
        "At the boards' distance the projection of a point is uncertain by "
        f"{number(near['centre']['sigma_px'], 2)} px in the middle of the picture, "
        f"{number(near['median'], 2)} px in the median and {number(near['worst']['sigma_px'], 2)} px in the "
        "worst corner"
    )
    if math.isfinite(far["median"]):
        return f"{said}; for far points it is {number(far['median'], 2)} px in the median."
    return f"{said}; for far points it is not determined."


def taken(report: Document) -> str:
    """The camera that most pictures name in their EXIF block, with its focal length; empty if none does."""
    named = Counter(f["taken"] for f in report["inputs"]["files"] if f.get("taken"))
    return named.most_common(1)[0][0] if named else ""
