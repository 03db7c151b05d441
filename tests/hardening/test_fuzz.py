"""Whatever stands in a file, each reader ends in a result or in one line of camcal's own.

Quick by default; `CAMCAL_FUZZ=20000 pytest tests/hardening/test_fuzz.py` takes so many inputs of each reader.
"""

import os
import random
import shutil
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.detect.decode import UnreadableError
from camcal.errors import CamcalError
from tests.hardening.mutate import mutated
from tests.hardening.readers import subjects

COUNT = int(os.environ.get("CAMCAL_FUZZ", "25"))
SUBJECTS = subjects()
#: streams are opened by the command; a state or an entry that is not there is made
MADE = ("frames", "checkpoint", "cache entry")
#: what a reader looks for beside its file
BESIDE = ("p.csv", "p3.csv", "f.csv", "boards.dsc", "boards.tp", "board.mat")


def seeds(made, subject):
    """(ending, bytes) of the inputs that a reader begins from."""
    found = []
    for seed in subject.seeds:
        for path in sorted(made.glob(seed)) or sorted(made.glob(f"{seed}.*")):
            found += [(e, path.read_bytes()) for e in subject.endings or (path.suffix,)]
    return found or [(".yaml", (made / "r.yaml").read_bytes()), (".txt", b"1 2 3\n4 5 6\n")]


def check(subject, path, data):
    """Read one input; anything but a result or a CamcalError of one line fails."""
    path.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            subject.read(path)
    except CamcalError as error:
        assert "\n" not in error.message, error.message
        assert error.exit_code in (2, 3, 4)
        return "refused"
    except UnreadableError as error:
        assert str(error)
        return "refused"
    return "read"


@pytest.mark.parametrize("subject", SUBJECTS, ids=lambda subject: subject.name)
def test_mutated(made, tmp_path, limited, subject):
    for name in BESIDE:
        shutil.copyfile(made / name, tmp_path / name)
    for seed in (made / s for s in subject.seeds if "/" in s):  # a board or a target that belongs to it
        for other in seed.parent.iterdir():
            if other != seed:
                shutil.copyfile(other, tmp_path / other.name)
    known = seeds(made, subject)

    @settings(
        max_examples=COUNT,
        derandomize="CAMCAL_FUZZ" not in os.environ,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**48))
    def run(seed):
        rng = random.Random(seed)
        ending, data = rng.choice(known)
        check(subject, tmp_path / f"input{ending}", mutated(data, rng))

    for ending, data in known:
        check(subject, tmp_path / f"input{ending}", data)
    run()


@pytest.mark.parametrize("subject", SUBJECTS, ids=lambda subject: subject.name)
def test_what_is_no_file(tmp_path, subject):
    """A pipe nobody writes to, a device without an end, a folder, nothing: refused at once."""
    for ending in subject.endings or (".yaml",):
        places = {n: tmp_path / f"{n}{ending}" for n in ("zero", "folder", "absent", "loop")}
        places["zero"].symlink_to("/dev/zero")
        places["loop"].symlink_to(places["loop"].name)
        places["folder"].mkdir(exist_ok=True)
        if (
            not subject.name.startswith("points") or subject.name == "points archive"
        ):  # tables may come by a pipe
            places["pipe"] = tmp_path / f"pipe{ending}"
            os.mkfifo(places["pipe"])
        for path in places.values():
            if subject.name in ("frames", "checkpoint", "cache entry") or (subject.name, path.stem) == (
                "jobs",
                "folder",
            ):
                continue  # streams are opened by the command; a state or an entry that is not there is made
            with pytest.raises((CamcalError, UnreadableError)):
                subject.read(path)
            if path.stem != "folder" and path.is_symlink():
                path.unlink()
