"""The one public face: its names, representations, and calls for pictures."""

from pathlib import Path

import pytest

import camcal
from camcal.errors import UsageError
from tests.solved import solved

SAMPLES = Path(__file__).resolve().parents[1] / "sample_data"


def test_every_public_name_exists_is_documented_and_listed():
    assert set(camcal.__all__) <= set(dir(camcal))
    for name in camcal.__all__:
        found = getattr(camcal, name)
        if name != "__version__":
            assert found.__doc__, name


@pytest.fixture(scope="module")
def solution():
    return camcal.calibrate(solved(views=8).observations, model="opencv5", max_rms=0.1)


def test_representations_fit_on_a_line(solution):
    for value in (solution, solution.observations, solution.camera, solution.poses[0]):
        assert len(repr(value)) < 160 and "\n" not in repr(value)
    assert repr(solution).startswith("<Solution: opencv5, 8 views") and "fail" in repr(solution)


def test_a_notebook_shows_a_table(solution):
    page = solution._repr_html_()
    assert page.startswith("<table>") and page.count("<tr>") == 10
    assert "fail, good" in page and "<th>k3</th>" in page


def test_a_solution_is_saved_and_loaded(solution, tmp_path):
    solution.save(tmp_path / "camera.yaml")
    back = camcal.load(tmp_path / "camera.yaml")
    assert back.camera.params.tolist() == solution.camera.params.tolist()
    assert (back.verdict, back.grade) == ("fail", "good")
    with pytest.raises(UsageError, match="exists"):
        solution.save(tmp_path / "camera.yaml")


def test_opencv_gets_its_arrays(solution):
    matrix, distortion = solution.camera.opencv()
    assert matrix.shape == (3, 3) and distortion.size == 5


def test_pictures_in_one_call():
    found = camcal.calibrate_images(SAMPLES / "board", square="25mm", holdout=0)
    assert len(found.poses) == 12 and found.rms_point < 0.01
    assert found.selection["chosen"] == "opencv5" and found.second_pass is not None
    with pytest.raises(UsageError, match="max_rsm"):
        camcal.calibrate_images(SAMPLES / "board", square="25mm", max_rsm=1)
