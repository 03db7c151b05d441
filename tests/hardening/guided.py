"""Coverage-guided fuzzing of every reader with atheris: inputs that reach new code are kept and damaged further.

    python -m tests.hardening.guided                  60 inputs for each reader (what CI does)
    python -m tests.hardening.guided 20000 report     20,000 for each reader with that in its name

The corpus of a reader is what it reads (tests/hardening/inputs.py); the damage is that of tests/hardening/mutate.py and
libFuzzer's own. Inputs that end in another error than camcal's are kept in the folder that is named. Printed are, for
each reader, its name, the inputs tried, and how it ended.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import re
import shutil
import sys
import tempfile
from pathlib import Path

import atheris

#: inputs of each reader, without an argument: a minute for all on one processor
RUNS = 60
#: bytes of an input at most; that of the largest reader's own file is 100 kB
LARGEST = 1 << 18


def main() -> int:
    """Fuzz the readers that are asked for; 1 where one let a foreign error out."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    # readers load their modules on first use: the hook stays for the whole run
    atheris.instrument_imports(include=["camcal"]).__enter__()
    folder = Path(tempfile.mkdtemp(prefix="camcal-guided-"))
    for name in ("made", "found"):
        (folder / name).mkdir()
    quiet = io.StringIO()  # a line for each module, and the results of the commands that make the inputs
    with contextlib.redirect_stderr(quiet), contextlib.redirect_stdout(quiet):
        from tests.hardening.conftest import fill
        from tests.hardening.readers import subjects

        fill(folder / "made")
    failed = 0
    for subject in subjects():
        if wanted in subject.name:
            count, code = _forked(subject, folder, runs)
            print(f"{subject.name},{count},{'passed' if code == 0 else f'failed ({code})'}", flush=True)
            failed += code != 0
    print(
        f"failed: {failed}; their inputs: {folder / 'found'}" if failed else "no reader let another error out"
    )
    return int(failed > 0)


def _forked(subject, folder: Path, runs: int) -> tuple[int, int]:
    """(inputs, exit status) of a reader in a process of its own: libFuzzer ends the process that it runs in."""
    log = folder / "log"
    child = os.fork()
    if child == 0:
        with log.open("w") as stream:
            os.dup2(stream.fileno(), 1)
            os.dup2(stream.fileno(), 2)
        _fuzz(subject, folder, runs)  # does not return
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    said = log.read_text(errors="replace")
    if code:
        print(said[-3000:], file=sys.stderr)
    return max(map(int, re.findall(r"^(?:#|Done )(\d+)", said, re.M)), default=0), code


def _fuzz(subject, folder: Path, runs: int) -> None:
    from tests.hardening.mutate import mutated
    from tests.hardening.test_fuzz import BESIDE, check, seeds

    place, corpus = folder / "place", folder / "corpus"
    for name in (place, corpus):
        shutil.rmtree(name, ignore_errors=True)
        name.mkdir()
    for name in BESIDE:
        shutil.copyfile(folder / "made" / name, place / name)
    known = seeds(folder / "made", subject)
    endings = sorted({ending for ending, _ in known})
    for number, (_, data) in enumerate(known):
        (corpus / str(number)).write_bytes(data)

    def one(data: bytes) -> None:
        check(subject, place / f"input{endings[len(data) % len(endings)]}", data)

    def mutator(data: bytes, size: int, seed: int) -> bytes:
        rng = random.Random(seed)
        return (mutated(data, rng) if rng.random() < 0.5 else atheris.Mutate(data, size))[:size]

    options = [f"-runs={runs}", f"-max_len={LARGEST}", "-rss_limit_mb=4096", "-timeout=60"]
    options += ["-seed=1", f"-artifact_prefix={folder}/found/{subject.name.replace(' ', '_')}-"]
    atheris.Setup(["guided", *options, str(corpus)], one, custom_mutator=mutator)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
