"""Cameras against each other: who is an outlier, how often without a cause, and how it is shown."""

import csv
import io

import numpy as np
import pytest

from camcal.batch import fleet, page

from .cameras import row


def fleet_of(count, seed=0, spread=4.0, sigma=0.5, **changed):
    """Rows of cameras whose true focal length scatters by `spread`; `changed` is a row's name -> its values."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        values = {
            "focal": 800 + rng.normal(0, spread) + rng.normal(0, sigma),
            "cx": 320 + rng.normal(0, 3),
            "cy": 240 + rng.normal(0, 3),
            "distortion": -5 + rng.normal(0, 0.1),
            "rms_point": 0.2 + rng.normal(0, 0.01),
            "holdout": 0.25 + rng.normal(0, 0.01),
            "sigma_focal": sigma,
        }
        rows.append(row(f"c{number:04d}", **{**values, **changed.get(f"c{number:04d}", {})}))
    return rows


def outliers(rows):
    return {r["name"]: r["outlier"] for r in fleet.with_fleet(rows, fleet.controls(rows)) if r["outlier"]}


def test_an_unusual_camera_is_named_with_what_is_unusual():
    found = outliers(fleet_of(40, c0007={"focal": 840.0}, c0011={"holdout": 0.9}, c0012={"distortion": 5.0}))
    assert list(found) == ["c0007", "c0011", "c0012"]
    assert found["c0007"].startswith("focal +") and found["c0012"].startswith("distortion +")


@pytest.mark.parametrize("seed", range(5))
def test_exactly_the_bad_cameras_of_a_production_line_are_named(seed):
    """Of 200: a lens out of place, a decentred sensor, a soft lens whose corners are noisy."""
    line = fleet_of(
        200, seed, c0017={"focal": 840.0}, c0101={"cx": 355.0}, c0163={"rms_point": 0.4, "holdout": 0.5}
    )
    found = outliers(line)
    assert list(found) == ["c0017", "c0101", "c0163"]
    assert [said.split()[0] for said in found.values()] == ["focal", "cx", "rms_point"]


def test_a_small_residual_is_no_fault():
    assert not outliers(fleet_of(40, c0003={"holdout": 0.01, "rms_point": 0.001}))


def test_a_fleet_without_outliers_has_few():
    """One false alarm in 20 fleets: 10 in 200, and 23 or more once in 3,000 times (Poisson)."""
    for count in (10, 50):
        assert sum(len(outliers(fleet_of(count, seed))) for seed in range(200)) < 23


def test_a_camera_that_is_poorly_known_is_not_blamed():
    rows = fleet_of(40, c0005={"focal": 840.0, "sigma_focal": 20.0})
    assert not outliers(rows)


def test_the_scatter_between_cameras_is_without_that_of_the_calibrations():
    rows = fleet_of(4000, spread=3.0, sigma=4.0)
    chart = next(c for c in fleet.controls(rows) if c.quantity == "focal")
    # of S = 5, the MAD of 4,000 cameras is known to 1.3 %, and its square less 4² to 2 x 1.3 % x 25 / 9
    assert chart.spread == pytest.approx(3.0, rel=0.5 * 3 * 0.072)
    assert chart.centre == pytest.approx(800.0, abs=0.3)


@pytest.mark.parametrize(("count", "charts"), [(7, 0), (8, len(fleet.QUANTITIES))])
def test_eight_cameras_of_a_type_are_needed(count, charts):
    rows = [*fleet_of(count), row("other", model="kb4"), row("lost", status="failed")]
    assert len(fleet.controls(rows)) == charts


def test_types_are_compared_apart():
    rows = [
        *fleet_of(10),
        *(dict(r, name="w" + r["name"], type="wide", focal=400.0) for r in fleet_of(10, 1)),
    ]
    assert {c.type for c in fleet.controls(rows)} == {"ordinary lens 640x480", "wide"}
    assert not outliers(rows)


def test_equal_cameras_are_one_type_whichever_ordinary_model_was_chosen():
    """`--model auto` takes one or the other by noise; a lens of another kind is another type."""
    models = ("opencv4", "opencv5", "brown:radial=1,decentering=0", "pinhole")
    rows = [dict(r, model=models[i % 4]) for i, r in enumerate(fleet_of(40, c0007={"focal": 840.0}))]
    assert list(outliers(rows)) == ["c0007"]
    assert fleet.type_of(dict(rows[0], model="opencv4+opencv5")) == fleet.type_of(rows[0])
    assert fleet.type_of(dict(rows[0], model="kb4")) == "kb4 640x480"
    assert fleet.type_of(dict(rows[0], model="opencv5+kb4")) == "opencv5+kb4 640x480"


def test_equal_values_are_no_outliers():
    assert not outliers([row(f"c{i}") for i in range(10)])


@pytest.mark.parametrize(
    ("tests", "cameras", "limit"), [(1, 10**6, 3.0), (18, 10**6, 3.0), (6000, 10**6, 4.46)]
)
def test_the_limit_of_many_cameras(tests, cameras, limit):
    """Shewhart's 3 where that keeps false alarms below 1 in 20; else the normal quantile for that."""
    assert fleet.limit_for(tests, cameras) == pytest.approx(limit, abs=0.02)


def test_few_cameras_have_a_wider_limit():
    limits = [fleet.limit_for(60, n) for n in (8, 20, 50, 1000)]
    assert limits == sorted(limits, reverse=True) and limits[0] > 10 > limits[1]


def test_ranks_are_by_the_error_on_held_out_views():
    rows = [
        row("a", holdout=0.3),
        row("b", holdout=0.1),
        row("c", status="failed"),
        row("d", holdout=None, rms_point=0.2),
    ]
    assert [r["rank"] for r in fleet.with_fleet(rows, ())] == [3, 1, None, 2]


def test_the_csv_holds_every_row_and_no_formula():
    rows = fleet.with_fleet(
        [row("a"), {"name": "b", "type": "", "status": "failed", "reason": "=1+1\nno board"}], ()
    )
    table = list(csv.DictReader(io.StringIO(fleet.csv_text(rows).decode())))
    assert [r["name"] for r in table] == ["a", "b"]
    assert table[1]["reason"] == "'=1+1 no board" and table[1]["rms_point"] == ""
    assert float(table[0]["focal"]) == 800.0


def test_the_page_shows_what_is_wrong_first_and_escapes_names():
    rows = fleet_of(12, c0007={"focal": 900.0})
    rows.append({"name": "bad", "type": "", "status": "failed", "reason": "<script>alert(1)</script>"})
    charts = fleet.controls(rows)
    text = page.page(fleet.with_fleet(rows, charts), charts)
    assert "<script>" not in text and "&lt;script&gt;" in text
    body = text[text.index("<tbody>") :]
    assert body.index("c0007") < body.index("c0001") and body.index("bad") < body.index("c0001")
    assert text.count("<svg") == len(charts) and "Outliers: c0007 (+" in text
    assert '<a href="c0001.yaml">' in text and "http" not in text.replace("http://www.w3.org", "")


def test_a_long_table_is_cut_on_the_page(monkeypatch):
    monkeypatch.setattr(page, "MOST_ROWS", 5)
    rows = fleet.with_fleet(fleet_of(9), ())
    text = page.page(rows, ())
    assert text.count("<tr>") == 6 and "4 more in summary.csv" in text
