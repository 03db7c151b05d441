"""What a batch is told: folders, lists, and each way to get one wrong."""

import re
from pathlib import Path

import pytest
import yaml

from camcal.batch.jobs import Job, read_jobs
from camcal.errors import DataError, UsageError


def listed(tmp_path, *jobs, **common):
    path = tmp_path / "jobs.yaml"
    path.write_text(yaml.safe_dump({"jobs": list(jobs)}))
    return read_jobs(str(path), common)


def test_a_folder_of_folders_and_tables(tmp_path):
    for name in ("b", "a", ".git"):
        (tmp_path / name).mkdir()
    (tmp_path / "c.csv").write_text("")
    (tmp_path / "notes.md").write_text("")
    jobs = read_jobs(str(tmp_path))
    assert [(j.name, j.kind) for j in jobs] == [("a", "images"), ("b", "images"), ("c", "points")]
    assert jobs[0].sources == (str(tmp_path / "a"),)


def test_a_list_of_jobs(tmp_path):
    jobs = listed(
        tmp_path,
        {"name": "one", "points": "p.csv", "model": "opencv4", "fix": "p1,k1=0.1", "max-rms": 0.5},
        {"name": 2, "images": ["a", "/abs/b", "s3://bucket/c"], "board": "9x6", "type": "wide"},
        seed=7,
        image_size=(640, 480),
    )
    first, second = jobs
    assert first.sources == (str(tmp_path / "p.csv"),)
    wanted = {
        "model": "opencv4",
        "fix": {"p1": None, "k1": 0.1},
        "max_rms": 0.5,
        "seed": 7,
        "image_size": (640, 480),
    }
    assert first.options == wanted
    assert second.name == "2" and second.type == "wide"
    assert second.sources == (str(tmp_path / "a"), "/abs/b", "s3://bucket/c")
    assert second.options == {"board": (9, 6), "seed": 7}  # pictures say their size themselves


def test_the_digest_is_that_of_what_is_done():
    job = Job("a", "points", ("/p.csv",), {"model": "opencv4", "seed": 1})
    assert job.digest == Job("b", "points", ("/p.csv",), {"seed": 1, "model": "opencv4"}, "type").digest
    for other in (
        Job("a", "points", ("/q.csv",), job.options),
        Job("a", "images", ("/p.csv",), job.options),
        Job("a", "points", ("/p.csv",), {**job.options, "seed": 2}),
    ):
        assert other.digest != job.digest


GOOD = {"name": "good", "points": "p.csv"}


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ({"name": "x", "points": "p", "model": "opencv99"}, "job 'x': model: unknown model 'opencv99'"),
        ({"name": "x", "points": "p", "model": "brown:radial=no"}, "job 'x'"),
        ({"name": "x", "points": "p", "model": "opencv4", "fix": "k9"}, "job 'x'"),
        ({"name": "x", "points": "p", "modle": "opencv4"}, "unknown option 'modle'"),
        ({"name": "x", "points": "p", "board": "9x6"}, "unknown option 'board'"),
        ({"name": "x", "images": "p", "image_size": "640x480"}, "unknown option 'image_size'"),
        ({"name": "x", "images": "p", "jobs": 4}, "unknown option 'jobs'"),
        ({"name": "x", "points": "p", "max_rms": -1}, "max_rms: -1 is not"),
        ({"name": "x"}, "neither points nor images"),
        ({"name": "x", "points": "p", "images": "q"}, "has points and images"),
        ({"name": "x", "points": []}, "not a path"),
        ({"name": "x", "points": [1]}, "not a path"),
        ({"points": "p"}, "job 2 has no name"),
        ("x", "job 2 is not a mapping"),
        (dict(GOOD), "two jobs are named 'good'"),
        *(
            ({"name": name, "points": "p"}, "cannot be the name of a file")
            for name in (
                "../x",
                "a/b",
                "a\\b",
                ".x",
                "..",
                "=1+1",
                "-x",
                "@x",
                "a\nb",
                "a\x1b[1m",
                "x" * 201,
                "x ",
                "x.",
            )
        ),
    ],
)
def test_what_is_refused(tmp_path, bad, said):
    with pytest.raises(UsageError, match=re.escape(said)):
        listed(tmp_path, GOOD, bad)


