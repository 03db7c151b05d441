"""Readers of point files written by other programs, by name.

Adding one = a file with `sniff` and `read`, a line in `POINT_FILES` and one in `SUMMARIES`.
"""

from __future__ import annotations

_HERE = "camcal.data.point_files."

POINT_FILES: dict[str, str] = {
    "vnl": _HERE + "vnl:READER",
    "orpc": _HERE + "deltille:READER",
    "tartan": _HERE + "tartan:MATLAB",
    "tartan-dataset": _HERE + "tartan:DATASET",
    "calibio": _HERE + "calibio:READER",
    "photonvision": _HERE + "observations:PHOTONVISION",
    "opencv": _HERE + "observations:OPENCV",
    "gcp": _HERE + "gcp:READER",
    "photomodeler": _HERE + "photomodeler:READER",
}

SUMMARIES: dict[str, str] = {
    "vnl": "corners of mrcal and mrgingham (.vnl)",
    "orpc": "corners of deltille and BabelCalib (.orpc, with its .dsc and .tp)",
    "tartan": "corners.mat of TartanCalib and BabelCalib, with board.mat",
    "tartan-dataset": "data set of TartanCalib (.bin)",
    "calibio": "detections in the JSON of calib.io's Calibrator",
    "photonvision": "observations in PhotonVision's calibration JSON",
    "opencv": "image_points and grid_points of OpenCV's calibration sample",
    "gcp": "gcp_list.txt of OpenDroneMap",
    "photomodeler": "text export of PhotoModeler (DBAT)",
}
