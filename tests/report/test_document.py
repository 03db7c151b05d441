"""The report: its keys, its exactness, reading back."""

import base64
import copy
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
import yaml

import camcal
from camcal.assess.covariance import covariance
from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import SkippedView
from camcal.errors import DataError, UsageError
from camcal.report import yaml as yaml_module
from camcal.report.document import document, save
from camcal.report.loading import load, load_camera
from camcal.report.plain import plain
from camcal.report.yaml import dump_json, dump_yaml
from tests.solved import solved

TOP = [
    "schema",
    "tool",
    "command",
    "inputs",
    "options",
    "target",
    "stages",
    "camera",
    "views",
    "fit",
    "holdout",
    "crosscheck",
    "warnings",
    "verdict",
]


@pytest.fixture(scope="module")
def solution():
    return solved(views=4, fix={"k3": None, "aspect": None})


def test_keys_stand_in_the_schemas_order(solution):
    made = document(solution, command=["estimate", "x.csv"])
    assert [k for k in made if k in TOP] == TOP
    assert made["schema"] == "camcal-report/1"
    assert set(made["tool"]) >= {"camcal", "opencv", "numpy", "python"}
    assert set(made["camera"]["parameters"]["fx"]) == {"value", "sigma", "start", "fixed"}
    assert {"rms_point", "rms_coord", "sigma_hat", "median", "p95", "max"} <= set(made["fit"])


def test_fixed_parameters_have_no_sigma_and_free_ones_have(solution):
    parameters = document(solution)["camera"]["parameters"]
    assert parameters["k3"]["fixed"] and parameters["k3"]["sigma"] is None
    assert not parameters["fx"]["fixed"] and parameters["fx"]["sigma"] > 0


@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_a_report_reads_back_exactly(solution, tmp_path, suffix):
    path = tmp_path / f"r.{suffix}"
    save(document(solution), path)
    back = load(path)
    ours, theirs = solution.observations, back.observations
    assert ours.view_ids == theirs.view_ids and theirs.sigma is None
    for name in ("xyz", "uv", "view", "point", "used"):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name
    assert np.array_equal(back.camera.params, solution.camera.params)
    assert np.array_equal(back.free, solution.free)
    assert np.array_equal(back.start.params, solution.start.params)
    assert back.camera.image_size == solution.camera.image_size
    # poses pass through rotation vectors: a few units in the last place of 1e3 px
    assert back.rms_point == pytest.approx(solution.rms_point, abs=1e-10)
    assert np.allclose(back.normal.poses, solution.normal.poses, rtol=1e-8)
    assert camcal.load(path).rms_point == back.rms_point


def test_a_report_of_a_report_is_the_same(solution, tmp_path):
    save(document(solution), tmp_path / "a.yaml")
    first = document(load(tmp_path / "a.yaml"))
    assert first["data"] == document(solution)["data"]
    assert first["camera"]["matrix"] == document(solution)["camera"]["matrix"]


def test_sigmas_ids_and_rejected_points_survive(tmp_path):
    made = solved(views=3, sigma=np.linspace(0.1, 0.5, 54))
    used = made.used.copy()
    used[made.observations.slices[1]][[3, 7]] = False
    made = replace(made, observations=made.observations.with_used(used))
    doc = document(made)
    assert doc["views"][1]["rejected_points"] == 2
    assert [r["row"] for r in doc["views"][1]["rejected"]] == [3, 7]
    assert doc["views"][1]["rejected"][0]["residual"] == made.residuals[54 + 3].tolist()
    assert doc["fit"]["points_rejected"] == 2
    save(doc, tmp_path / "r.yaml")
    back = load(tmp_path / "r.yaml")
    assert np.array_equal(back.observations.views[0].sigma, made.observations.views[0].sigma)
    assert np.array_equal(back.used, used)


def test_skipped_views_stand_in_the_order_of_the_files(tmp_path):
    made = solved(views=2)
    data = replace(
        made.observations,
        skipped=(SkippedView("a.jpg", "not_found", "too dark"), SkippedView("c.jpg", "unreadable", "empty")),
        view_ids=("b.jpg", "d.jpg"),
        files=tuple({"path": f"in/{n}.jpg", "sha256": "0"} for n in "abcd"),
    )
    doc = document(replace(made, observations=data))
    assert [v["id"] for v in doc["views"]] == ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
    assert [v["status"] for v in doc["views"]] == ["not_found", "used", "unreadable", "used"]
    assert doc["inputs"]["views"] == 4 and doc["views"][0]["reason"] == "too dark"
    save(doc, tmp_path / "r.yaml")
    back = load(tmp_path / "r.yaml")
    assert [v.id for v in back.observations.views] == ["b.jpg", "d.jpg"]
    assert back.observations.skipped == data.skipped


