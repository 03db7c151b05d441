"""Camera files of camcal and of other programs, by name.

Adding a format = a file that makes a `base.Format`, a line in `FORMATS` and one in `SUMMARIES`; `SUFFIXES`
where the ending of a file's name is clear. The order of `FORMATS` is the order in which a file is tried.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from camcal.data.formats.base import CameraFile

_HERE = "camcal.data.formats."

FORMATS: dict[str, str] = {
    "camcal": _HERE + "camcal:FORMAT",
    "photonvision": _HERE + "photonvision:FORMAT",
    "wpilib": _HERE + "photonvision:WPILIB",
    "camodocal": _HERE + "slam:CAMODOCAL_FORMAT",
    "orbslam": _HERE + "slam:ORBSLAM_FORMAT",
    "boofcv": _HERE + "slam:BOOFCV_FORMAT",
    "basalt": _HERE + "slam:BASALT_FORMAT",
    "opencv": _HERE + "opencv:FORMAT",
    "ros": _HERE + "ros:FORMAT",
    "kalibr": _HERE + "kalibr:FORMAT",
    "mrcal": _HERE + "mrcal:FORMAT",
    "colmap": _HERE + "colmap:FORMAT",
    "bouguet": _HERE + "bouguet:FORMAT",
    "matlab": _HERE + "matlab:FORMAT",
    "metashape": _HERE + "metashape:FORMAT",
    "dbat": _HERE + "dbat:FORMAT",
    "micmac": _HERE + "micmac:FORMAT",
    "visp": _HERE + "visp:FORMAT",
    "pix4d": _HERE + "pix4d:FORMAT",
    "calibio": _HERE + "calibio:FORMAT",
    "meshroom": _HERE + "meshroom:FORMAT",
    "qualisys": _HERE + "qualisys:FORMAT",
    "lcp": _HERE + "lcp:FORMAT",
    "lensfun": _HERE + "lensfun:FORMAT",
    "gyroflow": _HERE + "gyroflow:FORMAT",
    "usd": _HERE + "usd:FORMAT",
    "blender": _HERE + "blender:FORMAT",
    "realitycapture": _HERE + "realitycapture:FORMAT",
    "openmvg": _HERE + "openmvg:FORMAT",
    "opensfm": _HERE + "opensfm:FORMAT",
    "nerfstudio": _HERE + "nerfstudio:FORMAT",
    "caliscope": _HERE + "anipose:CALISCOPE",
    "pose2sim": _HERE + "anipose:POSE2SIM",
    "anipose": _HERE + "anipose:FORMAT",
    "dlt": _HERE + "dlt:FORMAT",
    "zhang": _HERE + "zhang:FORMAT",
}

SUMMARIES: dict[str, str] = {
    "camcal": "camcal's own report (YAML, JSON): any lens, rigs",
    "opencv": "OpenCV's FileStorage (YAML, XML, JSON), 4.x and 5.0; stereo pairs",
    "camodocal": "camodocal YAML of VINS: PINHOLE, MEI, KANNALA_BRANDT",
    "orbslam": "ORB-SLAM3 settings (YAML): PinHole, KannalaBrandt8",
    "boofcv": "BoofCV intrinsics (YAML), stereo pairs read",
    "basalt": "Basalt calibration.json: ds, eucm, ucm, kb4; rigs",
    "ros": "ROS camera_info (YAML, ini)",
    "kalibr": "Kalibr camchain (YAML): pinhole, omni, ds, eucm; rigs",
    "mrcal": "mrcal .cameramodel, with its pose",
    "colmap": "COLMAP cameras.txt and cameras.bin, many cameras; rigs.txt",
    "bouguet": "Bouguet's toolbox: Calib_Results.m and .mat; stereo pairs",
    "matlab": "MATLAB cameraParameters as a struct (.mat); stereo pairs",
    "metashape": "Agisoft Metashape: exported cameras and lens files (XML)",
    "dbat": "DBAT camera XML, millimetres; its distortion is refitted",
    "micmac": "MicMac AutoCal XML, radial about a distortion centre",
    "visp": "ViSP camera XML: one radial term",
    "pix4d": "Pix4D calibrated_camera_parameters.txt, with poses",
    "photonvision": "PhotonVision calibration JSON",
    "wpilib": "WPILib camera calibration JSON",
    "calibio": "calib.io Calibrator JSON, many cameras",
    "meshroom": "Meshroom (AliceVision) cameras.sfm: one focal length",
    "qualisys": "Qualisys calibration XML, 1/64 px; rigs",
    "lcp": "Adobe lens profile (.lcp): perspective, fisheye",
    "lensfun": "LensFun database XML: poly3, poly5; ptlens refitted",
    "gyroflow": "Gyroflow lens profile (JSON): fisheye or polynomial",
    "usd": "USD camera with OpenCV's lens (Isaac Sim, Omniverse)",
    "blender": "Blender, motion tracking: camera preset (.py)",
    "realitycapture": "RealityCapture XMP (.xmp): brown3 to brown4t2",
    "openmvg": "OpenMVG sfm_data.json: one focal length",
    "opensfm": "OpenSfM and ODM JSON: brown, fisheye; many cameras",
    "nerfstudio": "transforms.json of nerfstudio and instant-ngp",
    "caliscope": "caliscope camera_array.toml: rigs",
    "pose2sim": "Pose2Sim Calib.toml: rigs",
    "anipose": "anipose calibration.toml: rigs",
    "dlt": "11 DLT coefficients of each camera (DLTdv, Argus, StereoMorph)",
    "zhang": "Zhang's text: alpha gamma beta u0 v0, k1 k2",
}

#: endings that belong to one format; `.yaml` is camcal's report
SUFFIXES: dict[str, str] = {
    ".yaml": "camcal",
    ".yml": "opencv",
    ".xml": "opencv",
    ".json": "opencv",
    ".cameramodel": "mrcal",
    ".bin": "colmap",
    ".m": "bouguet",
    ".mat": "matlab",
    ".ini": "ros",
    ".toml": "anipose",
    ".sfm": "meshroom",
    ".lcp": "lcp",
    ".usda": "usd",
    ".py": "blender",
    ".xmp": "realitycapture",
}


def format_of(path: str | os.PathLike) -> str | None:
    """The format with this file name extension, or None if it is ambiguous or unknown."""
    return SUFFIXES.get(Path(path).suffix.lower())


def read(path: str | os.PathLike, name: str | None = None) -> CameraFile:
    """Read a camera file of any format; see `camcal.data.formats.files.read`."""
    from camcal.data.formats import files

    return files.read(path, name)


def write(
    path: str | os.PathLike, cameras: CameraFile, name: str | None = None, force: bool = False
) -> Mapping[str, Any]:
    """Write cameras in a format; see `camcal.data.formats.files.write`."""
    from camcal.data.formats import files

    return files.write(path, cameras, name, force)
