"""How often each warning speaks: on clean simulated data (it should not) and on faulty data (it should).

The cases are in `faulty_cases.py`. An error counts as flagged where it names the fault. As the true camera is known,
each run also says how far the calibrated one is off, against its own statement: a fault that moves it by less than
three of its sigmas need not be found, and a camera that is off by more, and by more than 1 px, must not be graded good.

Usage: python benchmarks/warnings_study.py [--clean 1000] [--kinds 50] [--faulty 100] [--jobs 1] [--seed 0] [--log FILE]
    [--write]
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import json
import multiprocessing
import multiprocessing.pool
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
from faulty_cases import CLEAN_KINDS, COMMON, HARMLESS, OTHERS, SILENT, Case, Said, clean, clean_kind
from tables import kept, markdown, update

PAGE = Path(__file__).parents[1] / "docs" / "trust-figures.md"
REPORT = PAGE.with_name("report.md")
CASES = {c.name: c for c in (*SILENT, *OTHERS, *COMMON, *HARMLESS)}


def bound(hits: int, runs: int) -> str:
    """A share with the standard error of a binomial count; of none or all, the 95 % bound (rule of three)."""
    if hits in (0, runs):
        return f"{hits / runs:.0%} ({'<' if hits == 0 else '>'} {abs((hits == runs) - 3 / runs):.1%})"
    p = hits / runs
    return f"{p:.1%} ± {np.sqrt(p * (1 - p) / runs):.1%}"


def known_codes() -> list[str]:
    """Every warning that docs/report.md knows."""
    text = REPORT.read_text(encoding="utf-8").partition("## Warnings")[2]
    first = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    return [code for cell in first for code in re.findall(r"`([a-z-]+)`", cell)]


def clean_table(alarms: collections.Counter, runs: int) -> str:
    silent = [c for c in known_codes() if c not in alarms]
    rows = [[f"`{c}`" if " " not in c else c, bound(n, runs)] for c, n in alarms.most_common()]
    rows.append([f"each of the {len(silent)} {'others' if alarms else 'warnings'}", bound(0, runs)])
    return markdown(["warning", f"share of {runs} clean runs"], rows)


def kinds_table(said: dict[str, list[Said]]) -> str:
    """How often each kind of clean data is graded less than good, and what was said."""
    rows = []
    for name, runs in said.items():
        counted = collections.Counter(c for f in runs for c in f)
        words = ", ".join(f"`{c}` {n}" for c, n in counted.most_common(3))
        counts = (sum(f.grade == g for f in runs) for g in ("doubtful", "wrong"))
        rows.append([name, len(runs), *counts, words or "nothing"])
    every = [f for runs in said.values() for f in runs]
    counts = (bound(sum(f.grade == g for f in every), len(every)) for g in ("doubtful", "wrong"))
    rows.append(["all", len(every), *counts, ""])
    return markdown(["clean data", "runs", "doubtful", "wrong", "what was said, in runs"], rows)


def faulty_table(cases: list[Case], said: dict[str, list[Said]]) -> str:
    """What is said of each fault, and how often it should have been because the camera is off."""
    rows = []
    for case in cases:
        runs = said[case.name]
        counted = collections.Counter(c.split(":")[0] for f in runs for c in f)
        words = ", ".join(
            f"{c if c == 'error' else f'`{c}`'} {n / len(runs):.0%}" for c, n in counted.most_common(3)
        )
        good = [case.named(f) if case.right else not f for f in runs]
        off = [f.off for f in runs if np.isfinite(f.off)]
        wrong = [g for g, f in zip(good, runs, strict=True) if f.wrong]
        rows.append(
            [
                case.name,
                len(runs),
                bound(sum(good), len(runs)),
                f"{np.median(off):.2g}" if off else "no camera",
                f"{sum(wrong)} of {len(wrong)}",
                sum(f.passed for f in runs),
                words or "nothing",
            ]
        )
    header = [
        "case",
        "runs",
        "as it should be",
        "camera off, px",
        "of those beyond 3 sigmas",
        "passed",
        "said most",
    ]
    return markdown(header, rows)


def pass_table(said: dict[str, dict[str, list[Said]]]) -> str:
    """How often a camera is graded good that is off by more than 1 px and three of its sigmas."""
    rows = []
    for table, by_name in said.items():
        runs = [f for found in by_name.values() for f in found]
        bad = [f for f in runs if f.off > 1 and f.wrong]
        passed = sum(f.passed for f in runs)
        share = [bound(passed, len(n)) if n else "" for n in (bad, runs)]
        rows.append([table, len(runs), len(bad), passed, *share])
    return markdown(["data", "runs", "cameras off", "graded good", "of the cameras off", "of all runs"], rows)


TABLES = {"silent": SILENT, "faulty": OTHERS, "common": COMMON, "harmless": HARMLESS}
KINDS = "kinds"


def _run(task: tuple[str, str, int]) -> dict[str, Any]:
    """A run as a line of the log."""
    table, name, seed = task
    said = clean_kind((name, seed))[1] if table == KINDS else CASES[name].run(np.random.default_rng(seed))
    return {"table": table, "name": name, "seed": seed, "said": sorted(said), "grade": said.grade,
            "off": said.off, "stated": said.stated}  # fmt: skip


def _said(line: dict[str, Any]) -> Said:
    found = Said(line["said"])
    found.grade, found.off, found.stated = line["grade"], line["off"], line["stated"]
    return found


def logged(
    tasks: list[tuple[str, str, int]], log: Path | None, pool: multiprocessing.pool.Pool
) -> dict[str, dict[str, list[Said]]]:
    """What was said in all runs of some tasks, by table and case; those in the log are not made again."""
    lines = kept(log)
    done = {(r["table"], r["name"], r["seed"]) for r in lines}
    with log.open("a") if log else contextlib.nullcontext() as file:
        for line in pool.imap_unordered(_run, [t for t in tasks if t not in done], chunksize=2):
            lines.append(line)
            if file is not None:
                print(json.dumps(line), file=file, flush=True)
    found: dict[str, dict[str, list[Said]]] = {}
    for table, name in dict.fromkeys((t[0], t[1]) for t in tasks):
        runs = [_said(r) for r in lines if (r["table"], r["name"]) == (table, name)]
        if runs:
            found.setdefault(table, {})[name] = runs
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, default in (("clean", 1000), ("kinds", 50), ("faulty", 100), ("jobs", 1), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--tables", help="only these of silent, faulty, common, harmless (commas)")
    parser.add_argument("--cases", help="only those whose name has this in it")
    parser.add_argument(
        "--log", type=Path, help="file for the runs, a line each; those in it are not made again"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into docs/trust-figures.md")
    told = parser.parse_args()
    begin, tables = time.perf_counter(), {}
    chosen = {k: c for k, c in TABLES.items() if told.tables is None or k in told.tables.split(",")}
    names = {k: [c.name for c in cases if (told.cases or "") in c.name] for k, cases in chosen.items()}
    seeds = range(told.seed, told.seed + told.faulty)
    tasks = [(KINDS, name, told.seed + i) for i in range(told.kinds) for name in CLEAN_KINDS]
    tasks += [(table, name, seed) for seed in seeds for table, some in names.items() for name in some]
    tasks.sort(
        key=lambda task: task[2]
    )  # seed by seed, so that a study that is stopped has all cases in its log
    with multiprocessing.Pool(told.jobs) as pool:
        if told.clean:
            alarms: collections.Counter = collections.Counter()
            for found in pool.imap_unordered(clean, range(told.seed, told.seed + told.clean), chunksize=4):
                alarms.update(c.split(":")[0] for c in found)
            tables["clean"] = clean_table(alarms, told.clean)
        said = logged(tasks, told.log, pool)
    if KINDS in said:
        tables[KINDS] = kinds_table(said[KINDS])
    tables |= {
        k: faulty_table([c for c in cases if c.name in said[k]], said[k])
        for k, cases in chosen.items()
        if k in said
    }
    if said:
        tables["pass"] = pass_table(said)
    for name, table in tables.items():
        print(f"{name}\n{table}\n")
        if told.write:
            update(PAGE, f"warnings-{name}", table)
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