def test_a_single_view_carries_its_projection_matrix():
    made = solved(model="pinhole", views=1, xyz=np.random.default_rng(0).uniform(-3, 3, (40, 3)), shift=0.5)
    m = np.array(document(made)["projection_matrix"])
    view = made.observations.views[0]
    q = np.c_[view.xyz, np.ones(len(view))] @ m.T
    rms = np.sqrt(np.square(q[:, :2] / q[:, 2:] - view.uv).sum(1).mean())
    assert m[2, 3] == pytest.approx(1)
    assert rms == pytest.approx(made.rms_point, abs=1e-9)
    assert "projection_matrix" not in document(solved(views=2))


def test_the_verdict_follows_the_gates(solution):
    assert document(solution)["verdict"] == "pass"
    assert document(solution, failures=["too bad"])["verdict"] == "fail"
    strict = document(replace(solution, options={"max_rms": 0.01}))
    assert strict["verdict"] == "fail" and "--max-rms" in strict["failures"][0]
    entry = {"stage": "refine", "against": "cv2.calibrateCamera", "status": "fail", "why": "cv2 is lower"}
    assert document(replace(solution, crosscheck=(entry,)))["verdict"] == "fail"


def test_warnings_of_both_sources_are_listed(solution):
    one = replace(solution, warnings=(CalibrationWarning("a", "b"),))
    codes = [w["code"] for w in document(one, warnings=[CalibrationWarning("c", "d", "e")])["warnings"]]
    assert codes == ["a", "c"]


AWKWARD = [1e-5, 1e16, 1e-300, 0.1, -0.0, 123456789.123456789, 5e-324, float("inf"), float("-inf")]


class TestYaml:
    def test_numbers_keep_every_bit(self):
        back = yaml.safe_load(dump_yaml({"x": AWKWARD}))["x"]
        assert all(isinstance(b, float) for b in back)
        assert [a.hex() for a in back] == [a.hex() for a in AWKWARD]

    def test_json_keeps_them_too(self):
        back = json.loads(dump_json({"x": AWKWARD, "n": float("nan")}))
        assert [a.hex() for a in back["x"]] == [a.hex() for a in AWKWARD]
        assert back["n"] is None

    def test_words_that_yaml_takes_for_values_stay_words(self):
        words = {
            "a": "no",
            "b": "1e-5",
            "c": "null",
            "d": "~",
            "e": "12:30",
            "f": "",
            "g": "x: y",
            "h": "été",
        }
        assert yaml.safe_load(dump_yaml(words)) == words

    @pytest.mark.parametrize("word", ["08", "0o17", "0x1f", "1e5", ".5", "+1", "1.", "no", "~", "1_000"])
    def test_text_that_some_reader_takes_for_a_value_is_quoted(self, word):
        """08 is text to YAML 1.1 and 8 to YAML 1.2."""
        assert dump_yaml({"id": word}) == f"{{id: '{word}'}}\n"

    def test_a_matrix_has_a_row_a_line(self):
        text = dump_yaml(
            {"matrix": [[1.5, 0.0, 320.12345678901234], [0.0, 1.5, 240.12345678901234], [0.0, 0.0, 1.0]] * 2}
        )
        assert "- [1.5, 0.0, 320.1234567890123]\n" in text

    def test_repeated_lists_are_no_anchors(self):
        row = [1.0, 2.0]
        assert "&" not in dump_yaml({"a": row, "b": row})

    def test_numpy_becomes_plain(self):
        found = plain(
            {"a": np.float64(1e-5), "b": np.arange(2), "c": (np.bool_(True), None), "d": np.int64(3)}
        )
        assert yaml.safe_load(dump_yaml(found)) == {"a": 1e-5, "b": [0, 1], "c": [True, None], "d": 3}

    def test_an_object_is_refused(self):
        with pytest.raises(TypeError, match="cannot hold"):
            plain({"a": object()})


