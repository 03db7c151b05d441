"""Files of points that other programs wrote, by name.

Adding one = a file with `sniff` and `read`, a line in `POINT_FILES` and one in `SUMMARIES`.
"""

from __future__ import annotations

_HERE = "camcal.data.point_files."

POINT_FILES: dict[str, str] = {
    "vnl": _HERE + "vnl:READER",
    "photonvision": _HERE + "observations:PHOTONVISION",
    "opencv": _HERE + "observations:OPENCV",
    "gcp": _HERE + "gcp:READER",
}

SUMMARIES: dict[str, str] = {
    "vnl": "corners of mrcal and mrgingham (.vnl)",
    "photonvision": "observations in PhotonVision's calibration JSON",
    "opencv": "image_points and grid_points of OpenCV's calibration sample",
    "gcp": "gcp_list.txt of OpenDroneMap",
}
