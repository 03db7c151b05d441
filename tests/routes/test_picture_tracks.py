"""Self-calibration from pictures: tracks of SIFT matches, what contradicts itself, what is refused."""

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.detect.matches import Points, points_of
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.routes.picture_tracks import CONTRAST, MOST_TRACKS, _Joined, _pairs, _tracks, of_pictures
from tests.shared_data import DATA, needs_data

CHAIR = DATA / "selfcalib_chair"


def points(count, seed=0):
    rng = np.random.default_rng(seed)
    return Points(
        rng.uniform(0, 500, (count, 2)), rng.normal(size=(count, 128)).astype(np.float32), np.ones(count)
    )


def textured(seed=0, size=(640, 480)):
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.uniform(0, 255, (60, 80)).astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
    return np.clip(coarse + rng.normal(0, 3, size[::-1]), 0, 255).astype(np.uint8)


def test_matches_join_to_tracks_and_contradictions_are_left_out():
    found = [points(5, s) for s in range(3)]
    joined = _Joined(len(p) for p in found)
    joined.join(0, 1, np.array([[0, 0], [1, 1], [2, 2]]))
    joined.join(1, 2, np.array([[0, 3], [2, 2]]))
    joined.join(0, 2, np.array([[2, 4]]))  # point 2 of picture 0 is now two points of picture 2
    tracks, count = _tracks(joined, found)
    assert count == 2
    by_track = {tuple(sorted(tracks.view[tracks.point == t].tolist())) for t in range(count)}
    assert by_track == {(0, 1, 2), (0, 1)}
    row = np.flatnonzero(tracks.view == 2)
    np.testing.assert_array_equal(tracks.uv[row[0]], found[2].uv[3])


def test_the_longest_tracks_of_a_picture_are_kept():
    count = MOST_TRACKS + 50
    found = [points(count, s) for s in range(3)]
    joined = _Joined(count for _ in found)
    every = np.stack([np.arange(count)] * 2, 1)
    joined.join(0, 1, every)
    joined.join(1, 2, every[:20])
    tracks, kept = _tracks(joined, found)
    assert kept == MOST_TRACKS and (tracks.view == 2).sum() == 20


def test_all_pairs_of_few_pictures_and_some_of_many():
    assert len(_pairs([points(50)] * 6)) == 15
    many = _pairs([points(60, s) for s in range(20)])
    assert 20 <= len(many) < 190 and all((i, i + 1) in many for i in range(19))


@needs_data
def test_a_chair_in_pictures(tmp_path):
    """COLMAP finds 450.7 px from all 21 pictures."""
    pictures = [str(CHAIR / f"image{i:03d}.jpg") for i in range(0, 10)]
    out = tmp_path / "tracks.csv"
    args = ["selfcalib", *pictures, "-m", "pinhole", "--save-tracks", str(out), "--format", "json"]
    done = CliRunner().invoke(camcal, args)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    f = found["camera"]["parameters"]["fx"]
    # SIFT's tracks, ten pictures: 2 % as for the tracks of the file
    assert abs(f["value"] - 450.7) < 9 and f["sigma"] < 5
    assert found["camera"]["image_size"] == [640, 480]
    again = CliRunner().invoke(
        camcal, ["selfcalib", str(out), "--image-size", "640x480", "-m", "pinhole", "--format", "json"]
    )
    assert abs(json.loads(again.stdout)["camera"]["parameters"]["fx"]["value"] - f["value"]) < 0.1


def test_pictures_turned_about_the_centre_are_refused(tmp_path):
    """A rotation alone gives no point a place."""
    k = np.array([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1.0]])
    for i in range(4):
        h = k @ rotations.exp(np.array([0.02 * i, 0.06 * i, 0.03 * i])) @ np.linalg.inv(k)
        cv2.imwrite(str(tmp_path / f"{i}.png"), cv2.warpPerspective(textured(), h, (640, 480)))
    done = CliRunner().invoke(camcal, ["selfcalib", str(tmp_path), "-m", "pinhole"])
    assert isinstance(done.exception, EstimationError) and "critical" in str(done.exception)


def test_pictures_without_a_common_scene_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), textured(1))
    with pytest.raises(DataError, match="pictures given: 1; 2 to 100"):
        of_pictures([tmp_path / "a.png"])
    (tmp_path / "b.png").write_text("no picture")
    with pytest.raises(DataError, match="cannot read") as caught:
        of_pictures([tmp_path])
    assert "view,point,u,v" in caught.value.hint
    cv2.imwrite(str(tmp_path / "b.png"), textured(2))
    with pytest.raises(DataError, match="no two of 2 pictures"):
        of_pictures([tmp_path])
    cv2.imwrite(str(tmp_path / "c.png"), textured(2)[:400])
    with pytest.raises(DataError, match="640x480 is needed"):
        of_pictures([tmp_path])


@pytest.mark.parametrize("size", [2.0, 4.0])
def test_points_of_a_picture_are_where_they_are(size):
    """cv2 by default places all points .25 px too far to the right, and as many too low."""
    at = np.array([60.3, 40.7])
    v, u = np.mgrid[:90, :120]
    spot = 40 + 180 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * size**2))
    found = points_of(np.rint(spot).astype(np.uint8))
    assert len(found) and np.abs(found.uv[0] - at).max() < 0.05


def test_a_large_picture_is_reduced():
    """Points are in px of the whole picture: the middle of a spot stays where it is."""
    at = np.array([60.3, 40.7])
    v, u = np.mgrid[:90, :121]
    spot = np.rint(40 + 180 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / 72)).astype(np.uint8)
    whole, reduced = points_of(spot, longest=121), points_of(spot, longest=60)
    assert np.abs(reduced.uv[0] - at).max() < 0.1 and not np.array_equal(whole.uv, reduced.uv)
    np.testing.assert_array_equal(whole.uv, points_of(spot).uv)
    assert reduced.sizes[0] == pytest.approx(whole.sizes[0], rel=0.1)


def test_faint_points_are_used():
    v, u = np.mgrid[:90, :120]
    spot = np.rint(120 + 16 * np.exp(-((u - 60) ** 2 + (v - 41) ** 2) / 32)).astype(np.uint8)
    assert len(points_of(spot, contrast=CONTRAST)) and not len(points_of(spot))