class TestBadFiles:
    def test_missing(self, tmp_path):
        with pytest.raises(DataError, match="no file"):
            load(tmp_path / "absent.yaml")

    def test_aliases_are_refused(self, tmp_path):
        """Nine lists of nine aliases each, nested nine deep, would be a document of 9^9 values."""
        path = tmp_path / "r.yaml"
        rows = [f"l{i}: &l{i} [{', '.join(['*l' + str(i - 1)] * 9)}]" for i in range(1, 10)]
        path.write_text("\n".join(["l0: &l0 [x]", *rows]))
        with pytest.raises(DataError, match="aliases"):
            load(path)

    def test_an_ampersand_is_no_alias(self, tmp_path):
        path = tmp_path / "r.yaml"
        path.write_text("a: 'Q & A'\nb: x &y\n")
        with pytest.raises(DataError, match="not a camcal report"):
            load(path)

    @pytest.mark.parametrize("text", ["{" + '"a":{' * 100_000, "a: " + "[" * 100_000, "- " * 100_000])
    def test_nested_too_deep(self, tmp_path, text):
        path = tmp_path / "r.yaml"
        path.write_text(text)
        with pytest.raises(DataError, match=r"nested more than 60 deep|the error is at line 1"):
            load(path)

    def test_a_number_of_many_digits(self, tmp_path):
        path = tmp_path / "r.json"
        path.write_text('{"schema": "camcal-report/1", "n": ' + "9" * 5000 + "}")
        with pytest.raises(DataError, match="Exceeds the limit"):
            load(path)

    def test_too_large(self, tmp_path, monkeypatch):
        monkeypatch.setattr("camcal.report.yaml.LARGEST", 9)
        path = tmp_path / "r.yaml"
        path.write_text("a: 1\nb: 22")
        with pytest.raises(DataError, match="more than 9 bytes"):
            load(path)
        path.write_text("a: 1\nb: 2")
        with pytest.raises(DataError, match="not a camcal report"):
            load(path)

    @pytest.mark.parametrize(
        ("keys", "value", "message"),
        [
            (("camera", "parameters", "fx", "value"), "abc", "camera.parameters.fx.value is 'abc'; a finite"),
            (("camera", "parameters", "fx", "value"), float("nan"), "parameters.fx.value is nan; a finite"),
            (("camera", "image_size"), [640, 0], "camera.image_size[1] is 0; a whole number from 1 up"),
            (("camera", "image_size"), [640.5, 480], "camera.image_size[0] is 640.5; a whole number"),
            (("camera", "matrix", 1), [0.0, 1.0], "camera.matrix[1] is a list of 2; a list of 3 is needed"),
            (("views", 2, "status"), "lost", "views[2].status is 'lost'; 'used' or 'rejected'"),
            (
                ("views", 1, "cam_from_board", "translation", 2),
                float("inf"),
                "translation[2] is inf; a finite",
            ),
            (("fit", "converged"), 1, "fit.converged is 1; true or false is needed"),
            (("data", "rows"), -1, "data.rows is -1; a whole number from 0 up"),
            (("verdict",), None, "verdict is null; 'pass' or 'fail' is needed"),
        ],
    )
    def test_a_bad_value_is_named_with_its_path(self, tmp_path, solution, keys, value, message):
        made = copy.deepcopy(document(solution))
        inside = made
        for key in keys[:-1]:
            inside = inside[key]
        inside[keys[-1]] = value
        save(made, tmp_path / "r.yaml")
        with pytest.raises(DataError, match=re.escape(message)):
            load(tmp_path / "r.yaml")
        if keys[0] == "camera":
            with pytest.raises(DataError, match="is damaged: camera"):
                load_camera(tmp_path / "r.yaml")

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("", "contains no mapping"),
            ("just words", "contains no mapping"),
            ("a: [1", "not readable as YAML: the error is at line 2"),
            ("- 1\n- 2\n", "contains no mapping"),
            ("\x00\x01", "not readable as YAML: the error is at an unknown character"),
            ("{", "not readable as YAML: the error is at line 2"),
            ("a: b: c", "not readable as YAML: the error is at line 1"),
        ],
    )
    def test_not_a_report(self, tmp_path, text, said):
        path = tmp_path / "r.yaml"
        path.write_text(text)
        with pytest.raises(DataError, match=said):
            load(path)

    def test_binary(self, tmp_path):
        path = tmp_path / "r.yaml"
        path.write_bytes(bytes(range(256)))
        with pytest.raises(DataError, match="cannot read"):
            load(path)

    def test_another_schema(self, tmp_path, solution):
        path = tmp_path / "r.yaml"
        path.write_text("schema: somebody/1\n")
        with pytest.raises(DataError, match="not a camcal report"):
            load(path)
        path.write_text(dump_yaml(document(solution) | {"schema": "camcal-report/2"}))
        with pytest.raises(DataError, match="camcal-report/2"):
            load(path)

    @pytest.mark.parametrize("key", ["camera", "views", "fit", "data", "inputs", "stages"])
    def test_a_missing_part(self, tmp_path, solution, key):
        made = document(solution)
        del made[key]
        path = tmp_path / "r.yaml"
        path.write_text(dump_yaml(made))
        with pytest.raises(DataError, match=f"damaged: '{key}' is missing"):
            load(path)

    def test_cut_off_data(self, tmp_path, solution):
        text = dump_yaml(document(solution))
        path = tmp_path / "r.yaml"
        # in the middle of the observations, or where a key breaks off
        path.write_text(text[: text.index("\ndata:") + 600])
        with pytest.raises(DataError, match=r"damaged|not a YAML file"):
            load(path)

    @pytest.mark.parametrize(
        ("column", "value", "message"),
        [
            ("view", 4.0, "name a view that it does not list"),
            ("view", -1.0, "name a view that it does not list"),
            ("view", np.nan, "hold a value of 'view' that is not finite"),
            ("u", np.inf, "hold a value of 'u' that is not finite"),
        ],
    )
    def test_damaged_observations(self, tmp_path, solution, column, value, message):
        made = copy.deepcopy(document(solution))
        table = np.frombuffer(zlib.decompress(base64.b64decode(made["data"]["text"])), "<f8").copy()
        table[made["data"]["columns"].index(column) * made["data"]["rows"]] = value
        made["data"]["text"] = base64.b64encode(zlib.compress(table.tobytes())).decode()
        save(made, tmp_path / "r.yaml")
        with pytest.raises(DataError, match=message):
            load(tmp_path / "r.yaml")

    def test_observations_that_unpack_to_more_than_their_rows(self, tmp_path, solution):
        made = copy.deepcopy(document(solution))
        made["data"]["text"] = base64.b64encode(zlib.compress(bytes(1 << 24))).decode()
        save(made, tmp_path / "r.yaml")
        with pytest.raises(DataError, match="data are damaged: not 216 rows of 9 columns"):
            load(tmp_path / "r.yaml")

    def test_a_used_view_without_a_pose(self, tmp_path, solution):
        made = copy.deepcopy(document(solution))
        made["views"][1]["cam_from_board"] = None
        save(made, tmp_path / "r.yaml")
        with pytest.raises(DataError, match=f"the view '{made['views'][1]['id']}' has points that were used"):
            load(tmp_path / "r.yaml")

    def test_a_report_is_not_overwritten_unasked(self, tmp_path, solution):
        path = tmp_path / "r.yaml"
        path.write_text("mine")
        with pytest.raises(UsageError, match="exists"):
            save(document(solution), path)
        assert path.read_text() == "mine"


