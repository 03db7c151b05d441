"""What a run imports: libraries that take longer to load than a camera takes to calibrate stay out of it."""

import os
import subprocess
import sys

import pytest

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
