"""A batch for CI systems: each job is a check."""

from __future__ import annotations

from collections.abc import Sequence

from camcal.batch.rows import Row
from camcal.batch.storage import is_remote
from camcal.batch.summary import DONE
from camcal.report import ci
from camcal.report.ci import Check

#: rows in the table of a job summary; GitHub shows 1 MiB at most
MOST_ROWS = 500


def checks(rows: Sequence[Row], out: str) -> list[Check]:
    """One check per job: it has finished, and its gates pass."""
    made = []
    for row in rows:
        done = row["status"] == DONE
        passed = done and row["verdict"] == "pass"
        said = row["reason"] or (f"rms_point {row['rms_point']:.4g} px" if done else "")
        file = f"{out.rstrip('/')}/{row['name']}.yaml" if done and not is_remote(out) else ""
        kind, seconds = "gate" if done else "failed", row.get("seconds") or 0.0
        made.append(Check(row["name"], passed, f"{row['name']}: {said}", kind, file, seconds))
    return made


def markdown(rows: Sequence[Row], source: str, out: str) -> str:
    """A job summary: what failed, and a table of the cameras."""
    header = ("camera", "status", "verdict", "rms px", "held out px", "outlier")
    table = [
        [
            row["name"],
            row["status"],
            row.get("verdict", ""),
            *(_number(row.get(k)) for k in ("rms_point", "holdout")),
        ]
        + [row["outlier"]]
        for row in rows[:MOST_ROWS]
    ]
    return ci.markdown(f"camcal batch {source}", header, table, checks(rows, out))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