def test_an_opencv_file_is_a_camera(tmp_path):
    import cv2

    path = tmp_path / "cv.yml"
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    store.write("image_width", 640)
    store.write("image_height", 480)
    matrix = np.array([[533.1, 0, 320.5], [0, 534.2, 240.5], [0, 0, 1]])
    store.write("camera_matrix", matrix)
    store.write("distortion_coefficients", np.array([[-0.2, 0.1, 1e-5, 2e-4, 0.01]]))
    store.release()
    camera = load_camera(path)
    assert camera.lens.name == "opencv5" and camera.image_size == (640, 480)
    assert np.array_equal(camera.matrix, matrix)
    assert camera.values["p1"] == 1e-5


def test_a_camera_of_a_report(tmp_path, solution):
    save(document(solution), tmp_path / "r.yaml")
    assert np.array_equal(load_camera(tmp_path / "r.yaml").params, solution.camera.params)
    (tmp_path / "x.yaml").write_text("a: 1\n")
    with pytest.raises(DataError, match="no camera"):
        load_camera(tmp_path / "x.yaml")


def test_poses_have_their_sigmas():
    s = solved(views=5)
    entries = document(s)["views"]
    blocks = covariance(s).poses()
    for entry, block in zip(entries, blocks, strict=True):
        sigma = entry["cam_from_board"]["sigma"]
        assert np.allclose([*sigma["rotation"], *sigma["centroid"]], np.sqrt(np.diag(block)))
    # a board of 9 units at 13 units: turned to a milliradian, and placed to a hundredth
    assert 1e-5 < entries[0]["cam_from_board"]["sigma"]["rotation"][0] < 1e-2


def test_options_are_written_as_the_rest():
    """Their lines are kept from one report to the next; the text is that of the whole document at once."""
    odd = {
        "plain": {"value": "auto", "from": "default"},
        "08": {"value": {"k1": None, "e": float("inf")}, "from": "1e5"},
        "long": {"value": "x" * 300, "from": "a\nb\x1b"},
        "list": {"value": [1.5, "é", True] * 30, "from": "job"},
    }
    for options in (odd, odd | {"plain": {"value": True, "from": "job"}}, {}, {"a": 1}, None, ["a"]):
        for made in ({"schema": "x", "options": options, "end": [1]}, {"options": options}):
            assert yaml_module.dump_yaml(made) == yaml_module._dumped(made)
