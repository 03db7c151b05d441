"""The jobs of a batch: a folder with a sub-folder per camera, or a file that lists them.

    jobs:
      - {name: left, images: pictures/left, board: 9x6}
      - {name: zhang, points: points.csv, model: opencv4, fix: "p1,p2", max_rms: 0.5}

      - {name: head, cameras: {left: head/left, right: head/right}, square: 25mm}

A job has a name, `images` or `points` (a path, a pattern or a list of them; relative to the file) or, for a rig,
`cameras` (the pictures of each by its name, or a table with a column `camera`), and options of `camcal checkerboard`,
`camcal estimate` or `camcal rig` under their names in camcal.yaml. `type` groups cameras or rigs that are compared
with each other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from camcal.batch.storage import is_remote
from camcal.errors import DataError, UsageError
from camcal.registry import suggestion
from camcal.settings.batch import COMPACT, FLEET_PRIOR
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.commands import OPTIONS
from camcal.settings.detection import REFINE_CORNERS, DetectionOptions
from camcal.settings.option import Option, readable
from camcal.settings.rig import CAMERA, RigOptions
from camcal.settings.run import IMAGE_SIZE
from camcal.system.text import readable as text_of

POINTS, IMAGES, CAMERAS = "points", "images", "cameras"
#: what a job is of -> the command that does the same
COMMANDS = {POINTS: "estimate", IMAGES: "checkerboard", CAMERAS: "rig"}
#: of a rig: the option --cameras of `camcal rig`, whose name is that of the input here
INTRINSICS = "intrinsics"
TABLES = (".csv", ".txt", ".tsv", ".dat", ".npz", ".vnl")
LONGEST_NAME = 200  #: a file's name has at most 255 bytes, and OUT/NAME.yaml and a temporary name must fit


@dataclass(frozen=True, slots=True)
class Job:
    """One calibration.

    Attributes
    ----------
    name : str
        Of the camera; the report is OUT/NAME.yaml.
    kind : {"points", "images", "cameras"}
    sources : tuple of str
        Absolute paths, patterns or addresses; those of a rig's pictures begin with the camera's name and `=`.
    options : mapping
        Values of options as the program works with them; those left out have the defaults of the command line.
    type : str
        Cameras of one type are compared with each other.
    """

    name: str
    kind: str
    sources: tuple[str, ...]
    options: Mapping[str, Any]
    type: str = ""

    @property
    def digest(self) -> str:
        """A digest of the job: equal for equal inputs and options."""
        said = [self.kind, self.sources, sorted((n, readable(v)) for n, v in self.options.items())]
        return hashlib.sha256(json.dumps(said, default=str).encode()).hexdigest()[:16]


@cache
def options_of(kind: str) -> Mapping[str, Option]:
    """The options that a job of a kind may have, by name."""
    settings = RigOptions if kind == CAMERAS else CalibrationOptions
    found = {**settings.options(), COMPACT.name: COMPACT}
    if kind != CAMERAS:
        found[FLEET_PRIOR.name] = FLEET_PRIOR
    if kind != IMAGES:
        found[IMAGE_SIZE.name] = IMAGE_SIZE
    if kind != POINTS:
        found |= {**DetectionOptions.options(), REFINE_CORNERS.name: REFINE_CORNERS}
        del found["jobs"]  # each worker has one thread
    of_command = {
        option.name: option for option in OPTIONS[COMMANDS[kind]]
    }  # its defaults are those of the job
    found = {name: of_command.get(name, option) for name, option in found.items()}
    if kind == CAMERAS:
        found[INTRINSICS] = found.pop(CAMERAS)
    return found


def read_jobs(source: str, common: Mapping[str, Any] | None = None) -> list[Job]:
    """Read and check all jobs of a folder or a file.

    Parameters
    ----------
    source : str
        FOLDER or JOBS.yaml (or .json).
    common : mapping, optional
        Options for all jobs; those of a job win. An option that does not concern a job is left out.

    Raises
    ------
    UsageError, DataError
        If anything is wrong with any job: nothing is done then.
    """
    path = Path(source)
    if path.is_dir():
        entries = list(_in_folder(path))
        base = path.absolute()
    elif not path.exists():
        raise DataError(f"there is no file or folder '{source}'.", "Check the path.")
    else:
        entries, base = _in_file(path), path.absolute().parent
    jobs: dict[str, Job] = {}
    shared: dict[str, dict[str, Any]] = {}
    entries.reverse()  # they are taken from the end, so that their memory is free again for the jobs
    while entries:
        job = _job(entries.pop(), len(jobs) + 1, base, common or {}, source, shared)
        if job.name in jobs:
            raise UsageError(f"{source}: two jobs are named '{job.name}'.", "Each job needs a unique name.")
        jobs[job.name] = job
    _check_models(jobs.values())
    return list(jobs.values())


def _in_folder(folder: Path) -> Iterator[dict[str, Any]]:
    """A job per sub-folder (pictures) and per table (points), in the order of their names."""
    found = False
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            found = True
            yield {"name": path.name, IMAGES: str(path.absolute())}
        elif path.suffix.lower() in TABLES:
            found = True
            yield {"name": path.stem, POINTS: str(path.absolute())}
    if not found:
        raise DataError(
            f"'{folder}' holds neither sub-folders nor tables of points.",
            "A batch needs a sub-folder of pictures, or a table, per camera.",
        )


def _in_file(path: Path) -> list[Any]:
    from camcal.report.yaml import read_document

    document = read_document(path)
    jobs = document.get("jobs")
    if not isinstance(jobs, list) or not jobs:
        raise UsageError(f"'{path}' lists no jobs.", "It needs a key 'jobs' with a list of them.")
    unknown = next((key for key in document if key != "jobs"), None)
    if unknown is not None:
        raise UsageError(f"'{path}': unknown key '{unknown}'.", "Known: jobs.")
    return jobs


def _job(
    entry: Any,
    number: int,
    base: Path,
    common: Mapping[str, Any],
    source: str,
    shared: dict[str, dict[str, Any]],
) -> Job:
    """One job; `shared` caches the options of earlier jobs by what was given, since thousands can have the same."""
    where = f"{source}: job {number}"
    if not isinstance(entry, Mapping):
        raise UsageError(f"{where} is not a mapping.", "Each job is {name: ..., images or points: ...}.")
    given = {str(key).replace("-", "_"): value for key, value in entry.items()}
    name = _name(given.pop("name", None), where)
    where = f"{source}: job '{name}'"
    kinds = [kind for kind in COMMANDS if kind in given]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "neither points nor images nor cameras"
        near = [] if kinds else [said for key in given if (said := suggestion(key, COMMANDS))]
        needed = f"One of these is needed: {', '.join(COMMANDS)}."
        raise UsageError(f"{where} has {found}.", " ".join([*near[:1], needed]))
    kind = kinds[0]
    value = given.pop(kind)
    sources = _cameras(value, base, where) if kind == CAMERAS else _sources(value, base, where)
    group = text_of(str(given.pop("type", "")))
    key = f"{kind} {given!r}"
    if key not in shared:
        shared[key] = _options(given, kind, base, common, where)
    return Job(name, kind, sources, shared[key], group)


def _options(
    given: Mapping[str, Any], kind: str, base: Path, common: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """The options of a job as the program works with them."""
    known = options_of(kind)
    # a rig takes a model or a size for all its cameras in another form than a camera does
    options = {n: known[n].convert(v) if kind == CAMERAS else v for n, v in common.items() if n in known}
    for key, value in given.items():
        if key not in known:
            raise UsageError(f"{where}: unknown option '{key}'.", suggestion(key, known) or _usual(kind))
        try:
            options[key] = known[key].convert(value)
        except UsageError as error:
            raise UsageError(f"{where}: {key}: {error.message}", error.hint) from None
    if INTRINSICS in options:
        options[INTRINSICS] = {n: str(base / str(path)) for n, path in options[INTRINSICS].items()}
    return options


def _usual(kind: str) -> str:
    return f"Options of `camcal {COMMANDS[kind]}` are known."


def _name(name: Any, where: str) -> str:
    if isinstance(name, int) and not isinstance(name, bool):
        name = str(name)
    if not isinstance(name, str) or not name:
        raise UsageError(f"{where} has no name.", "Each job needs a name: its report is OUT/NAME.yaml.")
    # = + - @ begin a formula where a spreadsheet opens the summary; / and \ would leave the folder
    bad = (
        not name.isprintable()
        or any(c in name for c in '/\\:*?"<>|')
        or name[0] in ".=+-@ "
        or name[-1] in " ."
    )
    if bad or len(name.encode()) > LONGEST_NAME:
        raise UsageError(
            f"{where}: the name {name[:60]!r} cannot be the name of a file.",
            "Use letters, digits, '_', '-' and '.', beginning with a letter or digit.",
        )
    return name


def _sources(value: Any, base: Path, where: str) -> tuple[str, ...]:
    paths = [value] if isinstance(value, str) else value
    if not isinstance(paths, Sequence) or not paths or not all(isinstance(p, str) and p for p in paths):
        raise UsageError(f"{where}: its input is not a path or a list of paths.", "Try: points: points.csv")
    return tuple(p if is_remote(p) else str(base / p) for p in paths)


def _cameras(value: Any, base: Path, where: str) -> tuple[str, ...]:
    """The sources of a rig: one table, or `NAME=PATH` for the pictures of each camera."""
    if isinstance(value, str):
        return _sources(value, base, where)
    if not isinstance(value, Mapping) or len(value) < 2:
        raise UsageError(
            f"{where}: cameras is neither a table nor the pictures of two cameras or more.",
            "Try: cameras: {left: FOLDER, right: FOLDER}",
        )
    bad = next((n for n in map(str, value) if not CAMERA.fullmatch(f"{n}=x")), None)
    if bad is not None:
        raise UsageError(
            f"{where}: {bad[:60]!r} cannot be the name of a camera.", "Use letters, digits, '_', '-' and '.'."
        )
    return tuple(f"{n}={path}" for n, paths in value.items() for path in _sources(paths, base, where))


def _check_models(jobs: Any) -> None:
    """Reject a model, or a held parameter, that does not exist, before any job is run."""
    from camcal.solve.parameters import check_held

    tried: set[tuple[str, bool, str]] = set()
    defaults = CalibrationOptions.options()
    for job in jobs:
        model, skew, fix = (job.options.get(n, defaults[n].default) for n in ("model", "skew", "fix"))
        # what a rig holds is named with its cameras, which only the data have
        rig = job.kind == CAMERAS
        for name in model.values() if rig and isinstance(model, Mapping) else [model]:
            fix = {} if rig else fix
            key = (name, skew, repr(fix))
            if key in tried:
                continue
            tried.add(key)
            try:
                check_held(name, skew, fix)
            except UsageError as error:
                raise UsageError(f"job '{job.name}': {error.message}", error.hint) from None
