"""How often each warning speaks: on clean simulated data (it should not) and on faulty data (it should).

The cases are in `faulty_cases.py`. An error counts as flagged where it names the fault.

Usage: python benchmarks/warnings_study.py [--clean 1000] [--kinds 50] [--faulty 100] [--jobs 1] [--seed 0] [--write]
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import re
import sys
import time
from pathlib import Path

import numpy as np
from faulty_cases import CLEAN_KINDS, COMMON, HARMLESS, OTHERS, SILENT, Case, Said, clean, clean_kind
from tables import markdown, update

PAGE = Path(__file__).parents[1] / "docs" / "trust-figures.md"
REPORT = PAGE.with_name("report.md")
CASES = {c.name: c for c in (*SILENT, *OTHERS, *COMMON, *HARMLESS)}


def _faulty(task: tuple[str, int]) -> tuple[str, set[str]]:
    name, seed = task
    return name, CASES[name].run(np.random.default_rng(seed))


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
        words = ", ".join(f"`{c}` {n / len(runs):.0%}" for c, n in counted.most_common(3))
        rows.append(
            [
                name,
                *(bound(sum(f.grade == g for f in runs), len(runs)) for g in ("doubtful", "wrong")),
                words or "nothing",
            ]
        )
    count = len(next(iter(said.values())))
    return markdown([f"clean data, {count} runs each", "doubtful", "wrong", "what was said most"], rows)


def faulty_table(cases: list[Case], flagged: dict[str, list[set[str]]]) -> str:
    rows = []
    for case in cases:
        runs = flagged[case.name]
        counted = collections.Counter(c.split(":")[0] for f in runs for c in f)
        said = ", ".join(
            f"{c if c == 'error' else f'`{c}`'} {n / len(runs):.0%}" for c, n in counted.most_common(3)
        )
        good = sum(case.named(f) for f in runs) if case.right else sum(not f for f in runs)
        rows.append([case.name, bound(good, len(runs)), said or "nothing"])
    count = len(flagged[cases[0].name])
    return markdown(["case", f"as it should be, of {count} runs", "what was said most"], rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, default in (("clean", 1000), ("kinds", 50), ("faulty", 100), ("jobs", 1), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--tables", help="only these of silent, faulty, common, harmless (commas)")
    parser.add_argument("--cases", help="only those whose name has this in it")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/trust-figures.md")
    told = parser.parse_args()
    begin = time.perf_counter()
    kinds = {"silent": SILENT, "faulty": OTHERS, "common": COMMON, "harmless": HARMLESS}
    if told.tables is not None:
        kinds = {k: cases for k, cases in kinds.items() if k in told.tables.split(",")}
    some = [c.name for cases in kinds.values() for c in cases]
    names = [n for n in some if told.faulty and (told.cases is None or told.cases in n)]
    with multiprocessing.Pool(told.jobs) as pool:
        alarms: collections.Counter = collections.Counter()
        for found in pool.imap_unordered(clean, range(told.seed, told.seed + told.clean), chunksize=4):
            alarms.update(c.split(":")[0] for c in found)
        tables = {"clean": clean_table(alarms, told.clean)} if told.clean else {}
        kinds_tasks = [(name, told.seed + i) for name in CLEAN_KINDS for i in range(told.kinds)]
        of_kinds: dict[str, list[Said]] = collections.defaultdict(list)
        for name, said in pool.imap(clean_kind, kinds_tasks, chunksize=4):
            of_kinds[name].append(said)
        if of_kinds:
            tables["kinds"] = kinds_table(of_kinds)
            print(tables["kinds"], file=sys.stderr, flush=True)
        tasks = [(name, told.seed + i) for name in names for i in range(told.faulty)]
        flagged: dict[str, list[set[str]]] = collections.defaultdict(list)
        for name, found in pool.imap(_faulty, tasks, chunksize=4):
            flagged[name].append(found)
            if len(flagged[name]) == told.faulty:
                print(faulty_table([CASES[name]], flagged).splitlines()[-1], file=sys.stderr, flush=True)
    if names:
        tables |= {
            k: faulty_table([c for c in cases if c.name in names], flagged) for k, cases in kinds.items()
        }
    for name, table in tables.items():
        print(f"{name}\n{table}\n")
        if told.write:
            update(PAGE, f"warnings-{name}", table)
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
