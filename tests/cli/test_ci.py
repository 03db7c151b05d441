"""The ready files for CI: their commands are run as they stand; what the CI systems get from them."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from camcal.batch import ci as batch_ci
from camcal.report.ci import Check, append_summary, github, junit, markdown
from tests.batch.cameras import row

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "sample_data" / "board"


def shell(command, tmp_path, **more):
    """Run a command line with `camcal` being this one."""
    programs = tmp_path / "bin"
    programs.mkdir(exist_ok=True)
    camcal = programs / "camcal"
    camcal.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m camcal "$@"\n')
    camcal.chmod(0o755)
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path]), "PATH": path, **more}
    return subprocess.run(command, shell=True, env=env, capture_output=True, text=True)


@pytest.fixture
def reference(tmp_path):
    """calibration/ with pictures and a reference, as the examples have it."""
    Path("calibration").mkdir()
    shutil.copytree(PICTURES, "calibration/pictures")
    done = shell(
        "camcal checkerboard calibration/pictures -o calibration/reference.yaml --no-crosscheck", tmp_path
    )
    assert done.returncode == 0, done.stderr
    return Path("calibration/reference.yaml")


def test_the_workflow_runs(reference, tmp_path):
    workflow = yaml.safe_load((ROOT / "examples/ci/github-workflow.yml").read_text())
    steps = workflow["jobs"]["calibration"]["steps"]
    commands = {step["name"]: step["run"] for step in steps if "run" in step}
    install = commands.pop("Install camcal")
    assert install.startswith("pip install 'camcal[")
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    for name, command in commands.items():
        done = shell(command, tmp_path, GITHUB_STEP_SUMMARY=str(summary))
        assert done.returncode == 0, f"{name}: {done.stderr}"
    assert ElementTree.parse("camcal.xml").getroot().get("failures") == "0"
    assert (
        summary.read_text().startswith("before\n### camcal compare: ") and ": passed" in summary.read_text()
    )
    kept = steps[-1]["with"]["path"].split()
    assert kept == ["camera.yaml", "camera.html", "camcal.xml"] and all(Path(name).exists() for name in kept)
    # another camera than the reference: the job fails and says why
    moved = yaml.safe_load(reference.read_text())
    moved["camera"]["parameters"]["k1"]["value"] += 0.05
    reference.write_text(yaml.safe_dump(moved))
    command = commands["Compare with the reference"] + " --force"
    done = shell(command, tmp_path, GITHUB_STEP_SUMMARY=str(summary))
    assert done.returncode == 1 and "::error title=camcal compare,file=camera.yaml::" in done.stderr
    assert "1 of 1 checks failed" in summary.read_text()
    assert ElementTree.parse("camcal.xml").getroot().get("failures") == "1"


def test_the_hook_runs(reference, tmp_path):
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    (repo,) = yaml.safe_load((ROOT / "examples/ci/pre-commit-config.yaml").read_text())["repos"]
    (used,) = repo["hooks"]
    assert used["id"] == hook["id"] and hook["pass_filenames"] is False
    shutil.copy(reference, "calibration/camera.yaml")
    command = f"{hook['entry']} {shlex.join(used['args'])}"
    assert shell(command, tmp_path).returncode == 0
    moved = yaml.safe_load(reference.read_text())
    moved["camera"]["parameters"]["k1"]["value"] += 0.05
    Path("calibration/camera.yaml").write_text(yaml.safe_dump(moved))
    assert shell(command, tmp_path).returncode == 1


def test_a_summary_in_markdown_to_the_letter():
    checks = [Check("a_b", True), Check("c", False, "c: 2 px | <b> exceeds 1")]
    assert markdown("camcal x", ("name", "px"), [["a_b", "1"], ["c", "2"]], checks) == (
        "### camcal x: 1 of 2 checks failed\n"
        "\n"
        "- **c**: c: 2 px \\| &lt;b&gt; exceeds 1\n"
        "\n"
        "| name | px |\n"
        "| --- | --- |\n"
        "| a\\_b | 1 |\n"
        "| c | 2 |\n"
        "\n"
    )
    assert markdown("t", ("n",), [], checks[:1]).startswith("### t: passed\n\n| n |")


def test_characters_that_a_format_cannot_hold():
    check = Check("a\x1b", False, "b\x00\n::error::x%,")
    ElementTree.fromstring(junit("camcal x", "s\x07", [check]))
    (line,) = github("camcal x", [check]).splitlines()
    assert line == "::error title=camcal x::b\x00%0A::error::x%25,"
    assert github("camcal x", [Check("silent", True)]) == ""


def test_a_summary_is_added_to_what_is_there(tmp_path):
    from camcal.errors import UsageError

    path = tmp_path / "s.md"
    append_summary(path, "one\n")
    append_summary(path, "two\n")
    assert path.read_text() == "one\ntwo\n"
    with pytest.raises(UsageError, match="cannot write"):
        append_summary(tmp_path / "absent" / "s.md", "x")


def test_a_batch_is_a_check_per_job():
    rows = [
        row("good", outlier=""),
        row("fallen", verdict="fail", reason="rms_point 2 px exceeds --max-rms 1", outlier=""),
        {"name": "lost", "status": "failed", "reason": "no board.", "outlier": ""},
    ]
    checks = batch_ci.checks(rows, "out")
    assert [(c.name, c.passed, c.kind) for c in checks] == [
        ("good", True, "gate"),
        ("fallen", False, "gate"),
        ("lost", False, "failed"),
    ]
    assert checks[1].file == "out/fallen.yaml" and checks[2].file == ""
    text = batch_ci.markdown(rows, "jobs.yaml", "out")
    assert "2 of 3 checks failed" in text and "| lost | failed |" in text