def test_a_misspelt_input_is_suggested(tmp_path):
    with pytest.raises(UsageError, match="neither points nor images") as caught:
        listed(tmp_path, {"name": "x", "imagez": "p"})
    assert caught.value.hint.startswith("Did you mean 'images'?")


def test_a_name_of_200_bytes_is_the_longest(tmp_path):
    assert listed(tmp_path, {"name": "ä" * 100, "points": "p"})[0].name == "ä" * 100


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "lists no jobs"),
        ("jobs: []", "lists no jobs"),
        ("jobs: 3", "lists no jobs"),
        ("jobs: [{name: a, points: b}]\nmodel: opencv4", "unknown key 'model'"),
    ],
)
def test_a_file_without_jobs(tmp_path, text, said):
    (tmp_path / "jobs.yaml").write_text(text)
    with pytest.raises(UsageError, match=said):
        read_jobs(str(tmp_path / "jobs.yaml"))


def test_nothing_to_do(tmp_path):
    with pytest.raises(DataError, match="neither sub-folders nor tables"):
        read_jobs(str(tmp_path))
    with pytest.raises(DataError, match="no file or folder"):
        read_jobs(str(Path(tmp_path) / "absent"))


def test_jobs_of_rigs(tmp_path):
    pictures, table = listed(
        tmp_path,
        {
            "name": "a",
            "cameras": {"left": "l", "right": ["r1", "/abs/r2"]},
            "model": {"left": "kb4"},
            "hold": "left",
        },
        {
            "name": "b",
            "cameras": "rig.csv",
            "intrinsics": {"left": "l.yaml"},
            "image_size": {"left": "64x48"},
        },
        model="opencv4",
        image_size=(640, 480),
        fleet_prior=True,
    )
    assert pictures.kind == table.kind == "cameras"
    assert pictures.sources == (f"left={tmp_path}/l", f"right={tmp_path}/r1", "right=/abs/r2")
    assert pictures.options == {"model": {"left": "kb4"}, "hold": ("left",), "image_size": {"": (640, 480)}}
    assert table.sources == (f"{tmp_path}/rig.csv",)
    assert table.options["model"] == {"": "opencv4"} and table.options["image_size"] == {"left": (64, 48)}
    assert table.options["intrinsics"] == {"left": f"{tmp_path}/l.yaml"}


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"cameras": {"left": "l"}}, "two cameras or more"),
        ({"cameras": {"a b": "l", "c": "r"}}, "name of a camera"),
        ({"cameras": {"left": "l", "right": 3}}, "not a path"),
        ({"cameras": "rig.csv", "model": {"left": "pinhol"}}, "pinhol"),
        ({"cameras": "rig.csv", "fleet-prior": True}, "fleet_prior"),
        ({"cameras": "rig.csv", "points": "p.csv"}, "points and cameras"),
    ],
)
def test_jobs_of_rigs_that_are_refused(tmp_path, entry, said):
    with pytest.raises(UsageError, match=said):
        listed(tmp_path, {"name": "a", **entry})


def test_a_held_parameter_that_the_default_model_does_not_have_is_refused_before_any_job(tmp_path):
    """`auto` tries opencv5 first."""
    with pytest.raises(UsageError, match=r"job 'a': .*no parameter 'k9'"):
        listed(tmp_path, {"name": "a", "points": "p.csv", "fix": "k9"})
    listed(tmp_path, {"name": "a", "points": "p.csv", "fix": "k3", "model": "auto"})


def test_defaults_are_those_of_the_command_of_each_kind():
    """A job of pictures lets the board bend, as `camcal checkerboard` does."""
    from camcal.batch.jobs import COMMANDS, options_of
    from camcal.settings.commands import OPTIONS

    for kind, command in COMMANDS.items():
        of_command = {o.name: o.default for o in OPTIONS[command] if o.name != "cameras"}
        differ = {n for n, o in options_of(kind).items() if n in of_command and o.default != of_command[n]}
        assert not differ, kind


def test_a_type_that_no_encoding_holds(tmp_path):
    """JSON can say half of a pair of surrogates; the summary is UTF-8."""
    (tmp_path / "jobs.json").write_text('{"jobs": [{"name": "a", "points": "p.csv", "type": "\\ud800x"}]}')
    (job,) = read_jobs(str(tmp_path / "jobs.json"))
    assert job.type == "\\ud800x"
