"""What a run imports: libraries that take longer to load than a camera takes to calibrate stay out of it."""

import ast
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

SLOW = ("scipy.stats", "scipy.interpolate", "matplotlib", "jinja2", "pycolmap", "dask")


@pytest.mark.parametrize("command", ["estimate", "checkerboard"])
def test_a_run_loads_nothing_slow(command, tmp_path):
    sample = {"estimate": "barranco_medel.csv", "checkerboard": "board"}[command]
    code = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from camcal.cli.group import camcal\n"
        f"done = CliRunner().invoke(camcal, ['{command}', 'sample_data/{sample}', '-o', r'{tmp_path / 'r.yaml'}'])\n"
        "assert done.exit_code in (0, 1), done.output\n"
        f"print(sorted(set({SLOW!r}) & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "[]", done.stderr


def test_help_loads_no_arrays():
    code = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from camcal.cli.group import camcal\n"
        "assert CliRunner().invoke(camcal, ['estimate', '--help']).exit_code == 0\n"
        "print(sorted({'numpy', 'cv2', 'scipy'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(given, used, monkeypatch):
    from camcal.system.processes import THREADS, limit_linear_algebra

    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
        if given:
            monkeypatch.setenv(name, given)
    limit_linear_algebra()
    assert {os.environ[name] for name in THREADS} == {used}


def test_the_command_limits_it_before_it_is_loaded():
    code = (
        "import sys, camcal.__main__\n"
        "import camcal.system.processes as p\n"
        "p.limit_linear_algebra = lambda: print('numpy' in sys.modules)\n"
        "sys.argv = ['camcal', '--version']\n"
        "camcal.__main__.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[0] == "False", done.stderr


@pytest.mark.parametrize(
    "path", [*ROOT.glob("benchmarks/*.py"), *ROOT.glob("examples/*.py")], ids=lambda path: path.stem
)
def test_what_benchmarks_and_examples_import_is_there(path):
    """The pages name them as the source of figures; they are not run here."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "camcal":
            owner = importlib.import_module(node.module)
            for name in node.names:
                assert hasattr(owner, name.name) or importlib.util.find_spec(f"{node.module}.{name.name}"), (
                    f"line {node.lineno}: {node.module}.{name.name}"
                )
