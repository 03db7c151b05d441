"""What a run imports: libraries that take longer to load than a camera takes to calibrate stay out of it."""

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
