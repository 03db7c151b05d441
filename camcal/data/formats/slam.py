"""Camera files of visual SLAM: camodocal (VINS), Basalt, ORB-SLAM and BoofCV."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, number, unknown
from camcal.data.formats.colmap import of_quaternion, to_quaternion
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import camera_of, choose, fisheye, polynomial, unified
from camcal.model.pose import Pose

# camodocal, as VINS-Mono and VINS-Fusion read it

CAMODOCAL = ("KANNALA_BRANDT", "MEI", "PINHOLE")


def _read_camodocal(source: Source) -> CameraFile:
    found = source.mapping
    kind = found["model_type"]
    if kind not in CAMODOCAL:
        raise unknown("model_type", kind, CAMODOCAL)
    size = image_size(found["image_width"], found["image_height"])
    p = found["projection_parameters"]

    def values(entry: Mapping[str, Any], names: str) -> list[float]:
        return floats([entry[n] for n in names.split()]).tolist()

    if kind == "KANNALA_BRANDT":
        camera = fisheye((*values(p, "mu mv u0 v0"), 0.0), size, values(p, "k2 k3 k4 k5"))
    else:
        d = values(found["distortion_parameters"], "k1 k2 p1 p2")
        if kind == "MEI":
            xi = values(found["mirror_parameters"], "xi")[0]
            camera = unified((*values(p, "gamma1 gamma2 u0 v0"), 0.0), size, xi, d)
        else:
            camera = polynomial((*values(p, "fx fy cx cy"), 0.0), size, d[:2], d[2:])
    return CameraFile((NamedCamera(str(found.get("camera_name") or "camera"), camera),))


def _write_camodocal(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, ("opencv4", "kb4", "mei"), "a camodocal file")
    width, height = named.camera.image_size
    matrix = [terms.fx, terms.fy, terms.cx, terms.cy]
    bend = dict(zip(("k1", "k2", "p1", "p2"), terms.get("k1", "k2", "p1", "p2"), strict=True))
    if terms.kind == "fisheye":
        own = dict(zip(("k2", "k3", "k4", "k5"), terms.get("k1", "k2", "k3", "k4"), strict=True))
        own |= dict(zip(("mu", "mv", "u0", "v0"), matrix, strict=True))
        kind, parts = "KANNALA_BRANDT", {"projection_parameters": own}
    elif terms.kind == "unified":
        own = dict(zip(("gamma1", "gamma2", "u0", "v0"), matrix, strict=True))
        kind = "MEI"
        parts = {
            "mirror_parameters": {"xi": terms.get("xi")[0]},
            "distortion_parameters": bend,
            "projection_parameters": own,
        }
    else:
        own = dict(zip(("fx", "fy", "cx", "cy"), matrix, strict=True))
        kind, parts = "PINHOLE", {"distortion_parameters": bend, "projection_parameters": own}
    name = "".join(c if c.isalnum() else "_" for c in named.name)
    out = f"%YAML:1.0\n---\nmodel_type: {kind}\ncamera_name: {name}\nimage_width: {width}\nimage_height: {height}\n"
    for part, entries in parts.items():
        out += f"{part}:\n" + "".join(f"   {n}: {number(v)}\n" for n, v in entries.items())
    return out


CAMODOCAL_FORMAT = Format(
    "camodocal",
    "a camodocal file",
    (".yaml", ".yml"),
    lambda source: (
        source.kind == "yaml" and "model_type" in source.mapping and "projection_parameters" in source.mapping
    ),
    _read_camodocal,
    _write_camodocal,
    ("opencv4", "kb4", "mei"),
    order="PINHOLE fx fy cx cy, k1 k2 p1 p2; MEI xi, k1 k2 p1 p2, gamma1 gamma2 u0 v0; "
    "KANNALA_BRANDT k2 to k5, mu mv u0 v0",
    traps=(
        "KANNALA_BRANDT numbers its coefficients from k2: its k2 to k5 are k1 to k4 of OpenCV's fisheye model.",
    ),
    source="camodocal, src/camera_models; VINS-Fusion, config",
)

# Basalt

#: basalt's camera_type -> camcal's model and the terms in basalt's order after fx fy cx cy
BASALT = {
    "pinhole": ("pinhole", ()),
    "kb4": ("kb4", ("k1", "k2", "k3", "k4")),
    "eucm": ("eucm", ("alpha", "beta")),
    "ucm": ("ucm", ("alpha",)),
    "ds": ("ds", ("xi", "alpha")),
}


def _read_basalt(source: Source) -> CameraFile:
    found = source.mapping["value0"]
    sizes = found["resolution"]
    poses = found.get("T_imu_cam") or [None] * len(found["intrinsics"])
    cameras = []
    for i, (entry, size, pose) in enumerate(zip(found["intrinsics"], sizes, poses, strict=True)):
        kind, p = entry["camera_type"], entry["intrinsics"]
        if kind not in BASALT:
            raise unknown("camera_type", kind, BASALT)
        spec, names = BASALT[kind]
        matrix = floats([p[n] for n in ("fx", "fy", "cx", "cy")])
        camera = camera_of(spec, (*matrix, 0.0), image_size(*size), {n: p[n] for n in names})
        placed = None
        if pose is not None:
            turn = of_quaternion(floats([pose[n] for n in ("qw", "qx", "qy", "qz")]))
            placed = Pose(turn, floats([pose[n] for n in ("px", "py", "pz")])).inverse()
        cameras.append(NamedCamera(f"cam{i}", camera, placed))
    return CameraFile(
        tuple(cameras), ("IMU and vignetting calibration are left out",) * ("calib_accel_bias" in found)
    )


def _write_basalt(cameras: CameraFile, suffix: str) -> str:
    intrinsics, poses, sizes = [], [], []
    for named in cameras.cameras:
        spec, terms = choose(named.camera, tuple(s for s, _ in BASALT.values()), "a Basalt file")
        kind = next(k for k, (s, _) in BASALT.items() if s == spec)
        names = BASALT[kind][1]
        values = dict(zip(("fx", "fy", "cx", "cy"), (terms.fx, terms.fy, terms.cx, terms.cy), strict=True))
        intrinsics.append(
            {"camera_type": kind, "intrinsics": values | dict(zip(names, terms.get(*names), strict=True))}
        )
        placed = (named.pose or Pose.identity()).inverse()
        w, x, y, z = to_quaternion(placed.rotation).tolist()
        px, py, pz = np.asarray(placed.translation).tolist()
        poses.append({"px": px, "py": py, "pz": pz, "qx": x, "qy": y, "qz": z, "qw": w})
        sizes.append(list(named.camera.image_size))
    return dump({"value0": {"T_imu_cam": poses, "intrinsics": intrinsics, "resolution": sizes}})


BASALT_FORMAT = Format(
    "basalt",
    "a Basalt file",
    (".json",),
    lambda source: source.kind == "json" and has(source.mapping.get("value0"), "intrinsics", "resolution"),
    _read_basalt,
    _write_basalt,
    tuple(s for s, _ in BASALT.values()),
    several=True,
    poses=True,
    order="fx fy cx cy, then by name; T_imu_cam: position and quaternion of the camera in the frame of the IMU",
    traps=("T_imu_cam is the pose of the camera in the IMU's frame, the inverse of cam_from_rig.",),
    source="Basalt, documentation of the calibration",
)

# ORB-SLAM3

ORB_TYPES = ("PinHole", "KannalaBrandt8")


def _read_orbslam(source: Source) -> CameraFile:
    found = source.mapping
    kind = found.get("Camera.type", "PinHole")
    if kind not in ORB_TYPES:
        raise unknown("Camera.type", kind, ORB_TYPES)
    at = "Camera1" if "Camera1.fx" in found else "Camera"
    size = image_size(found["Camera.width"], found["Camera.height"])

    def value(name: str) -> float:
        return float(floats(found.get(f"{at}.{name}", 0.0), 1, name)[0])

    matrix = (*floats([found[f"{at}.{n}"] for n in ("fx", "fy", "cx", "cy")]), 0.0)
    note = ("the second camera of the pair is left out",) * ("Camera2.fx" in found)
    if kind == "KannalaBrandt8":
        return CameraFile.one(fisheye(matrix, size, [value(f"k{i}") for i in (1, 2, 3, 4)]), "camera", *note)
    k = [value("k1"), value("k2"), value("k3")]
    return CameraFile.one(
        polynomial(matrix, size, k if k[2] else k[:2], [value("p1"), value("p2")]), "camera", *note
    )


def _write_orbslam(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, ("opencv5", "kb4"), "an ORB-SLAM3 file")
    wide = terms.kind == "fisheye"
    names = ("k1", "k2", "k3", "k4") if wide else ("k1", "k2", "p1", "p2", "k3")
    values = dict(zip(("fx", "fy", "cx", "cy"), (terms.fx, terms.fy, terms.cx, terms.cy), strict=True))
    values |= dict(zip(names, terms.get(*names), strict=True))
    if not values.get("k3", 1):
        del values["k3"]
    width, height = named.camera.image_size
    out = f'%YAML:1.0\n---\nFile.version: "1.0"\nCamera.type: "{ORB_TYPES[wide]}"\n'
    out += "".join(f"Camera1.{n}: {number(v)}\n" for n, v in values.items())
    return out + f"Camera.width: {width}\nCamera.height: {height}\n"


ORBSLAM_FORMAT = Format(
    "orbslam",
    "an ORB-SLAM3 file",
    (".yaml", ".yml"),
    lambda source: (
        source.kind == "yaml" and ("Camera.fx" in source.mapping or "Camera1.fx" in source.mapping)
    ),
    _read_orbslam,
    _write_orbslam,
    ("opencv5", "kb4"),
    order="Camera1.fx fy cx cy k1 k2 p1 p2 [k3]; KannalaBrandt8 k1 k2 k3 k4",
    traps=("The settings of the tracker have to be added to the file that camcal writes.",),
    source="ORB-SLAM3, Calibration_Tutorial",
)

# BoofCV

BOOF = ("pinhole", "pinhole_radial_tangential")


def _read_boofcv(source: Source) -> CameraFile:
    found = source.mapping
    if found.get("model") != "stereo_camera":
        return CameraFile.one(_boofcv_camera(found))
    between = found["rightToLeft"]
    turn = floats(between["rotation"], 9, "rotation").reshape(3, 3)
    left_from_right = Pose(turn, floats([between[n] for n in "xyz"]))
    left = NamedCamera("left", _boofcv_camera(found["left"]), Pose.identity())
    return CameraFile((left, NamedCamera("right", _boofcv_camera(found["right"]), left_from_right.inverse())))


def _boofcv_camera(found: Mapping[str, Any]) -> Any:
    if found.get("model") not in BOOF:
        raise unknown("BoofCV model", found.get("model"), BOOF)
    p = found["pinhole"]
    matrix = floats([p[n] for n in ("fx", "fy", "cx", "cy", "skew")]).tolist()
    size = image_size(p["width"], p["height"])
    bend = found.get("radial_tangential") or {}
    k = floats(bend.get("radial") or [], None, "radial").tolist()
    # t1 acts on x (2 t1 x y + t2 (r² + 2 x²)) as OpenCV's p1
    return polynomial(matrix, size, k, floats([bend.get("t1", 0.0), bend.get("t2", 0.0)]).tolist())


def _write_boofcv(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, ("brown:radial=4,decentering=1+skew",), "a BoofCV file")
    width, height = named.camera.image_size
    k = terms.get("k1", "k2", "k3", "k4")
    while len(k) > 2 and not k[-1]:
        k.pop()
    p1, p2 = terms.get("p1", "p2")
    values = {"fx": terms.fx, "fy": terms.fy, "cx": terms.cx, "cy": terms.cy}
    out = "pinhole:\n" + "".join(f"  {n}: {number(v)}\n" for n, v in values.items())
    out += f"  width: {width}\n  height: {height}\n  skew: {number(terms.skew)}\nmodel: pinhole_radial_tangential\n"
    out += "radial_tangential:\n  radial:\n" + "".join(f"  - {number(v)}\n" for v in k)
    return out + f"  t1: {number(p1)}\n  t2: {number(p2)}\n"


BOOFCV_FORMAT = Format(
    "boofcv",
    "a BoofCV file",
    (".yaml",),
    lambda source: (
        source.kind == "yaml"
        and (has(source.mapping, "pinhole", "model") or source.mapping.get("model") == "stereo_camera")
    ),
    _read_boofcv,
    _write_boofcv,
    ("brown:radial=4,decentering=1+skew",),
    order="fx fy cx cy skew; radial k1 k2 ...; t1 t2 as OpenCV's p1 p2",
    traps=("A stereo file holds the pose from the right camera to the left: rightToLeft.",),
    source="BoofCV, CameraPinholeBrown and StereoParameters",
)
