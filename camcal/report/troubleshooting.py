"""Generator of docs/troubleshooting.md: every warning by its code, with its usual cause and remedy.

`python -m camcal.report.troubleshooting > docs/troubleshooting.md` renews it. What each code means is taken from the
table of docs/report.md, so that it stands in one position.
"""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"

#: code -> (what usually causes it, what to do)
REMEDIES: dict[str, tuple[str, str]] = {
    "single-view": (
        "One picture of a flat board.",
        "Take 10 to 20 pictures with the board tilted to several sides, or hold what is known: "
        "`--fix fx=VALUE,cx=VALUE,cy=VALUE`.",
    ),
    "weak-geometry": (
        "Views that differ only by shifts, or by rotations about the optical axis.",
        "Tilt the board by 20 to 40 degrees, to the left, right, up and down; `camcal next REPORT` suggests poses.",
    ),
    "few-views": (
        "Too few pictures, or many in which the board was not found.",
        "Run `camcal doctor IMAGES`, then take more pictures.",
    ),
    "fronto-parallel-views": (
        "The board was parallel to the image in all pictures.",
        "Tilt it: otherwise focal length and distance cannot be separated.",
    ),
    "parallel-views": ("All pictures with the same tilt.", "Tilt the board in other directions."),
    "duplicate-views": (
        "A film, or consecutive pictures without movement.",
        "Remove repetitions: they count as one.",
    ),
    "repeated-view": (
        "Two pictures of the same pose.",
        "Nothing; the standard deviations count both.",
    ),
    "mirrored-views": (
        "A board that looks the same from behind, a mirror, or corners numbered from the other end.",
        "Check those pictures; give points their ids.",
    ),
    "mirrored-picture": (
        "A picture flipped by the camera's software, or corners numbered from the other end.",
        "Turn off the flipping, or remove those pictures.",
    ),
    "rejected-mirror-image": ("As `mirrored-picture`.", "As above; camcal did not use these views."),
    "rejected-view": (
        "A board that was detected wrongly, or that moved.",
        "Check the picture; no action is needed if it is bad.",
    ),
    "other-board": (
        "Pictures of several boards in one folder.",
        "Calibrate each board's pictures separately, or give `--target`.",
    ),
    "mismatched-points": (
        "A row or column of the table is shifted, or points are exchanged.",
        "Check the ids of those points.",
    ),
    "rejected-points": (
        "Wrong corners: glare, shadows, hands over the board.",
        "Check the pictures that the report names.",
    ),
    "undetermined-parameters": (
        "More parameters than the data determine: a large lens model, a principal point from few tilts.",
        "Use a smaller model (`-m opencv4`) or `--fix NAME`, or take the pictures that `camcal next` suggests.",
    ),
    "weak-parameters": (
        "Little tilt, or little of the picture covered.",
        "Take more pictures with tilt: `camcal next REPORT`.",
    ),
    "correlated-parameters": (
        "Two parameters have the same effect on these pictures, such as fx and the distance.",
        "Nothing if the projection uncertainty is small (`camcal uncertainty`); otherwise take pictures "
        "with more tilt.",
    ),
    "points-outside-model": (
        "A model that cannot represent this lens.",
        "Use `-m auto`, or a wide-lens model such as `kb4`.",
    ),
    "pictures-blurred": (
        "Out of focus.",
        "Focus at the distance of the board, then keep the focus fixed.",
    ),
    "pictures-motion": ("The board or the camera moved.", "Use a tripod, more light, or a shorter exposure."),
    "pictures-overexposed": (
        "White paper at full scale: edges of white squares move outwards.",
        "Use a shorter exposure.",
    ),
    "pictures-flat": ("Little contrast.", "Use more light, and a target in true black and white."),
    "pictures-rough": (
        "Noise from high gain, compression, or a textured print.",
        "Use more light, and no compression.",
    ),
    "pictures-small": ("The board is far away.", "Move closer: the board should fill half of the picture."),
    "fold-in-image": (
        "A polynomial without data in the corners of the picture.",
        "Take pictures with the board in the corners, or use a smaller model or a wide-lens model.",
    ),
    "image-circle": (
        "The picture's corners lie outside a fisheye's image circle.",
        "Nothing: no point can lie there.",
    ),
    "poor-coverage": (
        "The board was only in the middle.",
        "Take pictures with the board at the sides and in the corners.",
    ),
    "points-outside-image": (
        "A wrong `--image-size`, u and v exchanged, or pictures that were resized.",
        "Check the size.",
    ),
    "few-points": (
        "Too few data for the number of unknowns.",
        "Add points or views, use a smaller model, or `--fix` parameters.",
    ),
    "outliers": (
        "Wrong points that are used.",
        "Use `--robust auto`, and check the points that the report names.",
    ),
    "large-residuals": (
        "A wrong board size, wrong correspondences, a lens that the model cannot follow.",
        "Check `--board`; try `-m auto`; `camcal doctor REPORT`.",
    ),
    "systematic-residuals": ("The lens model is too small.", "`-m auto`, or `camcal select DATA`."),
    "board-not-flat": (
        "Paper on cardboard, a printer that stretches.",
        "Use `--board-shape auto`, or mount the print on glass or aluminium.",
    ),
    "shifted-group": (
        "A column, row or mark mistaken for its neighbour, or measured wrongly.",
        "Check the named points; remove them and compare the two cameras (`camcal compare`).",
    ),
    "circle-centres": (
        "Centres of a circle grid found as the centroids of their images (`cv2.findCirclesGrid`).",
        "Use `camcal images --target circles:COLUMNSxROWS`, which corrects for it, or corners instead of circles.",
    ),
    "noise-by-radius": (
        "A lens that is less sharp towards its border.",
        "Give a column `sigma` with the points; use a smaller aperture.",
    ),
    "heavy-tailed-residuals": (
        "Some bad pictures or points among good ones.",
        "Use `--robust auto`, and check the worst views.",
    ),
    "light-tailed-residuals": (
        "Errors that are not noise: rounding, interpolation, a repeated pattern.",
        "Unrounded points.",
    ),
    "rounded-coordinates": ("Points clicked or stored in whole pixels.", "Store sub-pixel coordinates."),
    "held-at-start": (
        "`--fix fx` without a value.",
        "Give `--fix fx=VALUE`, or a camera whose value is held: `--start-camera FILE`, or `--cameras "
        "NAME=FILE` for a rig.",
    ),
    "boards-as-designed": (
        "One of several boards is in few pictures.",
        "Nothing if that board is flat; otherwise take three or more pictures of it.",
    ),
    "cameras-out-of-step": (
        "A camera started later, or lost a frame.",
        "Shift its pictures by the reported number of views; use a common trigger.",
    ),
    "few-shared-instants": (
        "The cameras rarely see the board at the same time.",
        "Hold the board where both cameras see it.",
    ),
    "loose-relative-pose": (
        "Few shared instants, or a small board far away.",
        "Take more shared instants with tilt, at a smaller distance.",
    ),
    "views-disagree": (
        "A lens, focus or board that changed between the pictures; a model that is too small.",
        "Fix focus and zoom, switch stabilisation off; try `-m auto` and `--board-shape auto`.",
    ),
    "zoom-or-refocus": (
        "The zoom or autofocus changed between the pictures.",
        "Fix both; calibrate the pictures before and after separately, or use `camcal track`.",
    ),
    "several-cameras": (
        "Pictures of two cameras in one folder.",
        "Calibrate each separately, or together with `camcal rig`.",
    ),
    "resized-pictures": (
        "Some of the pictures were exported at a smaller size.",
        "Use the original pictures of the camera.",
    ),
    "cropped-pictures": ("Some of the pictures were cropped.", "Use the uncropped pictures."),
    "turned-pictures": (
        "Some of the pictures were rotated by 180 degrees.",
        "Use them in the orientation of the sensor.",
    ),
    "principal-point-moves": (
        "A stabiliser in lens, sensor or software; a loose lens.",
        "Switch stabilisation off; fasten the lens.",
    ),
    "rolling-shutter": (
        "Board or camera moved while the rows were read.",
        "Use a tripod, or a global shutter.",
    ),
    "image-size": (
        "A wrong `--image-size`, or pictures resized after the points were found.",
        "Check the size.",
    ),
    "data-exchanged": (
        "Exchanged columns, rows of another board or view, or coordinates in another frame.",
        "Make the change that the message names, and check how the table was created.",
    ),
    "does-not-fit": (
        "A focus or zoom different from the calibration, another camera, resized pictures, or a wrong board.",
        "Check which camera took the pictures and how; otherwise calibrate again.",
    ),
    "not-converged": (
        "A model that the data barely determine.",
        "Use a smaller model, or another `--start`.",
    ),
    "hand-eye-convention": (
        "Angles in another order or unit than was requested.",
        "Use the convention that the message names.",
    ),
    "hand-eye-outliers": (
        "Poses read while the robot moved, or pictures of another pose.",
        "Check the named pairs.",
    ),
    "hand-eye-few-poses": ("Too few poses.", "Take ten or more poses, rotated about at least two axes."),
    "hand-eye-unmatched": (
        "Names of pictures and poses do not agree.",
        "Use the report's view names for the poses.",
    ),
    "hand-eye-weak-direction": (
        "Rotations about nearly a single axis.",
        "Add the poses that the report lists under `next`.",
    ),
    "hand-eye-noise-at-zero": (
        "A robot whose poses are more accurate than those from the pictures, or few poses.",
        "Nothing; with more poses, smaller noise can be detected.",
    ),
    "hand-eye-scale": ("A wrong `--square`, or poses in another unit.", "Check both lengths."),
    "several-poses": (
        "A flat, small or distant target: two poses look alike.",
        "Use points off the plane, or a picture from a smaller distance.",
    ),
    "mirrored-points": (
        "v counted upwards, u and v exchanged, or a left-handed frame of the points.",
        "Use v = height - 1 - v, exchange u and v, or negate one axis.",
    ),
    "no-redundancy": ("As many points as unknowns.", "Add a point; otherwise errors cannot be detected."),
    "uncertain-distance": (
        "Points close together as seen from the camera, or cameras close together.",
        "Use points that are farther apart, a smaller distance, or a longer baseline.",
    ),
    "images-do-not-fit": (
        "Points and images in another order, images in another unit, v counted upwards, or the wrong camera.",
        "Check which points, images and cameras belong together.",
    ),
    "undetermined-points": (
        "One image of a point, or parallel rays.",
        "Use one more camera, or a longer baseline.",
    ),
    "outlier-images": (
        "A point that was mistaken for another one in some picture.",
        "Check the cameras that the table names.",
    ),
    "lines-left-out": ("Curves of the scene.", "Nothing if they really are curved."),
    "one-direction": ("All lines have the same direction.", "Take pictures with lines in other directions."),
    "undetermined": ("Lines do not determine these parameters.", "`--fix` them, or use another model."),
    "principal-point-assumed": ("The data leave it undetermined.", "Give it: `--fix cx=VALUE,cy=VALUE`."),
    "lines-bent": (
        "A lens with distortion, treated as a pinhole camera.",
        "Use `-m division:1`, or undistort the picture first.",
    ),
    "views-left-out": ("Views that share too few points.", "More tracks."),
    "points-twice": ("Two images of a point in one view.", "Give each point its own id."),
    "instants-left-out": (
        "Markers that fewer than two cameras see, or wrong tracks.",
        "`wand.left_out` names the images; track the markers again there.",
    ),
    "few-matches": (
        "Little texture, or pictures of different scenes.",
        "Use scenes with more texture, and several pairs.",
    ),
    "vertical-disparity": (
        "The cameras have moved relative to each other, a poor calibration, or pictures that were not "
        "taken at the same time.",
        "Check the trigger; calibrate the rig again.",
    ),
}
#: of the routes, whose pages have no table of codes
FOUND = {
    "several-poses": "`camcal pose`: more than one pose fits",
    "mirrored-points": "`camcal pose`: the points fit only with v counted upwards",
    "no-redundancy": "`camcal pose`: there are no residuals to judge the pose by",
    "uncertain-distance": "`camcal pose`, `camcal triangulate`: the 95 % interval of a distance exceeds 20 % to a side",
    "images-do-not-fit": "`camcal pose`, `camcal triangulate`: residuals of more than 5 % of the spread of the images",
    "undetermined-points": "`camcal triangulate`: points without a position",
    "outlier-images": "`camcal triangulate`: images that disagree with the others of their point",
    "lines-left-out": "`camcal lines`: lines that are not straight compared with the others",
    "one-direction": "`camcal lines`: all lines have one direction",
    "undetermined": "`camcal lines`: parameters that lines do not determine",
    "principal-point-assumed": "`camcal lines`, `scene`, `selfcalib`, `wand`: the image centre is assumed",
    "lines-bent": "`camcal scene`: lines are bent, and with distortion the focal length is outside its interval",
    "views-left-out": "`camcal selfcalib`: views that could not be added",
    "points-twice": "`camcal selfcalib`, `camcal wand`: a point twice in one view",
    "instants-left-out": "`camcal wand`: instants that are not used",
    "few-matches": "`camcal evaluate --natural`: fewer than 50 matches",
    "vertical-disparity": "`camcal evaluate --natural`: points lie farther from their rows than noise explains",
}

