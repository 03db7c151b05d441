"""Reports of rigs: written, read back, shown."""

import numpy as np
import pytest

import camcal
from camcal.assess.covariance import covariance
from camcal.errors import DataError
from camcal.report.rig import document
from camcal.report.rig_loading import load_rig
from camcal.report.rig_table import tables
from camcal.schema import Report, structure
from tests.rigs import LENS, observed, truth


@pytest.fixture(scope="module", params=["flat", "free"])
def solution(request):
    data, _ = observed(truth("abc"))
    return camcal.calibrate_rig(
        data, model=LENS, board_shape=request.param, fix={"a.k2": 0.0, "aspect": None}, robust="auto"
    )


@pytest.fixture
def path(solution, tmp_path):
    solution.save(tmp_path / "rig.yaml")
    return tmp_path / "rig.yaml"


def test_it_is_of_the_schema(solution):
    report = document(solution, command=["rig"])
    structure(Report, report, "report")
    assert tables(report) is not None


def test_it_reads_back(solution, path):
    again = load_rig(path)
    assert again.observations.view_ids == solution.observations.view_ids
    for name in ("uv", "xyz", "camera", "view", "point", "used"):
        np.testing.assert_array_equal(getattr(again.observations, name), getattr(solution.observations, name))
    for name, camera in solution.rig.cameras.items():
        np.testing.assert_array_equal(again.rig.cameras[name].params, camera.params)
    np.testing.assert_allclose(again.residuals, solution.residuals, rtol=0, atol=1e-9)
    ours, theirs = covariance(solution), covariance(again)
    assert list(ours.sigmas) == list(theirs.sigmas)
    # the equations of a board with a shape are linearised at the shape where it was settled, 1e-3 of it away
    np.testing.assert_allclose(list(theirs.sigmas.values()), list(ours.sigmas.values()), rtol=2e-3)


def test_load_gives_the_rig(solution, path):
    rig = camcal.load(path)
    assert isinstance(rig, camcal.Rig) and rig.reference == "a"
    assert rig.baseline("b", "c") == pytest.approx(solution.rig.baseline("b", "c"), rel=1e-12)


def test_another_document_is_refused(tmp_path, path):
    text = path.read_text().replace("rig_from_board", "rig_from_nothing")
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(DataError, match=r"damaged|rig_from_nothing"):
        load_rig(tmp_path / "bad.yaml")


def test_the_page_shows_every_camera(solution, path):
    pytest.importorskip("jinja2")
    from camcal.report.html.rig import page
    from camcal.report.yaml import read_document
    from tests.report.test_html import Reader

    text = page(read_document(path), load_rig(path), str(path))
    reader = Reader()
    reader.feed(text)
    for name in solution.rig.cameras:
        assert f"Camera {name}" in text and f"<title>{name}</title>" in text  # its parameters, its pyramid
    assert text.count('class="board"') == len(solution.poses)
    assert "a-b" in text and "epipolar" in text


def test_the_doctor_knows_a_rig(solution, path):
    from camcal.report.doctor.rig import diagnose
    from camcal.report.yaml import read_document

    found = diagnose(read_document(path), load_rig(path), str(path))
    assert found["about"] == "rig" and found["healthy"] == (solution.grade != "wrong")
    assert "Distances: a-b" in found["sentence"]


def test_one_camera_of_a_report(solution, path):
    from camcal.report.rig_loading import load_solution

    alone = load_solution(f"{path}#b")
    np.testing.assert_array_equal(alone.camera.params, solution.rig.cameras["b"].params)
    rows = solution.observations.camera == 1
    np.testing.assert_allclose(alone.residuals, solution.residuals[rows], rtol=0, atol=1e-9)
    with pytest.raises(DataError, match="no camera 'z'"):
        load_solution(f"{path}#z")
