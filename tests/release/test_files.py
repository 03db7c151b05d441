"""The files of a release say the same: versions, dependencies, exit codes, licence."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from camcal.cli import boundary
from camcal.errors import CamcalError
from camcal.version import __version__

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_one_version():
    assert yaml.safe_load(text("CITATION.cff"))["version"] == __version__
    assert f'{{% set version = "{__version__}" %}}' in text("packaging/conda/meta.yaml")
    assert re.findall(r"^## (\S+)", text("CHANGELOG.md"), re.M)[0] == __version__


def test_conda_asks_for_the_same_packages():
    """The wheel of OpenCV is called py-opencv there."""
    recipe = text("packaging/conda/meta.yaml").split("  run:\n")[1].split("\n\n")[0]
    conda = {line.strip("- ").replace(" ", "") for line in recipe.splitlines()}
    ours = {d.replace("opencv-contrib-python-headless", "py-opencv") for d in PROJECT["dependencies"]}
    assert conda == ours | {"python" + PROJECT["requires-python"]}


def test_the_conda_recipe_is_rendered():
    """As `conda build` does: Jinja, then YAML with the sections that it knows."""
    jinja2 = pytest.importorskip("jinja2")
    recipe = yaml.safe_load(jinja2.Template(text("packaging/conda/meta.yaml")).render(PYTHON="python"))
    assert set(recipe) == {"package", "source", "build", "requirements", "test", "about"}
    assert recipe["package"] == {"name": PROJECT["name"], "version": __version__}
    scripts = [f"{name} = {target}" for name, target in PROJECT["scripts"].items()]
    assert recipe["build"]["entry_points"] == scripts and recipe["build"]["noarch"] == "python"
    assert (ROOT / "packaging/conda" / recipe["source"]["path"]).resolve() == ROOT
    backend = tomllib.loads(text("pyproject.toml"))["build-system"]["requires"][0].partition(">")[0]
    assert backend in recipe["requirements"]["host"] and (ROOT / recipe["about"]["license_file"]).exists()
    assert recipe["test"]["imports"] == ["camcal"]


def test_the_image_is_built_of_known_steps_and_runs_as_nobody_special():
    lines = re.sub(r"\\\n", " ", text("Dockerfile")).splitlines()
    steps = [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]
    assert {name for name, _ in steps} <= {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENTRYPOINT", "CMD"}
    images = [said.split()[0] for name, said in steps if name == "FROM"]
    assert all(re.fullmatch(r"python:3\.\d+-slim", image) for image in images)  # a version, not `latest`
    last = dict(steps)
    assert last["USER"] != "root" and f"useradd --create-home {last['USER']}" in text("Dockerfile")
    assert all(isinstance(json.loads(last[name]), list) for name in ("ENTRYPOINT", "CMD"))


def test_licence():
    assert text("LICENSE").startswith("MIT License") and PROJECT["license"] == "MIT"
    assert yaml.safe_load(text("CITATION.cff"))["license"] == "MIT"


def test_the_promise_names_every_exit_code():
    line = next(row for row in text("docs/versions.md").splitlines() if row.startswith("| exit codes"))
    named = set(map(int, re.findall(r"\d+", line)))
    codes = {c.exit_code for c in CamcalError.__subclasses__()}
    assert named == codes | {0, 1, boundary.BUG, boundary.INTERRUPTED, boundary.BROKEN_PIPE, 143}


def test_the_promise_names_the_schema():
    from camcal.schema import SCHEMA

    assert SCHEMA in text("docs/versions.md")


def test_what_the_image_copies_is_let_in():
    copied = {w for line in re.findall(r"^COPY (.+)$", text("Dockerfile"), re.M) for w in line.split()[:-1]}
    allowed = {line[1:] for line in text(".dockerignore").splitlines() if line.startswith("!")}
    assert copied == allowed and all((ROOT / name).exists() for name in copied)
    assert 'ENTRYPOINT ["camcal"]' in text("Dockerfile")


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"])
def test_links_lead_somewhere(name):
    for target in re.findall(r"\]\(([^)#]+)", text(name)):
        assert (ROOT / target).exists(), target


def test_generators_that_contributors_are_told_of():
    from importlib.util import find_spec

    modules = re.findall(r"python -m (camcal[\w.]+)", text("CONTRIBUTING.md"))
    assert len(modules) >= 4 and all(find_spec(m) for m in modules)