HEAD = """\
# Troubleshooting by warning code

This page is generated: `python -m camcal.report.troubleshooting > docs/troubleshooting.md`.

Each warning of a report has a `code`, a `severity`, a message with the figures and a hint. `camcal doctor REPORT`
ranks the findings by the gain of their remedies. The message of an error that ends a run says what was found, what
was needed and what to try; exit codes are in the [README](../README.md).

| code | what was found | usual cause | what to do |
|---|---|---|---|
"""


def page() -> str:
    """The whole page as Markdown; KeyError for a code without a known remedy."""
    rows = [
        f"| `{code}` | {found} | {' | '.join(REMEDIES[code])} |" for code, found in found_by_code().items()
    ]
    return HEAD + "\n".join(rows) + "\n"


def found_by_code() -> dict[str, str]:
    """Each code with its meaning: the rows of the table in docs/report.md, then those of the routes."""
    text = (DOCS / "report.md").read_text(encoding="utf-8").split("\n## Warnings\n")[1].split("\n## ")[0]
    made: dict[str, str] = {}
    for codes, found in re.findall(r"^\| (`[^|]+`) \| ([^|]+) \|$", text, re.MULTILINE):
        made |= dict.fromkeys(re.findall(r"`([a-z-]+)`", codes), found)
    return made | FOUND


if __name__ == "__main__":
    print(page(), end="")
