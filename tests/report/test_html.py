"""The page: self-contained, complete, readable, and alive in a real browser."""

import hashlib
import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import SkippedView
from camcal.errors import UsageError
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import of_fit
from camcal.report.charts.base import round_down
from camcal.report.document import document
from camcal.report.html import page as pages
from camcal.report.html import scene
from camcal.report.html.page import code_of, page
from camcal.report.html.pictures import _undistorted
from camcal.solve.refine import How, refine
from camcal.study.cameras import example_camera
from tests.report.browser import needs_chromium, open_page
from tests.solved import camera_of, grid, observe, rig, solved, tilted_poses

STYLE = Path(pages.__file__).parent / "style.css"
VOID = {"meta", "link", "br", "image", "input", "hr", "img"}


@pytest.fixture(scope="module")
def full():
    """A solution with everything that a page can show: a shape, a rejected point, warnings, lost views."""
    rng, truth = np.random.default_rng(1), camera_of()
    poses = tilted_poses(grid(), 12, rng)
    data = observe(truth, poses, grid(), 0.2, rng)
    data = replace(
        data, target={"kind": "checkerboard", "columns": 9, "rows": 6, "square": 1.0, "unit": "square"}
    )
    s = of_fit(refine(truth, poses, data, How(board="bowl")))
    used = np.arange(s.observations.point_count) > 2
    stages = calibrate(data, model="opencv5").stages
    skipped = (SkippedView("lost <b>.jpg", "not_found", "no board & nothing else"),)
    warnings = (CalibrationWarning("poor-coverage", "the points cover <5 %.", "Bring it closer."),)
    return replace(
        s, stages=stages, warnings=warnings,
        observations=replace(s.observations.with_used(used), skipped=skipped),
    )  # fmt: skip


@pytest.fixture(scope="module")
def text(full):
    return page(document(full, command=["checkerboard", "imgs/"], failures=["rms_point 1 exceeds 0.5"]), full)


