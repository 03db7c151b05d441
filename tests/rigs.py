"""Simulated rigs with their truth, for the tests of everything about several cameras."""

import csv
from pathlib import Path

import numpy as np

from camcal.data.observations import Observations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.model.rig import Rig

SIZE = (640, 480)
LENS = "brown:radial=2,decentering=0"


def pose(vector, translation):
    return Pose.from_vector(np.array(vector, float), np.array(translation, float))


#: relative to the first camera, mm
PLACES = {
    "a": Pose.identity(),
    "b": pose((0.02, 0.25, 0.01), (-200, 3, 20)),
    "c": pose((-0.03, 0.5, 0.02), (-390, -5, 90)),
    "d": pose((0.1, -0.3, 0.0), (250, 10, 40)),
}


def truth(names="abc", lens=LENS):
    """A rig of up to four cameras that differ a little."""
    made = lenses.make(lens)
    cameras = {}
    for i, name in enumerate(names):
        values = {"fx": 600.0 + 5 * i, "fy": 602.0 + 4 * i, "cx": 322.0 - i, "cy": 238.0 + i}
        values |= {"k1": -0.2 + 0.02 * i} if "k1" in made.names else {}
        cameras[name] = Camera(made, made.from_values(values), SIZE)
    return Rig.in_frame_of(names[0], cameras, {n: PLACES[n] for n in names})


def board(columns=9, rows=6, square=30.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.c_[x.ravel(), y.ravel(), np.zeros(columns * rows)] * square


def observed(rig, seed=0, instants=10, noise=0.2, xyz=None, least=12):
    """Observations of a board at random poses before the first camera, and rig_from_board (V,)."""
    rng = np.random.default_rng(seed)
    xyz = board() if xyz is None else xyz
    poses = []
    for _ in range(instants):
        turn = pose(rng.uniform(-0.45, 0.45, 3), np.zeros(3))
        middle = (rng.uniform(-100, 100), rng.uniform(-70, 70), rng.uniform(750, 1000))
        poses.append(Pose(turn.rotation, middle - turn.rotation @ xyz.mean(0)))
    columns = {"xyz": [], "uv": [], "view": [], "camera": [], "point": []}
    for index, name in enumerate(rig.cameras):
        for view, place in enumerate(poses):
            uv = rig.cameras[name].project((rig.cam_from_rig[name] @ place).apply(xyz))
            seen = np.flatnonzero(((uv > 0) & (uv < np.array(SIZE) - 1)).all(1))
            uv = uv + rng.normal(0, noise, uv.shape)
            if len(seen) >= least:
                columns["xyz"].append(xyz[seen])
                columns["uv"].append(uv[seen])
                columns["view"].append(np.full(len(seen), view))
                columns["camera"].append(np.full(len(seen), index))
                columns["point"].append(seen)
    data = Observations(
        **{k: np.concatenate(v) for k, v in columns.items()},
        view_ids=tuple(str(i) for i in range(instants)),
        cameras=tuple(rig.cameras),
        image_sizes=(SIZE,) * len(rig.cameras),
    )
    return data, Poses.stack(poses)


def write_table(path, data):
    """The observations as a table with a column `camera`."""
    with Path(path).open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["camera", "view", "X", "Y", "Z", "u", "v", "id"])
        for i in range(data.point_count):
            place = data.cameras[data.camera[i]], data.view_ids[data.view[i]]
            out.writerow([*place, *data.xyz[i].tolist(), *data.uv[i].tolist(), int(data.point[i])])
    return path