class Reader(HTMLParser):
    """Checks that tags are balanced, and collects ids, links and what is asked of the network."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.sources, self.images = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        self._note(tag, given)

    def handle_startendtag(self, tag, attrs):
        self._note(tag, dict(attrs))

    def _note(self, tag, given):
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "a":
            self.links.append(given["href"])
        elif "href" in given or "src" in given:
            self.sources.append(given.get("href") or given.get("src"))
        if given.get("role") == "img" or tag == "img":
            self.images.append(given)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def read(text):
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
    return reader


def test_it_is_one_file_without_a_network(text):
    reader = read(text)
    assert [s for s in reader.sources if not s.startswith("data:")] == []
    assert "@import" not in text
    assert set(re.findall(r"url\((.)", text)) <= {"#"}  # parts of the page itself
    # a name space is no address that is asked for
    assert set(re.findall(r"https?://[^\"'\s<)]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_links_and_ids(text):
    reader = read(text)
    assert len(reader.ids) == len(set(reader.ids))
    assert {link[1:] for link in reader.links} <= set(reader.ids)


def test_every_picture_has_words(text):
    reader = read(text)
    assert len(reader.images) >= 12
    for image in reader.images:
        named = image.get("aria-label") or image.get("aria-labelledby")
        assert named, image
        for name in (image.get("aria-labelledby") or "").split():
            assert name in reader.ids


def test_it_says_what_there_is_to_say(text):
    for words in (
        "rms_point 1 exceeds 0.5", "poor-coverage", "the points cover &lt;5 %.", "Bring it closer.",
        "lost &lt;b&gt;.jpg", "no board &amp; nothing else", "Shape of the board", "Distortion field",
        "Projection uncertainty at infinity", "Coverage of the picture", "Radial residuals", "zhang",
        "the comparison was left out", "worst corner",
    ):  # fmt: skip
        assert words.lower() in text.lower(), words
    assert ">FAIL<" in text and ">PASS<" not in text and "<b>" not in text


def test_a_rig_and_a_camera_without_size():
    s = solved("opencv4", views=1, xyz=rig(), shift=0.3)
    bare = replace(s, camera=replace(s.camera, image_size=None))
    found = page(document(bare), bare)
    read(found)
    assert "Tilt of the boards" not in found and "Residuals over the picture" in found


def test_an_evaluated_camera_has_no_uncertainty():
    s = solved(views=5, fix=dict.fromkeys(camera_of().lens.names))
    found = page(document(s), s)
    assert "Projection uncertainty" not in found and "held" in found


def test_what_data_leave_open_is_said_plainly():
    s = solved("pinhole", views=2, tilt=0.0)
    uv = [replace(v, uv=v.uv + 0.0) for v in s.observations.views]
    found = document(replace(s, observations=s.observations.with_views(uv)))
    found["uncertainty"]["maps"][0]["median"] = float("inf")
    assert "do not use it" in page(found, s)


def test_thumbnails(tmp_path, full):
    picture = np.full((480, 640), 128, np.uint8)
    names = [v.id + ".png" for v in full.observations.views]
    for name in names[:3]:
        cv2.imwrite(str(tmp_path / name), picture)
    (tmp_path / names[3]).write_bytes(b"no picture")
    renamed = tuple(names)
    there = [tmp_path / n for n in names[:4]]
    digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in there]
    digests[1] = "0"  # another picture has taken its place
    digests += ["0"] * (len(names) - len(digests))
    files = tuple({"path": f"somewhere/{n}", "sha256": d} for n, d in zip(names, digests, strict=True))
    s = replace(full, observations=replace(full.observations, view_ids=renamed, files=files))
    found = page(document(s), s, str(tmp_path / "report.yaml"))
    assert found.count("data:image/jpeg;base64,") == 4  # two thumbnails, and the preview before and after
    assert f"Not shown, as their files have changed since the calibration: {names[1]}." in found
    assert "Without 10 pictures" in found
    assert 'class="dots lost"' in found  # the rejected points of the first view


def test_jinja2_that_is_missing_is_named(full, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(UsageError, match="jinja2") as raised:
        page(document(full), full)
    assert "camcal[report]" in raised.value.hint


# ---- the scene
def test_the_scene_is_centred_and_nearer_polygons_come_last(full):
    made = scene.shapes(full)
    made += scene.axes_and_scale(made, "square")[0]
    pivot, radius = scene.pivot_and_scale(made)
    places, depth = scene.projected(pivot[None], pivot, radius, 0.3, -0.2)
    assert np.allclose(places, [[scene.WIDTH / 2, scene.HEIGHT / 2]]) and depth == pytest.approx(0)
    order = [int(i) for i in re.findall(r'data-shape="(\d+)"', scene.drawing(full)["polygons"])]
    depths = [
        scene.projected(made[i].points, pivot, radius, np.radians(scene.YAW), np.radians(scene.PITCH))[1]
        for i in order
    ]
    assert depths == sorted(depths, reverse=True)


def test_the_scene_fits_into_its_drawing(full):
    polygons = scene.drawing(full)["polygons"]
    places = np.array(
        [[float(n) for n in p.split(",")] for p in re.findall(r"-?[0-9.]+,-?[0-9.]+", polygons)]
    )
    assert (places >= 0).all() and (places <= [scene.WIDTH, scene.HEIGHT]).all()
    taken = np.ptp(places, axis=0) / [scene.WIDTH, scene.HEIGHT]
    assert taken.max() > 0.6


def test_the_boards_stand_before_the_camera(full):
    boards = [s for s in scene.shapes(full) if s.kind == "board"]
    assert len(boards) == 12
    assert all((b.points[:, 2] > 0).all() for b in boards)
    side = np.linalg.norm(boards[0].points[0] - boards[0].points[1])
    assert side == pytest.approx(8.0, abs=0.01)  # squares, the long side


# ---- contrast
def luminance(colour):
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    c = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(c @ [0.2126, 0.7152, 0.0722])


def variables(block):
    return {k: v if len(v) == 7 else "#" + "".join(2 * c for c in v[1:]) for k, v in
            re.findall(r"--([a-z]+): (#[0-9a-f]{3}(?:[0-9a-f]{3})?);", block)}  # fmt: skip


@pytest.mark.parametrize("mode", ["light", "dark", "print"])
def test_contrast(mode):
    """WCAG 2.1: 4.5 for text, 3 for what else carries a meaning."""
    style = STYLE.read_text(encoding="utf-8")
    blocks = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    found = variables(blocks[["light", "dark", "print"].index(mode)])
    for behind in ("page", "panel"):
        for front, least in (
            ("text", 4.5), ("muted", 4.5), ("accent", 4.5), ("good", 4.5), ("bad", 4.5), ("warn", 4.5),
            ("second", 3), ("faint", 3),
        ):  # fmt: skip
            a, b = sorted((luminance(found[front]), luminance(found[behind])))
            assert (b + 0.05) / (a + 0.05) >= least, (front, behind)


# ---- a real browser
PROBE = """
<pre id="probe"></pre><script>
(function () {
  const svg = document.getElementById("scene"), out = {};
  const points = function () { return svg.querySelector('[data-shape="0"]').getAttribute("points"); };
  const first = points();
  const press = function (key) {
    svg.dispatchEvent(new KeyboardEvent("keydown", { key: key, bubbles: true }));
  };
  press("ArrowLeft"); out.key_turns = points() !== first;
  press("Home"); out.home_returns = points() === first;
  document.querySelector('button[data-turn="up"]').click(); out.button_turns = points() !== first;
  document.querySelector('button[data-turn="reset"]').click(); out.reset_returns = points() === first;
  press("+"); out.nearer = points() !== first;
  out.enabled = document.querySelectorAll("button:disabled").length === 0;
  out.wide = document.documentElement.scrollWidth - window.innerWidth;
  out.asked = performance.getEntriesByType("resource").filter(function (r) {
    return !r.name.startsWith("data:");
  }).length;
  document.getElementById("probe").textContent = JSON.stringify(out);
})();
</script></body>"""


@needs_chromium
@pytest.mark.parametrize("width", [1200, 390])
def test_in_a_browser(tmp_path, text, width):
    made = tmp_path / "page.html"
    made.write_text(text.replace("</body>", PROBE), encoding="utf-8")
    out, said = open_page(made, tmp_path, f"--window-size={width},900", "--dump-dom")
    assert said == []
    found = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', out)[1])
    assert found.pop("wide") <= 0  # nothing sticks out to the side
    assert found.pop("asked") == 0
    assert all(found.values()), found


@needs_chromium
def test_the_browser_would_tell_of_an_error(tmp_path):
    broken = tmp_path / "broken.html"
    broken.write_text("<script>nothing.there()</script>", encoding="utf-8")
    assert any("nothing is not defined" in line for line in open_page(broken, tmp_path, "--dump-dom")[1])


def test_the_camera_to_copy():
    """What the page shows is Python that gives the camera back."""
    s = solved("opencv5")
    said: dict = {}
    exec(code_of(s), said)  # our own text
    k, dist = s.camera.opencv()
    assert np.array_equal(said["K"], k) and np.array_equal(np.ravel(said["dist"]), np.ravel(dist))
    other = replace(s, camera=example_camera("eucm"))
    exec(code_of(other), said)
    assert said["model"] == "eucm" and list(said["parameters"].values()) == other.camera.params.tolist()


@pytest.mark.parametrize("grade", ["good", "doubtful", "wrong"])
def test_the_verdict_shows_the_grade(grade):
    s = solved("opencv4", views=4)
    warnings = () if grade == "good" else (CalibrationWarning("few-views", "few.", "", grade),)
    graded = replace(s, warnings=warnings)
    found = page(document(graded), graded)
    assert f'class="verdict {graded.verdict} {grade}"' in found and f">{grade.upper()}<" in found
    assert re.search(r"made \d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC", found)


def test_the_preview_is_what_a_pinhole_sees():
    """A picture whose gray is a ramp of the pinhole's u: without distortion it is that ramp."""
    camera = example_camera("opencv5")
    width, height = camera.image_size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = camera.unproject(np.c_[u.ravel(), v.ravel()].astype(float))
    ideal = (rays @ camera.matrix.T)[:, 0] / (rays @ camera.matrix.T)[:, 2]
    gray = np.clip(ideal / width * 255, 0, 255).reshape(height, width).astype(np.uint8)
    small, straight = _undistorted(camera, gray)
    wanted = (np.arange(small.shape[1]) + 0.5) / small.shape[1] * 255
    middle = np.s_[small.shape[0] // 4 : -small.shape[0] // 4, small.shape[1] // 4 : -small.shape[1] // 4]
    # a gray level of rounding, one of interpolation
    assert np.abs(straight[middle] - np.broadcast_to(wanted, small.shape)[middle]).max() <= 2


def test_a_view_is_linked_wherever_it_is_shown(full, text):
    """Its bar, its board in space and its row carry its id, by which the script marks them together."""
    for view in full.observations.view_ids:
        named = re.findall(rf'<(rect|polygon|tr)[^>]*data-view="{re.escape(view)}"', text)
        assert {"rect", "polygon", "tr"} <= set(named), view


def test_the_scene_has_axes_and_a_bar_of_a_round_length(text):
    drawn = text.partition('id="scene"')[2].partition("</svg>")[0]
    labels = set(re.findall(r"<text data-label[^>]*>([^<]*)</text>", drawn))
    assert {"x", "y", "z"} < labels
    (bar,) = labels - {"x", "y", "z"}
    assert f"the bar is {bar} long" in text and bar.endswith("squares")


@pytest.mark.parametrize(
    ("most", "length"), [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (0.051, 0.05), (730.0, 500.0)]
)
def test_round_lengths(most, length):
    assert round_down(most) == pytest.approx(length)


@needs_chromium
def test_a_click_on_a_bar_marks_its_board_and_row(text, tmp_path):
    view = re.search(r'<rect[^>]*data-view="([^"]*)"', text).group(1)
    path = tmp_path / "page.html"
    click = f"""<script>document.querySelector('rect[data-view="{view}"]').dispatchEvent(new Event("click"));
    document.title = document.querySelectorAll('.marked[data-view="{view}"]').length;</script></body>"""
    path.write_text(text.replace("</body>", click), encoding="utf-8")
    dom, said = open_page(path, tmp_path, "--dump-dom")
    assert re.search(r"<title>(\d+)</title>", dom).group(1) >= "3" and not said


def test_the_camera_that_the_pictures_name_is_shown(full):
    files = [{"path": f"{i}.jpg", "sha256": "0", "taken": "SONY DSC-HX5V at 4.25 mm"} for i in range(2)]
    files += [{"path": "2.jpg", "sha256": "0", "taken": "another <b>"}, {"path": "3.jpg", "sha256": "0"}]
    named = replace(full, observations=replace(full.observations, files=tuple(files)))
    head = page(document(named), named).partition("</header>")[0]
    assert "taken by SONY DSC-HX5V at 4.25 mm" in head and "another" not in head
    assert "taken by" not in page(document(full), full).partition("</header>")[0]
